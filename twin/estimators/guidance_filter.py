"""Guidance from a receiver, wheels, a gyro and the steering, in which what stays wrong is a state: our own filter (kind
``guidance_filter``).

An extended Kalman filter whose state (:mod:`twin.estimators.guidance_filter_model`) holds the receiver's slow error
beside the machine's motion. So it does not follow the wander of a receiver, as filters do that take it for white noise:
it moves by wheels and gyro, and lets the receiver say slowly where that leads. What a fix is worth decides the kind of
solution (:mod:`twin.estimators.guidance_filter_receiver`), what to make of changes and jumps
:mod:`twin.estimators.guidance_filter_core`. All variances come from data sheets or from :class:`NoiseConfig`.

**What it cannot do**: a constant error of the receiver. Whoever has nothing but single positions is wrong by metres
(sigma says so); but from pass to pass only the change matters, and of that only what wheels and gyro do not show
(:mod:`twin.scoring.guidance_bound` tells how little that could be). ``frame`` says what is told: ``"relative"``, the
position in a frame that is shifted by the receiver's error at the start; or ``"absolute"``, the best guess.

**Late fixes.** The filter stands at the time of the last fix and looks ahead from there by what wheels and gyro have
told since. A fix that is not later than the last one is not used. A minute after the last one it says nothing any more
(mode 0), and starts anew with the next.

**Without a gyro** the rate of turn is a state that wanders, and a headland turn, which begins from one fix to the next,
is beyond that. So where the receiver's velocity is not what the state expects, the machine may have turned: the
covariance gets a change of rate at an unknown time since the last fix, and what that does to heading and place.

Further columns: ``relative_sigma_e_m``, ``relative_sigma_n_m`` (how well the position is known but for the constant
error), ``mode`` (0 waiting for a fix, 1 tracking, 2 coasting: no fix for ``coasting_s``, 3 doubting the last fix),
``gated`` (1 where a fix was refused since the last output).
"""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

import numpy as np

from twin.config import Positive
from twin.estimators.engines import (
    AboutState,
    Engine,
    EngineOption,
    compiled_unless_told,
    make_engine,
)
from twin.estimators.guidance_base import STATE_COLUMNS, GuidanceOutput, SteeredConfig, guidance_sensors, transported
from twin.estimators.guidance_filter_core import Core, GatesConfig
from twin.estimators.guidance_filter_inputs import Inputs, Span
from twin.estimators.guidance_filter_kernels import told_state
from twin.estimators.guidance_filter_model import (
    PSI,
    AntennaSeen,
    Layout,
    SpanMotion,
    StandingRate,
    SteeredRate,
    V,
)
from twin.estimators.guidance_filter_noise import MachineNoise, NoiseConfig
from twin.estimators.guidance_filter_receiver import FixErrors
from twin.estimators.guidance_filter_velocity import VelocityAid, update_robustly
from twin.estimators.guidance_gps import Motion
from twin.estimators.guidance_readers import (
    AGE,
    ANGLE_TRANSDUCER,
    ODOMETRY,
    RATE_KINDS,
    SPEED_KINDS,
    STEERING_ANGLE,
    ColumnReader,
    EncoderReader,
    Fix,
    FixReader,
    rate_reader,
    speed_reader,
)
from twin.estimators.heading_inputs import WHEEL_ENCODERS
from twin.estimators.roles import GNSS, mount_arm
from twin.signals import NS_PER_S, BoolArray, Estimate, EstimatorSetup, FloatArray, Measurement, SensorInfo

KIND = "guidance_filter"
_LONGEST_NS = 250_000_000
"""Longer spans are taken in parts."""
_PATIENCE_NS = 150_000_000
"""A fix waits so long for the other sensors."""
_LONGEST_GAP_NS = 60 * NS_PER_S
"""After a silence of the receiver as long as that the filter starts anew, and until then it says nothing."""
_SILENT_NS = 2 * NS_PER_S
"""Neither fixes nor looking ahead wait for sensors that have been silent for so long."""
_UNORIENTED_RAD = 0.5
"""A heading that is less certain is none."""
_SHORT_NS = 200_000_000
"""Speed and rate of turn of the moment are means over so long."""
_SPEED_NS = 400_000_000
"""The speed that is told is one over so long, so that single slots do not show."""
_UNUSUAL_SIGMAS = 3.0
_SPEED_CHANGE_M_S2, _TURN_CHANGE_RAD_S = 0.1, 0.05
"""So much may speed and heading have changed per second since wheels and gyro were heard, 1 sigma; a choice: a machine
may start, stop or turn in between two samples a second apart, and mostly does not."""


