"""Positions of another log, on this one's clock and in its frame."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.logs import ORIGIN, MadeUpLog, fix
from twin.errors import BadInputError
from twin.formats.geodetic import Origin
from twin.logreplay.reference import ReferenceTrack
from twin.signals import NS_PER_S, Measurement

START = 1_600_000_000 * NS_PER_S


def track(*fixes: Measurement, start_utc_ns: int | None = START, origin: Origin = ORIGIN) -> ReferenceTrack:
    log = MadeUpLog(fixes, start_utc_ns=start_utc_ns, origin=origin)
    return ReferenceTrack(log, origin=ORIGIN, start_utc_ns=START, longest_gap_s=1.05)


def at(reference: ReferenceTrack, *t_s: float) -> np.ndarray:
    t_ns = np.array([round(each * NS_PER_S) for each in t_s], dtype=np.int64)
    reference.advance(int(t_ns.min()), int(t_ns.max()))
    found = reference.at(t_ns)
    return np.column_stack([found.east_m, found.north_m, found.var_e_m2, found.fixed])


def test_between_two_positions_lies_a_line() -> None:
    reference = track(fix(0.0, 0.0, 10.0, sigma_m=2.0, quality=4), fix(1.0, 4.0, 8.0, sigma_m=4.0, quality=4))
    np.testing.assert_allclose(at(reference, 0.0, 0.25, 1.0), [[0, 10, 4, 1], [1, 9.5, 6.25, 1], [4, 8, 16, 1]])


def test_nothing_is_said_across_gaps_before_the_beginning_and_after_the_end() -> None:
    reference = track(fix(0.0, 0.0, 0.0), fix(1.0, 1.0, 0.0), fix(3.0, 3.0, 0.0))
    found = at(reference, -0.5, 0.5, 1.0, 2.0, 3.0, 3.1)[:, 0]
    np.testing.assert_allclose(found, [math.nan, 0.5, 1.0, math.nan, 3.0, math.nan])


def test_lost_repeated_and_late_positions_are_passed_over() -> None:
    reference = track(
        fix(0.0, 0.0, 0.0),
        fix(0.5, 99.0, 99.0, valid=False),
        fix(1.0, 1.0, 0.0),
        fix(1.0, 55.0, 0.0),
        fix(0.7, 77.0, 0.0),
        fix(1.5, math.nan, 0.0),
        fix(2.0, 2.0, 0.0),
    )
    np.testing.assert_allclose(at(reference, 0.5, 1.0, 1.5)[:, 0], [0.5, 1.0, 1.5])


def test_clocks_are_matched_by_utc() -> None:
    # The reference began 90.5 s later: what it calls 10 s is 100.5 s here.
    reference = track(fix(9.5, 0.0, 0.0), fix(10.5, 1.0, 0.0), start_utc_ns=START + round(90.5 * NS_PER_S))
    assert at(reference, 100.5)[0, 0] == pytest.approx(0.5)


def test_a_reference_with_another_origin_is_brought_into_this_frame() -> None:
    # One minute of latitude is 1854.6 m at 52 deg (WGS 84: M = 6 375 5xx m; times pi / 180 / 60).
    north = ORIGIN.model_copy(update={"latitude_deg": 52.0 + 1.0 / 60.0})
    found = at(track(fix(0.0, 0.0, 0.0), origin=north), 0.0)[0]
    sine = math.sin(math.radians(52.0 + 0.5 / 60.0))
    e2 = 6.69437999014e-3
    meridian_m = 6_378_137.0 * (1.0 - e2) / (1.0 - e2 * sine**2) ** 1.5
    assert found[0] == pytest.approx(0.0, abs=1e-6)
    assert found[1] == pytest.approx((meridian_m + 40.0) * math.radians(1.0 / 60.0), abs=1e-3)


def test_heights_are_brought_along_and_unknown_ones_stay_unknown() -> None:
    higher = ORIGIN.model_copy(update={"height_m": ORIGIN.height_m + 5.0})
    fixes = (fix(0.0, 0.0, 0.0, up_m=1.0, sigma_m=3.0), fix(1.0, 0.0, 0.0, up_m=math.nan))
    for origin, above in ((ORIGIN, 1.0), (higher, 6.0)):
        reference = track(*fixes, origin=origin)
        reference.advance(0, NS_PER_S)
        found = reference.at(np.array([0, NS_PER_S], dtype=np.int64))
        np.testing.assert_allclose(found.up_m, [above, math.nan], atol=1e-6)
        np.testing.assert_allclose(found.var_u_m2, [9.0, 1.0])
        assert np.isfinite(found.east_m).all()


def test_it_is_read_along_in_memory_that_does_not_grow() -> None:
    reference = track(*(fix(float(t), float(t), 0.0) for t in range(20_000)))
    for t_s in range(0, 19_000, 500):
        np.testing.assert_allclose(at(reference, t_s + 0.25, t_s + 500.0)[:, 0], [t_s + 0.25, t_s + 500.0])
        assert len(reference._t_ns) < 500 + 20 + 2 * 512


@pytest.mark.parametrize("years", [-99, -1.1, 1.1, 99])
def test_logs_that_lie_years_apart_are_refused(years: float) -> None:
    away_ns = round(years * 365.25 * 86_400) * NS_PER_S
    with pytest.raises(BadInputError, match=rf"begins {abs(years):.1f} years away"):
        track(fix(0.0, 0.0, 0.0), start_utc_ns=START + away_ns)


@pytest.mark.parametrize("undated", ["reference", "replayed"])
def test_without_a_date_times_cannot_be_matched(undated: str) -> None:
    log = MadeUpLog([fix(0.0, 0.0, 0.0)], start_utc_ns=None if undated == "reference" else START)
    with pytest.raises(BadInputError, match=undated):
        ReferenceTrack(log, origin=ORIGIN, start_utc_ns=None if undated == "replayed" else START, longest_gap_s=1.0)
