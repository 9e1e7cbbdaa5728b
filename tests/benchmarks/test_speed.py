"""Where the time goes: `make benchmark`. Not part of the verdict, because machines are noisy: compare ratios."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from twin.execution import execute
from twin.recording import Recording
from twin.scenario import LoadedScenario, bundled, load
from twin.scoring import score
from twin.signals import Command
from twin.world.simulation import World, build_world
from viz import scene_of, write_rrd

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def loaded() -> LoadedScenario:
    return load(bundled()["planter_turns"], settings=[("duration_s", 90.0)])


@pytest.fixture(scope="module")
def world(loaded: LoadedScenario) -> Iterator[World]:
    scenario = loaded.scenario
    with build_world(scenario.terrain, scenario.soil, scenario.machine, seed=1) as built:
        built.command(Command(speed_m_s=0.5))
        yield built


def test_a_thousand_world_steps(world: World, benchmark: Any) -> None:
    benchmark.pedantic(lambda: world.advance(world.tick + 1000), rounds=5, warmup_rounds=1)


def test_a_thousand_bare_steps(world: World, benchmark: Any) -> None:
    benchmark.pedantic(lambda: world.bare_step_us(1000), rounds=5, warmup_rounds=1)


@pytest.mark.parametrize("runs", [1, 100])
def test_ninety_simulated_seconds(loaded: LoadedScenario, runs: int, benchmark: Any) -> None:
    benchmark.pedantic(lambda: execute(loaded, runs=range(runs)), rounds=2, warmup_rounds=1)


def test_writing_the_rrd(planter_turns: Recording, benchmark: Any, tmp_path: Path) -> None:
    result = score(planter_turns).as_json()
    scene = scene_of(planter_turns)
    benchmark.pedantic(lambda: write_rrd(planter_turns, scene, result, tmp_path / "run.rrd"), rounds=3, warmup_rounds=1)
