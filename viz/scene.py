"""What is drawn that no stream holds: ground, machine and planned path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from twin.control.planned_legs import PlannedLeg
from twin.scoring.coverage import Coverage
from twin.signals import FloatArray
from twin.world.blade_spec import BladeSpec
from twin.world.levelling import LevellingConfig
from viz.magnetic import MagneticPieces

_BEYOND_M, _BEYOND_SHARE = 1.0, 0.45
"""Tyres and bodywork reach this far beyond the footprint: a metre, or this share of a small machine's diagonal."""
_FULL_SIZE_M = 6.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Scanner:
    """A lidar whose axis is that of the machine."""

    xyz_m: tuple[float, float, float]
    """Where it sits on the machine's root link."""
    range_m: tuple[float, float]
    """Its least and largest range."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """The things around a recording that a picture needs; built by whoever knows the scenario."""

    urdf: Path | None
    """The machine; ``None`` draws none."""
    heights: FloatArray
    """(ny, nx) height of the ground, m; row 0 is the southern edge, column 0 the western."""
    origin_m: tuple[float, float]
    """East and north of ``heights[0, 0]``."""
    cell_m: float
    """Distance of neighbouring heights."""
    planned_path: FloatArray
    """(N, 2) east and north of the path the driver was asked to follow, m; may be empty."""
    row_count: int = 0
    """Number of row units; the first and the last are drawn and plotted. 0: the machine has none."""
    footprint_m: tuple[tuple[float, float], tuple[float, float]] = ((-4.6, -2.6), (2.8, 2.6))
    """Back right and front left corner of the machine, forward and left of its root link: how far off a camera stands;
    by default a tractor with a planter's."""
    paved: bool = False
    """The ground is asphalt, not soil: for its colour."""
    trunks: FloatArray = field(default_factory=lambda: np.zeros((0, 5)))
    """(N, 5) trunks of trees: east, north, radius, bottom, top, m."""
    signs: FloatArray = field(default_factory=lambda: np.zeros((0, 6)))
    """(N, 6) stop signs: east, north, up of the plate's middle, heading (rad), size, bottom of the post, m."""
    magnetic: MagneticPieces = field(default_factory=MagneticPieces)
    """Magnets and iron."""
    scanners: Mapping[str, Scanner] = field(default_factory=dict)
    """Lidars on the machine's root link, by the sensor's name."""
    hidden: frozenset[str] = frozenset()
    """Estimators that are not drawn."""
    banded: frozenset[str] | None = None
    """Estimators whose claimed sigma is drawn about their height; None: of all that claim one."""
    levelling: LevellingConfig = field(default_factory=LevellingConfig)
    """Design plane and area to be levelled, if there is one."""
    blade: BladeSpec | None = None
    """With which the machine moves soil."""
    bench: bool = False
    """The machine's root stands still: it is looked at from its front."""
    antennas: Mapping[str, FloatArray] = field(default_factory=dict)
    """(3,) from the reference frame to an antenna that moves with it, in its own axes, by the receiver's name."""
    highest: FloatArray | None = None
    """(ny, nx) the highest that the ground ever is, where soil is moved: on it, lines are drawn."""
    coverage: Coverage | None = None
    """What the implement covered of the area that counts, if there is one."""
    guided_legs: tuple[PlannedLeg, ...] = ()
    """Segments of the planned path, where guidance along it is judged."""
    segment_labels: tuple[str, ...] = ()
    """Name of segment ``i`` of the path at place ``i``; where it is short, the driver's events name segments."""

    def __post_init__(self) -> None:
        if self.heights.ndim != 2 or min(self.heights.shape) < 2:
            raise ValueError(f"heights: expected at least 2 x 2 values, got shape {self.heights.shape}")
        if not self.cell_m > 0.0:
            raise ValueError(f"cell_m: expected a positive number, got {self.cell_m}")

    @property
    def machine_size_m(self) -> float:
        """Diagonal of the machine's footprint, with room all round for tyres and bodywork."""
        (back, right), (front, left) = self.footprint_m
        beyond = min(_BEYOND_M, _BEYOND_SHARE * float(np.hypot(front - back, left - right)))
        return float(np.hypot(front - back + 2.0 * beyond, left - right + 2.0 * beyond))

    @property
    def scale(self) -> float:
        """How small all that goes with the machine (heights of lines above ground, textures) is drawn: 1 for a car."""
        return min(1.0, self.machine_size_m / _FULL_SIZE_M)

    @property
    def outer_rows(self) -> tuple[int, ...]:
        """The row units that are drawn: leftmost and rightmost, counted from 1."""
        return tuple(sorted({1, self.row_count})) if self.row_count > 0 else ()

    def height_at(self, east_m: FloatArray, north_m: FloatArray) -> FloatArray:
        """Bilinear height of the ground, m, at points of any shape; beyond the edge the edge's height. NaN stays.

        Where soil is moved, that of the highest ground there ever is.
        """
        heights = self.heights if self.highest is None else self.highest
        ny, nx = heights.shape
        x = np.clip((np.asarray(east_m) - self.origin_m[0]) / self.cell_m, 0.0, nx - 1.0)
        y = np.clip((np.asarray(north_m) - self.origin_m[1]) / self.cell_m, 0.0, ny - 1.0)
        unknown = np.isnan(x) | np.isnan(y)
        x, y = np.where(unknown, 0.0, x), np.where(unknown, 0.0, y)
        column = np.minimum(x.astype(np.int64), nx - 2)
        row = np.minimum(y.astype(np.int64), ny - 2)
        fx, fy = x - column, y - row
        low = heights[row, column] * (1.0 - fx) + heights[row, column + 1] * fx
        high = heights[row + 1, column] * (1.0 - fx) + heights[row + 1, column + 1] * fx
        height: FloatArray = np.where(unknown, np.nan, low * (1.0 - fy) + high * fy)
        return height
