"""The part of a field that is to be worked once everywhere, and how wide the implement works."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from twin.config import Config
from twin.world.levelling import Area

LARGEST_CELLS = 16_000_000
"""At most 80 MB of counts and marks."""


class CoverageConfig(Config):
    """What coverage, overlap and skips are counted in."""

    swath_m: Annotated[float, Field(gt=0.0, le=100.0)]
    """Width that the implement works, centred on the machine's reference frame."""
    area_m: Area
    """West, south, east and north limit of the area that counts."""
    cell_m: Annotated[float, Field(ge=0.01, le=1.0)] = 0.05
    """Side of the cells in which it is counted, or a little less or more, so that they fill the area. A cell belongs to
    a pass if its middle does, so every edge of a pass is off by half a cell at most, and by less on average where it
    does not run along the cells."""

    @model_validator(mode="after")
    def _an_area(self) -> Self:
        west, south, east, north = self.area_m
        if east <= west or north <= south:
            raise ValueError("area_m is west, south, east and north limit: east has to be beyond west, and so on")
        if any(abs(limit) > 1e6 for limit in self.area_m):
            raise ValueError("area_m: limits are at most 1e6 m from the origin")
        if min(east - west, north - south) < self.cell_m:
            raise ValueError(f"area_m is narrower than one cell (cell_m = {self.cell_m:g})")
        rows, columns = self.shape
        if rows * columns > LARGEST_CELLS:
            raise ValueError(
                f"area_m: {columns} x {rows} cells of cell_m = {self.cell_m:g} are too many; at most"
                f" {LARGEST_CELLS:,} are allowed: name a smaller area_m or a larger cell_m"
            )
        return self

    @property
    def shape(self) -> tuple[int, int]:
        """Cells northwards and eastwards."""
        west, south, east, north = self.area_m
        return max(1, round((north - south) / self.cell_m)), max(1, round((east - west) / self.cell_m))

    @property
    def cell_size_m(self) -> tuple[float, float]:
        """Exact size of a cell northwards and eastwards."""
        west, south, east, north = self.area_m
        rows, columns = self.shape
        return (north - south) / rows, (east - west) / columns
