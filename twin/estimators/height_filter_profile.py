"""The ground's profile as an aid of the height filter: the rear axle passes where the front axle has passed.

With L the wheelbase, v the speed, tau = L / v and theta the carrier's pitch (positive nose down), the front axle stands
L sin(theta) lower than the rear one, and the rear one stands where the front one stood at a time tau later:

    z_rear(t) - z_rear(t - tau) = -L sin(theta(t - tau))

The implement's AHRS sits x before the rear axle (x < 0) on a slide with the stroke s, so that it has risen by

    -L sin(theta(t - tau)) - x [sin(theta(t)) - sin(theta(t - tau))] + s(t) - s(t - tau)

which over tau is its mean vertical speed. Its speed now is more by what its acceleration made of it within tau, which
the filter's own integrals tell, but for half of tau times the accelerometer's bias.

**Error budget**, at 1 m/s with L = 1.1 m. The attitude error e of the carrier's AHRS (0.3 degrees, first-order
Gauss-Markov of 20 s) counts as v e: 5 mm/s that last for 20 s, which is 0.12 m after 28 s and 0.21 m after 60 s. The
receiver's vertical speed (2 mm/s for 60 s) makes 0.05 m and 0.10 m of it. So the aid by itself is worth something only
to a filter without vertical speed, if e is a state: what is learnt of it with RTK is forgotten after 20 s.
But the filter learns its own AHRS's attitude error from the receiver's level velocity
(:mod:`twin.estimators.height_filter_tilt`), all but a constant (the accelerometer's offset against gravity). On a
straight slide both AHRS have one pitch but for a constant, so their difference tells e but for a constant, and
constants are learnt with RTK in full. What is left is white: the tyres (2 mm in each tau on a paddy bottom of
645e-6 m3, so 2 mm times the square root of 28 or 60 taus: 11 mm and 15 mm), the tilt's rest (about 1 mrad for a second:
another 1 mm in each), and the trim: how much deeper the rear wheels stand than the front ones. A trim that changes by
0.5 mrad in a minute costs 15 mm in a minute.

**The surface just passed** is another aid (:mod:`twin.estimators.height_filter_surface`): it bounds the error for as
long as a loss lasts, where this one's grows with the square root of time, but only where the machine comes along a line
that its own blade has cut before.

**Worth** on that field with paper 002's receiver, 28 s and 60 s after corrections stopped (fixes go on for 10 s), sigma
and RMS error in mm of 100 members in 4 worlds: with everything 27 and 48 (26, 45); without vertical speed 30 and 55
(29, 58); without this aid 41 and 86 (43, 87); without both 76 and 294 (67, 246); without tilt 40 and 78 (41, 85).

White noise is learnt from what the aid's innovations are more than the filter expects while fixes are used. The
receiver gives the speed, so the aid is silent in a total outage. A stroke beyond the transducer's range, as of a raised
blade, is left to the gate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twin.errors import BadInputError
from twin.estimators.engines import Engine
from twin.estimators.height_filter_kernels import GAIN_H, GAIN_V, LASTING, REST, TILT
from twin.estimators.height_filter_model import B0, B1, Layout, SlowError, SumOfStates, V
from twin.estimators.height_filter_receiver import FixReading
from twin.estimators.height_filter_tracks import Track
from twin.estimators.roles import column_places
from twin.signals import NS_PER_S, BoolArray, EstimatorSetup, FloatArray, IntArray, Measurement, SensorInfo

TRIM = SlowError(sigma=0.01, correlation_s=5e4)
"""Wheels stand unevenly deep by a centimetre, which changes by half a millimetre in a minute; a choice."""
ALIGNMENT = SlowError(sigma=0.004, correlation_s=1e5)
"""Two AHRS on one machine are aligned to 0.2 degrees, and an accelerometer's offset is as a tilt; choices."""
_SLOWEST_M_S = 0.3
_FASTEST_TURN_RAD_S = 0.1
"""In a turn the rear wheels leave the track of the front ones."""
_SPEED_S = 0.5
"""The speed is a mean of so long."""
_ROUGH_M = 0.005
"""What tyres make of the same ground, 1 sigma, before it is learnt; a choice."""
_LEAST_M = 0.0003
_LEARNT, _GUESSED = 40.0, 4.0
"""Of how many samples the noise is learnt, and how many the first guess counts for."""
_LONGEST_GAP_NS = 350_000_000


