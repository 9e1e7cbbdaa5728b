"""The row-speed filter of paper 000, as published, central or distributed (kind ``row_speed_ekf``).

One extended Kalman filter with the coordinated-turn model (:mod:`twin.estimators.coordinated_turn`), the mean
longitudinal accelerometer as input, updates by the gyroscopes and by every radar, AccoSat and GNSS receiver on its own,
and rigid-body transport to the row units. Its Q is eq 4.1, its R table 4.1; Q is added once per 50 Hz step, not per
second.

* **central** (section 2.2.1): one filter at the machine's reference, fed by all inertial units.
* **distributed** (section 2.2.2): one filter per inertial unit, at its place on the row line, each with its own
  accelerometer and gyroscope; the aiding sensors are shared, the units do not talk to one another. A row without a unit
  takes its speed and place from the nearest unit's filter by rigid-body transport (the one with the lower row number
  at a tie); the machine's own pose, speed and yaw rate come in the same way from the unit nearest the reference.

**What is known to be wrong with it**, and kept: tilt is not modelled, so gravity's longitudinal share b enters as an
acceleration and the speed settles at b T (1 - K) / K beside the radar's (K the steady gain, T the step): 0.305 m/s on
a slope of 5 %, with K = 0.0311. The yaw rate's Q lets the gyroscopes speak with a time constant of about 0.1 s. Late
samples are used as if current: 0.08 s of latency are 0.2 m at 2.5 m/s. The model moves its origin along the heading,
but only at its axle does an implement not slip sideways: a row line d behind it moves sideways at d omega in a turn
(0.55 m and 0.15 m/s for ``planter_f8``), which is not modelled and costs 0.15 to 0.2 m of position where GNSS corrects
with a gain of 0.02 a fix. So NEES is far above the number of states even with RTK at its best. GNSS speed counts as
forward speed. No outlier is gated.

**What the paper leaves open**, and is decided here: units' accelerations are moved to the origin by eq 2.8; without any
accelerometer the acceleration is 0; the filter starts when the calibration ends, from the start pose the owner set out,
with the sigmas of ``StartConfig``; GNSS has the same number for position in m^2 and speed in (m/s)^2, as table 4.1 has
it. How a receiver's own word can be believed instead is in :mod:`twin.estimators.aiding`.

Beside what it estimates it tells, as diagnostics, the normalised innovation squared of its last updates
(``nis_gyro``, ``nis_<radar>``, ``nis_<gnss>_position``, ``nis_<gnss>_speed``): chi-square with 1 degree of freedom, a
position's with 2, if the filter is consistent.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Strict

from twin.config import Config, Names, NonNegative, Positive
from twin.errors import BadInputError
from twin.estimators import planter_output
from twin.estimators.aiding import AidingNoise, GnssWeighting, aids_of
from twin.estimators.coordinated_turn import CoordinatedTurn
from twin.estimators.engines import EngineName, make_engine
from twin.estimators.rigid_body_filter import RigidBodyFilter
from twin.estimators.roles import ACCOSAT, GNSS, IMU, RADAR, InertialUnit, common_rate, pick_sensors
from twin.estimators.standstill import StandstillConfig
from twin.estimators.thinning import Thinner, Thinning, ticks_per_sample
from twin.estimators.ticks import Tick, TickClock
from twin.signals import NS_PER_S, Estimate, EstimatorSetup, FloatArray, Measurement, SensorInfo

KIND = "row_speed_ekf"

Variances = Annotated[
    tuple[Positive, Positive, Positive, Positive, Positive],
    Strict(strict=False),
]


class NoiseConfig(AidingNoise):
    """Q and R of the filter; the defaults are the paper's (eq 4.1, table 4.1)."""

    process: Variances = (1e-5, 1e-5, 1e-4, 1e-8, 1e-8)
    """Diagonal of Q per step: east and north m^2, speed (m/s)^2, heading rad^2, yaw rate (rad/s)^2."""
    accelerometer_m2_s4: Positive = 0.05
    """Variance of an accelerometer axis per sample; only the standstill detector uses it, and only uncalibrated."""
    gyro_rad2_s2: Positive = 1e-6
    """Variance of a gyroscope sample."""


class StartConfig(Config):
    """How well the state is known when the filter starts (1 sigma)."""

    position_m: NonNegative = 0.1
    heading_rad: NonNegative = 0.02
    speed_m_s: NonNegative = 0.01
    yaw_rate_rad_s: NonNegative = 0.001


