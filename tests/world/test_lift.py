"""A lift answers its command as its figures say: late, with a lag, no faster than it can, and not beyond its ends."""

from __future__ import annotations

import math

import numpy as np
import pytest

from twin.paths import MACHINES
from twin.world.lift import LIFT_COLUMNS, Lift, LiftSpec
from twin.world.machine import Actuation
from twin.world.urdf import read_urdf

DT = 0.002
SPEC = LiftSpec(
    joint="plate",
    lowest_m=-0.1,
    highest_m=0.2,
    fastest_up_m_s=0.22,
    fastest_down_m_s=0.25,
    lag_s=0.08,
    dead_time_s=0.12,
    dead_band_m_s=0.005,
)


class Slide:
    """A lift whose servo moves its slide as it likes."""

    def __init__(self) -> None:
        urdf = read_urdf(MACHINES / "rail_bench.urdf")
        self.lift = Lift(SPEC, urdf)
        self.q = [0.0]
        self._out = Actuation(torque_n_m=np.zeros(1), brake_n_m=np.zeros(1), servo_rad_s=[0.0])

    def run(self, asked_m_s: float, seconds: float) -> list[float]:
        places = []
        for _ in range(round(seconds / DT)):
            self.lift.step(asked_m_s, self.q, DT, self._out)
            self.q[0] += self._out.servo_rad_s[0] * DT
            places.append(self.q[0])
        return places


def test_it_starts_after_the_dead_time_and_follows_with_the_lag() -> None:
    slide = Slide()
    places = slide.run(0.1, 0.6)
    assert max(abs(place) for place in places[: round(0.12 / DT)]) == 0.0
    for t in (0.2, 0.3, 0.6):
        since = t - 0.12
        expected = 0.1 * (since - 0.08 * (1.0 - math.exp(-since / 0.08)))
        # In steps, the ends of the dead time and of the lag are uncertain by one step each.
        assert places[round(t / DT) - 1] == pytest.approx(expected, abs=0.1 * 2.0 * DT)
    asked, rate = slide.lift.diagnostics()
    assert (asked, len(LIFT_COLUMNS)) == (0.1, 2)
    assert rate == pytest.approx(0.1, rel=0.01)


@pytest.mark.parametrize(("asked", "speed"), [(1.0, 0.22), (-1.0, -0.25), (0.05, 0.05), (0.005, 0.0), (-0.004, 0.0)])
def test_speed_is_limited_and_small_commands_leave_the_valve_shut(asked: float, speed: float) -> None:
    slide = Slide()
    slide.run(asked, 0.42)
    # 0.3 s behind the dead time are 3.75 lags: 97.6 % of the speed.
    assert slide.lift.diagnostics()[1] == pytest.approx(speed * (1.0 - math.exp(-0.3 / 0.08)), rel=0.01)


@pytest.mark.parametrize(("asked", "end"), [(0.3, 0.2), (-0.3, -0.1)])
def test_it_comes_to_rest_at_its_ends(asked: float, end: float) -> None:
    slide = Slide()
    places = np.array(slide.run(asked, 2.0))
    assert abs(places[-1] - end) < 1e-4
    assert np.all((places >= -0.1) & (places <= 0.2))
    # A cushion of 50 ms slows a lift of 0.25 m/s by at most 5 m/s2.
    assert np.abs(np.diff(places, 2)).max() / DT**2 < 6.0
    # It leaves the end at once.
    back = slide.run(-asked, 0.4)
    assert abs(back[-1] - end) > 0.03


def test_it_holds_its_place_against_what_pushes_it() -> None:
    slide = Slide()
    slide.run(0.1, 0.5)
    rested = slide.run(0.0, 1.0)[-1]
    slide.q[0] -= 0.01
    assert slide.run(0.0, 0.5)[-1] == pytest.approx(rested, abs=1e-5)


def test_reset_forgets_commands_on_their_way() -> None:
    slide = Slide()
    slide.run(0.2, 0.1)
    slide.lift.reset()
    slide.q[0] = 0.0
    assert slide.run(0.0, 0.5)[-1] == 0.0