@dataclass(frozen=True, slots=True)
class ProfileState:
    """What the aid remembers of R members. Arrays are replaced, never changed in place."""

    t_ns: int
    """What the inertial integrals are at."""
    speed_m_s: FloatArray
    """(R,) inertial vertical speed since the beginning, biases and all."""
    height_m: FloatArray
    """(R,) its integral."""
    level_m_s: FloatArray
    """(2, R) mean level velocity; NaN before any."""
    level_ns: IntArray
    """(R,) when it was heard last."""
    due_ns: IntArray
    """(R,) when the aid is to be heard again: its windows do not overlap."""
    rough_m2: FloatArray
    """(R,) variance of the white noise of a rise."""
    learnt: FloatArray
    """(R,) of how many samples it is."""


@dataclass(frozen=True, slots=True)
class Rise:
    """What the aid says of R members at one time."""

    known: BoolArray
    speed_m_s: FloatArray
    """Vertical speed now, with the accelerometer's biases of half of :attr:`over_s` in it."""
    over_s: FloatArray
    """tau."""
    difference_rad: FloatArray
    """Pitch error of the carrier's AHRS a tau ago, but for a constant."""
    difference_variance: FloatArray


class ProfileAid:
    """Turns pitch, stroke and level speed into vertical speeds.

    Args:
        chassis: AHRS on the carrier.
        stroke: transducer of the slide.
        blade: the filter's own AHRS.
        setup: with the wheelbase and the place of the reference point.

    Raises:
        BadInputError: a column is missing, the carrier has no wheelbase, or an AHRS is turned on its mount.
    """

    def __init__(self, chassis: SensorInfo, stroke: SensorInfo, blade: SensorInfo, setup: EstimatorSetup) -> None:
        if setup.wheelbase_m <= 0.0:
            raise BadInputError(f"[estimators.{setup.name}] profile: this machine has no wheelbase")
        for info in (chassis, blade):
            if any(info.mount.rpy_rad):
                raise BadInputError(f"[estimators.{setup.name}] profile: {info.name!r} is turned on its mount")
        self._wheelbase_m = setup.wheelbase_m
        self._arm_m = setup.reference_x_m + blade.mount.xyz_m[0] - setup.reference.xyz_m[0]
        runs = setup.runs
        longest_ns = round((self._wheelbase_m / _SLOWEST_M_S + 2.0) * NS_PER_S)

        def track(rows: int, gap_ns: int) -> Track:
            return Track(rows, runs=runs, kept_ns=longest_ns, longest_gap_ns=gap_ns)

        self._heard = {
            info.name: (column_places(info, columns, setup=setup), track(len(columns), round(2.5e9 / info.rate_hz)))
            for info, columns in (
                (chassis, ("pitch_rad",)),
                (stroke, ("displacement_m",)),
                (blade, ("pitch_rad", "heading_rad")),
            )
        }
        self._chassis, self._stroke, self._blade = (self._heard[info.name][1] for info in (chassis, stroke, blade))
        self._nodes = track(5, _LONGEST_GAP_NS)
        """Inertial speed and height; the blade's tilt, what is left of it, and for how long that lasts."""
        never, zero = np.full(runs, -(2**62), dtype=np.int64), np.zeros(runs)
        rough = np.full(runs, _ROUGH_M**2)
        self.state = ProfileState(0, zero, zero, np.full((2, runs), np.nan), never, never, rough, zero)

    def hear(self, measurement: Measurement) -> None:
        """Take a sample of one of the three sensors."""
        places, track = self._heard[measurement.sensor]
        values = np.where(measurement.valid[:, np.newaxis], measurement.values[:, places], np.nan)
        track.push(min(measurement.t_ns, measurement.t_available_ns), values.T)

    def advance(self, sums: FloatArray, span_s: float, t_ns: int) -> None:
        """Move on by a span with these integrals (13, R), to a time."""
        state = self.state
        self.state = replace(
            state,
            t_ns=t_ns,
            speed_m_s=state.speed_m_s + sums[GAIN_V],
            height_m=state.height_m + state.speed_m_s * span_s + sums[GAIN_H],
        )

    def restore(self, state: ProfileState) -> None:
        """Go back to what was known."""
        self.state = state
        self._nodes.forget_after(state.t_ns)

    def look(self, reading: FixReading, lean: FloatArray | None) -> Rise:
        """What the aid says at the time of a sample of the receiver; ``lean`` (13, R) is known of the blade's tilt."""
        t_ns, state = reading.t_ns, self.state
        node = np.full((5, len(state.due_ns)), np.nan)
        node[0], node[1] = state.speed_m_s, state.height_m
        if lean is not None:
            node[2], node[3], node[4] = lean[TILT], lean[REST], lean[LASTING]
        self._nodes.push(t_ns, node)
        self._follow(reading)
        speed = np.hypot(*self.state.level_m_s)
        due = reading.level_known & (speed >= _SLOWEST_M_S) & (t_ns >= state.due_ns)
        if not due.any():
            return Rise(due, speed, speed, speed, speed)
        over_s = self._wheelbase_m / np.where(due, speed, 1.0)
        rise = self._rise(t_ns, over_s, due)
        due_ns = np.where(rise.known, t_ns + np.round(over_s * NS_PER_S).astype(np.int64), state.due_ns)
        self.state = replace(self.state, due_ns=due_ns)
        return rise

    def _follow(self, reading: FixReading) -> None:
        state, known = self.state, reading.level_known
        since_s = (reading.t_ns - state.level_ns) / NS_PER_S
        fresh = since_s > 2.0 * _SPEED_S
        gain = np.where(fresh, 1.0, -np.expm1(-np.clip(since_s, 0.0, 1e3) / _SPEED_S))
        before = np.where(np.isnan(state.level_m_s) | fresh, reading.level_m_s, state.level_m_s)
        level = np.where(known, before + gain * (reading.level_m_s - before), state.level_m_s)
        self.state = replace(state, level_m_s=level, level_ns=np.where(known, reading.t_ns, state.level_ns))

    def _rise(self, t_ns: int, over_s: FloatArray, due: BoolArray) -> Rise:
        now = np.full(len(over_s), t_ns, dtype=np.int64)
        before = now - np.round(over_s * NS_PER_S).astype(np.int64)
        pitch, pitch_then = self._chassis.linear(now)[0], self._chassis.linear(before)[0]
        stroke = self._stroke.linear(now)[0] - self._stroke.linear(before)[0]
        blade, blade_then = self._blade.linear(now), self._blade.linear(before)
        one, other, since_s, span_s = self._nodes.at(before)
        height_then = one[1] + one[0] * since_s + 0.5 * (other[0] - one[0]) * since_s**2 / span_s
        lean_then = one[2:] + (other[2:] - one[2:]) * (since_s / span_s)
        sine, sine_then = np.sin(pitch), np.sin(pitch_then)
        risen = -self._wheelbase_m * sine_then - self._arm_m * (sine - sine_then) + stroke
        gained = self.state.speed_m_s - (self.state.height_m - height_then) / over_s
        speed = risen / over_s + gained
        turned = np.abs(np.remainder(blade[1] - blade_then[1] + np.pi, 2.0 * np.pi) - np.pi) / over_s
        known = due & np.isfinite(speed) & (turned < _FASTEST_TURN_RAD_S)
        return Rise(
            known=known,
            speed_m_s=np.where(known, speed, 0.0),
            over_s=over_s,
            difference_rad=pitch_then - blade_then[0] - lean_then[0],
            # white in samples a tau apart, with the density of what lasts
            difference_variance=lean_then[1] * np.maximum(2.0 * lean_then[2] / over_s, 1.0),
        )

    # --- what the filter makes of it ---------------------------------------------------------------------------------

    def observe(self, rise: Rise, layout: Layout) -> SumOfStates:
        """The vertical speed as the filter sees it."""
        assert layout.pitch is not None
        pace, half = self._wheelbase_m / rise.over_s, 0.5 * rise.over_s
        weights: dict[int, float | FloatArray] = {V: 1.0, B0: half, B1: half, layout.pitch: -pace}
        weights[layout.pitch + 1] = pace
        if layout.leak is not None:
            weights[layout.leak] = half
        return SumOfStates(weights, self.state.rough_m2 / np.square(rise.over_s), size=layout.size)

    def learn(self, rise: Rise, y: FloatArray, S: FloatArray, tracking: BoolArray) -> None:
        """Learn the noise from an innovation (R,) and its expected variance where fixes are used."""
        rough, square = self.state.rough_m2, np.square(rise.over_s)
        beyond = np.minimum(np.square(y), 9.0 * S) * square - (S * square - rough)
        count = self.state.learnt + (rise.known & tracking)
        learnt = np.maximum(rough + (beyond - rough) / np.minimum(count + _GUESSED, _LEARNT), _LEAST_M**2)
        self.state = replace(self.state, rough_m2=np.where(rise.known & tracking, learnt, rough), learnt=count)

    @staticmethod
    def align(branch: Engine, rise: Rise, layout: Layout, members: BoolArray) -> None:
        """Learn the carrier's pitch error from the blade's AHRS, if its own is followed."""
        if layout.tilt is None or layout.pitch is None:
            return
        known = members & rise.known & np.isfinite(rise.difference_rad)
        variance = np.where(known, np.maximum(rise.difference_variance, 1e-10), 1.0)
        both = SumOfStates({layout.pitch: 1.0, layout.pitch + 2: 1.0}, variance, size=layout.size)
        branch.update(both, np.where(known, rise.difference_rad, 0.0)[:, np.newaxis], known, both.R)
