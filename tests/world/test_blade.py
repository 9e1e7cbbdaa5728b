"""A blade moves soil as its rules say: none is lost, and neither heading nor step decides where it goes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.signals import FloatArray
from twin.world.blade import BLADE_COLUMNS, Blade
from twin.world.blade_spec import BladeSpec
from twin.world.terrain import Terrain

WIDTH, HEIGHT = 2.4, 0.35
TAN_REPOSE = math.tan(math.radians(30.0))


def spec(**figures: float) -> BladeSpec:
    return BladeSpec(body="scraper", middle_m=(0.0, 0.0, 0.0), width_m=WIDTH, height_m=HEIGHT, **figures)


def link(x: float, y: float, z: float, heading: float = 0.0, roll: float = 0.0) -> FloatArray:
    """Row of a link: position, then rotation."""
    c, s, cr, sr = math.cos(heading), math.sin(heading), math.cos(roll), math.sin(roll)
    return np.array([x, y, z, c, -s * cr, s * sr, s, c * cr, -c * sr, 0.0, sr, cr])


def ground(cell: float = 0.1, size: float = 14.0, height: float = 0.0) -> tuple[Terrain, FloatArray, FloatArray]:
    """Level ground, and the east and north of its nodes."""
    axis = -0.5 * size + cell * np.arange(round(size / cell) + 1)
    east, north = np.meshgrid(axis, axis)
    return Terrain(np.full_like(east, height), -0.5 * size, -0.5 * size, cell), east, north


def drive(
    blade: Blade,
    *,
    z: float = 0.0,
    heading: float = 0.0,
    start: float = -4.0,
    end: float = 4.0,
    step: float = 0.02,
    side: float = 0.0,
) -> None:
    """Straight through the middle (or ``side`` to its left) at one height."""
    c, s = math.cos(heading), math.sin(heading)
    for way in np.linspace(start, end, round(abs(end - start) / step) + 1):
        blade.step(link(way * c - side * s, way * s + side * c, z, heading))


def volume(terrain: Terrain) -> float:
    return float(terrain.heights.sum()) * terrain.cell_m**2


@pytest.mark.parametrize("cell", [0.1, 0.05])
@pytest.mark.parametrize("heading_deg", [0.0, 30.0, 45.0, 90.0, -160.0])
def test_a_sine_is_levelled_to_its_mean_whatever_the_heading(heading_deg: float, cell: float) -> None:
    amplitude, wave, heading = 0.03, 2.0, math.radians(heading_deg)
    terrain, east, north = ground(cell)
    along = east * math.cos(heading) + north * math.sin(heading)
    across = north * math.cos(heading) - east * math.sin(heading)
    terrain.heights[:] = amplitude * np.sin(2.0 * math.pi / wave * along)
    blade = Blade(spec(), terrain)
    drive(blade, heading=heading)
    # Four waves, crest first: each holds a wavelength x amplitude / pi of soil, which fills the hollow behind it.
    crests = 4.0 * amplitude * wave / math.pi * WIDTH
    # A sum over nodes gives an arch of a sine 1 - (pi / n)^2 / 12 of its area, with n nodes; that is 0.8 % for ten.
    assert blade.cut_m3 == pytest.approx(crests, rel=0.015)
    # Of the last hollow, half a strip may be left; elsewhere the whole goes in.
    assert blade.filled_m3 == pytest.approx(blade.cut_m3, rel=0.03)
    assert blade.spilled_m3 == 0.0
    swath = (np.abs(along) < 3.8) & (np.abs(across) < 0.5 * WIDTH - 2.0 * cell)
    before = amplitude / math.sqrt(2.0)
    assert terrain.heights[swath].std() < 0.02 * before
    assert abs(terrain.heights[swath].mean()) < 0.02 * before
    beside = np.abs(across) > 0.5 * WIDTH + cell
    assert np.array_equal(terrain.heights[beside], amplitude * np.sin(2.0 * math.pi / wave * along[beside]))


def test_volumes_and_draught_do_not_depend_on_the_step() -> None:
    figures, means_n, heading = [], [], 0.3
    for step in (0.002, 0.01, 0.02, 0.05, 0.2):
        terrain, east, north = ground()
        terrain.heights[:] = 0.04 * np.sin(3.0 * east + 1.0) * np.cos(2.0 * north) + 0.01 * east
        blade = Blade(spec(), terrain)
        ways, draughts_n = np.linspace(-4.0, 4.0, round(8.0 / step) + 1), []
        for way in ways:
            blade.step(link(way * math.cos(heading), way * math.sin(heading), 0.0, heading))
            draughts_n.append(blade.draught_n)
        figures.append((blade.cut_m3, blade.filled_m3, blade.draught_n))
        means_n.append(np.trapezoid(draughts_n, ways) / 8.0)
    spread = np.ptp(figures, axis=0) / np.mean(figures, axis=0)
    # The edge lags behind the link by less than half a cell, 0.05 m of 8 m.
    assert spread[0] < 0.01
    assert spread[1] < 0.01
    # A curve that comes so much later from nothing to its end has a mean that is less by this part of its end.
    assert np.ptp(means_n) < 0.05 / 8.0 * max(draught_n for _, _, draught_n in figures)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    cell=st.sampled_from([0.05, 0.1, 0.13]),
    height=st.floats(-0.3, 0.3),
    base=st.sampled_from([0.0, 50.0]),
)
def test_no_soil_is_lost_on_any_way(seed: int, cell: float, height: float, base: float) -> None:
    generator = np.random.default_rng(seed)
    terrain, east, _ = ground(cell, 8.0, base)
    terrain.heights += 0.1 * generator.standard_normal(east.shape)
    before = volume(terrain)
    blade = Blade(spec(), terrain)
    x = y = heading = 0.0
    # A walk that turns, stops, backs, lifts, rolls, and leaves the terrain.
    for _ in range(300):
        heading += 0.1 * generator.standard_normal()
        way = generator.choice([0.03, 0.03, 0.1, 0.4, 0.0, -0.15])
        x, y = x + way * math.cos(heading), y + way * math.sin(heading)
        z = base + height + 0.1 * generator.standard_normal()
        blade.step(link(x, y, z, heading, 0.1 * generator.standard_normal()))
    assert blade.cut_m3 > 0.0
    assert volume(terrain) + blade.load_m3 - before == pytest.approx(0.0, abs=1e-9 * blade.cut_m3 * (1.0 + base))
    balance = blade.cut_m3 - blade.filled_m3 - blade.spilled_m3
    assert balance == pytest.approx(blade.load_m3, abs=1e-9 * blade.cut_m3)


def test_no_soil_is_lost_in_a_long_run() -> None:
    terrain, east, north = ground(0.1, 30.0)
    terrain.heights[:] = 0.08 * np.sin(0.7 * east) * np.sin(0.9 * north + 1.0)
    before = volume(terrain)
    blade = Blade(spec(), terrain)
    for turn in np.linspace(0.0, 40.0 * math.pi, 40_000):
        radius = 9.0 + 4.0 * math.sin(0.11 * turn)
        place = radius * math.cos(turn), radius * math.sin(turn)
        blade.step(link(*place, 0.02 * math.sin(7.0 * turn), turn + 0.5 * math.pi))
    assert blade.cut_m3 > 5.0
    assert blade.spilled_m3 > 0.1
    assert volume(terrain) + blade.load_m3 - before == pytest.approx(0.0, abs=1e-9 * blade.cut_m3)


def test_every_node_of_a_pass_is_worked_on_once() -> None:
    """On level ground an edge that sinks cuts each node to the height at which it passed, and never again."""
    terrain, east, north = ground()
    blade = Blade(spec(), terrain)
    for way in np.linspace(-4.0, 4.0, 401):
        blade.step(link(way, 0.0, -0.002 * (way + 4.0)))
    passed = (np.abs(north) < 1.05) & (east > -3.95) & (east < 3.9)
    assert terrain.heights[passed] == pytest.approx(-0.002 * (east[passed] + 4.0), abs=1e-12)


def test_a_rolled_edge_cuts_a_slope() -> None:
    terrain, east, north = ground()
    blade = Blade(spec(), terrain)
    roll = math.radians(1.0)
    for way in np.linspace(-2.0, 0.0, 101):
        blade.step(link(way, 0.0, -0.03, 0.0, roll))
    passed = (np.abs(north) < 1.05) & (east > -1.9) & (east < -0.1)
    assert terrain.heights[passed] == pytest.approx(-0.03 + math.tan(roll) * north[passed], abs=1e-12)


def test_what_the_blade_cannot_hold_falls_past_its_ends_as_windrows() -> None:
    terrain, _, north = ground()
    blade = Blade(spec(), terrain)
    drive(blade, z=-0.05)
    assert blade.spec.capacity_m3 == pytest.approx(WIDTH * HEIGHT**2 / (2.0 * TAN_REPOSE))
    # 8 m x 2.4 m x 0.05 m, but for one of 80 lines of nodes that the edge may not have finished.
    assert blade.cut_m3 == pytest.approx(0.96, rel=0.0126)
    assert blade.filled_m3 == 0.0
    assert blade.load_m3 == pytest.approx(blade.spec.capacity_m3, rel=1e-6)
    assert blade.spilled_m3 == pytest.approx(blade.cut_m3 - blade.load_m3, rel=1e-9)
    swath = np.clip((0.5 * WIDTH - np.abs(north)) / 0.1 + 0.5, 0.0, 1.0)
    laid = (terrain.heights + 0.05 * swath)[:, 35:105] * 0.01
    side = north[:, 35:105]
    # Between the ends of the run the whole windrows lie beside the swath or slide in at its borders.
    rate = 0.05 * WIDTH * 7.0
    full = 0.5 * (blade.spec.capacity_m3 / (0.05 * WIDTH))
    assert full < 2.0
    assert laid[:, 20:].sum() == pytest.approx(rate * 5.0 / 7.0, rel=0.02)
    assert laid[:, 20:][np.abs(side[:, 20:]) > 1.15].sum() > 0.8 * rate * 5.0 / 7.0
    assert np.abs(laid[np.abs(side) < 0.8]).max() < 1e-12
    left, right = (float(laid[sign * side > 0.0].sum()) for sign in (1.0, -1.0))
    assert left == pytest.approx(right, rel=0.01)
    # Windrows are no steeper than loose soil stands, but for a tenth that sliding in steps leaves.
    ridge = np.where(np.abs(north) > 1.25, terrain.heights, np.nan)[:, 60:105]
    assert np.nanmax(np.abs(np.diff(ridge, axis=0))) / 0.1 < 1.1 * TAN_REPOSE


def test_a_lifted_blade_leaves_its_load_as_a_heap_at_the_angle_of_repose() -> None:
    terrain, _, north = ground(0.05, 8.0)
    blade = Blade(spec(), terrain)
    drive(blade, z=-0.02, start=-3.0, end=0.0)
    carried = blade.load_m3
    assert carried == pytest.approx(3.0 * WIDTH * 0.02, rel=0.02)
    assert blade.spilled_m3 == 0.0
    drive(blade, z=0.5, start=0.0, end=2.0)
    assert blade.load_m3 < 1e-6
    assert blade.draught_n < 1.0
    heap = terrain.heights[:, 60:][np.abs(north[:, 0]) < 0.5]
    # A wedge of 0.06 m^2: as high as sqrt(2 x 0.06 tan 30), its upright face slid down to both sides.
    wedge = math.sqrt(2.0 * 0.06 * TAN_REPOSE)
    assert 0.5 * wedge < heap.max() < 1.05 * wedge
    assert np.abs(np.diff(heap, axis=1)).max() / 0.05 < 1.1 * TAN_REPOSE


def test_a_blade_that_backs_leaves_its_load() -> None:
    terrain, east, _ = ground(0.05, 8.0)
    blade = Blade(spec(), terrain)
    drive(blade, z=-0.02, start=-3.0, end=0.0)
    carried, filled = blade.load_m3, blade.filled_m3
    drive(blade, z=-0.02, start=0.0, end=-1.0)
    assert blade.load_m3 == 0.0
    assert blade.draught_n == 0.0
    assert blade.filled_m3 - filled == pytest.approx(carried)
    assert terrain.heights[east > 0.3].max() > 0.02
    cut = blade.cut_m3
    drive(blade, z=-0.02, start=-1.0, end=-0.1)
    # Soil behind the heap is cut to the edge already.
    assert blade.cut_m3 - cut < 1e-3


def test_the_load_evens_out_along_the_blade() -> None:
    terrain, east, north = ground()
    terrain.heights[(np.abs(north - 0.5) < 0.11) & (east < -2.0)] = 0.05
    terrain.heights[east > -2.0] = -0.002
    blade = Blade(spec(), terrain)
    drive(blade)
    filled = np.where(east > -2.0, terrain.heights + 0.002, 0.0)
    reach = north[filled > 1e-9]
    # Diffusion by 0.05 m2/m over 2 m to the hollow alone spreads the lump by +-0.45 m.
    assert reach.min() < 0.1
    assert reach.max() > 0.9


def test_draught_is_what_cutting_and_carrying_cost() -> None:
    terrain, _, _ = ground()
    figures = spec(resistance_pa=10e3, density_kg_m3=1700.0, friction=0.5, base_n=150.0)
    blade = Blade(figures, terrain)
    drive(blade, z=-0.03, end=-1.5)
    expected = 150.0 + 10e3 * 0.03 * WIDTH + 0.5 * 1700.0 * 9.80665 * blade.load_m3
    # In strips of half a cell, every other one holds a line of nodes: +-12 % of cutting after averaging over 0.2 m.
    assert blade.draught_n == pytest.approx(expected, rel=0.12 * 720.0 / expected)
    assert blade.truth() == (blade.load_m3, blade.cut_m3, blade.filled_m3, blade.spilled_m3, blade.draught_n)
    assert len(blade.truth()) == len(BLADE_COLUMNS)


def test_changes_are_told_once() -> None:
    terrain, _, _ = ground()
    blade = Blade(spec(), terrain)
    before = terrain.heights.copy()
    assert blade.drain_changes().size == 0
    drive(blade, z=-0.05, heading=0.4)
    changes = blade.drain_changes()
    assert np.array_equal(np.unique(changes), changes)
    different = np.flatnonzero(before != terrain.heights)
    assert np.isin(different, changes).all()
    assert changes.size < 1.1 * different.size
    assert blade.drain_changes().size == 0
