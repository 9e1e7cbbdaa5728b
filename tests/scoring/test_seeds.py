"""Seeds in the ground, against figures worked out by hand."""

import math
from typing import Any

import numpy as np
import pytest

from tests.small_scenario import small_scenario_toml
from twin import scenario as scenario_files
from twin.recording import Recording, Stream
from twin.scoring import metrics
from twin.scoring.planting import STREAM_COLUMNS, seed_streams
from twin.scoring.scorer import Scorer

DT_S = 0.02
X_REF = 0.16
ROWS_Y_M = {1: 2.625, 4: 0.375, 8: -2.625}
IDEAL = {"spacing_m": X_REF, "drop_delay_s": 0.0, "drop_spread_s": 0.0, "skip_probability": 0.0,
         "double_probability": 0.0}  # fmt: skip
SPEED = 2.5


def _stream(columns: dict[str, np.ndarray]) -> Stream:
    values = np.stack(list(columns.values()), axis=-1)[:, np.newaxis]
    return Stream(columns=tuple(columns), t_ns=20_000_000 * np.arange(len(values), dtype=np.int64), values=values)


def _truth(speed: np.ndarray, curvature: np.ndarray) -> Stream:
    """Rigid motion of a bar along a path of this speed (T,), m/s, and curvature (T,), 1/m, left positive."""
    # Exact for speeds and curvatures that are constant over each step.
    heading = np.concatenate([[0.0], np.cumsum(speed * curvature * DT_S)[:-1]])
    step = speed * DT_S * np.sinc(speed * curvature * DT_S / (2 * math.pi))
    along = heading + speed * curvature * DT_S / 2
    east = np.concatenate([[0.0], np.cumsum(step * np.cos(along))[:-1]])
    north = np.concatenate([[0.0], np.cumsum(step * np.sin(along))[:-1]])
    columns = {"heading_rad": heading, "speed_m_s": speed, "yaw_rate_rad_s": speed * curvature}
    for row, y in ROWS_Y_M.items():
        columns[f"row_speed_{row}_m_s"] = speed * (1.0 - y * curvature)
        columns[f"row_{row}_e_m"] = east - y * np.sin(heading)
        columns[f"row_{row}_n_m"] = north + y * np.cos(heading)
    return _stream(columns)


def _one_speed(speed: np.ndarray) -> Stream:
    """An estimator that gives every row the same speed."""
    return _stream({"speed_m_s": speed, **{f"row_speed_{row}_m_s": speed for row in ROWS_Y_M}})


def _recording(truth: Stream, estimates: dict[str, Stream], *, run: int = 0, **seeding: Any) -> Recording:
    toml = small_scenario_toml(seeding={**IDEAL, **seeding}, duration_s=4000.0)
    streams = {"truth": truth, **{f"estimates/{name}": estimate for name, estimate in estimates.items()}}
    return Recording(scenario_toml=toml, scenario_name="made_up", seed=1, runs=(run,), streams=streams)


def _metrics(recording: Recording) -> dict[str, float]:
    scenario = scenario_files.loads(recording.scenario_toml, where="made_up")
    return {name: float(value[0]) for name, value in metrics.compute(recording, scenario).items()}


