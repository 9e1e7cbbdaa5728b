"""The surface just passed as an aid of the height filter: the rear axle comes by where the own blade has cut.

A blade that cuts leaves the ground as high as its edge, and how high that was the filter knew then. When the machine
comes along the same line again, either way, its rear wheels stand on it. With the stroke s, the attitude and the lever
from the implement's AHRS to the ground below the rear axle, whose height above the AHRS is l,

    edge's height then = h + l + o + m + w

h is the height of the AHRS now; o how much deeper the wheels stand than the blade cut, which goes with moisture, less
what soil was spilled there since, with whatever offset stroke and attitude have; m the error that the fix had when the
ground was cut; w white.

**Did it cut?** The filter knows how high the wheels stood just before the edge came there. Where they stood more than
5 mm above the edge, the edge cut. Elsewhere it only fills what its load suffices for.

**Errors.** o and m are states. m goes on along a pass as the fix's error does in time, and begins anew with every other
pass. It has to do with the fix's error now the less, the longer ago the
pass was: with a correlation rho its variance is taken (1 + rho) / (1 - rho) times as large, so that the mean of both is
not believed more than it is worth. w is learnt from what innovations are more than the filter expects while fixes are
used, from samples so far apart that they have nothing to do with one another.

**Measured** in the second round of ``scraper_levelling``, the lever known: all along the lanes the axle's height is
that of the edge in the first round less 4 mm, with 12 mm of spread that is another after 1 to 2 s (one world). Where
the edge surely cut, two fifths of the way, the spread within a lane is 2 to 6 mm, about a mean that is the fix's
error then and now; in one of ten lanes, where soil was spilled later, 19 mm (two worlds). In a loss of 120 s of that
round (``scraper_levelling_loss_again``), filters over the same recordings of four worlds: sigma 28, 60 and 100 s
after the last fix 22, 17 and 18 mm, without the aid 32, 51 and 78 (28 s is in a headland, where nothing can be read);
RMS error in the loss 16 mm, without 50.

Where it is, level, the filter reckons from the last fix by the receiver's level velocity; without that the aid is
silent. It needs to follow the attitude error too (:mod:`twin.estimators.height_filter_tilt`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from twin.errors import BadInputError
from twin.estimators.engines import Engine
from twin.estimators.height_filter_kernels import REST, TILT
from twin.estimators.height_filter_levers import Lever
from twin.estimators.height_filter_model import H, Layout, SlowError, SumOfStates, renew_state
from twin.estimators.height_filter_receiver import FixReading
from twin.estimators.height_filter_surface_map import POINT, SPACING_M, SurfaceMap
from twin.estimators.height_filter_tracks import Track
from twin.estimators.roles import column_places
from twin.signals import NS_PER_S, BoolArray, EstimatorSetup, FloatArray, IntArray, Measurement, SensorInfo

DIFFERENCE = SlowError(sigma=0.01, correlation_s=30.0)
"""How much lower or higher wheels stand than the blade cut: a centimetre that is another in thirty metres; a choice."""
_CUT_M = 0.005
"""So much higher than the edge the wheels stood where it surely cut."""
_RAISED_M = -0.10
"""An edge so much above the ground leaves it as it is."""
_KNOWN_M = 0.02
"""Nobody needs ground that was known no better when it was cut, 1 sigma."""
_APART_M = 1.5
"""Readings so far apart err each for itself: a wheel's chord and the waves of the lift are shorter; a choice."""
_ROUGH_M, _LEAST_M = 0.01, 0.004
"""White error before any was learnt, and the least that is believed, 1 sigma; choices."""
_LEARNT, _GUESSED = 40.0, 8.0
"""Of how many samples the noise is learnt, and how many the first guess counts for."""
_USUAL_SIGMAS = 1.345
"""What is farther off is believed less: Huber's usual choice, which costs 5 % where all errors are normal."""
_SLOWEST_M_S = 0.3
_FARTHEST_M = 200.0
"""So far from the last fix its place is known well enough."""
_LONGEST_GAP_NS = 350_000_000
_ANOTHER_PASS_NS = 5_000_000_000
_NEVER = -(2**62)


