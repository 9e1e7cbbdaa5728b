"""What guidance is judged by, of made-up drives over three passes 3 m apart whose figures follow from geometry."""

import math

import numpy as np
import pytest
from scipy import stats

from tests.scoring.lines import UP_AND_DOWN, driven, estimate_of, figures, guided, scored
from tests.small_scenario import small_scenario
from twin.errors import BadInputError
from twin.recording import Stream, covariance_column
from twin.scenario import Scenario, resolve
from twin.scoring.honesty import pooled_metrics
from twin.scoring.metrics import metric_names
from twin.scoring.motion import motion_metrics, motion_names

EAST, NORTH = "position_e_m", "position_n_m"


def _machine(scenario: Scenario, truth: Stream) -> dict[str, float]:
    return {name: float(value[0]) for name, value in motion_metrics(truth, scenario).items()}


# --- across the track ------------------------------------------------------------------------------------------------


def test_a_bias_is_to_the_left_one_way_and_to_the_right_the_other() -> None:
    scenario = guided()
    truth = driven(scenario)
    found = figures(scenario, truth, estimate_of(truth, 1.0, 0.4))
    # two passes east with the error 0.4 m to the left, one west with it to the right; the 1 m along does not count
    # (but at the pass's last metre, where the track turns away)
    assert found["cross_track.mean_error_straights_m"] == pytest.approx(0.4 / 3.0, abs=0.01)
    assert found["cross_track.rmse_straights_m"] == pytest.approx(0.4, abs=0.01)
    assert found["cross_track.p95_abs_error_straights_m"] == pytest.approx(0.4, rel=0.03)
    # in a turn of 1.5 m radius the error lies across the track in one place
    assert found["cross_track.max_abs_error_turns_m"] == pytest.approx(math.hypot(1.0, 0.4), rel=0.05)


def test_an_error_along_the_track_is_none_across_it() -> None:
    scenario = guided([{"straight_m": 60.0}])
    truth = driven(scenario)
    found = figures(scenario, truth, estimate_of(truth, -2.5, 0.0))
    assert found["position.rmse_m"] == pytest.approx(2.5)
    assert found["cross_track.max_abs_error_m"] == pytest.approx(0.0, abs=1e-9)


def test_beside_the_lines_a_bias_is_a_mean_and_a_wave_is_spread() -> None:
    """A wave of amplitude a about a bias: a / sqrt(2) about the mean, 2 a from end to end, whichever way it goes."""
    scenario = guided()
    truth = driven(scenario)
    wave = 0.3 * np.sin(2.0 * np.pi * truth.column(EAST)[:, 0] / 5.0)
    found = figures(scenario, truth, estimate_of(truth, 0.0, wave - 2.0))
    assert found["line.mean_error_m"] == pytest.approx(-2.0, abs=0.01)
    assert found["line.abs_mean_error_m"] == pytest.approx(2.0, abs=0.01)
    assert found["line.sd_error_m"] == pytest.approx(0.3 / math.sqrt(2.0), rel=0.02)
    assert found["line.max_abs_deviation_m"] == pytest.approx(0.3, rel=0.06)
    assert found["line.span_m"] == pytest.approx(0.6, rel=0.06)


def test_lag_in_a_curve_is_little_across_the_track() -> None:
    """A point that lags by d lies on the driven arc; it is the chord's offset d^2 / 2R that a tangent would show."""
    scenario = guided([{"straight_m": 10.0}, {"turn_deg": 300.0, "radius_m": 10.0}])
    truth = driven(scenario)
    lag = 50  # 1 s, 2 m
    late = Stream(columns=(EAST, NORTH), t_ns=truth.t_ns[lag:], values=truth.values[:-lag, :, :2])
    found = figures(scenario, truth, late)
    assert found["position.rmse_m"] == pytest.approx(2.0, rel=0.01)
    assert found["cross_track.max_abs_error_m"] < 1e-3


