"""Coverage, overlap and skips of passes whose areas geometry gives."""

import math

import numpy as np
import pytest

from tests.scoring.lines import driven, guided
from tests.small_scenario import SMALL
from twin.coverage import CoverageConfig
from twin.errors import BadInputError
from twin.recording import Stream
from twin.scenario import Scenario, resolve
from twin.scoring.coverage import Coverage, cover, coverage_of, metrics, names, passes_of

# The three passes run from east 0 to 60 m on north 0, 3 and 6 m.
AREA = [5.0, -1.5, 55.0, 7.5]
AREA_M2 = 450.0


def _field(swath_m: float = 3.0, **changes: object) -> Scenario:
    coverage = {"swath_m": swath_m, "area_m": AREA, "cell_m": 0.05, **changes}
    return guided(coverage=coverage)


def _percent(found: dict[str, float]) -> tuple[float, float, float]:
    return tuple(found[f"coverage.{kind}_percent"] for kind in ("covered", "overlap", "skip"))  # type: ignore[return-value]


def test_a_swath_of_the_passes_distance_covers_all_once() -> None:
    scenario = _field(3.0)
    found = metrics(driven(scenario), scenario)
    assert list(found) == names(scenario, driven(scenario).columns)
    assert _percent(found) == pytest.approx((100.0, 0.0, 0.0))
    assert found["coverage.covered_m2"] == pytest.approx(AREA_M2)


@pytest.mark.parametrize("swath_m", [3.4, 3.25])
def test_a_wider_swath_overlaps_between_passes(swath_m: float) -> None:
    scenario = _field(swath_m)
    # two strips between three passes, each swath - 3 m wide; four edges of them are off by half a cell at most
    expected = 100.0 * 2.0 * (swath_m - 3.0) * 50.0 / AREA_M2
    covered, overlap, skip = _percent(metrics(driven(scenario), scenario))
    assert (covered, skip) == pytest.approx((100.0, 0.0))
    assert overlap == pytest.approx(expected, abs=100.0 * 4 * 0.025 * 50.0 / AREA_M2)


def test_a_narrower_swath_leaves_strips_out() -> None:
    scenario = _field(2.6)
    # 0.4 m between passes, twice, and 0.2 m at either edge of the area
    expected = 100.0 * (2 * 0.4 + 2 * 0.2) * 50.0 / AREA_M2
    covered, overlap, skip = _percent(metrics(driven(scenario), scenario))
    assert skip == pytest.approx(expected, abs=0.01)
    assert covered == pytest.approx(100.0 - expected, abs=0.01)
    assert overlap == 0.0


def test_a_pass_beside_its_line_overlaps_on_one_side_and_skips_on_the_other() -> None:
    scenario = _field(3.0)
    # the second pass runs west, so 0.5 m left of it is 0.5 m south, over the first
    covered, overlap, skip = _percent(metrics(driven(scenario, left_m={2: 0.5}), scenario))
    strip = 100.0 * 0.5 * 50.0 / AREA_M2
    assert (covered, overlap, skip) == pytest.approx((100.0 - strip, strip, strip), abs=0.01)


def test_raised_segments_do_not_cover() -> None:
    scenario = _field(3.0, area_m=[60.5, -1.5, 66.0, 7.5])
    assert _percent(metrics(driven(scenario), scenario)) == (0.0, 0.0, 100.0)


