"""The position-velocity filter of paper 003 (kind ``guidance_pv``), as published or corrected.

A Kalman filter over [x, y, psi, v] (:mod:`twin.estimators.guidance_pv_model`) that steps with each fix of a consumer
receiver: it predicts (eqs 10, 11) and is corrected (eqs 7 to 9) by position, heading (gyro), speed (encoders; the
paper's index says GPS, but it is the encoders that measure it) and steering angle. Q, R and the first P are those of
eqs 12 to 14; Q is per step of the paper's 1 s, and scales with time for receivers of another rate.

**The zero row** of H (eq 6) makes of the steering angle a measurement of nothing: the fifth column of the gain is zero,
so that x and P are what they are without it. Only a normalised innovation over all five rows would count
delta^2 / 0.025 for it. The published variant keeps the row, the corrected one has none. ``steering_state`` is the
paper's further work: the steering angle as fifth state, a random walk, and a row of H that reads it.

**In turns the filter is closed**: while the steering angle or the rate of turn is beyond a threshold, and until both
have been within for ``straight_s``, position is the receiver's, heading the gyro's, speed the encoders'. In the new row
it starts anew at the first fix there (the paper: "set the initial state variable with changed x and y"), with the first
P; what began the row is not told to the filter a second time. The paper works in coordinates of the row and reverses
the sign of the encoders there; in the twin's fixed axes that is a heading turned by pi. So the published variant starts
from the old row's heading and as many half turns as come nearest to the gyro, the corrected one from the gyro itself.
Without gyro and transducer nothing tells a turn, and the filter is never closed.

**What is known to be wrong with it**, and kept as published: the receiver's error is taken for white noise (2.5 m, new
in each fix) and is a bias of minutes, which the filter follows with a time constant of some 15 s; sigma does not know
it. Phi is no Jacobian. The heading is the gyro's, whose offset nothing corrects. A late fix counts as current; the
corrected variant puts it at its own time.

Between two fixes the state moves on by eq 10. Further column: ``mode`` (0 waiting for a fix, 1 filtering, 2 closed).
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Strict

from twin.config import NonNegative, Positive
from twin.estimators.engines import EngineOption, compiled_unless_told, innovation, make_engine
from twin.estimators.guidance_base import STATE_COLUMNS, GuidanceOutput, SteeredConfig, guidance_sensors, transported
from twin.estimators.guidance_epochs import Epoch, Epochs
from twin.estimators.guidance_pv_model import (
    DELTA,
    PSI,
    Antenna,
    CorrectedMotion,
    PublishedMotion,
    Rows,
    V,
    X,
    Y,
)
from twin.geometry import wrap_angle
from twin.signals import NS_PER_S, BoolArray, Estimate, EstimatorSetup, FloatArray, IntArray, Measurement

KIND = "guidance_pv"
WAITING, FILTERING, CLOSED = 0.0, 1.0, 2.0
_STEP_S = 1.0
"""Of the paper."""
_LONGEST_GAP_S = 10.0
"""After a silence as long as that the filter starts anew."""
_NORTH = 0.5 * np.pi
_FLIP = np.array([1.0, 1.0, -1.0, 1.0])
_FLIPPED = _FLIP[:, np.newaxis] * _FLIP
"""Of a covariance, where the heading is counted the other way round."""

Four = Annotated[tuple[Positive, Positive, Positive, Positive], Strict(strict=False)]
Five = Annotated[tuple[Positive, Positive, Positive, Positive, Positive], Strict(strict=False)]


class GuidancePvConfig(SteeredConfig):
    """Options of :class:`GuidancePv`."""

    kind: Literal["guidance_pv"]
    variant: Literal["published", "corrected"] = "published"
    """Eqs 4 and 6 as printed, or put right."""
    steering_state: bool = False
    """The steering angle as fifth state."""
    engine: EngineOption = "auto"
    """Kalman engine; auto: ensemble, whose compiled loops are quicker for a single run, too."""
    process: Four = (0.033, 0.033, 0.003, 0.0025)
    """Diagonal of Q per second (eq 12): m^2, m^2, rad^2, (m/s)^2."""
    measurement: Five = (6.25, 6.25, 0.25, 0.025, 0.025)
    """Diagonal of R (eq 13): m^2, m^2, rad^2, (m/s)^2, rad^2."""
    initial: Four = (2.0, 2.0, 0.1, 0.01)
    """Diagonal of the first P (eq 14)."""
    steering_process: Positive = 0.01
    """Q of the steering angle per second, rad^2: a driver moves the wheel by 0.1 rad in a second; a choice."""
    steering_initial: Positive = 0.025
    """Its first variance, rad^2: that of its measurement."""
    c: float | None = None
    """Of eq 4; by default the antenna's distance ahead of the rear axle over the wheelbase."""
    turn_steering_rad: Positive = 0.15
    """A larger steering angle is a turn."""
    turn_rate_rad_s: Positive = 0.1
    """A faster rate of turn is a turn."""
    straight_s: NonNegative = 2.0
    """So long after both are back, the new row has begun."""


