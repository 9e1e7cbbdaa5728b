"""What is seen of the blade's load is rough and late."""

from __future__ import annotations

import pytest

from twin.control.blade_sight import BladeSight


@pytest.mark.parametrize(("load", "seen"), [(0.1, 0.0), (0.2, 0.25), (0.7, 0.75), (0.85, 0.75), (0.9, 1.0), (1.0, 1.0)])
def test_a_load_is_seen_in_quarters_half_a_second_later(load: float, seen: float) -> None:
    sight = BladeSight(interval_s=0.02)
    assert [sight.look(load) for _ in range(26)] == [0.0] * 25 + [seen]