@pytest.mark.parametrize("turn_deg", [300.0, -300.0])
@pytest.mark.parametrize("radius_m", [4.0, 1.0])
def test_a_turn_covers_a_ring_and_its_own_middle_once(turn_deg: float, radius_m: float) -> None:
    """A bar of 3 m that turns on 4 m sweeps a ring of 2.5 to 5.5 m; on 1 m, a disc of which a part is swept twice."""
    area = [-8.0, -8.0, 8.0, 8.0]
    scenario = guided(
        [{"turn_deg": turn_deg, "radius_m": radius_m}],
        coverage={"swath_m": 3.0, "area_m": area, "cell_m": 0.02},
    )
    truth = driven(scenario, speed_m_s=0.5)
    inner, outer = radius_m - 1.5, radius_m + 1.5
    swept = math.radians(300.0) / 2.0 * (outer**2 - max(inner, 0.0) ** 2)
    if inner < 0.0:
        # the other end sweeps 300 degrees too, of which 60 are not yet covered by the outer one
        swept += math.radians(60.0) / 2.0 * inner**2
    found = metrics(_around_middle(truth, turn_deg, radius_m), scenario)
    assert found["coverage.covered_m2"] == pytest.approx(swept, rel=0.002)
    assert found["coverage.overlap_m2"] == 0.0


def _around_middle(truth: Stream, turn_deg: float, radius_m: float) -> Stream:
    """The turn with its middle at the origin, wherever the machine starts."""
    values = truth.values.copy()
    values[:, 0, 1] -= math.copysign(radius_m, turn_deg)
    return Stream(columns=truth.columns, t_ns=truth.t_ns, values=values)


def test_finer_cells_come_nearer_to_the_area() -> None:
    """A slanting strip: the error of a raster shrinks with its cells."""
    heading = math.radians(27.0)
    along = np.linspace(-40.0, 40.0, 1601)[:, np.newaxis] * [math.cos(heading), math.sin(heading)]
    errors = []
    for cell_m in (0.4, 0.1, 0.025):
        config = CoverageConfig(swath_m=3.13, area_m=(-10.0, -15.0, 10.0, 15.0), cell_m=cell_m)
        found = cover(config, along, np.full(len(along), heading), np.zeros(len(along), dtype=np.int64))
        errors.append(abs(found.shares["covered"] * 600.0 - 3.13 * 20.0 / math.cos(heading)))
        assert found.counts.max() == 1
    # 2 edges of 22 m that cut cells at a slant: chance alone would leave cell^1.5 sqrt(2 * 22 / 12)
    assert errors[0] < 0.4**1.5 * 4.0
    assert errors[1] < 0.1**1.5 * 4.0
    assert errors[2] < 0.025**1.5 * 4.0


def test_steps_of_any_length_join_without_seam() -> None:
    """A straight sweeps its strip whatever the poses' distance, and no cell twice even if every pose were a pass."""
    rng = np.random.default_rng(2)
    along = np.sort(rng.uniform(-40.0, 40.0, 400))
    along[[0, -1]] = -40.0, 40.0
    heading = math.radians(-61.0)
    points = along[:, np.newaxis] * [math.cos(heading), math.sin(heading)]
    config = CoverageConfig(swath_m=4.0, area_m=(-10.0, -10.0, 10.0, 10.0), cell_m=0.1)
    whole = cover(config, points[[0, -1]], np.full(2, heading), np.zeros(2, dtype=np.int64))
    pieces = cover(config, points, np.full(400, heading), np.arange(400))
    # the pieces' ends are rounded on their own: a cell whose middle lies on the very edge may go either way
    assert np.count_nonzero(pieces.counts != whole.counts) <= 2
    assert pieces.counts.max() == 1


def test_a_straight_begins_a_pass_unless_it_goes_on_in_line() -> None:
    row = {"straight_m": 10.0}
    turn = {"turn_deg": 90.0, "radius_m": 2.0}
    lifted = {**turn, "raised": True}
    path = [row, row, turn, row, lifted, turn, row, {"stop_s": 1.0}, row]
    assert passes_of(guided(path).planned_legs) == [0, 0, 0, 1, -1, 2, 3, 3, 3]


def test_nothing_is_counted_without_the_section_or_without_a_heading() -> None:
    truth = driven(guided())
    assert coverage_of(truth, guided()) is None
    scenario = _field(3.0)
    kept = [truth.columns.index(name) for name in ("position_e_m", "position_n_m", "segment")]
    without = Stream(columns=tuple(truth.columns[k] for k in kept), t_ns=truth.t_ns, values=truth.values[:, :, kept])
    assert metrics(without, scenario) == {}
    assert names(scenario, without.columns) == []


