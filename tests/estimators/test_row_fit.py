"""Two rows fitted to one scan: as good as theory says, and not led astray."""

from __future__ import annotations

import numpy as np
import pytest

from tests.estimators.rows import (
    FORWARD_M,
    RADIUS_M,
    WIDTH_M,
    lane,
    noisy,
    sheet_of,
    standing,
    turn,
)
from twin.estimators.lidar_scan import TrunkConfig, find_trunks
from twin.estimators.row_fit import RowFit, RowFitter, RowsConfig
from twin.signals import FloatArray

SHEET = sheet_of()
RUNS = 400


def fit(ranges: FloatArray, *, bias_ratio: float = 0.0, **rows: float) -> RowFit:
    """Fit of scans (R, n) of a machine that stands."""
    config = RowsConfig.model_validate({"lane_width_m": WIDTH_M, **rows})
    trunks = find_trunks(ranges, SHEET, TrunkConfig())
    x = SHEET.forward_m + trunks.range_m * np.cos(trunks.bearing_rad)
    y = SHEET.left_m + trunks.range_m * np.sin(trunks.bearing_rad)
    nothing = np.zeros((len(ranges), 2)), np.full((len(ranges), 2), np.inf)
    return RowFitter(config, bias_ratio=bias_ratio).fit(trunks, x, y, *nothing)


# --- trunks ----------------------------------------------------------------------------------------------------------


def test_a_trunk_is_where_it_stands() -> None:
    trees = np.array([[11.2, 0.45, RADIUS_M], [9.0, -0.45, RADIUS_M]])
    trunks = find_trunks(turn(trees, standing(0.0, 0.0, 10.0), 1.0)[np.newaxis], SHEET, TrunkConfig())
    assert trunks.there.sum() == 2
    for place, (east, north) in enumerate([(1.2, 0.45), (-1.0, -0.45)]):
        x = FORWARD_M + trunks.range_m[0, place] * np.cos(trunks.bearing_rad[0, place])
        y = trunks.range_m[0, place] * np.sin(trunks.bearing_rad[0, place])
        # Half a beam at 1.2 m is 1 cm across; along the beam the mean of a disc's face is meant, five beams of it.
        assert np.hypot(x - east, y - north) < 0.012
        assert trunks.age_s[0, place] == pytest.approx(
            0.2 * (1.0 - (trunks.bearing_rad[0, place] / (2 * np.pi))), abs=2e-3
        )


def test_single_beams_and_long_faces_are_no_trunks() -> None:
    ranges = np.full((1, 360), np.nan)
    ranges[0, 40] = 1.0  # a wrong spot
    ranges[0, 100:130] = 1.0  # half a metre of ground
    ranges[0, 200:204] = 1.0  # a trunk of 7 cm
    assert find_trunks(ranges, SHEET, TrunkConfig()).there.sum() == 1
    # A beam that is lost in the middle of a trunk does not part it, two do.
    ranges[0, 202] = np.nan
    assert find_trunks(ranges, SHEET, TrunkConfig()).there.sum() == 1
    ranges[0, 201:203] = np.nan
    assert find_trunks(ranges, SHEET, TrunkConfig(lost_between=1)).there.sum() == 0


def test_members_are_found_alone_as_together() -> None:
    rng = np.random.default_rng(3)
    ranges = noisy(turn(lane(), standing(0.1, 0.1), 1.0), rng, 3)
    ranges[1] = np.nan
    together = find_trunks(ranges, SHEET, TrunkConfig())
    assert together.there[1].sum() == 0
    for member in (0, 2):
        alone = find_trunks(ranges[member : member + 1], SHEET, TrunkConfig())
        count = int(alone.there.sum())
        assert together.there[member].sum() == count
        np.testing.assert_array_equal(alone.range_m[0], together.range_m[member, :count])


# --- accuracy --------------------------------------------------------------------------------------------------------


def crooked_scans(crooked_m: float, offset_m: float, heading_rad: float, *, seeds: int, noise: bool) -> FloatArray:
    """One scan each of lanes whose trees stand beside their rows."""
    scans = []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        trees = lane(from_m=5.0, to_m=16.0)
        trees[:, :2] += crooked_m * rng.normal(size=(len(trees), 2))
        ranges = turn(trees, standing(offset_m, heading_rad), 1.0)
        scans.append(noisy(ranges, rng)[0] if noise else ranges)
    return np.array(scans)


def test_offset_and_heading_err_as_crooked_rows_must() -> None:
    # Rows of three trees ahead and three behind within 3 m, x from the machine: of N trees of sigma c beside their rows
    # the mean is off by c / sqrt(N), the slope by c / sqrt(sum (x - mean)^2).
    crooked, x = 0.03, np.arange(8.0, 14.0) - 10.3
    x = x[np.abs(x) < 2.95]
    found = fit(crooked_scans(crooked, 0.0, 0.0, seeds=RUNS, noise=False), crooked_m=crooked, width_sigma_m=0.0)
    assert found.good.all()
    centred = x - x.mean()
    slope = crooked / np.sqrt(2.0 * np.sum(centred**2))
    level = crooked / np.sqrt(2.0 * len(x)) * np.hypot(1.0, x.mean() * np.sqrt(len(x) / np.sum(centred**2)))
    # 400 worlds tell a sigma to 3.5 %; Tukey's weights cost 5 % and single trees come and go at the edge.
    assert np.std(found.heading_rad) == pytest.approx(slope, rel=0.2)
    assert np.std(found.offset_m) == pytest.approx(level, rel=0.2)
    # And the fit says so.
    claimed = np.sqrt(np.diagonal(found.covariance.mean(axis=0)))
    assert claimed == pytest.approx([level, slope], rel=0.2)