class GuidancePv:
    """Estimator of :class:`GuidancePvConfig`; columns as in :mod:`twin.estimators.guidance_base`, and ``mode``.

    Raises:
        BadInputError: sensors that do not fit (:func:`~twin.estimators.guidance_base.guidance_sensors`), or the
            filterpy engine with more than one run.
    """

    state_columns: tuple[str, ...] = STATE_COLUMNS

    def __init__(self, config: GuidancePvConfig, setup: EstimatorSetup) -> None:
        infos = guidance_sensors(setup, estimator=KIND)
        self._config, self._runs = config, setup.runs
        self._published = config.variant == "published"
        self._epochs = Epochs(infos, setup, config)
        self._build_model(config, setup)
        name = compiled_unless_told(config.engine, estimator=setup.name, runs=setup.runs)
        start, x = setup.start_e_n_heading[2], np.zeros((setup.runs, self._states))
        self._start_known = bool(np.isfinite(start))
        x[:, PSI] = _NORTH - start if self._start_known else 0.0
        self.engine = make_engine(name, x, self._initial_covariance())
        self._mode = np.full(setup.runs, WAITING)
        self._row_psi = np.full(setup.runs, np.nan)
        self._turned_ns: IntArray = np.full(setup.runs, np.iinfo(np.int64).min, dtype=np.int64)
        self._now_ns: int | None = None
        self._delta = np.zeros(setup.runs)
        extra = ("nis_steering",) if config.steering_state else ()
        self._output = GuidanceOutput(setup.runs, nis=("nis_heading", "nis_speed", *extra), extra=("mode",))
        self.columns = self._output.columns

    def _build_model(self, config: GuidancePvConfig, setup: EstimatorSetup) -> None:
        wheelbase = config.wheelbase_of(setup)
        receiver = self._epochs.receiver
        ahead = receiver.forward_m + setup.reference_x_m
        process = (*config.process, config.steering_process) if config.steering_state else config.process
        states = self._states = len(process)
        R = config.measurement
        self.motion: PublishedMotion | CorrectedMotion
        self._position: Rows | Antenna
        if self._published:
            c = config.c if config.c is not None else (ahead / wheelbase if wheelbase > 0.0 else 0.0)
            self.motion = PublishedMotion(process_variances=process, step_s=_STEP_S, wheelbase_m=wheelbase, c=c)
            self._position = Rows((X, Y), R[:2], states=states)
            self._to_reference = (-receiver.forward_m, -receiver.left_m)
        else:
            self.motion = CorrectedMotion(process_variances=process, step_s=_STEP_S, wheelbase_m=wheelbase)
            self._position = Antenna(R[:2], forward_m=ahead, left_m=receiver.left_m)
            self._to_reference = (setup.reference_x_m, 0.0)
        self._heading = Rows((PSI,), R[2:3], states=states)
        self._speed = Rows((V,), R[3:4], states=states)
        self._steering = None
        if config.steering_state or self._published:
            self._steering = Rows((DELTA if config.steering_state else None,), R[4:], states=states)

    def _initial_covariance(self) -> FloatArray:
        """Eq 14, (R, n, n)."""
        variances = (*self._config.initial, self._config.steering_initial)[: self._states]
        return np.repeat(np.diag(variances)[np.newaxis], self._runs, axis=0)

    # --- in ----------------------------------------------------------------------------------------------------------

    def process(self, measurement: Measurement) -> None:
        """Take one measurement, in order of arrival."""
        for epoch in self._epochs.add(measurement):
            self._step(epoch)

    def _step(self, epoch: Epoch) -> None:
        t_ns = epoch.fix.t_available_ns if self._published else epoch.fix.t_ns
        if self._now_ns is not None and t_ns <= self._now_ns:
            return  # overtaken, or a repeat
        if self._now_ns is not None:
            dt_s = (t_ns - self._now_ns) / NS_PER_S
            if dt_s > _LONGEST_GAP_S:
                self._mode[:] = WAITING
            else:
                self.engine.predict(self.motion, self._delta, dt_s)
        self._now_ns = t_ns
        self._delta = -epoch.steering  # of the next step: eq 10 has Phi(k)
        z = np.column_stack([epoch.fix.position, _NORTH - epoch.heading, epoch.speed, self._delta])
        begun = self._change_modes(epoch, z)
        self._update(epoch, z, (self._mode == FILTERING) & ~begun)

    def _change_modes(self, epoch: Epoch, z: FloatArray) -> BoolArray:
        """Close, begin or go on; return which members (R,) begin a row with this epoch."""
        config, now_ns, there = self._config, epoch.fix.t_available_ns, epoch.fix.there
        turning = (np.abs(epoch.steering) > config.turn_steering_rad) | (np.abs(epoch.rate) > config.turn_rate_rad_s)
        if not turning.any() and (self._mode == FILTERING).all():
            return turning  # none of them
        self._turned_ns = np.where(turning, now_ns, self._turned_ns)
        straight = ~turning & (self._turned_ns <= now_ns - round(config.straight_s * NS_PER_S))
        waiting = self._mode == WAITING
        oriented = epoch.heading_known | ~waiting | self._start_known
        starting: BoolArray = straight & (self._mode != FILTERING) & there & oriented
        closing = turning & (self._mode == FILTERING)
        self._row_psi = np.where(closing, self.engine.x[:, PSI], self._row_psi)
        begun_in_turn = waiting & ~straight & there & oriented
        self._mode = np.where(closing | begun_in_turn, CLOSED, self._mode)
        self._pass_on(z, epoch, (self._mode == CLOSED) | starting)
        self._start(starting, epoch.heading_known)
        self._mode = np.where(starting, FILTERING, self._mode)
        return starting

    def _pass_on(self, z: FloatArray, epoch: Epoch, mask: BoolArray) -> None:
        """Take what the sensors say for the state; corrected, the position is the antenna's less its arm."""
        if not mask.any():
            return
        if isinstance(self._position, Antenna):
            turned = self.engine.x.copy()
            turned[:, PSI] = np.where(epoch.heading_known, z[:, PSI], turned[:, PSI])
            z = z.copy()
            z[:, :2] -= self._position.arm(turned)
        there = epoch.fix.there
        known = np.column_stack([there, there, epoch.heading_known, epoch.speed_known, epoch.steering_known])
        taken = (known & mask[:, np.newaxis])[:, : self._states]
        x = np.where(taken, z[:, : self._states], self.engine.x)
        R = np.diag(self._config.measurement[: self._states])
        P = np.where(mask[:, np.newaxis, np.newaxis], R, self.engine.P)
        self.engine.restore(x, P)

    def _start(self, mask: BoolArray, heading_known: BoolArray) -> None:
        """The new row: P of eq 14; as published with the old row's heading, turned by half turns."""
        if not mask.any():
            return
        x, P = self.engine.x.copy(), self.engine.P
        if self._published:
            half_turns = np.where(heading_known, np.round((x[:, PSI] - self._row_psi) / np.pi), 0.0)
            turned = self._row_psi + np.pi * half_turns
            x[:, PSI] = np.where(mask & np.isfinite(turned), turned, x[:, PSI])
        self.engine.restore(x, np.where(mask[:, np.newaxis, np.newaxis], self._initial_covariance(), P))

    def _update(self, epoch: Epoch, z: FloatArray, on: BoolArray) -> None:
        """Eqs 7 to 9: R is diagonal, so row after row about the same expectation is the joint update."""
        news, engine = self._output.news, self.engine
        z = z.copy()
        z[:, PSI] = engine.x[:, PSI] + wrap_angle(z[:, PSI] - engine.x[:, PSI])
        before = innovation(engine, self._position, z[:, :2])
        mask = on & epoch.fix.there
        news.put_position(before.y, before.nis, mask)
        engine.update(self._position, z[:, :2], mask)
        news.put("nis_heading", engine.update(self._heading, z[:, PSI : PSI + 1], on & epoch.heading_known))
        news.put("nis_speed", engine.update(self._speed, z[:, V : V + 1], on & epoch.speed_known))
        if self._steering is not None:
            nis = engine.update(self._steering, z[:, DELTA:], on & epoch.steering_known)
            if self._states > DELTA:
                news.put("nis_steering", nis)

    # --- out ---------------------------------------------------------------------------------------------------------

    def estimate(self, t_ns: int) -> Estimate:
        """Return the estimate at ``t_ns``: the state after the last fix, moved on by eqs 10 and 11."""
        for epoch in self._epochs.close(t_ns):
            self._step(epoch)
        x, P = self._ahead(t_ns)
        state = x[:, : V + 1].copy()
        state[:, 2] = _NORTH - state[:, 2]
        if self._epochs.sums_rates:
            closed = (self._mode == CLOSED) & np.isfinite(self._epochs.heading)
            state[:, 2] = np.where(closed, self._epochs.heading, state[:, 2])
        covariance = P[:, :4, :4] * _FLIPPED
        state, covariance = transported(state, covariance, *self._to_reference)
        nothing = self._mode == WAITING
        if nothing.any():
            state[nothing], covariance[nothing] = np.nan, np.nan
        return self._output.estimate(t_ns, state, covariance, extra=self._mode[:, np.newaxis])

    def _ahead(self, t_ns: int) -> tuple[FloatArray, FloatArray]:
        x, P = self.engine.x, self.engine.P
        if self._now_ns is None or t_ns <= self._now_ns:
            return x, P
        dt_s = min((t_ns - self._now_ns) / NS_PER_S, _LONGEST_GAP_S)
        moved, F = self.motion.linearise(x, self._delta, dt_s)
        on = self._mode == FILTERING
        P_moved = np.einsum("rik,rjk->rij", np.einsum("rij,rjk->rik", F, P), F) + self.motion.Q(dt_s)
        return np.where(on[:, np.newaxis], moved, x), np.where(on[:, np.newaxis, np.newaxis], P_moved, P)
