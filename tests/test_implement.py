"""Who holds the implement in a scenario: what may be written, and what driver and implement get to know."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from tests.small_scenario import small_scenario
from twin.control import LevellingControlConfig
from twin.errors import BadInputError
from twin.execution import Journey, open_members, open_world
from twin.scenario import kinds, load, resolve
from twin.signals import HEIGHT, STROKE, Knowledge, Listening

SCRAPER: dict[str, Any] = {
    "title": "A scraper",
    "duration_s": 1.5,
    "terrain": {"kind": "flat", "size_m": [20.0, 10.0], "cell_m": 0.1},
    "soil": {"preset": "soft"},
    "machine": {"kind": "scraper", "start": {"east_m": -5.0}},
    "driver": {"speed_m_s": 1.0, "path": [{"straight_m": 10.0}]},
    "sensors": {"gnss": {"preset": "rtk_chcnav_i70", "mount": "antenna"}},
    "estimators": {"held": {"kind": "height_hold", "sensors": ["gnss"]}},
    "implement": {"kind": "levelling", "follows": "held"},
}
BENCH: dict[str, Any] = {
    "title": "A bench",
    "duration_s": 4.0,
    "terrain": {"kind": "flat"},
    "soil": {"preset": "firm"},
    "machine": {"kind": "rail_bench"},
    "driver": {"kind": "reciprocation", "stand_s": 0.0, "rest_probability": 0.0},
}


def _journey(folder: Path, table: dict[str, Any]) -> Journey:
    path = folder / "implement.toml"
    path.write_text(tomli_w.dumps(table), encoding="utf-8")
    loaded = load(path)
    return Journey(loaded.scenario, open_world(loaded), open_members(loaded, runs=(0,)))


def test_each_knows_what_it_says_it_goes_by(tmp_path: Path) -> None:
    """The driver sees the machine; whoever holds the blade by an estimate sees neither it nor the height."""
    journey = _journey(tmp_path, SCRAPER)
    driver, implement = journey._driver, journey._implement
    assert implement is not None
    drivers: list[Knowledge] = []
    holders: list[Knowledge] = []
    command, amend = driver.command, implement.amend
    driver.command = lambda knowledge, interval_s: command(drivers.append(knowledge) or knowledge, interval_s)  # type: ignore[method-assign, func-returns-value]
    implement.amend = lambda asked, knowledge: amend(asked, holders.append(knowledge) or knowledge)  # type: ignore[method-assign, func-returns-value]
    # a full blade from the beginning
    blade = journey._world._blade
    assert blade is not None
    blade._load[:] = blade.spec.capacity_m3 / len(blade._load)
    journey.go()
    assert drivers[-1].vehicle is not None
    assert drivers[-1].implement is not None
    assert not drivers[-1].said
    assert holders[-1].vehicle is holders[-1].implement is None
    assert "held" in holders[-1].said
    loads = [knowledge.load_share for knowledge in holders]
    assert loads[:25] == [0.0] * 25
    assert loads[25] == 1.0


def test_the_hand_on_a_bench_moves_alike_wherever_the_design_plane_lies(tmp_path: Path) -> None:
    strokes, heights = [], []
    for design_height_m in (0.0, 1.0):
        journey = _journey(tmp_path, {**BENCH, "levelling": {"design_height_m": design_height_m}})
        journey.go()
        truth = journey.truth_stream()
        strokes.append(truth.column("joint.plate_m"))
        heights.append(truth.column(HEIGHT))
        said = journey._world.implement().values
        assert said[STROKE] == strokes[-1][-1, 0]
    assert np.array_equal(*strokes)
    assert np.ptp(strokes[0]) > 0.1
    assert heights[0] - heights[1] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({**BENCH, "implement": {"kind": "levelling"}}, "implement: the hand that is the driver of a rail_bench"),
        ({**SCRAPER, "implement": {"kind": "levelling", "follows": "hold"}}, "implement.follows: unknown estimator"),
        (small_scenario(implement={"kind": "levelling"}), "a planter_f8 has no implement"),
    ],
)
def test_what_cannot_be_is_refused(table: dict[str, Any], message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        resolve(table, where="test")


class _Watching(LevellingControlConfig):
    watches: str = "eye"

    @property
    def listens(self) -> Listening:
        return Listening(sensors=(self.watches,))


def test_whom_a_controller_listens_to_has_to_be_there_whatever_its_key() -> None:
    with pytest.raises(BadInputError, match=r"implement\.watches: unknown sensor 'eye'"):
        resolve({**SCRAPER, "implement": _Watching(kind="levelling")}, where="test")


def test_the_kinds_of_implement_are_listed() -> None:
    assert kinds()["implement"] == ["levelling"]