def test_pieces_make_the_same_figures_as_the_whole() -> None:
    window = {"loss": {"from_s": 40.0, "to_s": 60.0}, "places": ["straight 60 m"]}
    scenario = guided(scoring=window)
    truth = driven(scenario)
    rng = np.random.default_rng(3)
    east, north = rng.normal(0.0, 0.3, (2, len(truth), 4))
    estimate = estimate_of(truth, east, north, **{f"{EAST}.sigma": 0.3, f"{NORTH}.sigma": 0.3})
    whole = scored(scenario, truth, estimate)
    expected = whole.metrics()
    assert any("cross_track" in name for name in expected)
    for scorer in (
        scored(scenario, truth, estimate, piece_s=7.0),
        scored(scenario, truth, estimate, piece_s=7.0, whole=True),
    ):
        found = scorer.metrics()
        assert set(found) == set(expected)
        for name, values in expected.items():
            np.testing.assert_allclose(found[name], values, rtol=1e-9, atol=1e-12, err_msg=name)
        for name in ("counts", "sums"):
            ours, theirs = (getattr(each.honesty()["one"], name) for each in (scorer, whole))
            np.testing.assert_allclose(ours, theirs, rtol=1e-9)


def test_members_are_judged_as_if_alone() -> None:
    scenario = guided(scoring={"places": ["straight 60 m"]})
    truth = driven(scenario)
    rng = np.random.default_rng(4)
    east, north = rng.normal(0.0, 0.5, (2, len(truth), 3))
    together = scored(scenario, truth, estimate_of(truth, east, north)).metrics()
    for member in range(3):
        alone = scored(scenario, truth, estimate_of(truth, east[:, member], north[:, member])).metrics()
        for name, values in together.items():
            assert values[member] == pytest.approx(alone[name][0], rel=1e-9, abs=1e-12), name


def test_names_known_beforehand_are_the_names_that_come_out() -> None:
    for changes in ({}, {"scoring": {"places": ["straight 60 m"], "loss": {"from_s": 1.0, "to_s": 2.0}}}):
        scenario = guided(coverage={"swath_m": 3.0, "area_m": [0.0, -2.0, 60.0, 8.0], "cell_m": 0.5}, **changes)
        truth = driven(scenario)
        estimate = estimate_of(truth, 0.1, 0.1, heading_rad=truth.column("heading_rad"))
        scorer = scored(scenario, truth, estimate)
        pooled = list(pooled_metrics(scorer.honesty(), scenario))
        found = [*motion_metrics(truth, scenario), *scorer.metrics(), *pooled]
        assert list(motion_metrics(truth, scenario)) == motion_names(scenario, truth.columns)
        assert found == metric_names(scenario, truth.columns, {"one": estimate.columns})


def test_other_scenarios_keep_their_metrics() -> None:
    scenario = resolve(small_scenario(), where="test")
    assert not scenario.judges_guidance
    truth = driven(scenario)
    names = metric_names(scenario, truth.columns, {"one": (EAST, NORTH)})
    assert not any("cross_track" in name or "pass_to_pass" in name or "step." in name for name in names)


def test_a_field_to_be_covered_is_about_guidance() -> None:
    coverage = {"swath_m": 3.0, "area_m": [0.0, -2.0, 60.0, 8.0]}
    assert resolve(small_scenario(coverage=coverage), where="test").judges_guidance
    assert not resolve(small_scenario(coverage=coverage, scoring={"guidance": False}), where="test").judges_guidance


# --- honesty ---------------------------------------------------------------------------------------------------------


def _claims(truth: Stream, east_sd: float, north_sd: float, correlation: float) -> dict[str, float]:
    return {
        f"{EAST}.sigma": east_sd,
        f"{NORTH}.sigma": north_sd,
        covariance_column(EAST, EAST): east_sd**2,
        covariance_column(EAST, NORTH): correlation * east_sd * north_sd,
        covariance_column(NORTH, NORTH): north_sd**2,
    }


