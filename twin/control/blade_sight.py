"""What the one on the seat sees of the blade's load: in quarters of what it holds, and half a second late.

Nobody measures the load of a blade; whoever sits in front of it looks round now and then. Both figures are choices: a
glance over the shoulder, and a heap whose height is told by eye.
"""

from __future__ import annotations

from collections import deque

_STEPS = 4
_LATE_S = 0.5


class BladeSight:
    """Looks at the blade every ``interval_s``."""

    def __init__(self, *, interval_s: float) -> None:
        self._seen: deque[float] = deque([0.0] * round(_LATE_S / interval_s))

    def look(self, load_share: float) -> float:
        """Return how full the blade seems, from how full it is now: the soil it carries over the most it holds."""
        self._seen.append(round(_STEPS * load_share) / _STEPS)
        return self._seen.popleft()
