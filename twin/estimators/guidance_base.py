"""What guidance filters share: which sensors they listen to, what they tell.

A guidance filter tells where the setup's reference frame is, where it heads and how fast it moves. Columns: position
east and north, heading, speed; then ``innovation_e_m``, ``innovation_n_m``, ``nis_position`` and whatever other
normalised innovations a filter has, each NaN at an output before which there was no such update since the last one.

**Nothing but a receiver is needed**; what else a filter is given it uses. A sensor that is not there, and one that
fails, is replaced as far as the receiver's own course and speed can. Where the owner does not know the heading at the
start (NaN in the setup's start pose) it is taken from the first course.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.config import Config, Names, Positive
from twin.errors import BadInputError
from twin.estimators.guidance_fix_kernels import roots_of_diagonal, row_of
from twin.estimators.guidance_readers import ANGLE_TRANSDUCER, ODOMETRY, YAW_GYRO
from twin.estimators.heading_inputs import WHEEL_ENCODERS
from twin.estimators.roles import GNSS, IMU, RADAR, pick_sensors
from twin.geometry import turned
from twin.signals import HEADING, POSITION, SPEED, BoolArray, Estimate, EstimatorSetup, FloatArray, SensorInfo

GUIDANCE_SENSORS = (GNSS, IMU, YAW_GYRO, WHEEL_ENCODERS, RADAR, ODOMETRY, ANGLE_TRANSDUCER)
"""Kinds that a guidance filter may be given."""
STATE_COLUMNS = (*POSITION[:2], HEADING, SPEED)
INNOVATIONS = ("innovation_e_m", "innovation_n_m")
NIS_POSITION = "nis_position"


class GuidanceConfig(Config):
    """What every guidance filter is told."""

    sensors: Names
    """One GNSS receiver, and what else the filter is to use; of each kind one."""
    rate_hz: Positive = 10.0
    """Output rate."""
    course_from_m_s: Positive = 0.2
    """Slower than this, a receiver's course is not a heading: it is the direction of noise."""


class SteeredConfig(GuidanceConfig):
    """What filters are told that count wheels."""

    wheel_radius_m: Positive | None = None
    """Rolling radius of the wheels with encoders; without it, that of the machine which carries the sensors."""
    wheelbase_m: Positive | None = None
    """Of a machine that steers; without it, that of the machine which carries the sensors."""

    def wheel_radius_of(self, setup: EstimatorSetup) -> float:
        """Rolling radius, m; zero where nobody tells."""
        return setup.wheel_radius_m if self.wheel_radius_m is None else self.wheel_radius_m

    def wheelbase_of(self, setup: EstimatorSetup) -> float:
        """Wheelbase, m; zero where nothing is known to steer."""
        return setup.wheelbase_m if self.wheelbase_m is None else self.wheelbase_m


def guidance_sensors(
    setup: EstimatorSetup, *, estimator: str, kinds: Sequence[str] = GUIDANCE_SENSORS
) -> dict[str, SensorInfo]:
    """The sensors by kind.

    Raises:
        BadInputError: there is no receiver, two sensors are of one kind, or one is of a kind that is not usable.
    """
    picked = pick_sensors(setup, kinds, estimator=estimator)
    for kind, infos in picked.items():
        if len(infos) > 1 or (kind == GNSS and not infos):
            allowed = "exactly one" if kind == GNSS else "at most one"
            raise BadInputError(
                f"[estimators.{setup.name}] sensors = {list(setup.sensors)}: {estimator} takes {allowed} sensor of "
                f"kind {kind!r}"
            )
    return {kind: infos[0] for kind, infos in picked.items() if infos}


def transported(
    state: FloatArray, covariance: FloatArray, forward_m: float, left_m: float
) -> tuple[FloatArray, FloatArray]:
    """Position, heading and speed (R, 4) and covariance (R, 4, 4) of a point so far before and to the left.

    Only the position moves: speeds are those of the rear axle wherever the point is.
    """
    if forward_m == left_m == 0.0:
        return state, covariance
    east, north = turned(forward_m, left_m, state[:, 2])
    moved, T = state.copy(), np.repeat(np.eye(4)[np.newaxis], len(state), axis=0)
    moved[:, 0] += east
    moved[:, 1] += north
    T[:, 0, 2], T[:, 1, 2] = -north, east
    return moved, np.einsum("rik,rjk->rij", np.einsum("rij,rjk->rik", T, covariance), T)


class News:
    """Innovations since the last output, by column: the last of each, NaN where there was none."""

    def __init__(self, columns: Sequence[str], runs: int) -> None:
        self.columns: tuple[str, ...] = tuple(columns)
        self._places = {column: place for place, column in enumerate(self.columns)}
        self.values: FloatArray = np.full((runs, len(self.columns)), np.nan)
        """(R, n); whoever tells them forgets them."""

    def put(self, column: str, values: FloatArray, mask: BoolArray | None = None) -> None:
        """Note values (R,) of a column where ``mask`` (R,) is True."""
        np.copyto(self.values[:, self._places[column]], values, where=True if mask is None else mask)

    def put_position(self, innovation: FloatArray, nis: FloatArray, mask: BoolArray) -> None:
        """Note a position's innovation (R, 2) and its normalised square (R,)."""
        for column, values in zip(INNOVATIONS, innovation.T, strict=True):
            self.put(column, values, mask)
        self.put(NIS_POSITION, nis, mask)


class GuidanceOutput:
    """Puts together what a guidance filter tells.

    Args:
        runs: R.
        nis: the normalised innovations that it has beside that of the position.
        extra: further columns that it tells at every output.
    """

    def __init__(self, runs: int, *, nis: Sequence[str] = (), extra: Sequence[str] = ()) -> None:
        self.news = News((*INNOVATIONS, NIS_POSITION, *nis), runs)
        self.columns: tuple[str, ...] = (*STATE_COLUMNS, *extra, *self.news.columns)
        self._nothing = np.empty((runs, 0))

    def estimate(
        self,
        t_ns: int,
        state: FloatArray,
        covariance: FloatArray | None,
        *,
        sigmas: FloatArray | None = None,
        extra: FloatArray | None = None,
    ) -> Estimate:
        """Tell position, heading and speed (R, 4), with their covariance (R, 4, 4) or just sigmas (R, 4) or neither.

        ``extra`` (R, k) are the further columns; they get no sigma.
        """
        if covariance is not None:
            sigmas = roots_of_diagonal(np.ascontiguousarray(covariance))
        elif sigmas is None:
            sigmas = np.full(state.shape, np.nan)
        further = self._nothing if extra is None else np.ascontiguousarray(extra)
        values, all_sigmas = row_of(np.ascontiguousarray(state), sigmas, further, self.news.values)
        return Estimate(t_ns=t_ns, values=values, sigmas=all_sigmas, covariance=covariance)
