"""Configuration of the GNSS receiver of :mod:`twin.sensors.gnss`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from twin.config import NonNegative, Positive, Probability
from twin.sensors.base import SensorConfig
from twin.sensors.gnss_geometry import GeometrySwing
from twin.sensors.gnss_internal_filter import InternalFilter
from twin.sensors.gnss_outputs import AntennaHeading, VerticalSpeed
from twin.sensors.gnss_states import FixState


class GnssConfig(SensorConfig):
    """A receiver and its fix states."""

    kind: Literal["gnss"]
    states: Annotated[Mapping[str, FixState], Field(min_length=1)]
    """The states the receiver can be in, by name, from the best to the worst."""
    state: str | None = None
    """Pin it to this one, whatever happens to corrections and satellites."""
    velocity_lag_s: NonNegative = 0.0
    """Time constant of the receiver's own velocity filter."""
    position_resolution_m: NonNegative = 0.0
    """Step of the position output; zero for all digits."""
    east_resolution_m: NonNegative | None = None
    """Step of the east output where it is another: digits of a longitude are not those of a latitude."""
    north_resolution_m: NonNegative | None = None
    """Step of the north output where it is another."""
    jump_interval_s: Positive | None = None
    """Mean time between two steps of the position by the ``jump_sigma_m`` of its state; without it there are none."""
    internal_filter: InternalFilter | None = None
    """For receivers that filter their positions before they tell them."""
    geometry: GeometrySwing | None = None
    """How DOP and errors swing as satellites move; without it they do not."""
    corrections_interval_s: Positive | None = None
    """Time between two sets of corrections; without it the receiver gets none and reports no age."""
    corrections_delay_s: NonNegative = 0.0
    """Age of a set of corrections when it arrives."""
    corrections_loss_probability: Probability = 0.0
    """Of losing one set, in each run independently."""
    age_drift_correlation_s: Positive = 100.0
    """1/e time of the error rate that old corrections cause."""
    vertical_speed: VerticalSpeed | None = None
    """For receivers that give a vertical speed."""
    heading: AntennaHeading | None = None
    """For receivers with two antennas."""

    @model_validator(mode="after")
    def _check_state(self) -> Self:
        if self.state is not None and self.state not in self.states:
            raise ValueError(f"state = {self.state!r} is none of the states {', '.join(self.states)}")
        if self.jump_interval_s is None and any(any(state.jump_sigma_m) for state in self.states.values()):
            raise ValueError("jump_sigma_m of a state needs jump_interval_s")
        return self

    @property
    def resolution_m(self) -> tuple[float, float, float]:
        """Steps of the east, north and up output; zero for all digits."""
        usual = self.position_resolution_m
        east, north = self.east_resolution_m, self.north_resolution_m
        return usual if east is None else east, usual if north is None else north, usual

    @property
    def usual_state(self) -> FixState:
        """The one its data sheet is about: the best, or the one it is pinned to."""
        return self.states[self.state or next(iter(self.states))]