@pytest.mark.parametrize(("offset", "heading"), [(0.0, 0.0), (0.12, 0.1), (-0.2, -0.3), (0.25, 0.35)])
def test_range_noise_counts_for_little_and_is_claimed(offset: float, heading: float) -> None:
    ranges = noisy(turn(lane(), standing(offset, heading), 1.0), np.random.default_rng(1), RUNS)
    found = fit(ranges, crooked_m=0.001, width_sigma_m=0.0)
    assert found.good.all()
    assert (found.rows_seen == 2).all()
    errors = np.column_stack([found.offset_m - offset, found.heading_rad - heading])
    # Across the lane a beam errs by 0.0175 of the range times the sine of its bearing: by 0.0175 of half the width at
    # any range, 8 mm. About twelve trunks of three to fourteen beams: 8 mm / sqrt(60) = 1 mm.
    assert np.std(errors[:, 0]) < 0.0015
    # Where the beams hit is the same in all scans of a machine that stands: one draw of what is claimed.
    claimed = np.sqrt(np.diagonal(found.covariance.mean(axis=0)))
    rms = np.sqrt(np.mean(errors**2, axis=0))
    assert (rms < 2.0 * claimed).all()
    assert (claimed < [0.002, 0.002]).all()


def test_a_range_error_in_proportion_does_not_move_the_middle_of_two_rows() -> None:
    ranges = turn(lane(), standing(0.1, 0.05), 1.0)[np.newaxis] * 1.036  # two sigma of the unit's constant error
    found = fit(ranges, bias_ratio=0.018)
    # Seen 3.6 % too far: the offset reads 3.6 % more, 4 mm, not 3.6 % of half the lane, 16 mm.
    assert found.offset_m[0] == pytest.approx(0.1036, abs=0.002)
    assert found.heading_rad[0] == pytest.approx(0.05, abs=0.003)


# --- what goes wrong -------------------------------------------------------------------------------------------------


def test_missing_trees_are_not_missed() -> None:
    trees = lane()
    keep = np.random.default_rng(5).random((50, len(trees))) > 0.3
    scans = np.array([turn(trees[each], standing(0.1, 0.1), 1.0) for each in keep])
    found = fit(scans)
    assert found.good.mean() > 0.9
    np.testing.assert_allclose(found.offset_m[found.good], 0.1, atol=0.01)
    np.testing.assert_allclose(found.heading_rad[found.good], 0.1, atol=0.01)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_one_row_gives_an_offset_as_good_as_the_width_is_known(side: float) -> None:
    trees = lane()
    ranges = turn(trees[trees[:, 1] * side > 0.0], standing(0.1, 0.1), 1.0)[np.newaxis]
    found = fit(ranges, width_sigma_m=0.05)
    assert found.good.all()
    assert found.rows_seen[0] == 1
    assert found.offset_m[0] == pytest.approx(0.1, abs=0.01)
    # Half of what the width is off by stands in the offset, and stays.
    assert np.sqrt(found.standing[0, 0, 0]) == pytest.approx(np.hypot(0.025, 0.03 / np.sqrt(6.0)), rel=0.15)
    wider = lane(width_m=WIDTH_M + 0.06)
    both = fit(turn(wider, standing(0.1, 0.1), 1.0)[np.newaxis], width_sigma_m=0.05)
    assert both.offset_m[0] == pytest.approx(0.1, abs=0.005)  # two rows need no width


def test_things_between_the_rows_weigh_nothing() -> None:
    trees = np.vstack([lane(), [[11.0, 0.15, 0.05], [9.2, -0.1, 0.04], [12.0, 0.0, 0.05]]])
    found = fit(turn(trees, standing(0.05, -0.05), 1.0)[np.newaxis])
    assert found.offset_m[0] == pytest.approx(0.05, abs=0.006)
    assert found.heading_rad[0] == pytest.approx(-0.05, abs=0.006)


def test_neighbouring_lanes_do_not_pull() -> None:
    trees = lane()
    beside = [trees + np.array([0.0, shift, 0.0]) for shift in (2 * WIDTH_M, -2 * WIDTH_M)]
    found = fit(turn(np.vstack([trees, *beside]), standing(0.1, 0.2), 1.0)[np.newaxis])
    assert found.offset_m[0] == pytest.approx(0.1, abs=0.006)


def test_nothing_and_too_little_are_no_fit() -> None:
    assert not fit(np.full((2, 360), np.nan)).good.any()
    trees = lane()
    near = trees[(np.abs(trees[:, 0] - 10.3) < 0.8)]  # one pair beside the machine tells no heading
    assert len(near) == 4
    pair = fit(turn(near[near[:, 0] < 10.2], standing(0.0, 0.0), 1.0)[np.newaxis])
    assert not pair.good.any()
    assert pair.rows_seen[0] == 0


def test_wrong_spots_alone_are_rarely_taken_for_rows() -> None:
    # What the LDS-01 gives in full sun: nine beams of ten are lost, one of ten of those lands anywhere.
    rng = np.random.default_rng(8)
    wrong = np.where(rng.random((500, 360)) < 0.09, 0.12 + 3.38 * rng.random((500, 360)), np.nan)
    assert fit(wrong).good.mean() < 0.01
