"""Row speeds by strapdown inertial navigation of the implement (kind ``row_speed_ins``).

What the coordinated-turn filter of paper 000 cannot do, and its section 5.2 asks for. One consistent Kalman filter of
the implement as a rigid body in space (:mod:`twin.estimators.ins_model`): roll and pitch are states, so gravity in
the longitudinal axis is not taken for acceleration; the inertial biases are states, so no calibration run is needed;
the radar's lag, and the pitching and heaving in it, are modelled; GNSS counts by its fix state and the age of its
corrections, at the time it is about (:mod:`twin.estimators.ins_aiding`). Any number of inertial units, any subset of
radars, AccoSats and GNSS receivers. Several inertial units become one, weighted by how they behave
(:mod:`twin.estimators.inertial_array`); outliers are gated by their innovation; standstill is told from several cues
(:mod:`twin.estimators.standing_cues`). The machine's own knowledge: wheels roll where they point
(:class:`~twin.estimators.ins_observations.NoSlip`), at the axle, whose place before the row line is configured.

The order of a step: fuse the units of the tick, predict, then no-slip, standstill, aids sensor by sensor; samples that
come late are put where they belong (:mod:`twin.estimators.ins_filter`). Innovations are told as they are before gating
(columns ``nis_<pulse sensor>``, chi-square with 1 degree of freedom; ``nis_<receiver>_position`` and
``nis_<receiver>_velocity``, with 2).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from twin.errors import BadInputError
from twin.estimators.engines import EngineName, make_engine
from twin.estimators.inertial_array import Fused
from twin.estimators.ins_aiding import Aid, PulseAid
from twin.estimators.ins_build import RowSpeedInsConfig, inertial_array, model_and_aids, start
from twin.estimators.ins_filter import Epoch, GateConfig, StrapdownFilter
from twin.estimators.ins_model import BG, PITCH, ROLL, VX, VZ, YAW, E, K, N, horizontal
from twin.estimators.ins_observations import NoSlip, Standing
from twin.estimators.planter_output import STATE_COLUMNS, PlanterOutput
from twin.estimators.roles import ACCOSAT, GNSS, IMU, RADAR, InertialUnit, common_rate, pick_sensors
from twin.estimators.rts_smoother import RtsRecorder
from twin.estimators.standing_cues import StandingCues
from twin.estimators.ticks import Tick, TickClock
from twin.signals import NS_PER_S, BoolArray, Estimate, EstimatorSetup, FloatArray, Measurement, SensorInfo

KIND = "row_speed_ins"
_LAG_SWITCH_M_S = 0.05
"""Smoothed difference of a radar's input and output at which the other time constant takes over: more than its noise,
less than what a change of speed of 0.5 m/s^2 leaves behind a lag of 0.2 s."""
_HISTORY_S = 0.6
"""How old a sample may be to be put where it belongs; older ones count as this old."""
_PULSE_PATIENCE_S = 0.1
_FIX_PATIENCE_S = 0.5
"""How long what a speed sensor said of standing holds."""
_OWN_SLOW_M_S = 0.3
_STANDING_M_S = 0.01
"""How well a standing machine stands: standstill is told again at every step."""
_MOST_SMOOTHED = 8
"""Members whose every step can be kept in memory for a smoother."""


@dataclass(frozen=True, slots=True)
class _Asked:
    """What was said, and of which epoch, for a smoother to say it again."""

    t_ns: int
    index: int
    u: FloatArray
    gyro_variance: FloatArray
    standing: BoolArray


class RowSpeedIns:
    """Estimator of :class:`RowSpeedInsConfig`; columns as in :mod:`twin.estimators.planter_output`.

    Raises:
        BadInputError: no inertial unit, a sensor of a kind or on a body the filter cannot use, inertial units with
            different rates, or the filterpy engine with more than one run.
    """

    def __init__(self, config: RowSpeedInsConfig, setup: EstimatorSetup) -> None:
        sensors = pick_sensors(setup, (IMU, RADAR, ACCOSAT, GNSS), estimator=KIND)
        if config.engine == "filterpy" and setup.runs > 1:
            raise BadInputError(
                f"[estimators.{setup.name}] engine = 'filterpy': steps one run, not {setup.runs};"
                " allowed: auto, ensemble"
            )
        if config.hindsight and setup.runs > _MOST_SMOOTHED:
            raise BadInputError(
                f"[estimators.{setup.name}] hindsight: keeps every step, for at most {_MOST_SMOOTHED} runs at once,"
                f" not {setup.runs}"
            )
        units = sensors[IMU]
        rate_hz = common_rate(units, setup, estimator=KIND)
        self._config, self._setup = config, setup
        self._clock = TickClock(rate_hz=rate_hz, max_age_s=config.max_age_s, inertial=[info.name for info in units])
        self._step_ns = self._clock.step_ns
        self._step_s = self._step_ns / NS_PER_S
        self._units = {info.name: (place, InertialUnit.of(info, setup)) for place, info in enumerate(units)}
        self._array = inertial_array(config, units, setup, self._step_s)
        self._cues = StandingCues(step_s=self._step_s, runs=setup.runs)
        self.model, self._aids = model_and_aids(config, sensors, setup)
        self.filter = self._make_filter(units)
        self._gyro_variance: FloatArray = np.full(setup.runs, 1e-6)
        self._u: FloatArray = np.zeros((setup.runs, 6))
        self._standing: BoolArray = np.zeros(setup.runs, dtype=np.bool_)
        self._now: int | None = None
        self._asked: list[_Asked] = []
        self._output = PlanterOutput(
            rows_y_m=setup.rows_y_m,
            origins_left_m=[0.0],
            innovations=self._innovations(),
        )
        self.columns = self._output.columns
        self.state_columns: tuple[str, ...] = STATE_COLUMNS

    # --- in ----------------------------------------------------------------------------------------------------------

    def process(self, measurement: Measurement) -> None:
        """Take one measurement, in order of arrival."""
        tick = self._clock.add(measurement)
        if tick is not None:
            self._step(tick)

    def _step(self, tick: Tick) -> None:
        """Advance to a tick, then put every aid of the group where it belongs."""
        aids = [(self._aids[m.sensor], m) for m, _ in tick.samples if m.sensor in self._aids]
        self._hear_speeds(tick.index, aids)
        if tick.steps:
            fused = self._fuse(tick)
            self._u, self._gyro_variance = fused.u, fused.gyro_variance
            if self._config.standstill:
                self._cues.inertial(fused)
                own_slow = np.abs(self.filter.engine.x[:, VX]) <= _OWN_SLOW_M_S
                self._standing = self._cues.standing(tick.index, fused, own_slow)
            self.filter.step(
                Epoch(index=tick.index, dt_s=tick.steps * self._step_s, inertial=fused, standing=self._standing)
            )
        self._now = tick.index
        speed = np.abs(self.filter.engine.x[:, VX])
        for aid, measurement in aids:
            if isinstance(aid, PulseAid):
                self.filter.add(self._index(measurement.t_ns), aid.read(measurement))
            else:
                self.filter.add(self._index(aid.time_ns(measurement)[0]), aid.read(measurement, speed))

    def _index(self, t_ns: int) -> int:
        return (t_ns + self._step_ns // 2) // self._step_ns

    def _hear_speeds(self, index: int, aids: list[tuple[Aid, Measurement]]) -> None:
        for aid, measurement in aids:
            slow, known = aid.slow(measurement)
            patience = (_PULSE_PATIENCE_S if isinstance(aid, PulseAid) else _FIX_PATIENCE_S) / self._step_s
            self._cues.speed(measurement.sensor, index, patience, slow=slow, known=known)

    def _fuse(self, tick: Tick) -> Fused:
        """One inertial sample of what the units said at this very tick."""
        runs, count = self._setup.runs, len(self._units)
        readings, present = np.zeros((count, runs, 6)), np.zeros((count, runs), dtype=np.bool_)
        for measurement, fresh in tick.samples:
            entry = self._units.get(measurement.sensor)
            if entry is not None and fresh:
                place, unit = entry
                values = unit.read(measurement)
                readings[place], present[place] = values, measurement.valid & np.isfinite(values).all(axis=1)
        return self._array.fuse(readings, present, tick.steps)

    # --- out ---------------------------------------------------------------------------------------------------------

    def estimate(self, t_ns: int) -> Estimate:
        """Return the estimate at ``t_ns``, after all that arrived until then.

        Between ticks, and where no inertial sample came, the motion goes on as at the last one.
        """
        tick = self._clock.close()
        if tick is not None:
            self._step(tick)
        if self._recorder is not None and self._now is not None:
            self._asked.append(_Asked(t_ns, self._now, self._u, self._gyro_variance, self._standing))
        return self._report(t_ns, *self._moved_on(t_ns, self._now, self.filter.engine.x, self.filter.engine.P))

    def _moved_on(self, t_ns: int, index: int | None, x: FloatArray, P: FloatArray) -> tuple[FloatArray, FloatArray]:
        """State (R, n) and covariance (R, n, n) at ``t_ns`` from those of an epoch not later than it."""
        if index is None or t_ns <= index * self._step_ns:
            return x, P
        dt_s = (t_ns - index * self._step_ns) / NS_PER_S
        x, F = self.model.linearise(x, self._u, dt_s)
        return x, F @ P @ F.transpose(0, 2, 1) + self.model.Q(dt_s)

    @property
    def says_in_hindsight(self) -> bool:
        """Whether what counts is said after the run, by :meth:`hindsight`."""
        return self._recorder is not None

    def hindsight(self) -> Iterator[Estimate]:
        """What a smoother says, for every time that was asked for, in order."""
        smoothed = {} if self._recorder is None else self._recorder.smooth()
        for asked in self._asked:
            x, P = smoothed[asked.index]
            self._u, self._gyro_variance, self._standing = asked.u, asked.gyro_variance, asked.standing
            yield self._report(asked.t_ns, *self._moved_on(asked.t_ns, asked.index, x, P))

    def _report(self, t_ns: int, x: FloatArray, P: FloatArray) -> Estimate:
        """Estimate from a state (R, n) and covariance (R, n, n)."""
        planar, J = self._planar(x)
        covariance = J @ P @ J.transpose(0, 2, 1)
        covariance[:, 4, 4] += self._gyro_variance + self._config.noise.yaw_rate_extra_rad_s**2
        nis = np.full((len(self._innovations()), len(x)), np.nan)
        for place, name in enumerate(self._innovations()):
            found = self.filter.nis.pop(name, None)
            if found is not None:
                nis[place] = found
        return self._output.estimate(t_ns, [(planar, covariance)], standing=[self._standing], nis=[nis])

    def _planar(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """East, north, forward speed, heading, yaw rate (R, 5), and their derivatives by the state (R, 5, n)."""
        J = np.zeros((len(x), 5, self.model.size))
        J[:, 0, E] = J[:, 1, N] = J[:, 3, YAW] = 1.0
        level = x[:, ROLL : YAW + 1].copy()
        level[:, 2] = 0.0
        along, by_velocity, by_attitude = horizontal(x[:, VX : VZ + 1], level)
        J[:, 2, VX : VZ + 1] = by_velocity[:, 0]
        J[:, 2, ROLL:YAW] = by_attitude[:, 0, :2]
        w = self.model.rate(x, self._u)
        sine, cosine = np.sin(x[:, ROLL]), np.cos(x[:, ROLL])
        secant = 1.0 / np.cos(x[:, PITCH])
        yaw_rate = (w[:, 1] * sine + w[:, 2] * cosine) * secant
        wz = self._u[:, 5] - x[:, BG + 2]
        J[:, 4, BG + 1] = -sine * secant
        J[:, 4, BG + 2] = -cosine * secant
        J[:, 4, K + 1] = -sine * secant * wz
        J[:, 4, K + 2] = -cosine * secant * wz
        return np.stack([x[:, E], x[:, N], along[:, 0], x[:, YAW], yaw_rate], axis=-1), J

    def _innovations(self) -> tuple[str, ...]:
        return tuple(name for aid in self._aids.values() for name in aid.sources)

    # --- building ----------------------------------------------------------------------------------------------------

    def _make_filter(self, units: list[SensorInfo]) -> StrapdownFilter:
        config, setup, size = self._config, self._setup, self.model.size
        name: EngineName = "filterpy" if setup.runs == 1 else "ensemble"
        if config.engine != "auto":
            name = config.engine
        wheels = config.wheels
        x, P = start(config, units, self.model, setup)
        self._recorder = RtsRecorder(x, P) if config.hindsight else None
        return StrapdownFilter(
            engine=make_engine(name, x, P),
            model=self.model,
            no_slip=NoSlip(
                (wheels.lateral_m_s**2, wheels.vertical_m_s**2),
                axle_m=(wheels.axle_forward_m, 0.0, wheels.axle_up_m),
                size=size,
            ),
            standing=Standing(speed_variance=_STANDING_M_S**2, size=size),
            gate=GateConfig(
                enabled=config.gating.enabled, sigmas=config.gating.sigmas, reacquire_s=config.gating.reacquire_s
            ),
            lag_switch_m_s=_LAG_SWITCH_M_S,
            step_s=self._step_s,
            history=max(1, round(_HISTORY_S / self._step_s)),
            speed_sources=[name for aid in self._aids.values() for name in aid.speed_sources],
            recorder=self._recorder,
        )
