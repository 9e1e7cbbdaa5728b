"""The four Kalman filters of paper 001, sections 4.4 and 4.5 and appendix H (kind ``heading_kalman``).

State [yaw, gyroscope bias]; A = [[1, -dT], [0, 1]], the input is a rate, the measurement a yaw (eqs 55 to 57). What the
input and the measurement are makes the four filters (``inputs``):

====================== ============================== ===========================
``inputs``             rate                           yaw
====================== ============================== ===========================
``imu``                gyroscope                      magnetometer (eq 23)
``odometry_gyro``      gyroscope                      wheel odometry (eq 2)
``odometry_gyro_mag``  gyroscope, and of the          wheel odometry
                       magnetometer for the bias
``integrated``         of the magnetometer (eq 69)    gyroscope, integrated
====================== ============================== ===========================

Q = diag(0.002, 0.005) dT and R = 0.03 (eqs 62 and 63; the dT is appendix H's, eq 62 has none), P_0 = 0.1 I. They are of
degrees and degrees per second; the gain hangs on their ratios only. The sigma reported is the filter's own: not honest,
because nothing in it says that the measured yaw is off for long. R counts per sample: it is made larger at a higher
rate (R 0.02 s / dT), so that a second of samples weighs the same.

**Known of them, as published.** Eq 59 gives the bias state the input w_mag - g_z: times dT it enters the bias with the
wrong sign (the gyroscope's bias is g_z - w) and as if it were a rate of change of the bias; under a held magnet the
deflection itself goes through the bias into the yaw, 0.6 to 1.5 deg (the paper's table 5: 1.09). The code of appendix H
feeds that entry 0: ``bias_input`` is ``"eq_59"`` or ``"appendix_h"``, with which the magnetometer has no say at all and
the filter is ``odometry_gyro``. Eq 50 as printed adds H x to z; the code subtracts it. Table 5 calls the first filter
Kalman IMU. A measured yaw is taken as it is: across +-180 deg, counted from the start, the innovation jumps by a turn;
``variant = "corrected"`` wraps it and levels the field before eq 23 by the accelerometer.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Strict

from twin.config import Positive
from twin.errors import BadInputError
from twin.estimators.engines import EngineName, make_engine
from twin.estimators.heading_base import PaperHeadingConfig, PaperHeadingFilter, level, tilt_of_force
from twin.estimators.heading_inputs import MAGNETOMETER, WHEEL_ENCODERS, HeadingSample
from twin.estimators.roles import IMU
from twin.estimators.wheel_odometry import TRACK_M, WHEEL_RADIUS_M, Odometer
from twin.geometry import wrap_angle
from twin.signals import EstimatorSetup, FloatArray

KIND = "heading_kalman"
_PAPER_STEP_S = 0.02
_SQUARE_DEG = float(np.deg2rad(1.0) ** 2)
_NEEDS = {
    "imu": (IMU, MAGNETOMETER),
    "odometry_gyro": (IMU, WHEEL_ENCODERS),
    "odometry_gyro_mag": (IMU, MAGNETOMETER, WHEEL_ENCODERS),
    "integrated": (IMU, MAGNETOMETER),
}


class HeadingKalmanConfig(PaperHeadingConfig):
    """Options of :class:`HeadingKalman`."""

    kind: Literal["heading_kalman"]
    inputs: Literal["imu", "odometry_gyro", "odometry_gyro_mag", "integrated"]
    """Which of the paper's four filters."""
    bias_input: Literal["eq_59", "appendix_h"] = "eq_59"
    """What drives the bias of ``odometry_gyro_mag``: w_mag - g_z, or 0."""
    variant: Literal["published", "corrected"] = "published"
    process_deg2: Annotated[tuple[Positive, Positive], Strict(strict=False)] = (0.002, 0.005)
    """Diagonal of Q per second, deg^2 and (deg/s)^2."""
    measurement_deg2: Positive = 0.03
    """R of a sample at 50 Hz, deg^2."""
    start_deg2: Positive = 0.1
    """Diagonal of P_0, deg^2 and (deg/s)^2."""
    wheel_radius_m: Positive = WHEEL_RADIUS_M
    track_m: Positive = TRACK_M
    engine: Literal["auto", "filterpy", "ensemble"] = "auto"
    """Kalman engine; auto: filterpy for a single run."""


