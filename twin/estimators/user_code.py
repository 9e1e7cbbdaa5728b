"""Errors of code that a user wrote: one line that says whose they are and where, and a traceback without our frames."""

from __future__ import annotations

import contextlib
import importlib
import sysconfig
from collections.abc import Iterator
from pathlib import Path
from traceback import FrameSummary, StackSummary, TracebackException

from twin.errors import BadInputError, TwinError

_PATHS = sysconfig.get_paths()
_LIBRARIES = tuple({_PATHS[name] for name in ("stdlib", "platstdlib", "purelib", "platlib")})
_BETWEEN = (
    "<frozen importlib",
    str(Path(importlib.__file__).parent),
    contextlib.__file__,
    __file__,
    str(Path(__file__).with_name("adapter.py")),
)
"""Where the frames lie that lead from here to the user's code, or serve it."""


@contextlib.contextmanager
def blaming(what: str, but: tuple[type[Exception], ...] = ()) -> Iterator[None]:
    """Let an exception of the user's code in the block be bad input (``but`` for some): ``what`` raised it, and where.

    Raises:
        BadInputError: with the traceback of the user's code; one that the user's code raised itself passes through.
    """
    try:
        yield
    except Exception as error:
        if isinstance(error, (TwinError, *but)):
            raise
        told = TracebackException.from_exception(error)
        frames = [frame for frame in told.stack if not frame.filename.startswith(_BETWEEN)]
        said = " ".join(f"{type(error).__name__}: {error}".removesuffix(": ").split())
        told.stack = StackSummary.from_list(frames)
        trace = "".join(told.format()) if frames or isinstance(error, SyntaxError) else ""
        raise BadInputError(f"{what} raised {said}{_place(frames)}", trace=trace) from error


def _place(frames: list[FrameSummary]) -> str:
    """The last line of the user's own that was reached, not that of a library which it called."""
    own = [frame for frame in frames if not frame.filename.startswith(_LIBRARIES)]
    if not frames:
        return ""
    frame = own[-1] if own else frames[0]
    return f" at {Path(frame.filename).name}:{frame.lineno}"
