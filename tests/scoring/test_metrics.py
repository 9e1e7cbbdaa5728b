"""Metrics on made-up recordings whose errors are known by construction."""

import math

import numpy as np
import pytest

from tests.small_scenario import small_scenario_toml
from twin import scenario as scenario_files
from twin.recording import Recording, Stream
from twin.scoring import metrics, score
from twin.scoring.scorer import Scorer

DT_NS = 20_000_000


def _stream(columns: dict[str, np.ndarray], start_tick: int = 0, every: int = 1) -> Stream:
    values = np.stack([np.atleast_2d(value.T).T for value in columns.values()], axis=-1)
    t_ns = (start_tick + every * np.arange(len(values), dtype=np.int64)) * DT_NS
    return Stream(columns=tuple(columns), t_ns=t_ns, values=values)


@pytest.fixture
def recording() -> Recording:
    """100 s; from 60 s to 80 s the machine turns at 0.25 rad/s; the estimate is 0.5 m/s off in turns and 0.1 else."""
    t = np.arange(0, 100.0, 0.02)
    turning = (t >= 60.0) & (t < 80.0)
    yaw_rate = np.where(turning, 0.25, 0.0)
    heading = np.concatenate([[0.0], np.cumsum(yaw_rate)[:-1] * 0.02])
    zeros = np.zeros_like(t)
    truth = {
        "position_e_m": zeros,
        "position_n_m": zeros,
        "heading_rad": np.angle(np.exp(1j * heading)),
        "speed_m_s": zeros + 2.0,
        "yaw_rate_rad_s": yaw_rate,
        "row_speed_1_m_s": 2.0 - yaw_rate * 2.625,
        "row_speed_2_m_s": zeros + 2.0,
    }
    error = np.where(turning, 0.5, 0.1)
    estimate = {
        "position_e_m": zeros + 0.3,
        "position_n_m": zeros - 0.4,
        "heading_rad": np.angle(np.exp(1j * (heading + 0.01))),
        "row_speed_1_m_s": truth["row_speed_1_m_s"] + error,
        "row_speed_2_m_s": truth["row_speed_2_m_s"] - error,
    }
    return Recording(
        scenario_toml=small_scenario_toml(scoring={"from_s": 50.0, "rows": [1]}),
        scenario_name="made_up",
        seed=1,
        runs=(0,),
        streams={"truth": _stream(truth), "estimates/one": _stream(estimate)},
        ended_t_s=100.0,
    )


def test_errors_are_averaged_over_the_phases_they_belong_to(recording: Recording) -> None:
    found = score(recording).metrics
    assert found["one.row_speed.mean_abs_error_turns_m_s"] == pytest.approx(0.5)
    assert found["one.row_speed.mean_abs_error_straights_m_s"] == pytest.approx(0.1)
    # 50 s count, 20 of them turning: (20 * 0.5 + 30 * 0.1) / 50.
    assert found["one.row_speed.mean_abs_error_m_s"] == pytest.approx(0.26)
    assert found["one.row_speed.max_abs_error_row_2_m_s"] == pytest.approx(0.5)
    assert found["one.position.rmse_m"] == pytest.approx(0.5)
    assert found["one.heading.mean_abs_error_deg"] == pytest.approx(math.degrees(0.01))


def test_heading_errors_wrap(recording: Recording) -> None:
    # 20 s at 0.25 rad/s pass through +-pi: an unwrapped difference would show 2 pi.
    assert score(recording).metrics["one.heading.max_abs_error_deg"] == pytest.approx(math.degrees(0.01))


def test_what_turning_adds_at_a_row_is_the_heading_change_times_its_distance(recording: Recording) -> None:
    found = score(recording).metrics
    expected = 2.625 * math.radians(found["truth.motion.turned_deg"]) / found["truth.motion.turning_s"]
    assert found["truth.row_speed.mean_abs_transport_row_1_turns_m_s"] == pytest.approx(expected)
    assert found["truth.motion.turning_s"] == pytest.approx(20.0)


def test_only_common_times_are_compared(recording: Recording) -> None:
    sparse = recording.estimates("one")
    thinned = Stream(columns=sparse.columns, t_ns=sparse.t_ns[::5], values=sparse.values[::5])
    recording.streams["estimates/one"] = thinned
    assert score(recording).metrics["one.row_speed.mean_abs_error_turns_m_s"] == pytest.approx(0.5)


