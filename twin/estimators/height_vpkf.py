"""The variable-parameter Kalman filter of paper 002, eqs 4 to 14 (kind ``height_vpkf``).

State [height S, vertical speed S'], input the upward free acceleration a, measurement the GNSS height z:

    x- = A x + B a,    P- = A P A^T + Q,    K = P- H^T (H P- H^T + R)^-1,    x = x- + K (z - H x-),    P = (I - K H) P-

with A = [[1, T], [0, 1]], B = [T^2 / 2, T]^T, H = [1, 0]. R is fixed, Q changes with what the receiver says (eq 14).

**As in the paper.** A computer samples everything at the AHRS's rate (50 Hz): each step takes the newest acceleration
and the newest height that have *arrived*, and the height, told at 10 Hz, is used as a new measurement in five steps,
errors and all. What is late counts as current, what is missing is what came last (quality and age too: a receiver that
falls silent in RTK stays in RTK). P is carried over when Q changes: nothing in the paper says otherwise.

**Q.** ``q_good`` (Q1) where corrections are good, ``q_lost`` (Q2) elsewhere, times the identity, per step. On the rail
4e-7 and 4e-13, in the field 4.2e-4 and 4e-13. Eq 14 is garbled. ``switch``:

* ``"age"``: Q1 if QI = 4 and the age of corrections is at most 4 s, else Q2, as section 2.1 has it;
* ``"quality"``: Q1 for every QI = 4, Q2 for others, the other way to read the brackets;
* ``"never"``: always Q1: a Kalman filter with fixed parameters.

None holds 30 mm for 28 s without corrections: with Q2 the gain does not drop to where Q2 has it, it decays from that of
Q1, and a height that is half a metre off still goes in 50 times a second. ``coast`` is **not in the paper**:

* ``"never"``: an update in every step, as published;
* ``"quality"``: none where QI is not 4;
* ``"age"``: none where QI is not 4 or the corrections are older than ``switch_age_s``.

**Units.** R = 1.88e-2 is the GNSS receiver's RMSE in metres, put where its square belongs; states are in millimetres in
the text. Gains hang on Q / R only, and that has no unit of length as long as Q and R have the same: read in m^2 or in
mm^2 the filter is one and the same. So it is computed in metres. Steady gains follow from w = (Q / (R T^2))^(1/4), the
filter's natural frequency: 0.48 rad/s with Q1 (error poles of 2.8 s), 0.015 rad/s with Q2 (93 s), 2.7 rad/s with the
field's Q1. Mixed units would not do: Q1 in mm^2 over R in m^2 is Q2 over R, a filter of 93 s with the best of
corrections, and with R the square of 18.8 mm the rail's filter would be 2.7 times as fast as it is.
P is the filter's own belief, and the sigmas reported are its roots: 16 mm with Q1, which is of the right size by
chance, and on the way to 2.8 mm with Q2, when the height is worst.

**I.** "I = [1 1]^T is the unit vector" is read as the identity matrix. The program the paper names (Matlab 2016b) is
the first to take [1 1]^T - K H without complaint, as a matrix whose second column is 1. P then grows without bound,
the gain goes to [1, 0.99] and the filter repeats GNSS. The paper's figures show no such thing, so there is no option
for it.

**Left open by the paper.** Eq 15 starts at [0, 0], the height of GNSS then being the zero: here the filter starts,
standing, at the first height told, which is 0 with ``zero = "start"``. P0 is diag(R, Q1): a height as good as GNSS, a
speed as sure as one step leaves it; 10 s later next to nothing is left of it. The acceleration of step k - 1 is used in
step k (eq 9): ``input = "previous"``. An AHRS that gives the mean over the interval before, as an MTi does, is thus a
step late; ``input = "current"`` takes the newest. Preparation: :mod:`twin.estimators.height_preparation`.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from twin.config import NonNegative, Positive
from twin.errors import BadInputError
from twin.estimators.engines import EngineName, make_engine
from twin.estimators.height_preparation import HeightPreparation, HeightPreparationConfig
from twin.estimators.held_height import AHRS, FREE_ACCELERATION_UP, HeightConfig, HeldHeight, the_sensors
from twin.estimators.roles import GNSS, column_places, usable
from twin.fix_quality import RTK_FIXED
from twin.signals import HEIGHT, NS_PER_S, VELOCITY, BoolArray, Estimate, EstimatorSetup, FloatArray, Measurement

KIND = "height_vpkf"
MODE = "mode"
GOOD, LOST, COASTING = 2.0, 1.0, 0.0
"""Modes: an update with Q1 in force, with Q2, and no update."""

_SIZE = 2


class HeightVpkfConfig(HeightConfig):
    """Options of :class:`HeightVpkf`; the defaults are the paper's on the rail."""

    kind: Literal["height_vpkf"]
    q_good: Positive = 4e-7
    """Q1 / I, added per step: m^2 and (m/s)^2. In the field 4.2e-4."""
    q_lost: Positive = 4e-13
    """Q2 / I."""
    r: Positive = 1.88e-2
    """R, m^2."""
    switch: Literal["age", "quality", "never"] = "age"
    """How eq 14 is read."""
    switch_age_s: NonNegative = 4.0
    """Corrections that are older count as lost."""
    coast: Literal["never", "quality", "age"] = "never"
    """When heights are not used."""
    input: Literal["previous", "current"] = "previous"
    """The step whose acceleration moves the state on."""
    engine: Literal["auto", "filterpy", "ensemble"] = "auto"
    """Kalman engine; auto: filterpy for a single run."""
    preparation: HeightPreparationConfig = HeightPreparationConfig()
    """What is done to the free acceleration first."""