class RowSpeedEkfConfig(Config):
    """Options of :class:`RowSpeedEkf`."""

    kind: Literal["row_speed_ekf"]
    sensors: Names
    """Names of the inertial units (at least one) and of the radars, AccoSats and GNSS receivers it listens to."""
    architecture: Literal["central", "distributed"] = "central"
    """One filter for the machine, or one per inertial unit."""
    rate_hz: Positive = 50.0
    """Output rate."""
    engine: Literal["auto", "filterpy", "ensemble"] = "auto"
    """Kalman engine; auto: filterpy for a single run."""
    calibration_s: NonNegative = 60.0
    """Standstill at the start from which biases are taken; 0: none."""
    input_rate_hz: Positive | None = None
    """Rate at which the filter runs, calibrates and looks for standstill, if slower than the inertial units; their
    rate has to be a whole multiple of it. Q stays per step, as published."""
    thinning: Thinning = "moving_average"
    """How the samples of one period become one: their mean, or the last of them (:mod:`twin.estimators.thinning`)."""
    max_age_s: Positive = 1.0
    """Samples older than this on arrival are dropped; younger late ones count as current."""
    noise: NoiseConfig = NoiseConfig()
    gnss: GnssWeighting = GnssWeighting()
    start: StartConfig = StartConfig()
    standstill: StandstillConfig = StandstillConfig()