def test_a_phase_that_never_came_has_no_number(recording: Recording) -> None:
    truth = recording.truth
    values = truth.values.copy()
    values[:, :, truth.columns.index("yaw_rate_rad_s")] = 0.0
    recording.streams["truth"] = Stream(columns=truth.columns, t_ns=truth.t_ns, values=values)
    verdict = score(recording)
    assert math.isnan(verdict.metrics["one.row_speed.mean_abs_error_turns_m_s"])
    assert verdict.as_json()["metrics"]["one.row_speed.mean_abs_error_turns_m_s"] is None  # type: ignore[index]


def test_names_known_beforehand_are_the_names_that_come_out(recording: Recording) -> None:
    columns = {"one": recording.estimates("one").columns}
    parsed = scenario_files.loads(recording.scenario_toml, where="made_up")
    assert list(score(recording).metrics) == metrics.metric_names(parsed, recording.truth.columns, columns)


def test_metrics_keep_the_ensemble_axis(recording: Recording) -> None:
    single = recording.estimates("one")
    doubled = Stream(
        columns=single.columns, t_ns=single.t_ns, values=np.concatenate([single.values, single.values + 0.2], axis=1)
    )
    recording.streams["estimates/one"] = doubled
    parsed = scenario_files.loads(recording.scenario_toml, where="made_up")
    found = metrics.compute(recording, parsed)["one.row_speed.mean_abs_error_row_1_turns_m_s"]
    np.testing.assert_allclose(found, [0.5, 0.7])


def test_an_empty_estimate_stream_scores_as_not_a_number(recording: Recording) -> None:
    single = recording.estimates("one")
    recording.streams["estimates/one"] = Stream(columns=single.columns, t_ns=single.t_ns[:0], values=single.values[:0])
    assert math.isnan(score(recording).metrics["one.position.rmse_m"])


def _pieces(stream: Stream, length: int) -> list[Stream]:
    starts = range(0, len(stream), length)
    return [
        Stream(columns=stream.columns, t_ns=stream.t_ns[at : at + length], values=stream.values[at : at + length])
        for at in starts
    ]


def test_scoring_in_pieces_is_scoring_the_whole(recording: Recording) -> None:
    parsed = scenario_files.loads(recording.scenario_toml, where="made_up")
    whole = metrics.compute(recording, parsed)
    estimate = recording.estimates("one")
    scorer = Scorer(parsed, recording.truth.columns, {"one": estimate.columns})
    for truth, piece in zip(_pieces(recording.truth, 701), _pieces(estimate, 701), strict=True):
        scorer.add(truth, {"one": piece})
    for name, value in scorer.metrics().items():
        np.testing.assert_allclose(value, whole[name], rtol=1e-12, err_msg=name)


def test_time_to_a_limit_counts_from_the_loss(recording: Recording) -> None:
    # The fault begins at 50 s; the error grows beyond 0.3 m/s when the machine turns at 60 s: 10 s later.
    faults = {"radar": {"faults": [{"kind": "outage", "from_s": 50.0, "to_s": 90.0}]}}
    scoring = {"from_s": 50.0, "rows": [1], "limits": {"row_speed": 0.3, "position": 0.6}}
    recording.scenario_toml = small_scenario_toml(scoring=scoring, sensors=faults, duration_s=100.0)
    found = score(recording).metrics
    assert found["one.row_speed.time_to_limit_s"] == pytest.approx(10.0)
    assert found["one.position.time_to_limit_s"] == math.inf
    # In the window 40 s: 20 turning with 0.5, 20 straight with 0.1; after it only 0.1.
    assert found["one.row_speed.mean_abs_error_loss_m_s"] == pytest.approx(0.3)
    assert found["one.row_speed.mean_abs_error_after_m_s"] == pytest.approx(0.1)


def test_an_error_that_is_not_known_is_no_error_kept_for_ever(recording: Recording) -> None:
    faults = {"radar": {"faults": [{"kind": "outage", "from_s": 50.0, "to_s": 90.0}]}}
    scoring = {"from_s": 50.0, "rows": [1], "limits": {"row_speed": 0.3}}
    recording.scenario_toml = small_scenario_toml(scoring=scoring, sensors=faults, duration_s=100.0)
    estimate = recording.estimates("one")
    row = estimate.columns.index("row_speed_1_m_s")
    # Unknown only after the first excess at 60 s: the time stands. Unknown before it: nobody can say.
    estimate.values[int(70 / 0.02) :, :, row] = np.nan
    assert score(recording).metrics["one.row_speed.time_to_limit_s"] == pytest.approx(10.0)
    estimate.values[int(55 / 0.02), :, row] = np.nan
    assert math.isnan(score(recording).metrics["one.row_speed.time_to_limit_s"])