def _driving(duration_s: float, *, curvature: float = 0.0, estimated: float = 1.0, **seeding: Any) -> dict[str, float]:
    """Metrics at constant speed and curvature, the speed estimated wrongly by a factor."""
    speed = np.full(round(duration_s / DT_S), SPEED)
    truth = _truth(speed, np.full_like(speed, curvature))
    return _metrics(_recording(truth, {"one": _one_speed(estimated * speed)}, **seeding))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_in_a_circle_one_speed_for_all_rows_spaces_row_i_by_1_minus_y_over_r(side: float) -> None:
    radius = 10.0
    speed = np.full(round(200.0 / DT_S), SPEED)
    recording = _recording(_truth(speed, np.full_like(speed, side / radius)), {"one": _one_speed(speed)})
    found = _metrics(recording)
    scenario = scenario_files.loads(recording.scenario_toml, where="made_up")
    seeds = seed_streams(scenario, recording)["seeds/one"]
    assert seeds.columns == STREAM_COLUMNS
    turn = "left_turns" if side > 0 else "right_turns"
    off = []
    for row, y in ROWS_Y_M.items():
        own = seeds.column("row")[:, 0] == row
        spacing = seeds.column("spacing_m")[own, 0][1:]
        # Chords of 5 cm stand for the arc: short by (0.05 / 7.4)**2 / 24 = 2e-6.
        np.testing.assert_allclose(spacing, X_REF * (1.0 - side * y / radius), rtol=1e-5)
        # 3125 seeds; one more or less at either end.
        expected = 100.0 * (radius / (radius - side * y) - 1.0)
        assert found[f"one.seeds.population_error_row_{row}_{turn}_percent"] == pytest.approx(expected, abs=0.05)
        off.append((expected, 1.0 - side * y / radius))
        # All of it stays in the feed class, so the indices of feed do not see it.
        assert found[f"one.seeds.quality_of_feed_row_{row}_percent"] == 100.0
    # Rows weigh by their metres.
    expected = sum(abs(error) * length for error, length in off) / sum(length for _, length in off)
    assert found["one.seeds.mean_abs_population_error_turns_percent"] == pytest.approx(expected, abs=0.05)
    # Pooled over rows, the spread of their spacings 0.7375, 0.9625 and 1.2625 shows as bad precision.
    pooled = np.array([1.0 - y / radius for y in ROWS_Y_M.values()]).std()
    assert found["one.seeds.precision_percent"] == pytest.approx(100.0 * pooled, rel=1e-3)
    assert found["one.seeds.precision_row_1_percent"] < 0.01


def test_left_and_right_turns_do_not_make_up_for_one_another() -> None:
    curvature = np.repeat([0.1, -0.1], 10_000)
    speed = np.full(20_000, SPEED)
    found = _metrics(_recording(_truth(speed, curvature), {"one": _one_speed(speed)}))
    # Row 1 has as many seeds as it should over the whole run, and is wrong everywhere.
    assert found["one.seeds.population_error_row_1_percent"] == pytest.approx(0.0, abs=0.1)
    wrong = sum(abs(y) for y in ROWS_Y_M.values()) / 10.0 / 3.0
    for phase in ("", "_turns"):
        found_percent = found[f"one.seeds.mean_abs_population_error{phase}_percent"]
        assert found_percent == pytest.approx(100.0 * wrong, abs=0.1)


def test_seven_percent_slip_in_the_speed_source_is_seven_percent_population() -> None:
    found = _driving(200.0, estimated=1.07)
    for row in ROWS_Y_M:
        assert found[f"one.seeds.population_error_row_{row}_straights_percent"] == pytest.approx(7.0, abs=0.05)
    assert found["one.seeds.mean_abs_population_error_percent"] == pytest.approx(7.0, abs=0.05)
    assert math.isnan(found["one.seeds.population_error_row_1_left_turns_percent"])
    assert math.isnan(found["one.seeds.precision_turns_percent"])


def test_half_the_pulses_are_half_the_seeds_and_nothing_but_misses() -> None:
    found = _driving(200.0, estimated=0.5)
    assert found["one.seeds.population_error_row_4_percent"] == pytest.approx(-50.0, abs=0.05)
    assert found["one.seeds.misses_percent"] == 100.0
    assert found["one.seeds.quality_of_feed_percent"] == 0.0
    assert math.isnan(found["one.seeds.precision_percent"])


def test_the_classes_end_at_half_and_one_and_a_half_spacings() -> None:
    # Metering 1.98 and 2.02 times too fast: spacings of 0.505 and 0.495; 1.49 and 1.51 the other way.
    for estimated, kind in ((1.98, "quality_of_feed"), (2.02, "multiples"), (1 / 1.49, "quality_of_feed"),
                            (1 / 1.51, "misses")):  # fmt: skip
        assert _driving(40.0, estimated=estimated)[f"one.seeds.{kind}_percent"] == 100.0


