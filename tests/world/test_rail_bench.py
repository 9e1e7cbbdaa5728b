"""The bench's plate is where a hand has moved it, and nothing else moves."""

from __future__ import annotations

import math

import pytest

from tests.world.conftest import WorldMaker, column
from twin.signals import HEIGHT, Command
from twin.world.body import PhysicsBody
from twin.world.rail_bench import MIDDLE_M, TRAVEL_M, RailBenchConfig


def test_it_stands_with_the_plate_in_the_middle(make_world: WorldMaker) -> None:
    world = make_world(kind="rail_bench")
    world.advance(500)
    assert column(world, HEIGHT) == pytest.approx(MIDDLE_M, abs=1e-6)
    assert column(world, "joint.plate_m") == pytest.approx(0.0, abs=1e-6)
    assert not world.moves_soil
    assert (column(world, "base_e_m"), column(world, "base_u_m")) == (0.0, 0.0)


def test_the_plate_follows_the_hand(make_world: WorldMaker) -> None:
    world = make_world(kind="rail_bench", start={"heading_deg": 40.0})
    for speed, sign in ((0.4, 1.0), (-0.4, -1.0)):
        before = column(world, "joint.plate_m")
        world.command(Command(lift_m_s=speed))
        world.advance(world.tick + 100)
        # 0.2 s less the lag of 0.03 s, and one step of 2 ms.
        moved = 0.4 * (0.2 - 0.03 * (1.0 - math.exp(-0.2 / 0.03)))
        assert column(world, "velocity_u_m_s") == pytest.approx(0.4 * sign, rel=0.005)
        assert column(world, "joint.plate_m") - before == pytest.approx(sign * moved, abs=0.4 * 0.002)
        world.command(Command())
        world.advance(world.tick + 200)
    assert column(world, HEIGHT) == pytest.approx(MIDDLE_M + column(world, "joint.plate_m"), abs=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_plate_stays_between_its_stops(make_world: WorldMaker, sign: float) -> None:
    world = make_world(kind="rail_bench")
    world.command(Command(lift_m_s=0.4 * sign))
    world.advance(1000)
    assert column(world, "joint.plate_m") == pytest.approx(sign * TRAVEL_M, abs=1e-3)
    assert abs(column(world, "velocity_u_m_s")) < 1e-3


def test_instruments_ride_on_the_plate() -> None:
    config = RailBenchConfig(kind="rail_bench")
    assert {mount.body for mount in config.resolved_mounts.values()} == {"plate"}
    assert config.reference_start == (0.0, 0.0, 0.0)


def test_the_copy_whose_bare_steps_are_timed_is_a_bench_too(
    make_world: WorldMaker, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = make_world(kind="rail_bench")
    fixed: list[bool] = []
    monkeypatch.setattr(PhysicsBody, "float_freely", lambda body: fixed.append(body._fixed))
    assert world.bare_step_us(5) > 0.0
    assert fixed == [True]
