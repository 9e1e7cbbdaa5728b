"""Distances to the trees of a lane, by threshold and window (kind ``tree_distances``): paper 001, chapter 5.

The machine starts between trees 1 and 2, with trees 3 and 4 ahead, all at known places. In every scan each tree is
looked for around its last angle (first: around the known one), and found where a distance repeats itself within
+-5 cm at other beams within +-10 degrees. As the machine passes, a tree moves backwards: only angles behind the last
one, by up to 10 degrees, are looked at. When L1 or L2 exceeds 0.5 m, trees 3 and 4 take over (eqs 70 and 71).

**The paper's angles.** "Tree 1 at 270 degrees, then at smaller angles; tree 2 at angles greater than 180": the latter
can only be a slip for 90, where the tree across from tree 1 stands. If angles went counter-clockwise, as a ROS scan's
do, tree 1 would be on the right, and eq 70, V = K (L1 - L2) with V positive to the left, would turn the machine away
from the middle: left of the axis L1 is the longer, V > 0 turns further left. Clockwise, tree 1 is on the left,
moves backwards with smaller angles as the paper says, and eq 70 turns back. So tree 1 (and 3) is taken to be on the
left, at +90 degrees in the twin's counter-clockwise bearings, tree 2 (and 4) on the right.

**Other gaps.** At 0.4 m a trunk of 5 cm fills +-6 degrees, so not all beams of +-10 can repeat a distance; three have
to. A "threshold distance" is read as the known distance, give or take ``threshold_m``; of several things in the window
the one nearest to the last distance is taken. A tree that is not found has no
distance (NaN) and is looked for at the same place again; after ``lost_after_scans`` it is lost for good. What comes
after tree 4 is not in the paper: it is lost. With ``repeat_spacing_m``, **an extension**, the next pair is looked for
that much ahead of the present one, and takes over when the present one has been passed.

Every beam is taken for one of now: nothing is done about the turn of 0.2 s in which the machine moves on. The left is
seen before the right, by (1 - b / pi) T of a turn T for a pair ahead at the angle b, so L1 is too long by
v cos(b) (1 - b / pi) T: 7.7 cm at 0.5 m/s and 25 degrees.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, Strict

from twin.config import Config, Names, Positive
from twin.estimators.lidar_scan import LIDAR, ranges_of, the_lidar
from twin.estimators.roles import pick_sensors
from twin.geometry import wrap_angle
from twin.signals import NS_PER_S, BoolArray, Estimate, EstimatorSetup, FloatArray, IntArray, Measurement

KIND = "tree_distances"
TREES = 4
_PAIR = 2
_SLOTS = 6
"""Trees 1 to 4, and the pair after them where the extension is used."""
_SIDE: FloatArray = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
_SLACK_RAD = np.deg2rad(1.5)
_FRESH_PERIODS = 2.0
DISTANCES = tuple(f"tree_{tree + 1}_m" for tree in range(TREES))
PAIR = "pair"


class TreePlace(Config):
    """Where a tree is seen from the lidar at the start."""

    bearing_deg: Annotated[float, Field(ge=-180.0, le=180.0)]
    """Counter-clockwise from ahead."""
    distance_m: Positive
    """To its bark."""


class TreeDistancesConfig(Config):
    """Options of :class:`TreeDistances`."""

    kind: Literal["tree_distances"]
    sensors: Names
    """The lidar."""
    rate_hz: Positive = 50.0
    """Output rate."""
    layout: Annotated[tuple[TreePlace, TreePlace, TreePlace, TreePlace], Strict(strict=False)]
    """Trees 1 (left), 2 (right), 3 (ahead left), 4 (ahead right) from where the lidar is at the start."""
    threshold_m: Positive = 0.1
    """How far a tree may be from its known distance at first; a choice."""
    jump_m: Positive = 0.25
    """How far a tree may be from its last distance: farther off it is another one; a choice."""
    window_deg: Annotated[float, Field(gt=0.0, le=45.0)] = 10.0
    """Angle within which a distance has to repeat itself, either way."""
    repeat_m: Positive = 0.05
    """To within which it has to."""
    min_beams: Annotated[int, Field(ge=2, le=50)] = 3
    """Beams that repeat it, its own included; a choice."""
    passed_m: Positive = 0.5
    """Distance of tree 1 or 2 at which trees 3 and 4 take over."""
    lost_after_scans: Annotated[int, Field(ge=1, le=1000)] = 5
    """Scans without a tree after which it is lost; a choice."""
    repeat_spacing_m: Positive | None = None
    """Extension: distance from pair to pair, to go on beyond tree 4."""


class TreeDistances:
    """Estimator of :class:`TreeDistancesConfig`.

    Columns: ``tree_1_m`` to ``tree_4_m``, distances in the last scan (NaN where not found), their bearings
    ``tree_1_bearing_rad`` and so on, and ``pair``: 1 where trees 1 and 2 steer, 2 where 3 and 4 do, 0 where one of
    those that should was not found.

    Raises:
        BadInputError: not exactly one lidar, or a sensor of another kind.
    """

    state_columns: tuple[str, ...] = ()

    def __init__(self, config: TreeDistancesConfig, setup: EstimatorSetup) -> None:
        self._sheet = the_lidar(setup, pick_sensors(setup, (LIDAR,), estimator=KIND)[LIDAR], kind=KIND)
        self._config, self._runs = config, setup.runs
        bearings = tuple(f"tree_{tree + 1}_bearing_rad" for tree in range(TREES))
        self.columns: tuple[str, ...] = (*DISTANCES, *bearings, PAIR)
        shape = (setup.runs, _SLOTS)
        self._bearing: FloatArray = np.zeros(shape)
        self._distance: FloatArray = np.zeros(shape)
        for slot, place in enumerate(config.layout):
            self._bearing[:, slot] = np.deg2rad(place.bearing_deg)
            self._distance[:, slot] = place.distance_m
        self._tracked: BoolArray = np.zeros(shape, dtype=np.bool_)
        self._found: BoolArray = np.zeros(shape, dtype=np.bool_)
        self._missed: IntArray = np.zeros(shape, dtype=np.int64)
        self._wanted: BoolArray = np.tile(np.arange(_SLOTS) < TREES, (setup.runs, 1))
        """Looked for at all: not those that are lost, nor a next pair of which nobody knows where it should be."""
        self._ahead: BoolArray = np.zeros(setup.runs, dtype=np.bool_)
        """Whether trees 3 and 4 have taken over."""
        self._scan_ns: int | None = None

    # --- in ----------------------------------------------------------------------------------------------------------

    def process(self, measurement: Measurement) -> None:
        """Take one scan, in order of arrival; an older one than the last is dropped."""
        if self._scan_ns is not None and measurement.t_ns <= self._scan_ns:
            return
        self._scan_ns = measurement.t_ns
        if self._config.repeat_spacing_m is not None:
            self._expect_next(self._config.repeat_spacing_m)
        self._search(ranges_of(measurement))
        self._take_over()

    def _search(self, ranges: FloatArray) -> None:
        """Find every tree that is looked for in ranges (R, n)."""
        config = self._config
        count, distance, bearing = self._repeated(ranges)
        repeated = (count >= config.min_beams)[:, np.newaxis, :]
        window = np.deg2rad(config.window_deg)
        turned = wrap_angle(self._sheet.bearings_rad - self._bearing[..., np.newaxis])  # (R, slots, n)
        behind = _SIDE[:, np.newaxis] * turned
        inside = (behind <= window) & (behind >= np.where(self._tracked, -_SLACK_RAD, -window)[..., np.newaxis])
        jump = np.abs(distance[:, np.newaxis, :] - self._distance[..., np.newaxis])
        inside &= jump <= np.where(self._tracked, config.jump_m, config.threshold_m)[..., np.newaxis]
        candidates = np.where(inside & repeated, jump, np.inf)
        best = np.argmin(candidates, axis=-1)  # (R, slots)
        members = np.arange(self._runs)[:, np.newaxis]
        self._found = self._wanted & np.isfinite(candidates[members, np.arange(_SLOTS), best])
        self._distance = np.where(self._found, distance[members, best], self._distance)
        self._bearing = np.where(self._found, wrap_angle(bearing[members, best]), self._bearing)
        self._missed = np.where(self._found, 0, self._missed + 1)
        lost = self._missed >= config.lost_after_scans
        self._wanted = self._wanted & ~(self._tracked & lost)
        self._tracked = (self._tracked | self._found) & ~lost

    def _repeated(self, ranges: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """For each beam (R, n): how many within the window repeat its distance, their mean distance and bearing."""
        reach = int(np.deg2rad(self._config.window_deg) / self._sheet.spacing_rad + 0.5)
        count, total, shift = (np.zeros_like(ranges) for _ in range(3))
        for step in range(-reach, reach + 1):
            other = np.roll(ranges, -step, axis=1)
            same = np.abs(other - ranges) <= self._config.repeat_m  # NaN repeats nothing
            count += same
            total += np.where(same, other, 0.0)
            shift += step * same
        some = np.maximum(count, 1.0)
        return count, total / some, self._sheet.bearings_rad + self._sheet.spacing_rad * shift / some

    def _take_over(self) -> None:
        """Eq 71 after eq 70; with the extension, the next pair after the present one."""
        beyond = self._found & (self._distance > self._config.passed_m)
        self._ahead = self._ahead | beyond[:, :_PAIR].any(axis=1)
        if self._config.repeat_spacing_m is None:
            return
        behind = np.abs(self._bearing) > 0.5 * np.pi
        present, following = slice(_PAIR, TREES), slice(TREES, _SLOTS)
        passed = (beyond & behind)[:, present].any(axis=1)
        gone = ~self._tracked[:, present].any(axis=1) & self._tracked[:, following].any(axis=1)
        shift = (self._ahead & (passed | gone))[:, np.newaxis]
        for state in (self._bearing, self._distance, self._tracked, self._found, self._missed):
            state[:, present] = np.where(shift, state[:, following], state[:, present])
        self._tracked[:, following] &= ~shift
        self._found[:, following] &= ~shift
        self._missed[:, following] = np.where(shift, 0, self._missed[:, following])
        self._wanted[:, present] |= shift

    def _expect_next(self, spacing_m: float) -> None:
        """Say where the pair after the present one should be: ahead of it, or of the tree across from it."""
        for side in range(_PAIR):
            own, across, slot = _PAIR + side, TREES - 1 - side, TREES + side
            by_own = self._tracked[:, own]
            source = np.where(by_own, own, across)
            members = np.arange(self._runs)
            bearing = self._bearing[members, source] * np.where(by_own, 1.0, -1.0)
            distance = self._distance[members, source]
            x, y = spacing_m + distance * np.cos(bearing), distance * np.sin(bearing)
            known = self._tracked[members, source]
            anew = known & ~self._tracked[:, slot]
            self._bearing[:, slot] = np.where(anew, np.arctan2(y, x), self._bearing[:, slot])
            self._distance[:, slot] = np.where(anew, np.hypot(x, y), self._distance[:, slot])
            self._wanted[:, slot] = known | self._tracked[:, slot]

    # --- out ---------------------------------------------------------------------------------------------------------

    def estimate(self, t_ns: int) -> Estimate:
        """Return the distances of the last scan; none where it is two turns old."""
        limit_ns = _FRESH_PERIODS * self._sheet.period_s * NS_PER_S
        fresh = self._scan_ns is not None and t_ns - self._scan_ns <= limit_ns
        found = self._found[:, :TREES] & fresh
        distance = np.where(found, self._distance[:, :TREES], np.nan)
        bearing = np.where(found, self._bearing[:, :TREES], np.nan)
        first, second = found[:, :_PAIR].all(axis=1), found[:, _PAIR:].all(axis=1)
        pair = np.where(self._ahead, 2.0 * second, 1.0 * first)
        values = np.column_stack([distance, bearing, pair])
        return Estimate(t_ns=t_ns, values=values, sigmas=np.full(values.shape, np.nan))