def test_a_spread_of_the_drop_time_is_a_precision_of_root_two_v_sigma() -> None:
    sigma_s = 0.005
    found = _driving(500.0, drop_delay_s=0.1, drop_spread_s=sigma_s)
    expected = 100.0 * math.sqrt(2.0) * SPEED * sigma_s / X_REF
    assert expected == pytest.approx(11.05, abs=0.01)
    # Three rows of 7800 spacings; neighbours share a seed, so the spread is known to about 0.6 %: four of that.
    assert found["one.seeds.precision_percent"] == pytest.approx(expected, rel=0.024)
    assert found["one.seeds.quality_of_feed_percent"] == pytest.approx(100.0, abs=0.1)


def test_skips_and_doubles_come_out_as_misses_and_multiples() -> None:
    skip, double = 0.05, 0.08
    found = _driving(500.0, skip_probability=skip, double_probability=double)
    # Per cell: 1 + double - skip spacings, one of zero length for a double, one too long for a run of skips, which
    # begins with probability skip (1 - skip).
    spacings = 1.0 + double - skip
    cells = 3 * 500.0 * SPEED / X_REF
    for kind, share in (("multiples", double / spacings), ("misses", skip * (1.0 - skip) / spacings)):
        spread = 100.0 * math.sqrt(share / cells)
        assert found[f"one.seeds.{kind}_percent"] == pytest.approx(100.0 * share, abs=4 * spread)
    spread = 100.0 * math.sqrt((skip + double) / (cells / 3))
    assert found["one.seeds.population_error_row_1_percent"] == pytest.approx(100.0 * (double - skip), abs=4 * spread)


def test_a_filter_that_believes_to_move_at_standstill_piles_its_seeds() -> None:
    speed = np.repeat([SPEED, 0.0], [5000, 500])
    believed = np.maximum(speed, 0.4)
    found = _metrics(_recording(_truth(speed, 0.0 * speed), {"one": _one_speed(believed)}))
    # 10 s at 0.4 m/s are 25 seeds on one spot, of 1562 + 25 in the row.
    assert found["one.seeds.multiples_percent"] == pytest.approx(100.0 * 25.0 / 1586.0, abs=0.1)
    assert found["one.seeds.population_error_row_1_percent"] == pytest.approx(100.0 * 25.0 / 1562.5, abs=0.1)


