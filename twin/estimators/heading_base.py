"""What the heading filters of paper 001 have in common: preparation, the reference of the heading, their output.

**Heading.** The twin's heading is counter-clockwise from east. In body axes (FLU) the horizontal field points to
magnetic north, ``magnetic_north_rad`` counter-clockwise from east (north: pi/2; a declination of 5 deg to the east:
pi/2 - 0.0873), at the angle atan2(My, Mx), so that

    heading = magnetic_north_rad - atan2(My, Mx).

Eq 23 of the paper is arctan(My / Mx): with the other sign, for axes of which one points the other way, and with an
arctangent that does not tell a direction from its opposite. Here the sign is the frame's; ``arctangent = "arctan"``
shows what its two-fold ambiguity does.

**Reference.** The paper counts yaw from where the robot stood at the start. ``heading_reference = "start"`` does so:
the heading at the start is the one set out by the owner, and the magnetometer's heading of the standstill is made to
agree with it (a constant declination or hard-iron error drops out). ``"magnetic_north"`` takes the magnetometer's word.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Literal

import numpy as np

from twin.config import Config, Names, Positive
from twin.estimators.heading_inputs import HeadingInputs, HeadingSample
from twin.estimators.heading_preparation import Preparation, PreparationConfig
from twin.geometry import wrap_angle
from twin.signals import HEADING, NS_PER_S, YAW_RATE, BoolArray, Estimate, EstimatorSetup, FloatArray, Measurement

NORTH_RAD = float(np.pi / 2)

Arctangent = Literal["atan2", "arctan"]


class HeadingConfig(Config):
    """What every heading filter is told."""

    sensors: Names
    """Names of the inertial unit, and of the magnetometer and the wheel encoders where the filter uses them."""
    rate_hz: Positive = 50.0
    """Output rate."""
    max_age_s: Positive = 1.0
    """Samples older than this on arrival are dropped; younger late ones count as current."""
    magnetic_north_rad: float = NORTH_RAD
    """Direction of the horizontal field, counter-clockwise from east."""


class PaperHeadingConfig(HeadingConfig):
    """What every heading filter of the paper is told."""

    heading_reference: Literal["start", "magnetic_north"] = "start"
    """Where the heading is counted from: the start's heading, or magnetic north."""
    arctangent: Arctangent = "atan2"
    """How eq 23 is read."""
    preparation: PreparationConfig = PreparationConfig()


def direction_of_field(field: FloatArray, arctangent: Arctangent = "atan2") -> FloatArray:
    """Angle (R,) of the horizontal field (R, 3), counter-clockwise from the x axis, rad."""
    if arctangent == "atan2":
        return np.asarray(np.arctan2(field[:, 1], field[:, 0]))
    return np.asarray(np.arctan(field[:, 1] / np.where(field[:, 0] == 0.0, 1e-12, field[:, 0])))


def level(vector: FloatArray, roll: FloatArray, pitch: FloatArray) -> FloatArray:
    """Body vectors (R, 3) seen in axes that share the body's heading but are level."""
    sr, cr, sp, cp = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
    across = sr * vector[:, 1] + cr * vector[:, 2]
    return np.stack(
        [cp * vector[:, 0] + sp * across, cr * vector[:, 1] - sr * vector[:, 2], cp * across - sp * vector[:, 0]],
        axis=-1,
    )