class RowSpeedEkf:
    """Estimator of :class:`RowSpeedEkfConfig`; columns as in :mod:`twin.estimators.planter_output`.

    Raises:
        BadInputError: no inertial unit, a sensor of a kind or on a body the filter cannot use, inertial units with
            different rates, a variance for a sensor it does not have, an input rate that does not divide theirs, or the
            filterpy engine with more than one run.
    """

    def __init__(self, config: RowSpeedEkfConfig, setup: EstimatorSetup) -> None:
        sensors = pick_sensors(setup, (IMU, RADAR, ACCOSAT, GNSS), estimator=KIND)
        rate_hz = common_rate(sensors[IMU], setup, estimator=KIND)
        _check(config, setup)
        self._config = config
        self._setup = setup
        self._clock = TickClock(
            rate_hz=rate_hz, max_age_s=config.max_age_s, inertial=[info.name for info in sensors[IMU]]
        )
        self._thinner: Thinner | None = None
        self._step_ns = self._clock.step_ns
        if config.input_rate_hz is not None:
            ticks = ticks_per_sample(rate_hz, config.input_rate_hz, where=f"[estimators.{setup.name}]")
            self._thinner = Thinner(
                ticks=ticks, thinning=config.thinning, sensors=list(setup.sensors), step_ns=self._step_ns
            )
            self._step_ns, rate_hz = ticks * self._step_ns, config.input_rate_hz
        self._filters = self._make_filters(sensors)
        self._output = planter_output.PlanterOutput(
            rows_y_m=setup.rows_y_m,
            origins_left_m=[each.origin_left_m for each in self._filters],
            innovations=self._filters[0].innovations,
        )
        self.columns = self._output.columns
        self.state_columns: tuple[str, ...] = planter_output.STATE_COLUMNS
        self._calibration_ticks = round(config.calibration_s * rate_hz)
        self._first_tick: int | None = None
        self._calibrated = False
        self._filter_t_ns: int | None = None
        self._at_start = self._report(0)

    @property
    def filters(self) -> tuple[RigidBodyFilter, ...]:
        """The Kalman filters inside: one if central, one per inertial unit if distributed."""
        return tuple(self._filters)

    def process(self, measurement: Measurement) -> None:
        """Take one measurement, in order of arrival."""
        self._take(self._clock.add(measurement))

    def estimate(self, t_ns: int) -> Estimate:
        """Return the estimate at ``t_ns``, after all that arrived until then.

        Between ticks, and where no sample came, the state is extrapolated by the motion model without acceleration.
        """
        self._take(self._clock.close())
        if self._filter_t_ns is None:
            start = self._at_start
            return Estimate(t_ns=t_ns, values=start.values, sigmas=start.sigmas, covariance=start.covariance)
        return self._report(t_ns)

    def _report(self, t_ns: int) -> Estimate:
        return self._output.estimate(
            t_ns,
            [self._state(each, t_ns) for each in self._filters],
            standing=[each.standing for each in self._filters],
            nis=[each.take_nis() for each in self._filters],
        )

    def _take(self, tick: Tick | None) -> None:
        """Let the filters step by a tick of the sensors' clock that is closed, or by what it completes."""
        if tick is None:
            return
        for each in (tick,) if self._thinner is None else self._thinner.add(tick):
            self._step(each)

    def _step(self, tick: Tick) -> None:
        if self._first_tick is None:
            self._first_tick = tick.index
        if tick.index < self._first_tick + self._calibration_ticks:
            for each in self._filters:
                each.calibrate(tick)
            return
        if not self._calibrated:
            self._calibrated = True
            for each in self._filters:
                each.finish_calibration()
        for each in self._filters:
            each.step(tick)
        self._filter_t_ns = tick.index * self._step_ns

    def _state(self, one: RigidBodyFilter, t_ns: int) -> tuple[FloatArray, FloatArray]:
        """State (R, 5) and covariance (R, 5, 5) of one filter at ``t_ns``."""
        x, P = one.engine.x, one.engine.P
        if self._filter_t_ns is None or t_ns <= self._filter_t_ns:
            return x, P
        dt_s = (t_ns - self._filter_t_ns) / NS_PER_S
        none = np.zeros(len(x))
        moved, F = one.motion.linearise(x, none, dt_s)
        return moved, np.einsum("rik,rjk->rij", np.einsum("rij,rjk->rik", F, P), F) + one.motion.Q(dt_s)

    def _make_filters(self, sensors: dict[str, list[SensorInfo]]) -> list[RigidBodyFilter]:
        units = [InertialUnit.of(info, self._setup) for info in sensors[IMU]]
        aiding = [*sensors[RADAR], *sensors[ACCOSAT], *sensors[GNSS]]
        if self._config.architecture == "central":
            return [self._make_filter(units, aiding, 0.0)]
        return [self._make_filter([unit], aiding, unit.left_m) for unit in units]

    def _make_filter(
        self, units: list[InertialUnit], aiding: list[SensorInfo], origin_left_m: float
    ) -> RigidBodyFilter:
        config, setup = self._config, self._setup
        noise, step_s = config.noise, self._step_ns / NS_PER_S
        name: EngineName = "filterpy" if setup.runs == 1 else "ensemble"
        if config.engine != "auto":
            name = config.engine
        x, P = _start(config.start, setup, origin_left_m)
        return RigidBodyFilter(
            engine=make_engine(name, x, P),
            motion=CoordinatedTurn(process_variances=noise.process, step_s=step_s),
            origin_left_m=origin_left_m,
            units=units,
            aids={info.name: aids_of(info, noise, config.gnss, setup, origin_left_m) for info in aiding},
            gyro_variance=noise.gyro_rad2_s2,
            accelerometer_variance=noise.accelerometer_m2_s4,
            standstill=config.standstill,
            step_ns=self._step_ns,
        )


def _check(config: RowSpeedEkfConfig, setup: EstimatorSetup) -> None:
    for name in config.noise.variance:
        if name not in setup.sensors or setup.sensors[name].kind == IMU:
            able = ", ".join(info.name for info in setup.sensors.values() if info.kind != IMU) or "none"
            raise BadInputError(
                f"[estimators.{setup.name}.noise.variance] {name}: no aiding sensor of that name; there are: {able}"
            )
    if config.engine == "filterpy" and setup.runs > 1:
        raise BadInputError(
            f"[estimators.{setup.name}] engine = 'filterpy': steps one run, not {setup.runs}; allowed: auto, ensemble"
        )


def _start(start: StartConfig, setup: EstimatorSetup, origin_left_m: float) -> tuple[FloatArray, FloatArray]:
    """State (R, 5) and covariance (R, 5, 5) at the start, of the filter's origin."""
    east, north, heading = setup.start_e_n_heading
    x = np.array([east - origin_left_m * np.sin(heading), north + origin_left_m * np.cos(heading), 0.0, heading, 0.0])
    sigmas = np.array([start.position_m, start.position_m, start.speed_m_s, start.heading_rad, start.yaw_rate_rad_s])
    return np.repeat(x[np.newaxis], setup.runs, axis=0), np.repeat(np.diag(sigmas**2)[np.newaxis], setup.runs, axis=0)
