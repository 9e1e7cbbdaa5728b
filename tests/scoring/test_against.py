"""The difference from an estimate that is taken for the truth."""

from __future__ import annotations

import numpy as np
import pytest

from tests.small_scenario import small_scenario, small_scenario_toml
from twin import scenario as scenario_files
from twin.errors import BadInputError
from twin.recording import Recording, Stream
from twin.scoring import metrics, score
from twin.scoring.scorer import Scorer

NAME = "radar_only.row_speed.mean_abs_difference_m_s"
COLUMNS = ("speed_m_s", "row_speed_1_m_s", "row_speed_2_m_s")


def stream(speed: float, first: float, second: float, *, seconds: float = 10.0) -> Stream:
    t_ns = np.arange(0, round(seconds * 50)) * 20_000_000
    values = np.tile([speed, first, second], (len(t_ns), 1, 1))
    return Stream(columns=COLUMNS, t_ns=t_ns, values=values)


def recording(**scoring: object) -> Recording:
    """Both are 0.5 m/s and more off, in the same direction: 0.1 and 0.3 m/s apart."""
    return Recording(
        scenario_toml=small_scenario_toml(scoring={"reference": "central", **scoring}),
        scenario_name="made_up",
        seed=1,
        runs=(0,),
        streams={
            "truth": stream(2.0, 2.0, 2.0),
            "estimates/radar_only": stream(2.5, 2.6, 2.8),
            "estimates/central": stream(2.5, 2.5, 2.5),
        },
        ended_t_s=10.0,
    )


def test_what_both_have_wrong_is_no_difference() -> None:
    found = score(recording()).metrics
    assert found[NAME] == pytest.approx(0.2)
    assert found["radar_only.row_speed.mean_abs_error_m_s"] == pytest.approx(0.7)
    assert "central.row_speed.mean_abs_difference_m_s" not in found
    assert score(recording(rows=[2])).metrics[NAME] == pytest.approx(0.3)


def test_names_are_known_beforehand_and_pieces_are_the_whole() -> None:
    made = recording()
    parsed = scenario_files.loads(made.scenario_toml, where="made_up")
    columns = dict.fromkeys(("radar_only", "central"), COLUMNS)
    whole = score(made).metrics
    assert list(whole) == metrics.metric_names(parsed, COLUMNS, columns)
    scorer = Scorer(parsed, COLUMNS, columns)
    estimates = {name: made.estimates(name) for name in columns}
    for at in range(0, 500, 70):
        cut = {
            name: Stream(columns=COLUMNS, t_ns=each.t_ns[at : at + 70], values=each.values[at : at + 70])
            for name, each in estimates.items()
        }
        scorer.add(made.truth, cut)
    assert scorer.metrics()[NAME][0] == pytest.approx(whole[NAME], rel=1e-12)


def test_the_reference_has_to_exist() -> None:
    with pytest.raises(BadInputError, match=r"scoring.reference: unknown estimator 'centra'; did you mean 'central'"):
        scenario_files.resolve(small_scenario(scoring={"reference": "centra"}), where="made_up")