class VerticalMotion:
    """Eqs 4 to 7: a point that is accelerated upwards; Q (R, 2, 2) is put in before each step."""

    def __init__(self, step_s: float, runs: int) -> None:
        self._step_s = step_s
        transition = np.array([[1.0, step_s], [0.0, 1.0]])
        self._F: FloatArray = np.repeat(transition[:, :, np.newaxis], runs, axis=2).transpose(2, 0, 1)
        self.variance: FloatArray = np.zeros((runs, _SIZE, _SIZE))

    def linearise(self, x: FloatArray, u: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """The state after one step under the acceleration ``u`` (R,), and A for all members."""
        moved = np.empty((_SIZE, len(x)))
        moved[0] = x[:, 0] + x[:, 1] * dt_s + 0.5 * u * dt_s**2
        moved[1] = x[:, 1] + u * dt_s
        return moved.T, self._F

    def Q(self, dt_s: float) -> FloatArray:  # noqa: ARG002, N802
        """Process noise of one step, (R, 2, 2); the paper's is per step, whatever it lasts."""
        return self.variance


class HeightSeen:
    """Eq 8: the height."""

    def __init__(self, variance: float, runs: int) -> None:
        self.R: FloatArray = np.array([variance])
        self._H: FloatArray = np.repeat(np.array([[1.0], [0.0]])[:, :, np.newaxis], runs, axis=2).transpose(2, 1, 0)

    def h(self, x: FloatArray) -> FloatArray:
        """Expected height (R, 1)."""
        return x[:, :1]

    def H(self, x: FloatArray) -> FloatArray:  # noqa: ARG002, N802
        """H for all members, (R, 1, 2)."""
        return self._H


class HeightVpkf:
    """Estimator of :class:`HeightVpkfConfig`.

    Columns: ``height_m``, ``velocity_u_m_s`` with the filter's own sigmas and covariance, NaN before the first height
    of GNSS; and ``mode``: 2 where Q1 is in force, 1 where Q2 is, 0 where heights are not used.

    Raises:
        BadInputError: not exactly one GNSS receiver and one AHRS, a sensor that lacks a column, an antenna on another
            body than the reference frame, or the filterpy engine with more than one run.
    """

    columns: tuple[str, ...] = (HEIGHT, VELOCITY[2], MODE)
    state_columns: tuple[str, ...] = (HEIGHT, VELOCITY[2])

    def __init__(self, config: HeightVpkfConfig, setup: EstimatorSetup) -> None:
        if config.engine == "filterpy" and setup.runs > 1:
            raise BadInputError(
                f"[estimators.{setup.name}] engine = 'filterpy': steps one run, not {setup.runs};"
                " allowed: auto, ensemble"
            )
        infos, runs = the_sensors(setup, (GNSS, AHRS), estimator=KIND), setup.runs
        self._config = config
        self._held = HeldHeight(infos[GNSS], setup, config)
        self._ahrs = infos[AHRS].name
        self._place = column_places(infos[AHRS], (FREE_ACCELERATION_UP,), setup=setup)
        self._preparation = HeightPreparation(
            config.preparation, noise_m_s2=infos[AHRS].datasheet.get("free_accel_noise_m_s2", 0.0), runs=runs
        )
        self._step_ns = round(NS_PER_S / infos[AHRS].rate_hz)
        self._next: int | None = None
        """Number of the step that is due."""
        self._motion = VerticalMotion(self._step_ns / NS_PER_S, runs)
        self._height = HeightSeen(config.r, runs)
        self._start_covariance: FloatArray = np.tile(np.diag([config.r, config.q_good]), (runs, 1, 1))
        name: EngineName = "filterpy" if runs == 1 else "ensemble"
        if config.engine != "auto":
            name = config.engine
        self._engine = make_engine(name, np.zeros((runs, _SIZE)), self._start_covariance)
        self._started: BoolArray = np.zeros(runs, dtype=np.bool_)
        self._previous: FloatArray = np.zeros(runs)
        self._mode: FloatArray = np.full(runs, COASTING)

    # --- in ----------------------------------------------------------------------------------------------------------

    def process(self, measurement: Measurement) -> None:
        """Take one measurement, in order of arrival; the steps that were due before it come first."""
        self._step_until(measurement.t_available_ns - 1)
        if measurement.sensor == self._held.sensor:
            self._held.take(measurement)
        elif measurement.sensor == self._ahrs:
            sample = measurement.values[:, self._place]
            self._preparation.take(measurement.t_ns, sample[:, 0], usable(measurement, sample))

    def _step_until(self, t_ns: int) -> None:
        last = t_ns // self._step_ns
        if self._next is None:
            self._next = last + 1
        for _ in range(self._next, last + 1):
            self._step()
        self._next = max(self._next, last + 1)

    def _step(self) -> None:
        held, newest = self._held, self._preparation.acceleration
        good, used = self._judge()
        q = np.where(good, self._config.q_good, self._config.q_lost)
        self._motion.variance = np.zeros((_SIZE, _SIZE, len(q))).transpose(2, 0, 1)
        for state in range(_SIZE):
            self._motion.variance[:, state, state] = q
        accelerated = newest if self._config.input == "current" else self._previous
        self._engine.predict(self._motion, accelerated, self._step_ns / NS_PER_S)
        self._engine.update(self._height, held.height[:, np.newaxis], used & self._started)
        self._previous = newest
        self._mode = np.where(used, np.where(good, GOOD, LOST), COASTING)
        begins = held.known & ~self._started
        if begins.any():
            self._begin(begins)

    def _judge(self) -> tuple[BoolArray, BoolArray]:
        """Where Q1 is in force (eq 14) and where the height is used, (R,) each."""
        config, held = self._config, self._held
        fixed = held.quality == RTK_FIXED
        fresh = fixed & (held.age <= config.switch_age_s)
        every = np.ones_like(fixed)
        good = {"age": fresh, "quality": fixed, "never": every}[config.switch]
        used = {"age": fresh, "quality": fixed, "never": every}[config.coast]
        return good, used & held.known

    def _begin(self, begins: BoolArray) -> None:
        """Start the members that have their first height."""
        start = np.column_stack([self._held.height, np.zeros(len(begins))])
        x = np.where(begins[:, np.newaxis], start, self._engine.x)
        P = np.where(begins[:, np.newaxis, np.newaxis], self._start_covariance, self._engine.P)
        self._engine.restore(x, P)
        self._started = self._started | begins

    # --- out ---------------------------------------------------------------------------------------------------------

    def estimate(self, t_ns: int) -> Estimate:
        """Return the state of the last step until ``t_ns``."""
        self._step_until(t_ns)
        known = self._started[:, np.newaxis]
        x, P = self._engine.x, self._engine.P
        state = np.where(known, x, np.nan)
        sigmas = np.where(known, np.sqrt(np.diagonal(P, axis1=1, axis2=2)), np.nan)
        return Estimate(
            t_ns=t_ns,
            values=np.column_stack([state, self._mode]),
            sigmas=np.column_stack([sigmas, np.full(len(x), np.nan)]),
            covariance=np.where(known[:, np.newaxis], P, np.nan),
        )