class GuidanceFilterConfig(SteeredConfig):
    """Options of :class:`GuidanceFilter`."""

    kind: Literal["guidance_filter"]
    frame: Literal["relative", "absolute"] = "relative"
    """Which position is told."""
    engine: EngineOption = "auto"
    """Kalman engine; auto: ensemble, whose compiled loops are quicker for a single run, too."""
    velocity: bool = True
    """Use the receiver's speed and course."""
    steering: bool = True
    """Use the steering angle, if it is told."""
    coasting_s: Positive = 2.5
    """Without a fix for so long it says that it coasts."""
    gates: GatesConfig = GatesConfig()
    noise: NoiseConfig = NoiseConfig()


class GuidanceFilter:
    """Estimator of :class:`GuidanceFilterConfig`; columns as in :mod:`twin.estimators.guidance_base`, and further ones.

    Raises:
        BadInputError: sensors that do not fit (:func:`~twin.estimators.guidance_base.guidance_sensors`), or the
            filterpy engine with more than one run.
    """

    state_columns: tuple[str, ...] = STATE_COLUMNS

    def __init__(self, config: GuidanceFilterConfig, setup: EstimatorSetup) -> None:
        infos = guidance_sensors(setup, estimator=KIND)
        self._config, self._runs = config, setup.runs
        self._reference_x_m = setup.reference_x_m
        self._start_heading = setup.start_e_n_heading[2]
        self._receiver = FixReader(infos[GNSS], setup)
        self._errors = FixErrors(infos[GNSS].datasheet, setup.runs, tells_age=AGE in infos[GNSS].columns)
        self._motion = Motion(setup.runs)
        self._arm = self._receiver.forward_m + setup.reference_x_m, self._receiver.left_m
        self._build_inputs(infos, setup)
        self._wheelbase_m = config.wheelbase_of(setup)
        steering = self.inputs.steering is not None and self._wheelbase_m > 0.0
        self.layout = Layout(
            speed=self.inputs.speed is not None,
            rate=self.inputs.rate is not None,
            steering=steering,
            jumps=self._errors.jumps,
            drifts=self._errors.drifts,
            anchor=config.frame == "relative",
        )
        steering_info = None if self._steering is None else self._steering.info
        rate_info = None if self._rate is None else self._rate.info
        self.noise = MachineNoise(config.noise, self.layout, rate=rate_info, steering=steering_info)
        self._velocity = VelocityAid(
            self.layout,
            infos[GNSS].datasheet,
            config.noise,
            arm=self._arm,
            course_from_m_s=config.course_from_m_s,
            gate_sigmas=config.gates.sigmas,
            told_variances=(self._rounding_variance(_SHORT_NS), self._rate_variance(_SHORT_NS)),
        )
        name = compiled_unless_told(config.engine, estimator=setup.name, runs=setup.runs)
        nothing = np.zeros((setup.runs, self.layout.size))
        flat = np.repeat(np.eye(self.layout.size)[np.newaxis], setup.runs, axis=0)
        self.engine, self._tip = make_engine(name, nothing, flat), make_engine(name, nothing, flat)
        self.core = Core(
            self.engine,
            self.layout,
            self._antenna,
            start_variances=self.noise.start_variances,
            gates=config.gates,
            sway_m=config.noise.sway_rad * max(mount_arm(infos[GNSS], setup)[2], 0.0),
            sway_s=config.noise.sway_s,
            jump_s=self._errors.jump_s,
            drift_s=self._errors.drift_s,
            white_told=self._errors.white_told,
        )
        self._now_ns: int | None = None
        self._tip_ns = 0
        self._accepted_ns = np.zeros(setup.runs, dtype=np.int64)
        self._gated: BoolArray = np.zeros(setup.runs, dtype=np.bool_)
        """(R,) whether a fix was refused since the last output."""
        self._waiting: list[Fix] = []
        nis = [*(("nis_velocity",) if config.velocity else ()), *(("nis_steering",) if steering else ())]
        extra = ("relative_sigma_e_m", "relative_sigma_n_m", "mode", "gated")
        self._output = GuidanceOutput(setup.runs, nis=nis, extra=extra)
        self.columns = self._output.columns

    # --- what it is told of its sensors ------------------------------------------------------------------------------

    def _build_inputs(self, infos: dict[str, SensorInfo], setup: EstimatorSetup) -> None:
        config = self._config
        rate = next((infos[kind] for kind in RATE_KINDS if kind in infos), None)
        speed = next((infos[kind] for kind in SPEED_KINDS if kind in infos), None)
        steering = infos.get(ANGLE_TRANSDUCER) if config.steering else None
        self._rate = None if rate is None else rate_reader(rate, setup)
        self._speed = (
            None if speed is None else speed_reader(speed, setup, wheel_radius_m=config.wheel_radius_of(setup))
        )
        self._steering = None if steering is None else ColumnReader(steering, setup, STEERING_ANGLE)
        self.inputs = Inputs(
            setup.runs,
            rate=rate is not None,
            speed=speed is not None,
            steering=steering is not None,
            counts=speed is not None and speed.kind in {WHEEL_ENCODERS, ODOMETRY},
        )

    def _rounding_variance(self, span_ns: int) -> float:
        """Of a mean speed over that time: the mean of two counts, each rounded twice."""
        if not isinstance(self._speed, EncoderReader):
            return 0.0
        return (self._speed.slot_m / (span_ns / NS_PER_S)) ** 2 / 12.0

    def _rate_variance(self, span_ns: int) -> float:
        """Of a mean rate of turn over that time."""
        gyro = self.noise.gyro
        return gyro.walk_noise**2 / (span_ns / NS_PER_S) + gyro.rounding**2 if self.layout.has_rate else 0.0

    def _antenna(self, drift_m: FloatArray) -> AntennaSeen:
        return AntennaSeen(self.layout, forward_m=self._arm[0], left_m=self._arm[1], drift_m=drift_m)

    # --- in ----------------------------------------------------------------------------------------------------------

    def process(self, measurement: Measurement) -> None:
        """Take one measurement, in order of arrival."""
        name, inputs = measurement.sensor, self.inputs
        if self._rate is not None and inputs.rate is not None and name == self._rate.name:
            inputs.rate.add(self._rate.read(measurement))
        if self._speed is not None and inputs.speed is not None and name == self._speed.name:
            inputs.speed.add(self._speed.read(measurement))
        if self._steering is not None and inputs.steering is not None and name == self._steering.name:
            inputs.steering.add(self._steering.read(measurement))
        if name == self._receiver.name:
            self._waiting.append(self._receiver.read(measurement))
            self._waiting.sort(key=lambda fix: fix.t_ns)
        self._take_waiting(measurement.t_available_ns)
        inputs.forget(measurement.t_available_ns - _LONGEST_GAP_NS)

    def _take_waiting(self, arrival_ns: int) -> None:
        while self._waiting:
            fix, settled = self._waiting[0], self.inputs.settled_ns
            moved = self.inputs.rate is not None or self.inputs.speed is not None
            behind = settled is None or fix.t_ns - _SILENT_NS <= settled < fix.t_ns
            if moved and behind and arrival_ns <= fix.t_available_ns + _PATIENCE_NS:
                return
            self._take(self._waiting.pop(0))

    def _take(self, fix: Fix) -> None:
        dt_s = 1.0 / self._receiver.info.rate_hz
        if self._now_ns is None:
            self._now_ns = fix.t_ns
        elif fix.t_ns <= self._now_ns:
            return
        else:
            dt_s = (fix.t_ns - self._now_ns) / NS_PER_S
            if fix.t_ns - self._now_ns > _LONGEST_GAP_NS:
                self.core.started[:] = False
            else:
                self._advance(self.engine, self._now_ns, fix.t_ns)
        span = self.inputs.span(fix.t_ns - round(min(dt_s, 1.0) * NS_PER_S), fix.t_ns)
        self._now_ns = fix.t_ns
        self._hear_machine(span)
        short = self.inputs.span(fix.t_ns - _SHORT_NS, fix.t_ns)
        self._hear_fix(fix, short, dt_s)
        self.inputs.forget(fix.t_ns)
        self._tip_ns = fix.t_ns
        self._tip.restore(self.engine.x, self.engine.P)

    def _advance(self, engine: Engine, begin_ns: int, end_ns: int) -> None:
        parts = -((begin_ns - end_ns) // _LONGEST_NS)
        times = [begin_ns + (end_ns - begin_ns) * part // parts for part in range(parts + 1)]
        for first, last in pairwise(times):
            span = self.inputs.span(first, last)
            motion = SpanMotion(
                self.layout,
                self.noise.motion,
                span,
                receiver=self.core.receiver,
                turning=self._velocity.turning(engine.x, span),
            )
            engine.predict(motion, span.rate, span.dt_s)

    def _hear_machine(self, span: Span) -> None:
        """What gyro and steering say beside moving the filter, once per fix."""
        started = self.core.started
        if self.layout.has_rate and span.standing.any():
            variance = self.noise.gyro.standing_variance / span.dt_s
            mask = started & span.standing & span.rate_known
            self.engine.update(
                StandingRate(self.layout), span.rate[:, np.newaxis], mask, np.full((self._runs, 1), variance)
            )
        if self.layout.steering is None:
            return
        speed = np.abs(span.speed) if self.layout.has_speed else np.abs(self.engine.x[:, V])
        mask = started & span.steering_known & ~span.standing & (speed > self._config.course_from_m_s)
        mask &= span.rate_known | (not self.layout.has_rate)
        bend = 1.0 + np.square(np.tan(np.clip(span.steering, -1.2, 1.2)))
        loose = np.square(self._config.noise.steering_rad * bend * speed / self._wheelbase_m)
        loose *= max(self._config.noise.steering_s / span.dt_s, 1.0)  # the fixes of that time share it
        variance_of = (loose + self.noise.gyro.walk_noise**2 / span.dt_s)[:, np.newaxis]
        seen = AboutState(SteeredRate(self.layout, span, wheelbase_m=self._wheelbase_m), self.engine.x)
        rate = span.rate[:, np.newaxis]
        nis = update_robustly(self.engine, seen, rate, mask, variance_of, gate_sigmas=self._config.gates.sigmas)
        self._output.news.put("nis_steering", nis, mask)

    def _hear_fix(self, fix: Fix, span: Span, dt_s: float) -> None:
        core, there = self.core, fix.there
        error = self._errors.of(fix)
        way_speed, course = self._motion.of(fix)
        fast = np.nan_to_num(way_speed) >= max(self._config.course_from_m_s, 3.0 * self._velocity.sigma_m_s)
        fast &= np.isfinite(course)
        heading = np.where(fast & ~np.isfinite(self._start_heading), course, self._start_heading)
        beginning = there & np.isfinite(heading) & ~core.started
        core.begin(
            fix, error, np.nan_to_num(heading), beginning, self._errors.resolution_m, speed=way_speed, keep=~beginning
        )
        going = there & core.started & ~beginning
        self._orient(going & fast, way_speed, course)
        if self._config.velocity:
            if not self.layout.has_rate:
                self._velocity.may_have_turned(self.engine, fix, error.dilution, span, dt_s=dt_s, mask=going)
            heard = self._velocity.hear(self.engine, fix, error.dilution, span, mask=core.started & there)
            self._output.news.put("nis_velocity", *heard)
        x = self.engine.x
        speed = span.speed + x[:, V]
        speeds = np.stack([speed * np.cos(x[:, PSI]), speed * np.sin(x[:, PSI])], axis=-1)
        white = core.white_variances(error, speeds, self._errors.resolution_m, min(dt_s, 1.0))
        moves_by_itself = span.speed_known | (np.isfinite(fix.speed) & self._config.velocity)
        y, nis, taken, lost = core.hear(fix, error, white, going, may_jump=moves_by_itself)
        self._output.news.put_position(y, nis, going)
        self._gated = self._gated | (going & core.doubting)
        core.anchor_better(error, taken)
        wrong = taken & core.lost(error)
        ahead = np.where(fast, course, self.engine.x[:, PSI])
        again = lost | wrong
        core.begin(fix, error, ahead, again, self._errors.resolution_m, speed=way_speed, keep=lost)
        self._accepted_ns = np.where(taken | beginning | again, fix.t_ns, self._accepted_ns)

    def _orient(self, mask: BoolArray, speed: FloatArray, course: FloatArray) -> None:
        """Where the heading is as good as unknown, take the course for it: there is nothing to linearise about."""
        mask = mask & (self.engine.P[:, PSI, PSI] > _UNORIENTED_RAD**2)
        if not mask.any():
            return
        x, P = self.engine.x.copy(), self.engine.P.copy()
        places = [(PSI, course, 0.5 * _UNORIENTED_RAD)] + ([] if self.layout.has_speed else [(V, speed, 1.0)])
        for place, value, sigma in places:
            x[mask, place] = value[mask]
            P[mask, place, :] = P[mask, :, place] = 0.0
            P[mask, place, place] = sigma**2
        self.engine.restore(x, P)

    # --- out ---------------------------------------------------------------------------------------------------------

    def estimate(self, t_ns: int) -> Estimate:
        """Return the estimate at ``t_ns``."""
        self._take_waiting(t_ns)
        self.inputs.forget(t_ns - _LONGEST_GAP_NS)
        if self._now_ns is None or t_ns - self._now_ns > _LONGEST_GAP_NS:
            nothing = np.full((self._runs, 4), np.nan)
            extra = np.column_stack([nothing[:, :2], np.zeros((self._runs, 2))])
            return self._output.estimate(t_ns, nothing, np.full((self._runs, 4, 4), np.nan), extra=extra)
        begin_ns = self._tip_ns
        settled = min(max(self.inputs.settled_ns or t_ns, t_ns - _SILENT_NS), t_ns)
        if settled > begin_ns:
            self._advance(self._tip, begin_ns, settled)
            begin_ns = self._tip_ns = settled
        x, P = self._tip.x, self._tip.P
        if t_ns > begin_ns:
            self._advance(self._tip, begin_ns, t_ns)
            (x, P), back = (self._tip.x, self._tip.P), (x, P)
            self._tip.restore(*back)
        return self._tell(t_ns, x, P)

    def _changing(self, t_ns: int) -> FloatArray:
        """Variance (R,) of a told speed that is a mean while the speed changes: what it changed by, beyond rounding."""
        half_ns = _SPEED_NS // 2
        before, after = self.inputs.span(t_ns - 2 * half_ns, t_ns - half_ns), self.inputs.span(t_ns - half_ns, t_ns)
        changed = np.square(after.speed - before.speed)
        rounding = 2.0 * self._rounding_variance(half_ns)
        return np.where(changed > _UNUSUAL_SIGMAS**2 * rounding, changed, 0.0)

    def _tell(self, t_ns: int, x: FloatArray, P: FloatArray) -> Estimate:
        layout = self.layout
        span = self.inputs.span(t_ns - _SPEED_NS, t_ns)
        state, covariance, alike = told_state(
            np.ascontiguousarray(x), np.ascontiguousarray(P), layout.places, span.speed, span.standing
        )
        covariance[:, 3, 3] += np.where(span.standing, 0.0, self._rounding_variance(_SPEED_NS))
        covariance[:, 3, 3] += self._changing(t_ns)
        for place, of, change in (
            (3, self.inputs.speed, _SPEED_CHANGE_M_S2),
            (2, self.inputs.rate, _TURN_CHANGE_RAD_S),
        ):
            age_s = 0.0 if of is None or of.newest_ns is None else max(t_ns - of.newest_ns, 0) / NS_PER_S
            covariance[:, place, place] += (change * age_s) ** 2
        state, covariance = transported(state, covariance, self._reference_x_m, 0.0)
        coasting = t_ns - self._accepted_ns > round(self._config.coasting_s * NS_PER_S)
        mode = np.where(self.core.doubting, 3.0, np.where(coasting, 2.0, 1.0))
        unknown = ~self.core.started
        if unknown.any():
            state[unknown], covariance[unknown], alike[unknown], mode[unknown] = np.nan, np.nan, np.nan, 0.0
        extra = np.column_stack([np.sqrt(np.maximum(alike, 0.0)), mode, self._gated])
        self._gated = np.zeros_like(self._gated)
        return self._output.estimate(t_ns, state, covariance, extra=extra)
