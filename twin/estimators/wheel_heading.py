"""The wheels as a heading reference of :mod:`twin.estimators.heading_filter`: quantised, drifting, and at times wrong.

A wheel's angle is known to a slot, so the heading counted is off by a uniform error of one slot per wheel: sigma
slot / sqrt(6) for two, 2.3 deg for the robot of paper 001. That error stays while no slot passes; only counts that
changed say something new. But a count that has just changed is not anywhere within its slot: the wheel stands at the
edge it came over, half a slot behind the middle (forwards; ahead of it backwards), which for two wheels that turn a
robot on the spot makes a whole slot of heading. So a count that changed is taken at its edge.

The offset between heading and count (state C) wanders with the way (uneven ground, tyres) and with the turn (track and
radius not quite as configured, scrubbing: 50 deg asked for give 48.5 to 50).

What is beyond that is slip: the offset is settled anew from the heading held, and the wheels have no say until they
have agreed with the gyroscope for ``settle_s``.
"""

from __future__ import annotations

import numpy as np

from twin.config import Config, NonNegative, Positive
from twin.estimators.engines import Engine, innovation
from twin.estimators.heading_model import C, T, WheelsSeen
from twin.estimators.wheel_odometry import TRACK_M, WHEEL_RADIUS_M, Odometer
from twin.signals import BoolArray, EstimatorSetup, FloatArray, SensorInfo

_ROLLED_S = 0.5
"""How long after a slot the wheels count as turning."""
_SETTLE_S = 0.5
_WHOLE_TURN_RAD = 1.0
"""A turn of one radian makes of a relative error, taken for white, the right angle error."""


class WheelHeadingConfig(Config):
    """The wheels, and how far they are believed."""

    wheel_radius_m: Positive = WHEEL_RADIUS_M
    track_m: Positive = TRACK_M
    turn_ratio: NonNegative = 0.03
    """Error of a turn, of the turn, 1 sigma; a choice (a small skid-steered robot was 2.7 % off)."""
    drift_rad_rtm: NonNegative = 0.01
    """Drift per root of a metre of way, 1 sigma; a choice."""
    slip_sigmas: Positive = 3.5
    """Innovation beyond which the wheels slip."""


class WheelHeading:
    """Counts, judges and tells the engine; also the position by dead reckoning. Arrays are (R,)."""

    def __init__(self, config: WheelHeadingConfig, info: SensorInfo, setup: EstimatorSetup) -> None:
        runs = setup.runs
        self._config = config
        self._odometer = Odometer(info, wheel_radius_m=config.wheel_radius_m, track_m=config.track_m, runs=runs)
        self._seen = WheelsSeen(self._odometer.slot_rad**2 / 6.0)
        self._known: BoolArray = np.zeros(runs, dtype=np.bool_)
        self._still_s = np.full(runs, _ROLLED_S)
        self._right_s = np.full(runs, _SETTLE_S)
        self._changed: BoolArray = np.zeros(runs, dtype=np.bool_)
        self._way: FloatArray = np.zeros(runs)
        self._dt_s = 0.0
        self._slip_variance: FloatArray = np.zeros(runs)
        east, north, _ = setup.start_e_n_heading
        self.east_m: FloatArray = np.full(runs, float(east))
        self.north_m: FloatArray = np.full(runs, float(north))

    @property
    def rolled(self) -> BoolArray:
        """Whether a slot passed not long ago."""
        return self._still_s < _ROLLED_S

    @property
    def slipping(self) -> BoolArray:
        """Whether the wheels have no say."""
        return self._right_s < _SETTLE_S

    def count(self, slots: FloatArray, counted: BoolArray, dt_s: float) -> None:
        """Take counts (R, 2)."""
        turned, self._way = self._odometer.step(slots, counted)
        self._dt_s = dt_s
        self._changed = (turned != 0.0) | (self._way != 0.0)
        self._still_s = np.where(self._changed, 0.0, self._still_s + dt_s)
        config = self._config
        by_turn = config.turn_ratio**2 * np.abs(turned) * _WHOLE_TURN_RAD
        self._slip_variance = self._slip_variance + by_turn + config.drift_rad_rtm**2 * np.abs(self._way)

    def take_slip_variance(self) -> FloatArray:
        """What the offset may have wandered since this was asked last, rad^2."""
        variance, self._slip_variance = self._slip_variance, np.zeros_like(self._slip_variance)
        return variance

    def hear(self, engine: Engine, counted: BoolArray, heading: FloatArray) -> None:
        """Tell the engine what the wheels say against the heading held, (R,), not wrapped."""
        edges = -0.5 * np.sign(self._odometer.since)
        counted_yaw = self._odometer.yaw + self._odometer.slot_rad * (edges[:, 1] - edges[:, 0])
        seen = (counted_yaw - heading)[:, np.newaxis]
        news = counted & self._known & self._changed
        off = news
        if news.any():
            off = news & (innovation(engine, self._seen, seen).nis > self._config.slip_sigmas**2)
        self._right_s = np.where(off, 0.0, np.minimum(self._right_s + self._dt_s, _SETTLE_S))
        anew = counted & (self.slipping | ~self._known)
        told = news & ~anew
        if told.any():
            engine.update(self._seen, seen, told)
        if anew.any():
            self._settle(engine, seen[:, 0], anew)
            self._known = self._known | counted

    def _settle(self, engine: Engine, seen: FloatArray, members: BoolArray) -> None:
        """The offset becomes what the heading makes of it: C = theta_z - seen, off by theta_z and by a slot."""
        x, P = engine.x.copy(), engine.P.copy()
        x[:, C] = np.where(members, x[:, T + 2] - seen, x[:, C])
        here = members[:, np.newaxis]
        row = np.where(here, P[:, T + 2], P[:, C])
        row[:, C] = np.where(members, P[:, T + 2, T + 2] + self._seen.R[0], P[:, C, C])
        P[:, C, :] = row
        P[:, :, C] = row
        engine.restore(x, P)

    def travel(self, heading: FloatArray) -> None:
        """Move on by the way of this step along a heading."""
        self.east_m = self.east_m + self._way * np.cos(heading)
        self.north_m = self.north_m + self._way * np.sin(heading)
        self._way = np.zeros_like(self._way)