def test_sigma_across_the_track_is_taken_from_the_whole_covariance() -> None:
    """On a slanting track, errors east and north that go together nearly cancel across it."""
    scenario = guided([{"straight_m": 200.0}], machine={"start": {"heading_deg": 45.0}})
    truth = driven(scenario)
    rng = np.random.default_rng(5)
    correlation, sd = 0.9, 0.08
    common, own = rng.normal(0.0, sd, (2, len(truth), 20))
    east, north = common, correlation * common + math.sqrt(1.0 - correlation**2) * own
    across = sd * math.sqrt(1.0 - correlation)
    honest = estimate_of(truth, east, north, **_claims(truth, sd, sd, correlation))
    blind = estimate_of(truth, east, north, **{f"{EAST}.sigma": sd, f"{NORTH}.sigma": sd})
    told = [pooled_metrics(scored(scenario, truth, each).honesty(), scenario) for each in (honest, blind)]
    # 100 000 epochs: a share of 99 % is known to 0.03 %
    assert told[0]["one.honesty.inside_percent"] == pytest.approx(99.0, abs=0.15)
    # whoever leaves the correlation out claims 1 / sqrt(1 - 0.9) = 3.2 times as much (in the worst of 100 bins of
    # 1000 epochs, of which each tells its ratio to 2.2 %)
    assert told[1]["one.honesty.largest_sigma_ratio"] == pytest.approx(1.0 / math.sqrt(1.0 - correlation), rel=0.1)
    found = scored(scenario, truth, honest).metrics()["one.cross_track.rmse_m"]
    assert float(np.sqrt(np.mean(found**2))) == pytest.approx(across, rel=0.01)


def test_who_claims_too_little_is_found_unsafe() -> None:
    scenario = guided([{"straight_m": 200.0}])
    truth = driven(scenario)
    estimate = estimate_of(truth, 0.0, 0.15, **{f"{EAST}.sigma": 0.02, f"{NORTH}.sigma": 0.02})
    told = pooled_metrics(scored(scenario, truth, estimate).honesty(), scenario)
    assert told["one.honesty.inside_percent"] == 0.0
    assert told["one.honesty.unsafe_percent"] == 100.0


def test_the_first_excess_of_a_decimetre_since_a_loss_is_timed() -> None:
    scenario = guided(
        [{"straight_m": 200.0}], scoring={"loss": {"from_s": 20.0, "to_s": 80.0}, "limits": {"cross_track": 0.2}}
    )
    truth = driven(scenario)
    drift = 0.01 * np.maximum(truth.t_s - 20.0, 0.0)
    found = figures(scenario, truth, estimate_of(truth, 0.0, drift))
    assert found["cross_track.time_to_100mm_s"] == pytest.approx(10.0, abs=0.05)
    assert found["cross_track.time_to_limit_s"] == pytest.approx(20.0, abs=0.05)


# --- between passes --------------------------------------------------------------------------------------------------


def test_a_bias_does_not_change_the_spacing_of_passes() -> None:
    scenario = guided()
    truth = driven(scenario)
    found = figures(scenario, truth, estimate_of(truth, 2.0, -3.0))
    for figure in ("median", "rms", "p95"):
        assert found[f"pass_to_pass.{figure}_m"] == pytest.approx(0.0, abs=1e-9)


def test_what_changes_from_pass_to_pass_does() -> None:
    scenario = guided()
    truth = driven(scenario)
    # error north by the leg: 0.0, 0.3 and 0.4 m on the passes
    north = np.array([0.0, 9.0, 0.3, 9.0, 0.4])[truth.column("segment")[:, 0].astype(int)]
    found = figures(scenario, truth, estimate_of(truth, 0.0, north))
    # pairs: 0.3, 0.4 and 0.1 m, each at all stations
    assert found["pass_to_pass.median_m"] == pytest.approx(0.3)
    assert found["pass_to_pass.rms_m"] == pytest.approx(math.sqrt((0.09 + 0.16 + 0.01) / 3.0), rel=0.02)
    assert found["pass_to_pass.p95_m"] == pytest.approx(0.4)


def test_errors_are_compared_at_equal_places_along_the_line() -> None:
    """An error that is a function of the place is the same on every pass, driven up or down, at any rate of output."""
    scenario = guided()
    truth = driven(scenario)
    north = 0.5 * np.sin(truth.column(EAST)[:, 0] / 7.0)
    dense = estimate_of(truth, 0.0, north)
    sparse = Stream(columns=dense.columns, t_ns=dense.t_ns[::50], values=dense.values[::50])
    assert figures(scenario, truth, dense)["pass_to_pass.p95_m"] == pytest.approx(0.0, abs=1e-3)
    # between outputs 2 m apart a sine of amplitude A leaves its chord by A (2 / 7)^2 / 8
    assert figures(scenario, truth, sparse)["pass_to_pass.p95_m"] < 2.0 * 0.5 * (2.0 / 7.0) ** 2 / 8.0