class YawAndBias:
    """Motion of [yaw, bias], eqs 48, 49, 56 to 59: inputs (R, 2), rad/s and rad/s^2."""

    def __init__(self, process_deg2: tuple[float, float]) -> None:
        self._density = np.diag(process_deg2) * _SQUARE_DEG

    def linearise(self, x: FloatArray, u: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """State after ``dt_s``, (R, 2), and A, (R, 2, 2)."""
        A = np.zeros((len(x), 2, 2))
        A[:, 0, 0] = A[:, 1, 1] = 1.0
        A[:, 0, 1] = -dt_s
        moved = x + dt_s * u
        moved[:, 0] -= dt_s * x[:, 1]
        return moved, A

    def Q(self, dt_s: float) -> FloatArray:  # noqa: N802
        """Process noise (2, 2)."""
        return self._density * dt_s


class YawSeen:
    """The yaw is measured: H = [1 0]."""

    def __init__(self, variance: float) -> None:
        self.R: FloatArray = np.array([variance])
        self._H: FloatArray = np.array([[1.0, 0.0]])

    def h(self, x: FloatArray) -> FloatArray:
        """Expected yaw (R, 1)."""
        return x[:, :1]

    def H(self, x: FloatArray) -> FloatArray:  # noqa: ARG002, N802
        """Jacobian (1, 2)."""
        return self._H


class HeadingKalman(PaperHeadingFilter):
    """Estimator of :class:`HeadingKalmanConfig`; columns: heading, yaw rate, gyroscope bias.

    Raises:
        BadInputError: a sensor that the filter needs is missing, or the filterpy engine with more than one run.
    """

    extra_columns = ("gyro_bias_z_rad_s",)

    def __init__(self, config: HeadingKalmanConfig, setup: EstimatorSetup) -> None:
        needs = _NEEDS[config.inputs]
        super().__init__(config, setup, kind=f"{KIND} ({config.inputs})", needs=needs)
        if config.engine == "filterpy" and setup.runs > 1:
            raise BadInputError(
                f"[estimators.{setup.name}] engine = 'filterpy': steps one run, not {setup.runs};"
                " allowed: auto, ensemble"
            )
        name: EngineName = "filterpy" if setup.runs == 1 else "ensemble"
        if config.engine != "auto":
            name = config.engine
        self._config = config
        start = np.tile(config.start_deg2 * _SQUARE_DEG * np.eye(2), (setup.runs, 1, 1))
        self.engine = make_engine(name, np.zeros((setup.runs, 2)), start)
        self._motion = YawAndBias(config.process_deg2)
        self._seen = YawSeen(config.measurement_deg2 * _SQUARE_DEG)
        self._odometer = None
        if WHEEL_ENCODERS in needs:
            info = self._inputs.infos[WHEEL_ENCODERS]
            self._odometer = Odometer(
                info, wheel_radius_m=config.wheel_radius_m, track_m=config.track_m, runs=setup.runs
            )
        self._offset: FloatArray = np.zeros(setup.runs)
        self._integral: FloatArray = np.zeros(setup.runs)
        self._field: FloatArray | None = None
        self._had_field = np.zeros(setup.runs, dtype=np.bool_)

    def begin_at(self, yaw: FloatArray) -> None:
        """Start from this yaw (R,)."""
        x = self.engine.x.copy()
        x[:, 0] = yaw
        self.engine.restore(x, self.engine.P)
        self._offset = self._integral = yaw

    def step(self, sample: HeadingSample) -> None:
        """Take a prepared sample: predict, then update."""
        field = sample.field
        if self._config.variant == "corrected":
            field = level(field, *tilt_of_force(sample.force))
        if self._odometer is not None:
            self._odometer.step(sample.slots, sample.counted)
        if sample.dt_s == 0.0:
            return
        rate = sample.rate[:, 2]
        inputs = self._config.inputs
        magnetic_rate = self._magnetic_rate(field, sample) if inputs in {"odometry_gyro_mag", "integrated"} else rate
        u = np.zeros((self.runs, 2))
        u[:, 0] = magnetic_rate if inputs == "integrated" else rate
        if inputs == "odometry_gyro_mag" and self._config.bias_input == "eq_59":
            u[:, 1] = magnetic_rate - rate
        self.engine.predict(self._motion, u, sample.dt_s)
        self._integral = self._integral + sample.dt_s * rate
        if self._odometer is not None:
            seen, mask = self._offset + self._odometer.yaw, sample.counted
        elif inputs == "integrated":
            seen, mask = self._integral, sample.inertial
        else:
            seen, mask = self.magnetic_yaw(field, sample.magnetic), sample.magnetic
        if self._config.variant == "corrected":
            now = self.engine.x[:, 0]
            seen = now + wrap_angle(seen - now)
        variance = self._seen.R * (_PAPER_STEP_S / sample.dt_s)
        self.engine.update(self._seen, seen[:, np.newaxis], mask, variance)

    def _magnetic_rate(self, field: FloatArray, sample: HeadingSample) -> FloatArray:
        """Yaw rate (R,) by the change of the field since the last one: eq 69, with the sign of the frame.

        Between fields it is zero, and the whole change falls into the step of the next one: the integral is right.
        """
        before = field if self._field is None else self._field
        x, y = field[:, 0], field[:, 1]
        square = np.maximum(x * x + y * y, 1e-12)
        turned = ((y - before[:, 1]) * x - (x - before[:, 0]) * y) / square
        both = sample.magnetic & self._had_field
        rate = np.where(both, -turned / sample.dt_s, 0.0)
        self._field = np.where(sample.magnetic[:, np.newaxis], field, before)
        self._had_field = self._had_field | sample.magnetic
        return rate

    def yaw(self) -> FloatArray:
        """Yaw (R,), rad."""
        return self.engine.x[:, 0]

    def yaw_sigma(self) -> FloatArray:
        """The filter's own standard deviation of the yaw (R,), rad."""
        return np.sqrt(self.engine.P[:, 0, 0])

    def extra(self) -> FloatArray:
        """Bias (R, 1), rad/s."""
        return self.engine.x[:, 1:]
