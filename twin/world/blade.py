"""A levelling blade: it cuts what stands above its edge, carries it on, and fills what lies below.

The soil in front of the blade is one wedge per bin of about a cell's width, standing at the angle of repose against
the blade. Soil cut goes into the wedge; where the ground lies below the edge, the wedge runs out until the ground
reaches the edge. Wedges even out along the blade as it travels. A wedge is at most as high as the blade; the rest
moves outwards and falls past the blade's ends, as windrows beside it. Soil neither swells nor settles, and what the
heights lose the load gains: the volume of both together stays what it was.

Not modelled: the wedge's foot lies on the ground ahead, and rides over hollows that it does not fill; backwards, the
blade moves no soil.
"""

from __future__ import annotations

import math

import numpy as np

from twin.geometry import STANDARD_GRAVITY_M_S2
from twin.signals import FloatArray, IntArray
from twin.world import earthmoving
from twin.world.blade_spec import BladeSpec
from twin.world.terrain import Terrain

BLADE_COLUMNS = ("blade_load_m3", "soil_cut_m3", "soil_filled_m3", "soil_spilled_m3", "blade_draught_n")
"""Truth columns of :meth:`Blade.truth`."""
SMOOTHING_M = 0.2
"""Travel over which the cut cross-section is averaged for the draught: a cell's worth of soil fails over some way."""


class Blade:
    """A blade at work on a terrain, whose heights it changes in place."""

    def __init__(self, spec: BladeSpec, terrain: Terrain) -> None:
        self.spec = spec
        self._terrain = terrain
        self._grid = terrain.west_m, terrain.south_m, terrain.cell_m
        self._middle = np.array(spec.middle_m)
        self._figures = np.array(
            [
                0.5 * spec.width_m,
                math.tan(spec.repose_rad),
                spec.capacity_m3 / spec.width_m,
                spec.evening_m,
                spec.resistance_pa,
                spec.friction * spec.density_kg_m3 * STANDARD_GRAVITY_M_S2,
                spec.base_n,
                max(SMOOTHING_M, 2.0 * terrain.cell_m),
            ]
        )
        self._changed = np.zeros(terrain.heights.shape, dtype=np.bool_)
        self._edge = np.full(earthmoving.EDGE_COLUMNS, np.nan)
        self._load = np.zeros(max(2, round(spec.width_m / terrain.cell_m)))
        self._totals = np.zeros(earthmoving.TOTALS)

    def step(self, link: FloatArray) -> None:
        """Work the ground up to where the blade's link is now.

        ``link`` is the link's row of ``twin.world.dynamics``: position (3), then rotation matrix (9), then what is not
        looked at. To be called at least once per half cell of travel; more often changes little.
        """
        earthmoving.work(
            link, self._middle, self._figures, self._terrain.heights, self._changed, *self._grid,
            self._edge, self._load, self._totals,
        )  # fmt: skip

    @property
    def draught_n(self) -> float:
        """Force of the soil against the blade's forward motion now, N."""
        return float(self._totals[earthmoving.DRAUGHT_N])

    @property
    def load_m3(self) -> float:
        """Soil carried in front of the blade now."""
        return float(self._load.sum())

    @property
    def cut_m3(self) -> float:
        """Soil cut so far."""
        return float(self._totals[earthmoving.CUT])

    @property
    def filled_m3(self) -> float:
        """Soil laid down so far, below the edge or as a heap."""
        return float(self._totals[earthmoving.FILLED])

    @property
    def spilled_m3(self) -> float:
        """Soil lost past the blade's ends so far."""
        return float(self._totals[earthmoving.SPILLED])

    def truth(self) -> tuple[float, ...]:
        """Values of ``BLADE_COLUMNS``."""
        return self.load_m3, self.cut_m3, self.filled_m3, self.spilled_m3, self.draught_n

    def drain_changes(self) -> IntArray:
        """Flat indices (n,), in rising order, of the heights that changed since the last call."""
        indices: IntArray = np.flatnonzero(self._changed).astype(np.int64)
        self._changed.ravel()[indices] = False
        return indices
