"""The machine moves as mechanics says it must. The numbers are derived beside each test."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.world.conftest import MACHINES, WorldMaker, column, every_machine, no_tools, record, slope
from twin.geometry import STANDARD_GRAVITY_M_S2 as G
from twin.signals import Command, MotionNeed
from twin.world import tyres
from twin.world.planter_f8 import AXLE_X_M, HITCH_BEHIND_AXLE_M, PlanterF8Config
from twin.world.simulation import World
from twin.world.soil import SoilConfig
from twin.world.statics import static_loads
from twin.world.terrain import RoughTerrain, Terrain
from twin.world.tyres import ground_plane

PER_S = 500


def drive(world, speed, steering=0.0, seconds=10.0):
    world.command(Command(speed_m_s=speed, steering_rad=steering))
    world.advance(world.tick + round(seconds * PER_S))


def test_coasting_never_gains_energy(make_world: WorldMaker) -> None:
    # Nothing drives the machine and every force in it is passive, so the energy after letting go is never above what
    # it was then. Potential energy counts from the machine's rest position, so that a relative bound means something.
    world = make_world(draught_n=0.0)
    rest = world.energy_j()
    drive(world, 3.0)
    world.engage(False)
    world.advance(world.tick + 1)
    start = world.energy_j() - rest
    assert start > 0.5 * 9_000 * 2.9**2
    energies = []
    for _ in range(2000):
        world.advance(world.tick + 2)
        energies.append(world.energy_j() - rest)
    assert max(energies) <= start
    # ... and rolling resistance alone stops it: m v^2 / 2 = rho m g s, within what the wheels' own spin adds.
    assert energies[-1] < 0.5 * start


@every_machine
@pytest.mark.parametrize("rough", [False, True], ids=["flat", "class C"])
def test_coasting_without_resistance_gains_no_energy(make_world: WorldMaker, kind: str, rough: bool) -> None:
    ground = RoughTerrain(kind="rough", iso8608_class="C", size_m=(90.0, 90.0)) if rough else None
    world = make_world(ground, kind=kind, soil_keys={"rolling_resistance": 0.0}, **no_tools(kind))
    rest = world.energy_j()
    drive(world, 3.0, seconds=5.0 if rough else 10.0)
    world.engage(False)
    world.advance(world.tick + 1)
    start = world.energy_j() - rest
    energies, heave = [], []
    for _ in range(4 * PER_S):
        world.advance(world.tick + 1)
        energies.append(world.energy_j() - rest)
        heave.append(abs(column(world, "velocity_u_m_s")))
    weight = world._body.urdf.mass_kg * G
    # The tyres' energy is told as of the forces of the latest step, so it lags by up to one step of their power.
    bound = 4.0 * weight * max(heave) / PER_S
    if rough:
        # The normal force N leans by the slope fitted to the patch, which is not quite the derivative of its mean
        # height: between two places N times the difference of the heights that belong to either is gained or lost,
        # and comes back. Of the road's spectrum, 256e-6 m^3 (n / 0.1)^-2 for class C, a patch of half length l keeps
        # 3 (sin a - a cos a) / a^3 of the slope and sin(a) / a of the height, a = 2 pi n l. Four sigma, at two places.
        n = np.linspace(0.02, 20.0, 20_000)
        variance = 0.0
        for load, length in zip(_loads(world), world._parts.wheels[:, tyres.HALF_LENGTH], strict=True):
            arg = 2.0 * math.pi * n * length
            unlike = 3.0 * (np.sin(arg) - arg * np.cos(arg)) / arg**3 - np.sin(arg) / arg
            variance += load**2 * float(np.trapezoid(256e-6 * (0.1 / n) ** 2 * unlike**2, n))
        bound += 4.0 * math.sqrt(2.0 * variance)
        assert bound < 0.005 * start
    else:
        assert max(heave) < 1e-3
        assert bound < 1e-4 * start
    assert max(energies) <= start + bound


def _loads(world: World) -> np.ndarray:
    machine = world.machine
    return static_loads(world._body.urdf, [w.joint for w in machine.wheels], [s.joint for s in machine.springs])


@every_machine
def test_a_braked_machine_stands_still_on_a_slope(make_world: WorldMaker, kind: str) -> None:
    world = make_world(slope(10.0), kind=kind)
    world.command(Command(brake=True))
    world.advance(10 * PER_S)
    start = world.truth()[:3]
    speeds = record(world, 60 * PER_S, 10, ("velocity_e_m_s", "velocity_n_m_s", "velocity_u_m_s"))
    assert np.linalg.norm(world.truth()[:3] - start) <= 0.5e-3
    assert math.sqrt(np.mean(np.sum(speeds**2, axis=1))) <= 0.1e-3


@every_machine
@pytest.mark.parametrize(("percent", "rolls"), [(10.0, True), (7.5, True), (5.5, False), (3.0, False)])
def test_an_unbraked_machine_rolls_unless_rolling_resistance_exceeds_the_slope(
    make_world: WorldMaker, kind: str, percent: float, rolls: bool
) -> None:
    # Tilled soil: rho = 1/40 + 0.04 = 6.5 %. On 7.5 % the excess, 1 % of g, moves a machine with 10 % of its mass more
    # in its turning wheels 0.5 x 0.09 x 10^2 = 4 m in ten seconds.
    world = make_world(slope(percent), kind=kind, **no_tools(kind))
    begin = column(world, "position_e_m")
    world.engage(False)
    world.command(Command())
    world.advance(10 * PER_S)
    if rolls:
        assert column(world, "position_e_m") - begin < -2.0
    else:
        assert abs(column(world, "position_e_m") - begin) < 0.01


@every_machine
def test_rolling_down_a_slope_accelerates_as_mechanics_demands(make_world: WorldMaker, kind: str) -> None:
    # a (m + sum J / r^2) = m g (sin - rho cos): no draught.
    world = make_world(slope(10.0), kind=kind, **no_tools(kind))
    world.engage(False)
    world.command(Command())
    samples = record(world, 10 * PER_S, 50, ("speed_m_s",))[:, 0]
    urdf = world._body.urdf
    wheels = world.machine.wheels
    spin = sum(urdf.links[urdf.joint_index(w.joint) + 1].inertia_kg_m2[1] / w.radius_m**2 for w in wheels)
    angle = math.atan(0.10)
    expected = urdf.mass_kg * G * (math.sin(angle) - 0.065 * math.cos(angle)) / (urdf.mass_kg + spin)
    slopes = np.polyfit(np.arange(len(samples))[40:] * 0.1, np.abs(samples[40:]), 1)
    # Wheels turn on their loaded radius, a few per cent less than r: the spin term (7 % of the mass) changes by < 1 %.
    assert slopes[0] * math.cos(angle) ** -1 == pytest.approx(expected, rel=0.02)


@every_machine
@pytest.mark.parametrize("speed", [0.1, 0.5, 2.5, 5.0])
def test_constant_speed_on_flat_ground_is_smooth(make_world: WorldMaker, kind: str, speed: float) -> None:
    world = make_world(kind=kind, soil="tilled" if kind == "planter_f8" else "asphalt")
    world.watch("bar", MotionNeed(mount=world.machine.reference))
    drive(world, speed, seconds=20.0)
    world.capture("bar")
    forces = []
    for _ in range(2 * PER_S):
        world.advance(world.tick + 1)
        forces.append(world.capture("bar").mean_specific_force_m_s2)
    assert np.std(forces, axis=0).max() <= 0.01


@pytest.mark.parametrize(
    ("kind", "draught"),
    [("planter_f8", 0.0), ("planter_f8", 4000.0), ("planter_f8", 12000.0), ("prototype_car", 0.0)],
)
def test_slip_is_pull_over_slip_stiffness(make_world: WorldMaker, kind: str, draught: float) -> None:
    world = make_world(kind=kind, **({"draught_n": draught} if draught else no_tools(kind)))
    drive(world, 2.0, seconds=20.0)
    soil = SoilConfig(preset="tilled").soil()
    rear = [w.joint for w in world.machine.wheels if "rear" in w.joint]
    free = [w.joint for w in world.machine.wheels if "rear" not in w.joint]
    resistance = soil.rolling_resistance * sum(column(world, f"{joint}.normal_n") for joint in free)
    stiffness = soil.longitudinal_stiffness * sum(column(world, f"{joint}.normal_n") for joint in rear)
    expected = (draught + resistance) / stiffness
    for joint in rear:
        assert column(world, f"{joint}.slip") == pytest.approx(expected, rel=0.05)
        # and the slip reported is ASABE's 1 - v / (omega r), r the loaded radius
        tyre = next(wheel for wheel in world.machine.wheels if wheel.joint == joint)
        loaded = tyre.radius_m - column(world, f"{joint}.normal_n") / tyre.stiffness_n_m
        speed, rate = column(world, "vehicle_speed_m_s"), _rate(world, joint)
        assert 1.0 - speed / (rate * loaded) == pytest.approx(expected, rel=0.05)


def _rate(world, joint):
    before = column(world, f"joint.{joint}_rad")
    world.advance(world.tick + 100)
    return (column(world, f"joint.{joint}_rad") - before) / (100 / PER_S)


@every_machine
@pytest.mark.parametrize(("steering_deg", "resistance"), [(8.0, None), (16.0, None), (-16.0, None), (25.0, 0.01)])
def test_turn_radius_is_ackermanns_at_low_speed(
    make_world: WorldMaker, kind: str, steering_deg: float, resistance: float | None
) -> None:
    # The rear axle's middle runs on R = L / tan(steering) while tyre side forces are small: firm ground, 0.5 m/s, no
    # tools in the soil; 16 degrees is a radius of 9.7 m. At 25 degrees (6 m) the planter stands at 40 degrees to the
    # tractor and its rolling resistance of 1.8 kN alone pulls 1.1 kN sideways at the hitch: with the steered wheels'
    # own resistance that takes (0.43 + 0.59 kN) / 143 kN/rad of front slip angle and 1.6 kN / 274 kN/rad at the rear,
    # 3.3 % of radius. So there the wheels roll lightly.
    steering = math.radians(steering_deg)
    keys = {} if resistance is None else {"rolling_resistance": resistance}
    world = make_world(kind=kind, soil="firm", soil_keys=keys, **no_tools(kind))
    drive(world, 0.5, steering, seconds=70.0)
    rates = record(world, 10 * PER_S, 50, ("vehicle_speed_m_s", "yaw_rate_rad_s"))
    radius = np.mean(rates[:, 0]) / np.mean(rates[:, 1])
    assert radius == pytest.approx(MACHINES[kind](kind=kind).wheelbase_m / math.tan(steering), rel=0.03)


@pytest.mark.parametrize("steering_deg", [12.0, -20.0])
def test_the_planters_axle_runs_on_the_radius_geometry_gives(make_world: WorldMaker, steering_deg: float) -> None:
    # Rear axle on R, hitch a behind it on sqrt(R^2 + a^2), the planter's axle L behind that on sqrt(R^2 + a^2 - L^2).
    world = make_world(soil="firm")
    drive(world, 0.8, math.radians(steering_deg), seconds=90.0)
    names = ("vehicle_speed_m_s", "yaw_rate_rad_s", "speed_m_s")
    tractor, rate, planter = record(world, 10 * PER_S, 50, names).mean(axis=0)
    radius = tractor / rate
    expected = math.sqrt(radius**2 + HITCH_BEHIND_AXLE_M**2 - AXLE_X_M**2)
    # The bar's forward speed is the axle's: both lie on the planter's centre line.
    assert abs(planter / rate) == pytest.approx(expected, rel=0.02)


@every_machine
def test_motion_does_not_depend_on_where_east_is(make_world: WorldMaker, kind: str) -> None:
    def path(turn_deg: float, east: float, north: float, percent: float) -> np.ndarray:
        ground = slope(percent, turn_deg + 30.0) if percent else None
        world = make_world(ground, kind=kind, start={"east_m": east, "north_m": north, "heading_deg": turn_deg})
        rows = []
        for steering in (0.2, -0.1, 0.3):
            world.command(Command(speed_m_s=2.0, steering_rad=steering))
            rows.append(record(world, 4 * PER_S, 100, ("position_e_m", "position_n_m", "position_u_m", "speed_m_s")))
        found = np.concatenate(rows)
        angle = math.radians(turn_deg)
        # height of the slope's plane at the start
        uphill = np.array([math.cos(angle + math.radians(30)), math.sin(angle + math.radians(30))]) * percent / 100.0
        shifted = found[:, :2] - (east, north)
        found[:, 2] -= uphill @ (east, north)
        found[:, :2] = shifted @ np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        return found

    for percent in (0.0, 5.0):
        here = path(0.0, 0.0, 0.0, percent)
        for turn, east, north in ((90.0, 0.0, 0.0), (137.0, 21.3, -40.7)):
            assert np.abs(path(turn, east, north, percent) - here).max() < 1e-5


@every_machine
def test_halving_the_time_step_changes_little(make_world: WorldMaker, kind: str) -> None:
    # Semi-implicit Euler is of first order: over 40 m with turns the end moves by far less than the 5 cm allowed.
    ends = []
    for dt_ns in (2_000_000, 1_000_000):
        world = make_world(kind=kind, dt_ns=dt_ns)
        per_s = 1_000_000_000 // dt_ns
        for steering in (0.25, -0.25):
            world.command(Command(speed_m_s=2.5, steering_rad=steering))
            world.advance(world.tick + 8 * per_s)
        ends.append(world.truth()[:3])
    assert np.linalg.norm(ends[0] - ends[1]) < 0.05


@pytest.mark.parametrize("length_m", [1.0, 2.0])
def test_vertical_motion_does_not_depend_on_the_grid(length_m: float) -> None:
    # The same waves, 2 cm high, stored at 0.1 and at 0.025 m. Straight lines between nodes multiply a wave by
    # sinc^2(cell / length), 3.3 % off for 1 m waves at 0.1 m; nothing else may depend on the cell.
    def shaking(cell_m: float) -> float:
        x = -15.0 + cell_m * np.arange(round(60.0 / cell_m) + 1)
        heights = np.tile(0.01 * np.sin(2.0 * math.pi / length_m * x), (round(12.0 / cell_m) + 1, 1))
        config = PlanterF8Config(kind="planter_f8")
        ground = Terrain(np.ascontiguousarray(heights), -15.0, -6.0, cell_m)
        with World(terrain=ground, soil=SoilConfig().soil(), machine=config.model(1), seed=1) as world:
            drive(world, 2.0, seconds=6.0)
            return float(np.std(record(world, 3 * PER_S, 1, ("velocity_u_m_s",))))

    interpolation = (np.sinc(0.1 / length_m) / np.sinc(0.025 / length_m)) ** 2
    assert shaking(0.1) == pytest.approx(shaking(0.025) * interpolation, rel=0.01)


def test_waves_shorter_than_the_contact_patch_are_swallowed() -> None:
    # 0.25 m waves under patches of 0.3 to 0.6 m: at least half of a 1 cm amplitude has to be enveloped, while 2 m
    # waves pass.
    heights = {}
    for length_m in (0.25, 2.0):
        x = 0.025 * np.arange(401)
        field = np.ascontiguousarray(np.tile(0.01 * np.sin(2.0 * math.pi / length_m * x), (81, 1)))
        means = [ground_plane(field, 0.0, 0.0, 0.025, 5.0 + s, 1.0, 1.0, 0.0, 0.2, 0.2)[0] for s in x[:80]]
        heights[length_m] = np.ptp(means) / 0.02
    assert heights[0.25] < 0.5
    assert heights[2.0] > 0.9