def tilt_of_force(force: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Roll and pitch (R,) of a body at rest from its specific force (R, 3): atan2(a_y, a_z) and eq 20, rad."""
    x, y, z = force[:, 0], force[:, 1], force[:, 2]
    return np.arctan2(y, z), np.arctan2(-x, np.sqrt(y * y + z * z))


class PaperHeadingFilter(ABC):
    """A heading filter of the paper: calibrates and pre-filters, steps, reports.

    Subclasses count yaw in the frame of the reference: the heading is ``self.zero + yaw``.

    Raises:
        BadInputError: the sensors do not fit, as :class:`~twin.estimators.heading_inputs.HeadingInputs` says.
    """

    extra_columns: tuple[str, ...] = ()

    def __init__(
        self,
        config: PaperHeadingConfig,
        setup: EstimatorSetup,
        *,
        kind: str,
        needs: Sequence[str],
        may_use: Sequence[str] | None = None,
    ) -> None:
        self._inputs = HeadingInputs(
            setup, kind=kind, needs=needs, may_use=needs if may_use is None else may_use, max_age_s=config.max_age_s
        )
        self._base = config
        self.runs = setup.runs
        self._preparation = Preparation(config.preparation, step_s=self._inputs.step_ns / NS_PER_S, runs=setup.runs)
        self._start = float(setup.start_e_n_heading[2])
        self.zero: FloatArray = np.full(setup.runs, self._start)
        """(R,) heading at which yaw is zero, rad."""
        self.yaw_rate: FloatArray = np.zeros(setup.runs)
        """(R,) rate about the upward axis, rad/s."""
        self._field_zero = np.zeros(setup.runs)
        self._has_field_zero: BoolArray = np.zeros(setup.runs, dtype=np.bool_)
        self._began = False
        self.columns: tuple[str, ...] = (HEADING, YAW_RATE, *self.extra_columns)
        self.state_columns: tuple[str, ...] = ()

    # --- what a filter is ---------------------------------------------------------------------------------------------

    @abstractmethod
    def step(self, sample: HeadingSample) -> None:
        """Take a prepared sample."""

    @abstractmethod
    def yaw(self) -> FloatArray:
        """Yaw (R,) in the frame of the reference, rad."""

    def yaw_sigma(self) -> FloatArray:
        """What the filter holds its yaw's standard deviation to be (R,), rad; NaN where it has no notion of it."""
        return np.full(self.runs, np.nan)

    def extra(self) -> FloatArray:
        """The extra columns, (R, n)."""
        return np.empty((self.runs, 0))

    # --- magnetometer -------------------------------------------------------------------------------------------------

    def magnetic_yaw(self, field: FloatArray, fresh: BoolArray) -> FloatArray:
        """Yaw (R,) of the horizontal field (R, 3), in the frame of the reference, in (-pi, pi].

        With the reference "start" the first field there is counts as that of the start, if there was no standstill.
        """
        angle = direction_of_field(field, self._base.arctangent)
        first = fresh & ~self._has_field_zero
        if first.any():
            self._field_zero = np.where(first, self._yaw_of_first_field(angle), self._field_zero)
            self._has_field_zero = self._has_field_zero | first
        return wrap_angle(self._field_zero - angle)

    def _yaw_of_first_field(self, angle: FloatArray) -> FloatArray:
        """Direction of the field where yaw is zero, (R,)."""
        if self._base.heading_reference == "magnetic_north":
            return np.zeros(self.runs)
        return angle + self._preparation.turned

    # --- in and out ---------------------------------------------------------------------------------------------------

    def process(self, measurement: Measurement) -> None:
        """Take one measurement, in order of arrival."""
        sample = self._inputs.add(measurement)
        if sample is not None:
            self._take(sample)

    def estimate(self, t_ns: int) -> Estimate:
        """Return what the filter says after all that arrived until ``t_ns``; it does not extrapolate."""
        sample = self._inputs.close()
        if sample is not None:
            self._take(sample)
        values = np.column_stack([wrap_angle(self.zero + self.yaw()), self.yaw_rate, self.extra()])
        sigmas = np.full(values.shape, np.nan)
        sigmas[:, 0] = self.yaw_sigma()
        return Estimate(t_ns=t_ns, values=values, sigmas=sigmas)

    def _take(self, sample: HeadingSample) -> None:
        prepared = self._preparation.take(sample)
        if prepared is None:
            return
        if not self._began:
            self._began = True
            self._begin(prepared)
        if prepared.dt_s > 0.0:
            self.yaw_rate = np.where(prepared.inertial, prepared.rate[:, 2], self.yaw_rate)
        self.step(prepared)

    def _begin(self, sample: HeadingSample) -> None:
        """The calibration is over: settle where yaw is counted from."""
        field, there = self._preparation.standing_field()
        angle, turned = direction_of_field(field, self._base.arctangent), self._preparation.turned
        if self._base.heading_reference == "start":
            self._field_zero, self._has_field_zero = np.where(there, angle, 0.0), there
            self.begin_at(turned)
            return
        self.zero = np.full(self.runs, self._base.magnetic_north_rad)
        now = np.where(sample.magnetic, -direction_of_field(sample.field, self._base.arctangent), 0.0)
        self.begin_at(wrap_angle(np.where(there, turned - angle, now)))

    @abstractmethod
    def begin_at(self, yaw: FloatArray) -> None:
        """Start from this yaw (R,): what the machine turned during its calibration."""
