"""What a driver who goes by an estimator believes of the middle of the rear axle, and for how long.

An estimate is of the reference frame, ``ahead_m`` before the rear axle on the machine's own axis; it is some tens of
milliseconds old, or more where the estimator speaks seldom. So the axle is looked for ``ahead_m`` behind, and is taken
to have gone on since at the estimated speed (where that is NaN, at the one asked for), and to have turned as it has
been asked to.

An estimate without position or heading is none: the last one that had both is believed until it is older than
``stale_after_s``, then there is nothing to go by. Nor is there where one repeats itself for so long while the machine
is asked to move, as a receiver's does that is held through a silence. Before the first one, the machine stands where
its owner set it out.

**A-B lines.** A line that was surveyed before is where it is, whatever error a receiver has today. But who sets point A
where the machine stands lays all lines out from where the receiver has it then: its error of that moment is in every
line alike, and does no harm. With ``sets_a`` estimates are shifted by what they are off at the start, until it moves.

Whether it stands, a driver does not ask a receiver, whose speed is never quite zero: it stands when it has been asked
to.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

from twin.geometry import wrap_angle_scalar
from twin.signals import HEADING, NS_PER_S, POSITION, SPEED, Knowledge, Said, VehicleState

GOES_BY = (POSITION[0], POSITION[1], HEADING, SPEED)
"""Columns that are needed of the estimator."""
STANDING_M_S = 0.05
"""Below this, a machine stands."""


class FollowedEstimate:
    """The rear axle by one estimator.

    Args:
        estimator: its name.
        ahead_m: reference frame before the rear axle.
        stale_after_s: age up to which an estimate is believed.
        start_e_n_heading: where the middle of the rear axle stands at the beginning, m and rad.
        sets_a: whether point A is set by the estimator there.
    """

    def __init__(
        self,
        estimator: str,
        *,
        ahead_m: float,
        stale_after_s: float,
        start_e_n_heading: tuple[float, float, float],
        sets_a: bool = False,
    ) -> None:
        east, north, heading = start_e_n_heading
        self.believed = VehicleState(east_m=east, north_m=north, heading_rad=heading, speed_m_s=0.0)
        """The last there was to believe."""
        self._estimator = estimator
        self._ahead_m = ahead_m
        self._stale_ns = round(stale_after_s * NS_PER_S)
        self._start_e_n_m = east, north
        self._setting_a = sets_a
        self._off_m = (0.0, 0.0)
        """East and north, what the estimator was off when A was set."""
        self._last: Said | None = None
        self._looked_ns = self._repeated_ns = 0
        """When it was looked last, and for how long the machine has been asked to move and nothing new been said."""
        self._turned_rad = 0.0
        self._asked_turns: deque[tuple[int, float]] = deque()
        """When it was looked (ns), and by how much the machine had been asked to turn until then (rad), from the last
        look before the last estimate on."""

    def look(self, knowledge: Knowledge, asked_m_s: float) -> VehicleState | None:
        """Return where the rear axle is now, by speed ``asked_m_s`` of the machine; None where nobody knows."""
        said = knowledge.said.get(self._estimator)
        if said is not None and all(math.isfinite(said.values[column]) for column in GOES_BY[:3]):
            repeats = self._last is not None and _pose(self._last) == _pose(said)
            moves_ns = knowledge.t_ns - self._looked_ns if asked_m_s >= STANDING_M_S else 0
            self._repeated_ns = self._repeated_ns + moves_ns if repeats else 0
            self._last = said
        self._looked_ns = knowledge.t_ns
        last_ns = -1 if self._last is None else self._last.t_ns
        self._asked_turns.append((knowledge.t_ns, self._turned_rad))
        while len(self._asked_turns) > 1 and self._asked_turns[1][0] <= max(last_ns, knowledge.t_ns - self._stale_ns):
            self._asked_turns.popleft()
        stale = knowledge.t_ns - last_ns > self._stale_ns or self._repeated_ns > self._stale_ns
        if self._last is None or stale:
            return None
        told = self._now(self._last, knowledge.t_ns, asked_m_s)
        self._setting_a &= asked_m_s == 0.0
        if self._setting_a:
            self._off_m = told.east_m - self._start_e_n_m[0], told.north_m - self._start_e_n_m[1]
        self.believed = replace(told, east_m=told.east_m - self._off_m[0], north_m=told.north_m - self._off_m[1])
        return self.believed

    def turn(self, angle_rad: float) -> None:
        """Note by how much the machine has been asked to turn until the next look."""
        self._turned_rad += angle_rad

    def _now(self, said: Said, t_ns: int, asked_m_s: float) -> VehicleState:
        east, north, heading, speed = (said.values[column] for column in GOES_BY)
        if not math.isfinite(speed):
            speed = asked_m_s
        turned = self._turned_rad - self._asked_turns[0][1]
        made_m, along = speed * (t_ns - said.t_ns) / NS_PER_S, heading + 0.5 * turned
        return VehicleState(
            east_m=east - self._ahead_m * math.cos(heading) + made_m * math.cos(along),
            north_m=north - self._ahead_m * math.sin(heading) + made_m * math.sin(along),
            heading_rad=wrap_angle_scalar(heading + turned),
            speed_m_s=speed if asked_m_s >= STANDING_M_S else 0.0,
        )


def _pose(said: Said) -> tuple[float, ...]:
    return tuple(said.values[column] for column in GOES_BY[:3])
