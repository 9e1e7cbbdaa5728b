"""Ctrl-C and SIGTERM, wherever they come.

An exception cannot pass through every piece of C: while a module is imported or a kernel made or loaded, a
``KeyboardInterrupt`` may come out as another exception, or not at all. There it waits until that is done.
"""

from __future__ import annotations

import signal
import threading
from types import FrameType

_NOT_WITHIN = ("importlib", "llvmlite", "numba")
_RETRY_S = 0.05
_raised = threading.Event()


def listen() -> None:
    """Turn signals to end into ``KeyboardInterrupt``, but for those that whoever started the process ignores."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)


def interrupted() -> bool:
    """Whether such a signal has come, and whatever ends the process now comes of it."""
    return _raised.is_set()


def _interrupt(number: int, frame: FrameType | None) -> None:
    if _within(frame):
        again = threading.Timer(_RETRY_S, signal.pthread_kill, [threading.get_ident(), number])
        again.daemon = True
        again.start()
        return
    _raised.set()
    raise KeyboardInterrupt


def _within(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_globals.get("__name__", "").partition(".")[0] in _NOT_WITHIN:
            return True
        frame = frame.f_back
    return False
