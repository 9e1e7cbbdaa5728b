"""Heading filters over a recorded motion with optical truth: enters the house at the measurements, without a world.

The filters are told what the owner of the instrument could tell them and nothing else: parameters are the paper's, or
our defaults; the sensors' noise is what they show in the first ten seconds, in which every trial of BROAD lies still
(it has no data sheet); the gyroscope's offset for the paper's filters is the mean of those ten seconds (chapter 3).
Nothing is taken from the optical truth, and nothing was tuned to these recordings.

An orientation is what a filter's roll, pitch and heading columns say. A filter that gives a heading only is scored by
its heading, the optical roll and pitch taken for its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from twin.errors import BadInputError
from twin.estimation import EstimatorFactory
from twin.estimators import build_estimator
from twin.estimators.heading_complementary import HeadingComplementaryConfig
from twin.estimators.heading_filter import HeadingFilterConfig
from twin.estimators.heading_inputs import FIELD_COLUMNS, MAGNETOMETER
from twin.estimators.heading_kalman import HeadingKalmanConfig
from twin.estimators.heading_madgwick import HeadingMadgwickConfig
from twin.estimators.heading_preparation import PreparationConfig
from twin.estimators.roles import IMU, INERTIAL_COLUMNS
from twin.formats.broad import BroadTrial
from twin.geometry import rotation_from_quaternion, rpy_from_rotation, wrap_angle
from twin.scoring.orientation import OrientationErrors, multiply, orientation_errors
from twin.signals import HEADING, BoolArray, Estimator, EstimatorSetup, FloatArray, Measurement, Mount, SensorInfo

STANDSTILL_S = 10.0
SENSORS = (IMU, MAGNETOMETER)
_BODY = "instrument"
_CALIBRATED = PreparationConfig(standstill_s=STANDSTILL_S, accelerometer_offset=False)
_COMMON: dict[str, Any] = {"sensors": SENSORS, "heading_reference": "magnetic_north"}
NEEDS_WHEELS = ("kalman_odometry_gyro", "kalman_odometry_gyro_mag")
"""The two of the paper's six filters that an instrument without wheels cannot feed."""


