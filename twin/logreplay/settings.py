"""What a user may tell of a log that the log does not know: where the antenna sits, options of estimators."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pydantic import Field, ValidationError

from twin.config import Config, NonNegative, Positive, Vector3
from twin.errors import BadInputError
from twin.scenario import apply_setting, parse_setting
from twin.validation import explain


class Vehicle(Config):
    """What carries the antenna."""

    antenna_xyz_m: Vector3 = (0.0, 0.0, 0.0)
    """Forward, left and up from the reference frame whose position is estimated; zero: that of the antenna itself."""
    wheelbase_m: NonNegative = 0.0
    """Zero where nothing is known of its steering."""
    reference_x_m: float = 0.0
    """How far before the middle of the rear axle the reference frame is."""


class Reference(Config):
    """How the log with which positions are compared is read."""

    mapping: str | None = None
    """What its columns mean, if it is a table."""
    longest_gap_s: Positive = 1.05
    """Between two of its positions one is interpolated only if they are no farther apart."""


class ReplaySettings(Config):
    """Keys of ``--set`` for a log."""

    vehicle: Vehicle = Vehicle()
    reference: Reference = Reference()
    estimators: dict[str, dict[str, Any]] = Field(default_factory=dict)
    """Options of estimators, by name."""


def read_settings(settings: Sequence[str]) -> ReplaySettings:
    """Settings from the texts of ``--set``, as ``vehicle.wheelbase_m=2.5``.

    Raises:
        BadInputError: a key is unknown, or a value is not what it has to be.
    """
    table: dict[str, Any] = {}
    for text in settings:
        apply_setting(table, *parse_setting(text))
    try:
        return ReplaySettings.model_validate(table)
    except ValidationError as error:
        raise BadInputError(explain(error, ReplaySettings, "--set")) from None