@dataclass(frozen=True, slots=True)
class SurfaceState:
    """What the aid remembers of R members beside its map. Arrays are replaced, never changed in place."""

    t_ns: int
    """The last reading of the receiver."""
    place_m: FloatArray
    """(2, R) of the AHRS; NaN where it is not known."""
    velocity_m_s: FloatArray
    """(2, R) level."""
    astray_m: FloatArray
    """(R,) travelled since the last fix."""
    since_point_m: FloatArray
    """(R,) travelled since the last point of the map."""
    since_read_m: FloatArray
    """(R,) travelled since the ground was last read."""
    read_ns: IntArray
    """(R,) when the ground read last was cut."""
    valid_ns: IntArray
    """(R,) what was cut before is not believed any more."""
    waiting: tuple[tuple[int, FloatArray, BoolArray], ...]
    """Points that are not in the map yet: time, (R, 6), whose."""
    rough_m2: FloatArray
    """(R,) variance of the white error."""
    learnt: FloatArray
    """(R,) of how many samples it is."""


@dataclass(frozen=True, slots=True)
class Ground:
    """What the aid says of R members at one time."""

    known: BoolArray
    height_m: FloatArray
    """Of the AHRS, with the errors o and m in it."""
    variance: FloatArray
    """White."""
    then_variance: FloatArray
    """Of m."""
    cut_ns: IntArray
    """When the ground was cut."""


