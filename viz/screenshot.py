"""Pictures of a recording as a person would see it, without a display.

    python -m viz.screenshot RUN.rrd FOLDER --at 5 35 60 --views

Writes ``whole_<t>.png`` and, with ``--views``, ``<view>_<t>.png`` for every view that is not in a hidden tab.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from twin.errors import TwinError
from viz.viewer import headless_viewer


def take_screenshots(
    rrd: Path, folder: Path, times_s: Sequence[float], *, views: bool = False, size: str = "1600x900"
) -> list[Path]:
    """Take pictures of the whole window, and of single views, at the given times; return the files.

    Raises:
        BadInputError: there is no such recording.
        TwinError: the viewer cannot start, or its picture does not come to rest.
        OSError: the pictures cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    with headless_viewer(rrd, size=size) as viewer:

        def take(name: str, t_s: float, view_id: str | None) -> None:
            path = folder / f"{re.sub(r'[^A-Za-z0-9]+', '_', name).strip('_')}_{t_s:07.2f}.png"
            viewer.seek(t_s)
            path.write_bytes(viewer.screenshot(view_id))
            written.append(path)

        for t_s in times_s:
            take("whole", t_s, None)
        # Only now: asking for a hidden view puts a notice over the window.
        shown = [(name, view) for name, view in viewer.views.items() if views and viewer.is_visible(view)]
        for t_s in times_s:
            for name, view in shown:
                take(name, t_s, view)
        for complaint in viewer.complaints:
            print(f"viewer: {complaint}", file=sys.stderr)
    return written


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m viz.screenshot", description="Pictures of a recording, without a display."
    )
    parser.add_argument("rrd", type=Path, help="a .rrd file or a run folder")
    parser.add_argument("folder", type=Path, help="where the pictures go")
    parser.add_argument("--at", type=float, nargs="+", default=[0.0], metavar="T", help="times, s")
    parser.add_argument("--size", default="1600x900", help="of the window, pixels")
    parser.add_argument("--views", action="store_true", help="one picture per view as well")
    given = parser.parse_args(arguments)
    try:
        pictures = take_screenshots(given.rrd, given.folder, given.at, views=given.views, size=given.size)
    except (TwinError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    for picture in pictures:
        print(picture)
    return 0


if __name__ == "__main__":
    sys.exit(main())