def test_shares_add_up() -> None:
    config = CoverageConfig(swath_m=1.0, area_m=(0.0, 0.0, 4.0, 2.0), cell_m=1.0)
    found = Coverage(config=config, counts=np.array([[0, 1, 2, 3], [1, 1, 1, 0]], dtype=np.uint8))
    assert found.shares == {"covered": 0.75, "overlap": 0.25, "skip": 0.25}
    assert found.area_m2 == 8.0


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"swath_m": 0.0}, "swath_m"),
        ({"area_m": [0.0, 0.0, -1.0, 5.0]}, "west, south, east and north"),
        ({"area_m": [0.0, 0.0, 1000.0, 1000.0]}, "too many"),
        ({"area_m": [0.0, 0.0, 1e9, 1.0], "cell_m": 1.0}, "1e6 m"),
        ({"area_m": [0.0, 0.0, 0.5, 5.0], "cell_m": 0.6}, "narrower than one cell"),
        ({"cell_m": 0.001}, "cell_m"),
        ({"width_m": 1.0}, "width_m"),
    ],
)
def test_a_wrong_area_is_told(changes: dict[str, object], said: str) -> None:
    with pytest.raises(BadInputError, match=said):
        _field(**changes)  # type: ignore[arg-type]


def test_only_a_path_driver_has_passes() -> None:
    table = {"machine": {"kind": "rail_bench"}, "driver": {"kind": "reciprocation", "stand_s": 1.0}}
    coverage = {"swath_m": 1.0, "area_m": [0.0, 0.0, 1.0, 1.0]}
    with pytest.raises(BadInputError, match="coverage: only a driver of kind 'path'"):
        _bench(table, coverage)


def _bench(table: dict[str, object], coverage: dict[str, object]) -> Scenario:
    bench = {**SMALL, **table, "sensors": {}, "estimators": {}, "coverage": coverage}
    return resolve(bench, where="bench")


def test_overlap_and_skips_are_what_the_error_from_pass_to_pass_makes() -> None:
    """Where neighbours are d too near or too far, d ~ N(0, s), s / sqrt(2 pi) of width is lost either way on average.

    Offsets are drawn every 5 m, straight between: 39 borders of 20 draws and what lies between them. A mean of 800
    draws of max(d, 0), whose standard deviation is 0.584 s, is within 0.062 s of s / sqrt(2 pi) with 3 sigma, 16 %.
    Between two draws the standard deviation is less, as the mean of the root below says.
    """
    passes, width, sigma, length = 40, 1.8, 0.1, 100.0
    rng = np.random.default_rng(5)
    knots = np.linspace(0.0, length, 21)
    along = np.arange(0.0, length, 0.1)
    rows, numbers = [], []
    for number in range(passes):
        offset = np.interp(along, knots, sigma * rng.standard_normal(len(knots)))
        rows.append(np.column_stack([along, number * width + offset]))
        numbers.append(np.append(np.full(len(along) - 1, number), -1))  # nothing from its end to the next
    points = np.concatenate(rows)
    area = (0.0, 0.0, length - 0.1, (passes - 1) * width)  # from the middle of the first to that of the last
    config = CoverageConfig(swath_m=width, area_m=area, cell_m=0.025)
    shares = cover(config, points, np.zeros(len(points)), np.concatenate(numbers)).shares
    expected = math.sqrt(2.0) * sigma * _mean_of_the_root() / math.sqrt(2.0 * math.pi) / width
    assert shares["overlap"] == pytest.approx(expected, rel=0.16)
    assert shares["skip"] == pytest.approx(expected, rel=0.16)


def _mean_of_the_root() -> float:
    """Mean of sqrt(a^2 + (1 - a)^2) for a from 0 to 1: standard deviation between two draws, for one of theirs."""
    a = np.linspace(0.0, 1.0, 10_001)
    return float(np.mean(np.hypot(a, 1.0 - a)))
