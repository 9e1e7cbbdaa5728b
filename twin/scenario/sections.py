"""Sections of a scenario that are of no machine, sensor or estimator: clock, scoring, recording, checks."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Self

from pydantic import Field, Strict, field_validator, model_validator

from twin.config import Config, Names, NonNegative, Positive, Probability
from twin.families import LIMITED
from twin.validation import did_you_mean


class WorldConfig(Config):
    """The clock of the physics."""

    physics_hz: Annotated[float, Field(ge=50.0, le=10_000.0)] = 500.0
    """Physics steps per second."""

    @field_validator("physics_hz")
    @classmethod
    def _whole_nanoseconds(cls, value: float) -> float:
        if not (1e9 / value).is_integer():
            raise ValueError("the step 1 / physics_hz has to be a whole number of nanoseconds, as 250, 500, 1000 Hz")
        return value


class Check(Config):
    """A requirement on one metric, on its ratio to another, or on its difference from another."""

    metric: str
    """Name of the metric, as in result.json."""
    min: float | None = None
    """Smallest value allowed."""
    max: float | None = None
    """Largest value allowed."""
    ratio_to: str | None = None
    """Another metric to divide by; under stress member by member."""
    min_ratio: float | None = None
    """Smallest ratio allowed."""
    max_ratio: float | None = None
    """Largest ratio allowed."""
    difference_to: str | None = None
    """Another metric to subtract; under stress member by member."""
    max_difference: float | None = None
    """Largest difference allowed: with 0.2, the metric is at most 0.2 above the other."""
    percentile: Annotated[float, Field(ge=0.0, le=100.0)] | None = None
    """Under stress: this share of the members has to keep it (in a single run the run itself)."""
    confidence: Probability | None = None
    """Under stress: with this confidence."""
    stress_only: bool = False
    """Judge only under stress: for statements about a distribution that a single run need not keep."""

    @model_validator(mode="after")
    def _says_something(self) -> Self:
        if (self.ratio_to is None) != (self.min_ratio is None and self.max_ratio is None):
            raise ValueError("ratio_to goes with min_ratio or max_ratio")
        if (self.difference_to is None) != (self.max_difference is None):
            raise ValueError("difference_to goes with max_difference")
        if self.ratio_to is not None and self.difference_to is not None:
            raise ValueError("a check has ratio_to or difference_to, not both")
        if self.confidence is not None and self.percentile is None:
            raise ValueError("confidence goes with a percentile")
        if self.min is None and self.max is None and self.ratio_to is None and self.difference_to is None:
            raise ValueError(
                "a check needs min, max, ratio_to with min_ratio or max_ratio, or difference_to with max_difference"
            )
        return self


class LossConfig(Config):
    """When something is missing."""

    from_s: NonNegative
    """Begin of the loss."""
    to_s: Positive
    """End of the loss."""

    @model_validator(mode="after")
    def _forwards(self) -> Self:
        if self.from_s >= self.to_s:
            raise ValueError(f"from_s = {self.from_s:g} is not before to_s = {self.to_s:g}")
        return self


class ScoringConfig(Config):
    """Which part of the run counts."""

    from_s: NonNegative = 0.0
    """Errors before this time (calibration, start-up) do not count."""
    rows: Annotated[tuple[int, ...], Strict(strict=False)] | None = None
    """Row units that count where no row is named; all if not given."""
    turning_rad_s: Annotated[float, Field(gt=0.0)] = 0.05
    """True yaw rate beyond which the machine is said to be turning."""
    transition_s: Positive | None = None
    """Phase ``transitions``: so many seconds or less before or after a place where the path begins or ceases to bend;
    the rest of turns and straights are the phases ``steady_turns`` and ``steady_straights``. Without it there are none
    of the three."""
    loss: LossConfig | None = None
    """Phases ``loss`` and ``after``; by default all of the faults' time windows."""
    causal_bound_of: str | None = None
    """Name of an estimator: also give the least row-speed error any causal filter with its sensors could have."""
    height_bound_of: str | None = None
    """Name of an estimator: also give the least error of the height any causal filter with its sensors could have."""
    pass_to_pass_bound_of: str | None = None
    """Name of an estimator: also give the least pass-to-pass error any causal filter with its receiver, wheels and gyro
    could have."""
    limits: Annotated[dict[str, Positive], Field(json_schema_extra={"propertyNames": {"enum": list(LIMITED)}})] = Field(
        default_factory=dict
    )
    """Error (m/s, m) whose first excess since a loss is timed, by family: ``<family>.time_to_limit_s``."""
    fixes_of: str | None = None
    """GNSS receiver whose first true fix after the loss begins the time of recovery: ``height.recovery_s`` and others;
    without it they are not told."""
    smallest_ramp_m_s: Positive | None = None
    """Change of speed from which on reaction time and lag are measured, ``speed.reaction_accelerating_s`` and others;
    without it they are not."""
    reference: str | None = None
    """Estimator from which the others' difference is measured too, ``row_speed.mean_abs_difference_m_s``: what a paper
    without a truth took for it."""
    guidance: bool | None = None
    """Whether also to measure what guidance along lines is judged by: ``cross_track.rmse_m``, ``pass_to_pass.p95_m``,
    ``step.smallest_e_m`` and others. By default where there is a ``[coverage]``, or an estimator of a ``guidance_``
    kind."""
    places: Names = ()
    """Names of segments of the driver's path (their ``label``, if they have one) for each of which the deviation of
    every estimated position is told: ``place.<name>.sigma_e_m`` and others."""

    @field_validator("places")
    @classmethod
    def _places_with_names_of_their_own(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        told: dict[str, str] = {}
        for place in value:
            key = place_key(place)
            if not key:
                raise ValueError(f"places: {place!r} has no letter or digit to name metrics by")
            if key in told:
                raise ValueError(f"places: {told[key]!r} and {place!r} would both be {key!r} in metrics")
            told[key] = place
        return value

    @field_validator("limits")
    @classmethod
    def _families_that_may_be_limited(cls, value: dict[str, float]) -> dict[str, float]:
        for name in value:
            if name not in LIMITED:
                raise ValueError(unknown(name, LIMITED, "family"))
        return value


def place_key(place: str) -> str:
    """How metrics name a place: in small letters and digits."""
    return re.sub(r"[^a-z0-9]+", "_", place.lower()).strip("_")


class RecordingConfig(Config):
    """What is kept."""

    truth_hz: Annotated[float, Field(gt=0.0)] = 50.0
    """Rate of the truth stream."""
    baseline_trace: bool = False
    """Keep what the estimators said once a second beside the baseline of the metrics."""
    drawn: Names = ()
    """Estimators drawn in the recording for the viewer, where there are too many for one picture; all if none is
    named. The streams hold all of them either way."""


def unknown(given: str, allowed: Sequence[str] | Mapping[str, Any], what: str) -> str:
    """Say that a name is not known, with the nearest one and all that are."""
    return f"unknown {what} {given!r}{did_you_mean(given, allowed)} (there are {', '.join(sorted(allowed)) or 'none'})"
