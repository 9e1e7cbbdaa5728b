"""The exceptions a user can meet, with one root."""

from __future__ import annotations


class TwinError(Exception):
    """Root of every exception this package raises on purpose."""


class BadInputError(TwinError):
    """Something the user gave cannot be used: the message names file, key, what was given and what is allowed.

    The command line turns it into exit code 2, without a traceback but that of the user's own code, where that failed.
    """

    def __init__(self, message: str, *, trace: str = "") -> None:
        super().__init__(message)
        self.trace = trace

    def within(self, where: str) -> BadInputError:
        """The same with the name of what it lies in before the message."""
        return BadInputError(f"{where}: {self}", trace=self.trace)


class WorldEndedError(TwinError):
    """The machine can no longer go on (tipped over, left the terrain).

    The run ends with ``reason`` as its end and the verdict ``error``; what was recorded until then is kept.
    """

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason
