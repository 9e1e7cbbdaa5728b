"""Machines and soils are what their sources and their files say."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from tests.world.conftest import MACHINES
from twin.errors import BadInputError
from twin.geometry import STANDARD_GRAVITY_M_S2 as G
from twin.world.planter_f8 import FRONT_TRACK_M, WHEELBASE_M, WHEELS, PlanterF8Config
from twin.world.soil import SoilConfig
from twin.world.statics import static_loads
from twin.world.tractor import ackermann
from twin.world.urdf import read_urdf

REAR_WHEELS = {f"{axle}_{side}" for axle in ("rear_wheel", "wheel_rear", "wheel") for side in ("left", "right")}
ASSET = PlanterF8Config.asset


def test_masses_and_axle_loads_are_the_stated_ones() -> None:
    # Tractor 6700 kg with 40 % on the front axle; planter 3500 kg, 40 kg of coupling parts. By moments about the
    # planter's axle (3.0 m behind the hitch): drawbar load 3180 x 0.35 / 3.0 = 371 kg, which with the 40 kg hangs
    # 1.05 m behind the rear axle.
    urdf = read_urdf(ASSET)
    assert urdf.mass_kg == pytest.approx(6700 + 3500 + 40)
    loads = dict(zip((w.joint for w in WHEELS), static_loads(urdf, [w.joint for w in WHEELS]) / G, strict=True))
    drawbar = 3180 * 0.35 / 3.0 + 40
    front = loads["front_wheel_left"] + loads["front_wheel_right"]
    rear = loads["rear_wheel_left"] + loads["rear_wheel_right"]
    assert front == pytest.approx(0.4 * 6700 - drawbar * 1.05 / WHEELBASE_M, rel=1e-3)
    assert front + rear == pytest.approx(6700 + drawbar, rel=1e-6)
    assert loads["planter_wheel_1"] == pytest.approx((3500 - 3180 * 0.35 / 3.0) / 4, rel=1e-6)


def test_rows_and_mounts_are_those_of_the_planter() -> None:
    config = PlanterF8Config(kind="planter_f8")
    assert config.rows_y_m == (2.625, 1.875, 1.125, 0.375, -0.375, -1.125, -1.875, -2.625)
    for row, y in enumerate(config.rows_y_m, start=1):
        mount = config.resolved_mounts[f"row_{row}"]
        assert mount.body == "planter"
        assert mount.xyz_m[0] == config.reference.xyz_m[0]
        assert mount.xyz_m[1] == y
    assert {"radar", "antenna", "tractor_antenna"} <= set(config.mounts)
    assert PlanterF8Config.model_validate(config.model_dump()) == config


def test_ackermann_axes_meet_on_the_rear_axles_line() -> None:
    for steering in (0.3, -0.3, 0.6):
        left, right = ackermann(steering, WHEELBASE_M, FRONT_TRACK_M)
        centre = WHEELBASE_M / math.tan(steering)
        assert WHEELBASE_M / math.tan(left) + FRONT_TRACK_M / 2 == pytest.approx(centre)
        assert WHEELBASE_M / math.tan(right) - FRONT_TRACK_M / 2 == pytest.approx(centre)
    assert ackermann(0.0, WHEELBASE_M, FRONT_TRACK_M) == (0.0, 0.0)


def _edited(tmp_path: Path, edit: str) -> Path:
    tree = ET.parse(ASSET)
    root = tree.getroot()
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    if edit == "inertia":
        tensor = root.find("link[@name='rear_wheel_left_hub']/inertial/inertia")
        tensor.set("ixx", "96")
        tensor.set("izz", "96")  # 96 + 96 < 300: no body has such moments
    elif edit == "fixed":
        root.find("joint[@name='hitch_roll']").set("type", "fixed")
    elif edit == "two_roots":
        root.remove(root.find("joint[@name='hitch_yaw']"))
    path = tmp_path / f"{edit}.urdf"
    tree.write(path)
    return path


@pytest.mark.parametrize(("edit", "message"), [("inertia", "moments"), ("fixed", "fixed"), ("two_roots", "one root")])
def test_a_urdf_that_would_be_simulated_wrongly_is_refused(tmp_path: Path, edit: str, message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        read_urdf(_edited(tmp_path, edit))
    assert read_urdf(_edited(tmp_path, "nothing")).mass_kg == pytest.approx(10_240)


def test_soil_presets_are_brixius_with_the_standards_wheel_numerics() -> None:
    # Bn = 40: 0.88 (1 - e^-4) = 0.8639; + 0.04; x (1 - e^-0.75) / 0.1 = 4.558; 1/40 + 0.04 = 0.065.
    tilled = SoilConfig(preset="tilled").soil()
    assert tilled.friction == pytest.approx(0.9039, abs=1e-4)
    assert tilled.longitudinal_stiffness == pytest.approx(4.558, abs=1e-3)
    assert tilled.rolling_resistance == pytest.approx(0.065)
    resistances = [SoilConfig(preset=name).soil().rolling_resistance for name in ("firm", "tilled", "soft", "paddy")]
    assert resistances == sorted(resistances)
    assert SoilConfig(preset="soft", friction=0.3).soil().friction == 0.3


@pytest.mark.parametrize("kind", sorted(MACHINES))
def test_a_machine_knows_its_rear_wheels(kind: str) -> None:
    """Where its URDF has them, half a track to either side; they roll on no more than their free radius."""
    config = MACHINES[kind](kind=kind)
    urdf, model = read_urdf(config.asset), config.model(1)
    rear = [wheel for wheel in model.wheels if wheel.joint in REAR_WHEELS]
    if not rear:
        assert config.wheel_radius_m == config.track_m == 0.0
        return
    hubs = {joint.name: urdf.zero_pose(joint.child)[0] for joint in urdf.joints}
    half_m = 0.5 * config.track_m
    assert sorted(hubs[wheel.joint][1] for wheel in rear) == pytest.approx([-half_m, half_m])
    for wheel in rear:
        assert 0.9 * wheel.radius_m < config.wheel_radius_m <= wheel.radius_m
