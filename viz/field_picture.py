"""A picture for a report: the field before levelling, and as each of several runs left it, in the same colours.

    python -m viz.field_picture FIELDS.png RUN_FOLDER...

The runs have to start from the same field. Each map is named after whom its blade followed.
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure

import twin
from twin.errors import BadInputError, TwinError
from twin.recording import Recording
from twin.signals import FloatArray
from viz.compose import scene_of
from viz.levelled import flatness, levelled_field
from viz.relief import FULL_M, TICKS_M, height_colours
from viz.scene import Scene


def draw_fields(recordings: Sequence[Recording], path: Path) -> None:
    """Draw the field at first, and at the end of every recording, to a PNG.

    Raises:
        BadInputError: a recording moves no soil in an area to be levelled, or starts from another field.
        OSError: the file cannot be written.
    """
    scenes = [scene_of(recording) for recording in recordings]
    maps = [("before", scenes[0], scenes[0].heights)]
    for recording, scene in zip(recordings, scenes, strict=True):
        if recording.ground is None or levelled_field(scene) is None:
            raise BadInputError(f"{recording.scenario_name}: no soil is moved there in an area to be levelled")
        if scene.levelling != scenes[0].levelling or not np.array_equal(scene.heights, scenes[0].heights):
            raise BadInputError(f"{recording.scenario_name}: this run started from another field than the first")
        last_ns = int(recording.truth.t_ns[-1])
        maps.append((_followed(recording), scene, recording.ground.heights_at(scene.heights, last_ns)))
    columns = 2 if len(maps) < 5 else 3
    rows = -(-len(maps) // columns)
    with mpl.rc_context({"font.size": 9}):
        figure = Figure(figsize=(4.6 * columns + 0.8, 3.1 * rows), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
        for axis, (name, scene, heights) in zip(axes, maps, strict=False):
            _draw_map(axis, name, scene, heights)
        for axis in axes[len(maps) :]:
            axis.set_visible(False)
        _draw_scale(figure, axes)
        figure.savefig(path, dpi=130, metadata={"Software": None})


def _followed(recording: Recording) -> str:
    """Whom the blade followed, and how careful it was."""
    implement = tomllib.loads(recording.scenario_toml).get("implement", {})
    name = str(implement.get("follows", recording.scenario_name)).replace("_", " ")
    careful = implement.get("raise_when_sigma_m")
    return name if careful is None else f"{name}, raised when sigma > {1000.0 * careful:.0f} mm"


def _draw_map(axis: Axes, name: str, scene: Scene, heights_m: FloatArray) -> None:
    field, area = levelled_field(scene), scene.levelling.area_m
    assert field is not None
    assert area is not None
    half = 0.5 * field.pitch_m
    extent = (field.east_m[0] - half, field.east_m[-1] + half, field.north_m[0] - half, field.north_m[-1] + half)
    image = height_colours(field.picked(heights_m) - field.design_height_m)
    axis.imshow(image, origin="lower", extent=extent, interpolation="nearest")
    west, south, east, north = area
    axis.plot([west, east, east, west, west], [south, south, north, north, south], color="k", linewidth=1.0)
    spread, share = flatness(scene, heights_m)
    axis.set_title(f"{name}\n$S_d$ {1000.0 * spread:.1f} mm, {100.0 * share:.0f} % within 30 mm", fontsize=9)
    axis.set_xlabel("east [m]")
    axis.set_ylabel("north [m]")


def _draw_scale(figure: Figure, axes: Sequence[Axes]) -> None:
    """One scale of colours for all maps."""
    levels = np.linspace(-FULL_M, FULL_M, 401)
    colours = ListedColormap(height_colours(levels) / 255.0)
    norm = Normalize(-1000.0 * FULL_M, 1000.0 * FULL_M)
    mappable = ScalarMappable(norm=norm, cmap=colours)
    bar = figure.colorbar(mappable, ax=list(axes), shrink=0.8, label="height above the design plane [mm]")
    bar.set_ticks([1000.0 * tick for tick in reversed(TICKS_M)])


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m viz.field_picture", description="The field before levelling and after each of several runs."
    )
    parser.add_argument("picture", type=Path, help="the .png to write")
    parser.add_argument("runs", type=Path, nargs="+", help="run folders")
    given = parser.parse_args(arguments)
    try:
        draw_fields([twin.open(folder) for folder in given.runs], given.picture)
    except (TwinError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
