"""Distance from a machine's outline to the trunks, by figures that can be had with a ruler."""

from __future__ import annotations

import math

import numpy as np
import pytest

from twin.world.clearance import clearance_m

OUTLINE = ((-0.5, -0.25), (1.0, 0.25))


def _trunk(east_m: float, north_m: float, radius_m: float = 0.1) -> np.ndarray:
    return np.array([[east_m, north_m, radius_m, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("east_m", "north_m", "expected"),
    [
        (2.0, 0.0, 0.9),  # ahead
        (0.0, 1.0, 0.65),  # to the left
        (-1.0, -0.1, 0.4),  # behind
        (1.3, 0.65, 0.4),  # off the front left corner: hypot(0.3, 0.4) - 0.1
        (1.05, 0.0, -0.05),  # touching
        (0.2, 0.1, -0.1),  # inside
    ],
)
def test_distances_on_all_sides(east_m: float, north_m: float, expected: float) -> None:
    assert clearance_m(_trunk(east_m, north_m), 0.0, 0.0, 0.0, OUTLINE) == pytest.approx(expected)


def test_the_outline_turns_and_moves_with_the_machine() -> None:
    trunk = _trunk(3.0, 7.0)  # 2 m ahead of a machine at (3, 5) that looks north
    assert clearance_m(trunk, 3.0, 5.0, math.pi / 2, OUTLINE) == pytest.approx(0.9)


def test_the_nearest_counts_and_without_trees_nothing_is_near() -> None:
    both = np.vstack([_trunk(2.0, 0.0), _trunk(0.0, 1.0)])
    assert clearance_m(both, 0.0, 0.0, 0.0, OUTLINE) == pytest.approx(0.65)
    assert clearance_m(np.empty((0, 5)), 0.0, 0.0, 0.0, OUTLINE) == math.inf
