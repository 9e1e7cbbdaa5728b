"""How bright it is: a level for the whole field, and times when it is another."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, Strict, model_validator

from twin.config import Config, NonNegative, Positive


class LightChange(Config):
    """Another brightness for a while, as the sun comes out of a cloud."""

    from_s: NonNegative
    """It begins here."""
    to_s: Positive
    """It ends here."""
    lux: NonNegative
    """Brightness meanwhile."""

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.to_s <= self.from_s:
            raise ValueError(f"to_s = {self.to_s:g} must be later than from_s = {self.from_s:g}")
        return self


class LightConfig(Config):
    """Illuminance. A room has some hundred lux, an overcast day 5 to 20 thousand, full sun 100 thousand."""

    lux: NonNegative = 5_000.0
    """Brightness where no change is under way."""
    changes: Annotated[tuple[LightChange, ...], Strict(strict=False), Field(max_length=1000)] = ()
    """Other brightness at times; of two at once the later in this list counts."""

    def at(self, t_s: float) -> float:
        """Brightness at a time, lux."""
        now = [change.lux for change in self.changes if change.from_s <= t_s < change.to_s]
        return now[-1] if now else self.lux
