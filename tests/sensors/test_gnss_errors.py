"""Errors across time and states: growth with the age of corrections, steps at transitions, memory of a state."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tests.sensors.f9p_record import FOLDER, Record, load
from tests.sensors.motions import STANDING, Log, drive, preset, sensor
from tests.sensors.test_gnss_states import ONLY, log_of
from twin.signals import POSITION

MEASURED_MM = {1: 15.0, 10: 21.0, 20: 31.0, 30: 41.0, 40: 58.0}
"""Vertical sigma by age of corrections (s), lefebure.com/articles/rtk-correction-data-age-accuracy."""
RATIO = 1.9
"""Vertical to horizontal."""


def errors(log: Log, part: str = "error") -> np.ndarray:
    """(T, R, 3)."""
    return np.stack([log.hidden(f"{column}.{part}") for column in POSITION], axis=-1)


def outage() -> Log:
    # Samples at full seconds: 1 s old. Those of 9 s arrive at 9.5 s and are the last until those of 52 s at 52.5 s.
    fault = {"kind": "corrections_lost", "from_s": 10.0, "to_s": 52.0}
    return log_of("rtk_survey", fault, until_s=53.0, runs=2000, rate_hz=1.0)


def test_fixed_error_grows_with_the_age_of_corrections_as_measured() -> None:
    log = outage()
    error, age = errors(log), log.values("age_s")[:, 0]
    np.testing.assert_allclose(age[9:52], np.arange(1.0, 44.0), atol=1e-9)
    for seconds, measured in MEASURED_MM.items():
        row = 8 + seconds  # 1 s old at 10 s, which is row 9
        east, _, up = 1e3 * np.std(error[row], axis=0)
        # The formula is up to 9 % off the measured points; 2000 runs have 1.6 %.
        assert up == pytest.approx(math.hypot(15.0, 1.4 * seconds), rel=0.065)
        assert up == pytest.approx(measured, rel=0.15)
        assert east == pytest.approx(up / RATIO, rel=0.10)
        # The receiver knows.
        assert 1e3 * log.values("sigma_u_m")[row, 0] == pytest.approx(math.hypot(15.0, 1.4 * seconds), rel=1e-9)


def test_growth_is_a_drift_and_not_noise_and_ends_with_a_step() -> None:
    log = outage()
    slow = errors(log, "correlated")[:, :, 2]
    # In one second: 1.4 mm of age, 14 mm sqrt(2/100) of the fresh part, 56 mm sqrt(2/100) of the drift's direction.
    bound = math.hypot(1.4e-3, math.hypot(0.014, 0.056) * math.sqrt(2 / 100))
    moves = np.std(np.diff(slow[9:50], axis=0), axis=1)
    assert moves.max() < 1.1 * bound
    # New corrections at 53 s: from 15 and 60 mm (age 43) back to 14 mm, and the step is what was lost.
    assert np.std(slow[52]) == pytest.approx(0.014, rel=0.07)
    assert np.std(slow[52] - slow[51]) == pytest.approx(1.4e-3 * 43, rel=0.07)
    # Drift in one direction: over 20 s the error at age 40 is mostly that of age 20, doubled.
    assert np.corrcoef(slow[28], slow[48])[0, 1] > 0.6


def test_steps_between_fix_and_float_are_as_large_as_in_the_record() -> None:
    # Medians in the F9P record: 0.16 m into float, 0.13 m out of it (three axes), 21 transitions each, which know their
    # own median to 25 % (bootstrap). Most of its episodes of float lasted less than half a minute: 20 s here.
    mask = {"kind": "satellites_masked", "satellites": 20, "from_s": 10.0, "to_s": 30.0}
    states = {"fix": {"satellites_needed": 21}}
    log = log_of("rtk_f9p", mask, until_s=60.0, runs=1000, states=states)
    error, quality = errors(log), log.values("quality")
    into, out = [], []
    for run in range(1000):
        changed = np.flatnonzero(np.diff(quality[:, run])) + 1
        assert quality[changed, run].tolist() == [5.0, 4.0]
        steps = np.linalg.norm(error[changed, run] - error[changed - 1, run], axis=1)
        into.append(steps[0])
        out.append(steps[1])
    assert np.median(into) == pytest.approx(0.16, rel=0.25)
    assert np.median(out) == pytest.approx(0.13, rel=0.25)


def test_step_to_differential_is_several_feet() -> None:
    fault = {"kind": "corrections_lost", "from_s": 10.0}
    log = log_of("rtk_chcnav_i70", fault, until_s=25.0, runs=1000)
    row = int(np.argmax(log.values("quality")[:, 0] == 2.0))
    step = errors(log)[row] - errors(log)[row - 1]
    # Independent of the fix: 0.4 m and 0.05 m white per horizontal axis; 1000 runs: 2.2 %.
    assert np.std(step[:, 0]) == pytest.approx(math.hypot(0.4, 0.05), rel=4 * 0.022)
    assert 1.0 < np.median(np.linalg.norm(step, axis=1)) / 0.3048 < 6.0


def test_a_receiver_back_after_a_moment_finds_the_error_it_left_and_a_new_one_after_long() -> None:
    # Single for 20 s, then for 600 s; 1/e time of the up error of a fix 100 s.
    states = {"fix": {"acquire_s": 0.0}}

    def left(seconds: float) -> float:
        mask = {"kind": "satellites_masked", "satellites": 4, "from_s": 10.0, "to_s": 10.0 + seconds}
        log = log_of("rtk_f9p", mask, until_s=11.0 + seconds, runs=1000, states=states, rate_hz=1.0)
        slow = errors(log, "correlated")[:, :, 2]
        assert log.values("quality")[[8, 9, -2], 0].tolist() == [4.0, 1.0, 4.0]
        return float(np.corrcoef(slow[8], slow[-2])[0, 1])

    # The age drift (1.4 mm at 1 s beside 5 mm, same 1/e time) decays alike. Standard error at most 1/sqrt(1000).
    assert left(20.0) == pytest.approx(math.exp(-21.0 / 100.0), abs=4 * 0.032)
    assert left(600.0) == pytest.approx(math.exp(-601.0 / 100.0), abs=4 * 0.032)


@pytest.fixture(scope="module")
def record() -> Record:
    if not Path(FOLDER).is_dir():
        pytest.skip(f"no F9P record in {FOLDER}")
    return load()


def test_float_error_is_like_the_f9p_record(record: Record) -> None:
    """Decided beforehand: rms per axis within a factor of 2, time over which it is correlated within a factor of 5,
    median squared normalised error within a factor of 5 and above 50 in both (1/0.455 = 2.2 times less than the mean
    of a normal error; an honest receiver has 0.455)."""
    log = log_of("rtk_f9p", until_s=1000.0, runs=200, states=ONLY["float"], rate_hz=1.0)
    ours = errors(log)[400:]
    for axis, column in enumerate(POSITION):
        theirs, claimed = record.float_error_m[:, axis], record.float_sigma_m[:, axis]
        assert 0.5 < np.sqrt(np.mean(ours[..., axis] ** 2)) / np.sqrt(np.mean(theirs**2)) < 2.0
        ours_nees = np.median((ours[..., axis] / log.values(f"sigma_{column[9]}_m")[400:]) ** 2)
        theirs_nees = np.median((theirs / claimed) ** 2)
        assert min(ours_nees, theirs_nees) > 50.0
        assert 0.2 < ours_nees / theirs_nees < 5.0
        left = np.mean(ours[:-10, :, axis] * ours[10:, :, axis]) / np.mean(ours[..., axis] ** 2)
        tau, recorded_tau = -10.0 / math.log(left), record.correlation_s(axis, lag_s=10)
        assert 0.2 < tau / recorded_tau < 5.0


def test_steps_in_the_record_are_those_the_model_was_made_for(record: Record) -> None:
    assert np.median(record.steps_m(1, 2)) == pytest.approx(0.16, abs=0.01)
    assert np.median(record.steps_m(2, 1)) == pytest.approx(0.13, abs=0.01)


def test_a_pinned_state_is_never_left() -> None:
    log = drive(sensor(preset("rtk_f9p") | {"state": "fix", "faults": [{"kind": "corrections_lost"}]}), STANDING, 100.0)
    assert np.all(log.values("quality") == 4.0)