def test_passes_more_than_a_quarter_of_an_hour_apart_are_not_compared() -> None:
    path = [UP_AND_DOWN[0], UP_AND_DOWN[1], UP_AND_DOWN[2], {"stop_s": 40.0}, UP_AND_DOWN[3], UP_AND_DOWN[4]]
    scenario = guided(path, duration_s=2000.0)
    truth = driven(scenario)
    segments = truth.column("segment")[:, 0].astype(int)
    north = np.array([0.0, 0.0, 0.3, 0.0, 0.0, 0.4])[segments]
    late = Stream(columns=truth.columns, t_ns=truth.t_ns + 900 * 10**9 * (segments > 3), values=truth.values)
    assert figures(scenario, truth, estimate_of(truth, 0.0, north))["pass_to_pass.p95_m"] == pytest.approx(0.4)
    # now the third pass is at most 900 s after the second pass's end only, at no station
    assert figures(scenario, late, estimate_of(late, 0.0, north))["pass_to_pass.p95_m"] == pytest.approx(0.3)


def test_white_errors_differ_by_root_two_between_passes() -> None:
    scenario = guided([{"straight_m": 1000.0}, *UP_AND_DOWN[1:2], {"straight_m": 1000.0}], duration_s=1100.0)
    truth = driven(scenario)
    north = np.random.default_rng(6).normal(0.0, 0.2, len(truth))
    # outputs lie 0.04 m apart, so that a whole metre lies on one of them: nothing is averaged between two
    found = figures(scenario, truth, estimate_of(truth, 0.0, north))
    sigma = 0.2 * math.sqrt(2.0)
    assert found["pass_to_pass.rms_m"] == pytest.approx(sigma, rel=4.0 / math.sqrt(2.0 * 1000.0))
    assert found["pass_to_pass.median_m"] == pytest.approx(stats.norm.ppf(0.75) * sigma, rel=0.12)
    assert found["pass_to_pass.p95_m"] == pytest.approx(stats.norm.ppf(0.975) * sigma, rel=0.12)


# --- the machine -----------------------------------------------------------------------------------------------------


def test_a_machine_beside_its_lines_is_told_with_its_side() -> None:
    scenario = guided()
    found = _machine(scenario, driven(scenario, left_m={0: 0.2, 1: -0.5, 2: 0.2, 4: -0.1}))
    prefix = "truth.cross_track."
    assert found[prefix + "mean_error_straights_m"] == pytest.approx(0.1, abs=1e-3)
    assert found[prefix + "rmse_straights_m"] == pytest.approx(math.sqrt((0.04 + 0.04 + 0.01) / 3.0), rel=1e-3)
    assert found[prefix + "max_abs_error_straights_m"] == pytest.approx(0.2)
    assert found[prefix + "p95_abs_error_straights_m"] == pytest.approx(0.2)
    # half of the time in turns it is half a metre to the right, on the other turn on the arc
    assert found[prefix + "mean_error_turns_m"] == pytest.approx(-0.25, abs=2e-3)
    assert found[prefix + "max_abs_error_turns_m"] == pytest.approx(0.5)
    # in the fixed normal of the first pass: 0.2, -0.2 and -0.1 m
    assert found["truth.pass_to_pass.median_m"] == pytest.approx(0.3)
    assert found["truth.pass_to_pass.p95_m"] == pytest.approx(0.4)


def test_a_machine_beyond_the_end_of_a_line_is_not_beside_it() -> None:
    scenario = guided([{"straight_m": 60.0}])
    truth = driven(scenario)
    values = truth.values.copy()
    ahead = values[:, 0, 0] > 50.0
    values[ahead, 0, 0] += 20.0
    values[ahead, 0, 1] = 7.0
    found = _machine(scenario, Stream(columns=truth.columns, t_ns=truth.t_ns, values=values))
    assert found["truth.cross_track.max_abs_error_m"] == pytest.approx(0.0, abs=1e-9)


# --- steps -----------------------------------------------------------------------------------------------------------


def test_the_smallest_step_of_a_coarse_position_is_its_grid() -> None:
    scenario = guided([{"straight_m": 180.0}], machine={"start": {"heading_deg": 30.0}})
    truth = driven(scenario, speed_m_s=0.9)
    true_e, true_n = truth.column(EAST)[:, 0], truth.column(NORTH)[:, 0]
    coarse = estimate_of(truth, 2.21 * np.round(true_e / 2.21) - true_e, 0.68 * np.round(true_n / 0.68) - true_n)
    found = figures(scenario, truth, coarse)
    assert found["step.smallest_e_m"] == pytest.approx(2.21)
    assert found["step.smallest_n_m"] == pytest.approx(0.68)
    assert found["step.median_e_m"] == pytest.approx(2.21)