def filters() -> dict[str, Any]:
    """Configuration of every filter that an inertial unit and a magnetometer can feed: the paper's, then ours."""
    paper = _COMMON | {"preparation": _CALIBRATED}
    return {
        "complementary": HeadingComplementaryConfig(kind="heading_complementary", **paper),
        "complementary_corrected": HeadingComplementaryConfig(
            kind="heading_complementary", variant="corrected", **paper
        ),
        "madgwick_published": HeadingMadgwickConfig(kind="heading_madgwick", variant="published", **paper),
        "madgwick": HeadingMadgwickConfig(kind="heading_madgwick", **paper),
        "kalman_imu": HeadingKalmanConfig(kind="heading_kalman", inputs="imu", **paper),
        "kalman_imu_corrected": HeadingKalmanConfig(kind="heading_kalman", inputs="imu", variant="corrected", **paper),
        "integrated_kalman": HeadingKalmanConfig(kind="heading_kalman", inputs="integrated", **paper),
        "heading_filter": HeadingFilterConfig(kind="heading_filter", **_COMMON),
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialResult:
    """What a filter was worth in a trial."""

    name: str
    errors: OrientationErrors
    mean_sigma_deg: float
    """Root mean square of the sigma claimed for the heading over the scored samples; NaN where none is."""


def replay_trial(
    trial: BroadTrial,
    *,
    names: Callable[[str], bool] = lambda _: True,
    plugins: Mapping[str, EstimatorFactory] | None = None,
) -> Iterator[TrialResult]:
    """Run the filters (those whose ``names`` says yes), then the plug-ins, over a trial; one result after the other.

    Raises:
        BadInputError: an estimator gives no heading, or cannot work with the two sensors.
    """
    for name, config in filters().items():
        if names(name):
            yield _result(name, build_estimator(config, trial_setup(name, trial)), trial)
    for name, factory in (plugins or {}).items():
        yield _result(name, factory(trial_setup(name, trial)), trial)


def vqf_result(trial: BroadTrial) -> TrialResult | None:
    """The same of VQF (Laidig and Seel 2023), the state of the art on BROAD; None where it is not installed."""
    try:
        from vqf import VQF  # noqa: PLC0415  (not a dependency: for comparison only)
    except ImportError:
        return None
    arrays = [np.ascontiguousarray(each) for each in (trial.rate_rad_s, trial.force_m_s2, trial.field_ut)]
    found = VQF(trial.step_s).updateBatch(*arrays)["quat9D"]
    errors = orientation_errors(np.roll(found, -1, axis=1), trial.orientation, trial.movement)
    return TrialResult(name="vqf", errors=errors, mean_sigma_deg=float("nan"))


def trial_setup(name: str, trial: BroadTrial) -> EstimatorSetup:
    """What an estimator is told: the two sensors in body axes, with the noise of the first ten seconds."""
    count = max(2, round(STANDSTILL_S / trial.step_s))
    mount = Mount(body=_BODY, xyz_m=(0.0, 0.0, 0.0))
    sheets = {
        IMU: {
            "accel_noise_m_s2": _spread(trial.force_m_s2[:count]),
            "gyro_noise_rad_s": _spread(trial.rate_rad_s[:count]),
        },
        MAGNETOMETER: {"mag_noise_ut": _spread(trial.field_ut[:count])},
    }
    columns = {IMU: INERTIAL_COLUMNS, MAGNETOMETER: FIELD_COLUMNS}
    infos = {
        kind: SensorInfo(
            name=kind,
            kind=kind,
            columns=columns[kind],
            mount=mount,
            rate_hz=trial.rate_hz,
            datasheet=sheets[kind],
        )
        for kind in SENSORS
    }
    return EstimatorSetup(
        name=name, runs=1, sensors=infos, reference=mount, rows_y_m=(), start_e_n_heading=(0.0, 0.0, 0.0)
    )


def trial_measurements(trial: BroadTrial) -> Iterator[tuple[int, list[Measurement]]]:
    """Time, and the two measurements of each sample; sample k is about the interval that ends at k + 1 steps."""
    inertial = np.concatenate([trial.force_m_s2, trial.rate_rad_s], axis=1)[:, np.newaxis]
    field, valid = trial.field_ut[:, np.newaxis], np.ones(1, dtype=np.bool_)
    for index in range(len(inertial)):
        t_ns = (index + 1) * trial.step_ns
        yield (
            t_ns,
            [
                _measurement(IMU, t_ns, INERTIAL_COLUMNS, inertial[index], valid),
                _measurement(MAGNETOMETER, t_ns, FIELD_COLUMNS, field[index], valid),
            ],
        )


def _measurement(sensor: str, t_ns: int, columns: tuple[str, ...], values: FloatArray, valid: BoolArray) -> Measurement:
    return Measurement(sensor=sensor, t_ns=t_ns, t_available_ns=t_ns, columns=columns, values=values, valid=valid)


def _spread(readings: FloatArray) -> float:
    """Standard deviation of a sample, the axes taken together."""
    return float(np.sqrt(np.mean(np.var(readings, axis=0))))


def _result(name: str, estimator: Estimator, trial: BroadTrial) -> TrialResult:
    if HEADING not in estimator.columns:
        raise BadInputError(f"{name}: gives no {HEADING}; it gives {', '.join(estimator.columns)}")
    wanted = [HEADING, *(each for each in ("roll_rad", "pitch_rad") if each in estimator.columns)]
    places = [estimator.columns.index(each) for each in wanted]
    said = np.empty((len(trial.movement), len(places)))
    sigma = np.empty(len(trial.movement))
    for index, (t_ns, measurements) in enumerate(trial_measurements(trial)):
        for measurement in measurements:
            estimator.process(measurement)
        estimate = estimator.estimate(t_ns)
        said[index], sigma[index] = estimate.values[0, places], estimate.sigmas[0, places[0]]
    tilted = len(places) == 3
    estimated = _orientation(said) if tilted else _with_optical_tilt(said[:, 0], trial.orientation)
    errors = orientation_errors(estimated, trial.orientation, trial.movement)
    if not tilted:
        nan = float("nan")
        errors = OrientationErrors(
            total_deg=nan,
            heading_deg=errors.heading_deg,
            inclination_deg=nan,
            relative_heading_deg=errors.relative_heading_deg,
            samples=errors.samples,
        )
    claimed = float(np.rad2deg(np.sqrt(np.mean(np.square(sigma[trial.movement])))))
    return TrialResult(name=name, errors=errors, mean_sigma_deg=claimed)


def _orientation(said: FloatArray) -> FloatArray:
    """Quaternions (N, 4) of heading, roll and pitch (N, 3)."""
    none = np.zeros(len(said))
    halves = [0.5 * said[:, place] for place in range(3)]
    yaw = np.stack([none, none, np.sin(halves[0]), np.cos(halves[0])], axis=-1)
    roll = np.stack([np.sin(halves[1]), none, none, np.cos(halves[1])], axis=-1)
    pitch = np.stack([none, np.sin(halves[2]), none, np.cos(halves[2])], axis=-1)
    return multiply(yaw, multiply(pitch, roll))


def _with_optical_tilt(heading: FloatArray, optical: FloatArray) -> FloatArray:
    """The optical orientation (N, 4) turned about the vertical to this heading (N,)."""
    known = np.logical_and.reduce(np.isfinite(optical), axis=1)
    safe = np.where(known[:, np.newaxis], optical, np.array([0.0, 0.0, 0.0, 1.0]))
    half = 0.5 * wrap_angle(heading - rpy_from_rotation(rotation_from_quaternion(safe))[2])
    none = np.zeros(len(heading))
    turned = multiply(np.stack([none, none, np.sin(half), np.cos(half)], axis=-1), safe)
    return np.where(known[:, np.newaxis], turned, np.nan)
