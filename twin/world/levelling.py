"""The plane a field is to be levelled to, and the part of the field that counts."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, Strict, model_validator

from twin.config import Config

Area = Annotated[tuple[float, float, float, float], Strict(strict=False)]


class LevellingConfig(Config):
    """What a levelling machine works towards."""

    design_height_m: Annotated[float, Field(ge=-100.0, le=100.0)] = 0.0
    """Up coordinate of the level design plane; heights are told above it."""
    area_m: Area | None = None
    """West, south, east and north limit of the area whose flatness is judged; without it none is."""

    @model_validator(mode="after")
    def _an_area(self) -> Self:
        if self.area_m is not None:
            west, south, east, north = self.area_m
            if east <= west or north <= south:
                raise ValueError("area_m is west, south, east and north limit: east has to be beyond west, and so on")
        return self