class SurfaceAid:
    """Remembers what the blade cut, and reads it with the rear axle.

    Args:
        stroke: transducer of the slide.
        blade: the filter's own AHRS.
        setup: with the place of the reference point, which is taken for the middle of the edge.
        fix: the correlated error of fixes, m.
        later_s: no sample comes so late.

    Raises:
        BadInputError: a column is missing, the implement is not behind the rear axle, or the AHRS is turned on its
            mount.
    """

    def __init__(
        self, stroke: SensorInfo, blade: SensorInfo, setup: EstimatorSetup, *, fix: SlowError, later_s: float
    ) -> None:
        if setup.reference_x_m >= 0.0:
            raise BadInputError(f"[estimators.{setup.name}] surface: the implement is not behind the rear axle")
        if any(blade.mount.rpy_rad):
            raise BadInputError(f"[estimators.{setup.name}] surface: {blade.name!r} is turned on its mount")
        runs = setup.runs
        self._behind_m = -setup.reference_x_m
        self._edge = Lever.between(blade, setup.reference, setup)
        self._fix, self._later_ns = fix, round((later_s + 1.0) * NS_PER_S)

        def track(rows: int, rate_hz: float, kept_s: float) -> Track:
            gap_ns = _LONGEST_GAP_NS if rate_hz == 0.0 else round(2.5 * NS_PER_S / rate_hz)
            return Track(rows, runs=runs, kept_ns=round(kept_s * NS_PER_S), longest_gap_ns=gap_ns)

        self._heard = {
            stroke.name: (column_places(stroke, ("displacement_m",), setup=setup), track(1, stroke.rate_hz, 3.0)),
            blade.name: (
                column_places(blade, ("roll_rad", "pitch_rad", "heading_rad"), setup=setup),
                track(4, blade.rate_hz, 3.0),
            ),
        }
        self._stroke, self._blade = self._heard[stroke.name][1], self._heard[blade.name][1]
        self._blade_name = blade.name
        self._stood = track(1, 0.0, self._behind_m / _SLOWEST_M_S + 2.0)
        """Height of the ground below the rear axle."""
        self._map = SurfaceMap(runs)
        self._kept_ns = _NEVER
        """Points up to then are in the map."""
        never, zero, nothing = np.full(runs, _NEVER, dtype=np.int64), np.zeros(runs), np.full((2, runs), np.nan)
        self.state = SurfaceState(
            _NEVER, nothing, nothing, zero, zero, zero, never, never, (), np.full(runs, _ROUGH_M**2), zero
        )
        self._attitude: FloatArray = np.full((4, runs), np.nan)
        self._axle: FloatArray = np.full(runs, np.nan)

    def hear(self, measurement: Measurement) -> None:
        """Take a sample of one of the two sensors."""
        places, track = self._heard[measurement.sensor]
        values = np.where(measurement.valid[:, np.newaxis], measurement.values[:, places], np.nan).T
        if measurement.sensor == self._blade_name:
            values = np.concatenate([values[:2], np.cos(values[2:]), np.sin(values[2:])])
        track.push(min(measurement.t_ns, measurement.t_available_ns), values)

    def restore(self, state: SurfaceState) -> None:
        """Go back to what was known."""
        self.state = state
        self._stood.forget_after(state.t_ns)

    def forget(self, members: BoolArray) -> None:
        """What the map of some members rests on has turned out to be wrong."""
        self.state = replace(self.state, valid_ns=np.where(members, self.state.t_ns, self.state.valid_ns))

    # --- where it is -------------------------------------------------------------------------------------------------

    def follow(self, reading: FixReading, antenna_m: FloatArray, behind_m_s: FloatArray) -> None:
        """Take place and level velocity at the time of a sample of the receiver.

        ``antenna_m`` (2 or more, R) is where the antenna is, seen from the AHRS; ``behind_m_s`` (2 or more, R) how much
        slower the receiver's velocity is than the AHRS.
        """
        state, t_ns = self.state, reading.t_ns
        span_s = (t_ns - state.t_ns) / NS_PER_S
        velocity = np.where(reading.level_known, reading.level_m_s + behind_m_s[:2], np.nan)
        short = 0 < t_ns - state.t_ns <= _LONGEST_GAP_NS
        moved = 0.5 * span_s * (state.velocity_m_s + velocity) if short else np.full_like(velocity, np.nan)
        placed = reading.placed
        step = np.where(np.isfinite(moved[0]), np.hypot(*moved), 0.0)
        self.state = replace(
            state,
            t_ns=t_ns,
            place_m=np.where(placed, reading.place_m - antenna_m[:2], state.place_m + moved),
            velocity_m_s=velocity,
            astray_m=np.where(placed, 0.0, state.astray_m + step),
            since_point_m=state.since_point_m + step,
            since_read_m=state.since_read_m + step,
        )

    def _axle_below(self, lean: FloatArray) -> FloatArray:
        """(R,) how far the ground under the rear axle is above the AHRS, o left out."""
        now = np.full(lean.shape[1], self.state.t_ns, dtype=np.int64)
        self._attitude = self._blade.linear(now)
        roll, pitch = self._attitude[0] - lean[TILT + 1], self._attitude[1] + lean[TILT]
        forward, _, down = self._edge.xyz_m
        down = down - self._stroke.linear(now)[0]
        above: FloatArray = np.cos(pitch) * np.cos(roll) * down - np.sin(pitch) * (forward + self._behind_m)
        return above

    # --- reading -----------------------------------------------------------------------------------------------------

    def read(self, lean: FloatArray) -> Ground:
        """What the ground under the rear axle says; ``lean`` (13, R) is known of the tilt."""
        state = self.state
        self._axle = self._axle_below(lean)
        self._keep()
        due = (state.since_read_m >= _APART_M) & (state.astray_m <= _FARTHEST_M) & np.isfinite(self._axle)
        due &= np.isfinite(state.place_m[0])
        nothing = np.zeros(len(due))
        if not due.any():
            return Ground(due, nothing, nothing, nothing, state.read_ns)
        direction = self._attitude[2:]
        ahead = self._edge.xyz_m[0] + self._behind_m
        place = np.where(due, state.place_m + ahead * direction, np.nan)
        height, variance, age_s = self._map.find(state.t_ns, place, direction, state.valid_ns)
        known = np.isfinite(height)
        alike = np.exp(-np.where(known, age_s, 1.0) / self._fix.correlation_s)
        cut_ns = state.t_ns - np.round(np.where(known, age_s, 0.0) * NS_PER_S).astype(np.int64)
        self.state = replace(state, since_read_m=np.where(known, 0.0, state.since_read_m))
        return Ground(
            known=known,
            height_m=np.where(known, height - self._axle, 0.0),
            variance=state.rough_m2 + ahead**2 * lean[REST],
            then_variance=np.where(known, variance, 1.0) * (1.0 + alike) / (1.0 - alike),
            cut_ns=np.where(known, cut_ns, state.read_ns),
        )

    def begin(self, branches: Iterable[Engine], ground: Ground, layout: Layout) -> None:
        """Begin m anew in all branches where another pass is read than before."""
        assert layout.surface is not None
        another = ground.known & (np.abs(ground.cut_ns - self.state.read_ns) > _ANOTHER_PASS_NS)
        if another.any():
            for branch in branches:
                renew_state(branch, layout.surface + 1, another, np.zeros(len(another)), ground.then_variance)
        self.state = replace(self.state, read_ns=ground.cut_ns)

    @staticmethod
    def observe(ground: Ground, layout: Layout) -> SumOfStates:
        """The height as the filter sees it."""
        assert layout.surface is not None
        return SumOfStates({H: 1.0, layout.surface: 1.0, layout.surface + 1: 1.0}, ground.variance, size=layout.size)

    @staticmethod
    def believed(ground: Ground, y: FloatArray, S: FloatArray) -> FloatArray:
        """(R, 1) white variance by what an innovation (R,) says: spilled soil may lie on what was cut (Huber)."""
        return (ground.variance * np.maximum(np.abs(y) / (_USUAL_SIGMAS * np.sqrt(S)), 1.0))[:, np.newaxis]

    def learn(self, ground: Ground, y: FloatArray, S: FloatArray, tracking: BoolArray) -> None:
        """Learn the noise from an innovation (R,) and its expected variance where fixes are used."""
        rough, news = self.state.rough_m2, ground.known & tracking
        beyond = np.minimum(np.square(y), 9.0 * S) - (S - rough)
        count = self.state.learnt + news
        learnt = np.maximum(rough + (beyond - rough) / np.minimum(count + _GUESSED, _LEARNT), _LEAST_M**2)
        self.state = replace(self.state, rough_m2=np.where(news, learnt, rough), learnt=count)

    # --- writing -----------------------------------------------------------------------------------------------------

    def write(self, x: FloatArray, P: FloatArray, layout: Layout, tracking: BoolArray) -> None:
        """Remember what the edge leaves, by the state (R, n) now and its covariance; as void while no fix is used."""
        assert layout.surface is not None
        state, height, variance = self.state, x[:, H], P[:, H, H]
        stood = height + self._axle + x[:, layout.surface]
        self._stood.push(state.t_ns, stood[np.newaxis])
        speed = np.hypot(*state.velocity_m_s)
        moving = (speed >= _SLOWEST_M_S) & (state.since_point_m >= SPACING_M) & np.isfinite(state.place_m[0])
        if not moving.any():
            return
        behind_ns = np.round(self._behind_m / np.where(moving, speed, 1.0) * NS_PER_S).astype(np.int64)
        before = self._stood.linear(state.t_ns - behind_ns)[0]
        edge = height + self._edge.height(self._attitude[:3])
        above = before - edge
        put = moving & ~(above < _RAISED_M) & np.isfinite(edge)
        if not put.any():
            return
        sure = tracking & (above > _CUT_M) & (variance < _KNOWN_M**2)
        points = np.empty((len(put), POINT))
        points[:, :2] = (state.place_m + self._edge.xyz_m[0] * self._attitude[2:]).T
        points[:, 2:4] = self._attitude[2:].T
        points[:, 4], points[:, 5] = np.where(sure, edge, np.nan), variance
        self.state = replace(
            state,
            since_point_m=np.where(put, 0.0, state.since_point_m),
            waiting=(*state.waiting, (state.t_ns, points, put)),
        )

    def _keep(self) -> None:
        """Put into the map what nothing late can change any more."""
        until_ns, waiting = self.state.t_ns - self._later_ns, self.state.waiting
        if not waiting or waiting[0][0] > until_ns:
            return
        for t_ns, points, members in waiting:
            if self._kept_ns < t_ns <= until_ns:
                self._map.add(t_ns, points, members)
                self._kept_ns = t_ns
        self.state = replace(self.state, waiting=tuple(each for each in waiting if each[0] > until_ns))
