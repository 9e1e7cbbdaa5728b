"""A real run that is judged as guidance: every metric promised comes out, and they agree with one another."""

import numpy as np
import pytest
import tomli_w

from tests.small_scenario import IMUS, small_scenario
from twin.execution import execute
from twin.recording import Recording
from twin.scenario import load, loads
from twin.scoring.metrics import compute, metric_names

SWATH_M = 6.0


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    table = small_scenario(
        duration_s=16.0,
        driver={"path": [{"stop_s": 3.0}, {"straight_m": 20.0, "label": "row"}]},
        estimators={"ins": {"kind": "row_speed_ins", "sensors": [*IMUS, "radar", "gnss"]}},
        # more than the bar drives over, which hangs behind the axle
        coverage={"swath_m": SWATH_M, "area_m": [-20.0, -10.0, 40.0, 10.0], "cell_m": 0.1},
        scoring={"from_s": 4.0, "places": ["row"]},
    )
    path = tmp_path_factory.mktemp("guided") / "guided.toml"
    path.write_text(tomli_w.dumps(table))
    return execute(load(path))


def test_a_run_has_the_metrics_that_were_promised(recording: Recording) -> None:
    scenario = loads(recording.scenario_toml, where="guided")
    estimates = {name: recording.estimates(name).columns for name in recording.names("estimates")}
    found = compute(recording, scenario)
    assert set(found) == set(metric_names(scenario, recording.truth.columns, estimates))
    assert "ins.cross_track.rmse_straights_m" in found
    assert "ins.honesty.inside_percent" in found


def test_what_is_covered_is_the_swath_along_the_way_driven(recording: Recording) -> None:
    found = compute(recording, loads(recording.scenario_toml, where="guided"))
    way = np.ptp(recording.truth.column("position_e_m")[:, 0])
    assert way > 15.0
    # the strip's four edges are off by half a cell at most
    assert found["truth.coverage.covered_m2"][0] == pytest.approx(SWATH_M * way, abs=0.1 * (SWATH_M + way))
    assert found["truth.coverage.overlap_m2"][0] == 0.0


def test_the_error_across_the_track_is_a_part_of_the_position_s(recording: Recording) -> None:
    found = {
        name: float(value[0]) for name, value in compute(recording, loads(recording.scenario_toml, where="x")).items()
    }
    assert found["ins.cross_track.rmse_m"] <= found["ins.position.rmse_m"] * 1.001
    # the machine drives eastwards: what lies across is what lies north, but for the track's own sway
    assert found["ins.cross_track.mean_error_m"] == pytest.approx(found["ins.place.row.mean_n_m"], abs=2e-3)
    # RTK: a centimetre or two (that of a standing u-blox F9P wanders by 5 mm), and a driver who sees the truth
    assert found["ins.cross_track.max_abs_error_m"] < 0.1
    assert found["truth.cross_track.max_abs_error_straights_m"] < 0.1