def test_a_filter_that_believes_to_stand_leaves_a_gap() -> None:
    speed = np.full(5000, SPEED)
    believed = np.where(np.arange(5000) // 50 == 50, 0.0, speed)
    found = _metrics(_recording(_truth(speed, 0.0 * speed), {"one": _one_speed(believed)}))
    # One second of a hundred: 1 % of the seeds are not there, in one long miss.
    assert found["one.seeds.population_error_row_1_percent"] == pytest.approx(-1.0, abs=0.1)
    assert found["one.seeds.misses_row_1_percent"] == pytest.approx(100.0 / 1546.0, rel=0.01)


def test_a_late_drop_moves_the_seeds_on_by_the_way_of_the_delay() -> None:
    speed = np.full(1000, SPEED)
    truth = _truth(speed, 0.0 * speed)
    places = []
    for delay_s in (0.0, 0.2):
        recording = _recording(truth, {"one": _one_speed(speed)}, drop_delay_s=delay_s)
        scenario = scenario_files.loads(recording.scenario_toml, where="made_up")
        seeds = seed_streams(scenario, recording)["seeds/one"]
        places.append(seeds.column("position_e_m")[seeds.column("row")[:, 0] == 8, 0])
    count = len(places[1])
    np.testing.assert_allclose(places[1] - places[0][:count], SPEED * 0.2, atol=1e-6)
    assert places[0][0] == pytest.approx(X_REF, abs=1e-6)


def test_only_seeds_that_land_in_the_scored_part_count() -> None:
    speed = np.repeat([1.0, SPEED], 2500)
    believed = np.repeat([3.0, SPEED], 2500)
    recording = _recording(_truth(speed, 0.0 * speed), {"one": _one_speed(believed)})
    toml = small_scenario_toml(seeding=IDEAL, duration_s=4000.0, scoring={"from_s": 50.0, "rows": [1, 8]})
    recording.scenario_toml = toml
    found = _metrics(recording)
    assert found["one.seeds.population_error_row_1_percent"] == pytest.approx(0.0, abs=0.2)
    assert found["one.seeds.multiples_percent"] == 0.0
    assert "one.seeds.population_error_row_4_percent" not in found


def test_estimators_side_by_side_have_the_same_luck_and_do_not_change_one_another() -> None:
    speed = np.full(5000, SPEED)
    truth, luck = _truth(speed, 0.0 * speed), {"skip_probability": 0.1, "double_probability": 0.1}
    both = _metrics(_recording(truth, {"one": _one_speed(speed), "two": _one_speed(speed)}, **luck))
    alone = _metrics(_recording(truth, {"two": _one_speed(speed)}, **luck))
    other_run = _metrics(_recording(truth, {"two": _one_speed(speed)}, run=1, **luck))
    for name, value in alone.items():
        if name.startswith("two.seeds"):
            np.testing.assert_equal(both[name], value)
            np.testing.assert_equal(both[name.replace("two", "one")], value)
    assert alone["two.seeds.misses_percent"] != other_run["two.seeds.misses_percent"]


def test_names_known_beforehand_are_the_names_that_come_out() -> None:
    speed = np.full(500, SPEED)
    recording = _recording(_truth(speed, 0.0 * speed), {"one": _one_speed(speed)})
    for faults in ([], [{"kind": "outage", "from_s": 2.0, "to_s": 3.0}]):
        toml = small_scenario_toml(seeding=IDEAL, sensors={"radar": {"faults": faults}}, duration_s=10.0)
        recording.scenario_toml = toml
        parsed = scenario_files.loads(toml, where="made_up")
        columns = {"one": recording.estimates("one").columns}
        names = metrics.metric_names(parsed, recording.truth.columns, columns)
        assert list(_metrics(recording)) == names
        assert ("one.seeds.misses_loss_percent" in names) == bool(faults)


def _pieces(stream: Stream, length: int) -> list[Stream]:
    return [
        Stream(columns=stream.columns, t_ns=stream.t_ns[i : i + length], values=stream.values[i : i + length])
        for i in range(0, len(stream), length)
    ]


@pytest.mark.parametrize("whole_truth", [True, False])
def test_pieces_score_as_the_whole_does(whole_truth: bool) -> None:
    speed = 2.0 + 0.5 * np.sin(0.01 * np.arange(6000))
    curvature = np.where(np.arange(6000) // 1000 % 2, 0.1, -0.08)
    defaults = {"drop_delay_s": 0.1, "drop_spread_s": 0.02, "skip_probability": 0.05, "double_probability": 0.05}
    truth = _truth(speed, curvature)
    recording = _recording(truth, {"one": _one_speed(speed)}, **defaults)
    parsed = scenario_files.loads(recording.scenario_toml, where="made_up")
    whole = metrics.compute(recording, parsed)
    estimate = recording.estimates("one")
    scorer = Scorer(parsed, truth.columns, {"one": estimate.columns})
    for true, piece in zip(_pieces(truth, 701), _pieces(estimate, 701), strict=True):
        scorer.add(truth if whole_truth else true, {"one": piece})
    for name, value in scorer.metrics().items():
        np.testing.assert_allclose(value, whole[name], rtol=1e-12, err_msg=name)


def test_without_seeding_and_without_row_places_there_are_no_seeds() -> None:
    speed = np.full(500, SPEED)
    truth = _truth(speed, 0.0 * speed)
    recording = _recording(truth, {"one": _one_speed(speed)})
    recording.scenario_toml = small_scenario_toml(duration_s=10.0)
    assert not any("seeds" in name for name in _metrics(recording))
    bare = [column for column in truth.columns if not column.endswith(("_e_m", "_n_m"))]
    bare_truth = Stream(columns=tuple(bare), t_ns=truth.t_ns, values=truth.select(bare))
    assert not any("seeds" in name for name in _metrics(_recording(bare_truth, {"one": _one_speed(speed)})))