def test_the_steps_of_a_smooth_position_are_what_is_driven_in_a_second() -> None:
    scenario = guided([{"straight_m": 180.0}], machine={"start": {"heading_deg": 30.0}})
    truth = driven(scenario, speed_m_s=0.9)
    noise = np.random.default_rng(7).normal(0.0, 0.02, (2, len(truth)))
    found = figures(scenario, truth, estimate_of(truth, *noise))
    east, north = 0.9 * math.cos(math.radians(30.0)), 0.9 * math.sin(math.radians(30.0))
    assert found["step.median_e_m"] == pytest.approx(east, abs=0.01)
    assert found["step.median_n_m"] == pytest.approx(north, abs=0.01)
    # one in twenty is more than 1.645 sigma of a difference below
    assert found["step.smallest_e_m"] == pytest.approx(east - 1.645 * 0.02 * math.sqrt(2.0), abs=0.02)


def test_steps_of_turns_and_of_standing_do_not_count() -> None:
    path = [{"straight_m": 60.0}, {"turn_deg": 180.0, "radius_m": 10.0}, {"stop_s": 40.0}]
    scenario = guided(path)
    truth = driven(scenario)
    segments = truth.column("segment")[:, 0]
    jumps = np.where(segments > 0, 5.0 * (np.arange(len(truth)) // 50 % 2), 0.0)
    found = figures(scenario, truth, estimate_of(truth, jumps, jumps))
    assert found["step.median_e_m"] == pytest.approx(2.0)
    assert math.isnan(found["step.smallest_n_m"])


# --- places ----------------------------------------------------------------------------------------------------------

TESTED = [
    {"stop_s": 40.0, "label": "Stop 1"},
    {"straight_m": 60.0, "label": "track 1"},
    {"turn_deg": 90.0, "radius_m": 10.0, "label": "track 1"},
    {"stop_s": 40.0, "label": "stop 2"},
]


def test_each_place_has_its_own_table() -> None:
    scenario = guided(TESTED, scoring={"places": ["Stop 1", "track 1", "stop 2"], "guidance": False})
    truth = driven(scenario)
    segments = truth.column("segment")[:, 0].astype(int)
    rng = np.random.default_rng(8)
    east, north = np.array([0.2, -0.5, 0.1, 3.0])[segments], np.array([0.5, 1.0, 1.0, 4.0])[segments]
    east = east + np.where(segments == 0, rng.normal(0.0, 0.4, len(truth)), 0.0)
    found = figures(scenario, truth, estimate_of(truth, east, north))
    stop = east[segments == 0]
    assert found["place.stop_1.sigma_e_m"] == pytest.approx(np.std(stop, ddof=1))
    assert found["place.stop_1.mean_e_m"] == pytest.approx(stop.mean())
    assert found["place.stop_1.sigma_n_m"] == pytest.approx(0.0, abs=1e-12)
    assert found["place.stop_1.largest_m"] == pytest.approx(np.hypot(stop, 0.5).max())
    assert found["place.stop_1.smallest_m"] == pytest.approx(np.hypot(stop, 0.5).min())
    # both segments of the track are one place
    track = east[(segments == 1) | (segments == 2)]
    assert found["place.track_1.mean_e_m"] == pytest.approx(track.mean())
    assert found["place.track_1.sigma_e_m"] == pytest.approx(np.std(track, ddof=1))
    assert found["place.stop_2.largest_m"] == found["place.stop_2.smallest_m"] == pytest.approx(5.0)
    assert not any("cross_track" in name for name in found)


@pytest.mark.parametrize(
    ("places", "said"),
    [
        (["stop 3"], "unknown segment 'stop 3'; did you mean"),
        (["Stop 1", "stop-1"], "would both be 'stop_1'"),
        (["°"], "no letter or digit"),
    ],
)
def test_a_place_has_to_be_on_the_path(places: list[str], said: str) -> None:
    with pytest.raises(BadInputError, match=said):
        guided(TESTED, scoring={"places": places})
