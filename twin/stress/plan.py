"""What a stress test runs: worlds, noise realisations, and settings that are varied."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from twin.errors import BadInputError
from twin.scenario import LoadedScenario, load, parse_setting

_LARGEST_RUN = 10_000_000
_RANGE_POINTS = 5

BLOCK = 500
"""Members that are stepped together over one truth."""
CLOSED_BLOCK = 2
"""Members of a closed loop, each in a world of its own, that make one task."""

Setting = tuple[str, Any]


class Task(NamedTuple):
    """What is run, kept and resumed in one piece. Blocks of members are fixed by index, not by the workers."""

    point: int
    world: int
    block: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """What to run."""

    path: Path
    settings: tuple[Setting, ...]
    runs: int
    seeds: tuple[int, ...]
    """One world each."""
    points: tuple[tuple[Setting, ...], ...]
    """Settings of each point of ``--vary``; one empty point without."""
    block_sizes: tuple[int, ...]
    """Members of a task, by point."""

    def blocks(self, point: int) -> int:
        """How many blocks the members of one world make."""
        return -(-self.runs // self.block_sizes[point])

    def tasks(self) -> list[Task]:
        """Every (point, world, block), in the order in which results are merged."""
        return [
            Task(point, world, block)
            for point in range(len(self.points))
            for world in range(len(self.seeds))
            for block in range(self.blocks(point))
        ]

    def members(self, task: Task) -> range:
        """Run indices of one task."""
        size = self.block_sizes[task.point]
        return range(task.block * size, min(self.runs, (task.block + 1) * size))

    def load(self, point: int, world: int) -> LoadedScenario:
        """The scenario of one point in one world.

        Raises:
            BadInputError: it is wrong.
        """
        return load(self.path, settings=[*self.settings, *self.points[point], ("seed", self.seeds[world])])


def parse_vary(text: str) -> list[Setting]:
    """Values of ``KEY=LO:HI`` (five, evenly spaced), ``KEY=LO:HI:N`` or ``KEY=A,B,C``.

    Raises:
        BadInputError: none of these forms.
    """
    key, equals, values = text.partition("=")
    if not equals or not key.strip() or not values.strip():
        raise BadInputError(f"--vary {text!r}: expected KEY=LO:HI, KEY=LO:HI:N or KEY=A,B,C")
    if ":" in values and "," not in values:
        parts = values.split(":")
        try:
            low, high = float(parts[0]), float(parts[1])
            count = int(parts[2]) if len(parts) > 2 else _RANGE_POINTS
        except ValueError:
            raise BadInputError(f"--vary {text!r}: a range is LO:HI or LO:HI:N with numbers") from None
        if len(parts) > 3 or not 1 <= count <= 1000 or not np.isfinite([low, high]).all():
            raise BadInputError(f"--vary {text!r}: a range is LO:HI or LO:HI:N with N from 1 to 1000")
        if low > high:
            raise BadInputError(f"--vary {text!r}: a range goes upwards, as {key.strip()}={high:g}:{low:g}")
        return [(key.strip(), float(value)) for value in np.linspace(low, high, count)]
    return [parse_setting(f"{key}={value}") for value in values.split(",")]


def make_plan(
    path: Path, *, runs: int, worlds: int, settings: Sequence[Setting], vary: Sequence[str], seed: int | None
) -> Plan:
    """Lay out the tasks; every point is loaded once, so that bad input shows before anything is simulated.

    Raises:
        BadInputError: a setting or a varied value is wrong.
    """
    if not 1 <= runs <= _LARGEST_RUN or not 1 <= worlds <= _LARGEST_RUN:
        raise BadInputError(f"--runs {runs} --worlds {worlds}: expected at least 1 of each, at most {_LARGEST_RUN}")
    points = tuple(itertools.product(*(parse_vary(text) for text in vary)))
    first = load(path, settings=[*settings, *points[0], *([("seed", seed)] if seed is not None else [])])
    seeds = tuple(range(first.scenario.seed, first.scenario.seed + worlds))
    worlds_of = [load(path, settings=[*settings, *point, ("seed", seeds[0])]).scenario for point in points]
    sizes = tuple(CLOSED_BLOCK if scenario.listens.closes_loop else BLOCK for scenario in worlds_of)
    return Plan(path=path, settings=tuple(settings), runs=runs, seeds=seeds, points=points, block_sizes=sizes)
