"""A carrier drives a curve with the sensors of paper 003, all sampled when the receiver's sentence arrives."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import tomli_w

from twin.execution import execute
from twin.recording import Recording
from twin.scenario import load

TRIGGERED = ("gyro", "potentiometer", "encoders")
TABLE: dict[str, Any] = {
    "title": "A curve",
    "duration_s": 20.0,
    "terrain": {"kind": "flat", "size_m": [40.0, 40.0], "cell_m": 0.2},
    "soil": {"preset": "firm"},
    "machine": {"kind": "scraper"},
    "driver": {"speed_m_s": 0.73, "path": [{"stop_s": 1.0}, {"straight_m": 2.0}, {"turn_deg": 170.0, "radius_m": 4.0}]},
    "sensors": {
        "gps": {"preset": "lea_5s", "mount": "antenna"},
        "gyro": {
            "kind": "yaw_gyro",
            "mount": "chassis",
            "rate_hz": 1.0,
            "triggered_by": "gps",
            "range_rad_s": math.radians(70.0),
            "converter": {"bits": 16},
        },
        "potentiometer": {"kind": "angle_transducer", "mount": "chassis", "rate_hz": 1.0, "triggered_by": "gps"},
        "encoders": {"preset": "encoders_e6b2", "mount": "chassis", "triggered_by": "gps"},
    },
}


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    path = tmp_path_factory.mktemp("triggered") / "curve.toml"
    path.write_text(tomli_w.dumps(TABLE), encoding="utf-8")
    return execute(load(path), runs=(0, 1))


def test_all_sample_together_when_the_sentence_arrives(recording: Recording) -> None:
    gps = recording.measurements("gps")
    assert gps.t_available_ns is not None
    came = gps.t_available_ns[gps.t_available_ns <= 20_000_000_000]
    assert len(came) == 19
    for name in TRIGGERED:
        np.testing.assert_array_equal(recording.measurements(name).t_ns, came)


def test_the_gyro_sums_up_to_the_angle_turned(recording: Recording) -> None:
    gyro, truth = recording.measurements("gyro"), recording.truth
    intervals_s = np.diff(gyro.t_ns, prepend=0) / 1e9
    heading = np.unwrap(truth.column("heading_rad")[:, 0])
    turned = np.interp(gyro.t_ns[-1], truth.t_ns, heading) - heading[0]
    assert turned > 2.0
    # Evenly within half a step of the converter each second (2.1e-3 deg/s), 20 of them; on flat ground the carrier
    # leans in the curve by a fraction of a degree, whose cosine is one to 1e-4.
    assert np.sum(gyro.values[:, 0, 0] * intervals_s) == pytest.approx(turned, abs=20 * 1.9e-5 + 1e-4 * turned)


def test_potentiometer_and_encoders_tell_the_same_curve(recording: Recording) -> None:
    truth, angle, counts = recording.truth, recording.measurements("potentiometer"), recording.measurements("encoders")
    # A wheel in the middle of the front axle points along the circle: atan(wheelbase / radius). Side slip is small.
    steady = angle.values[(angle.t_ns > 8e9) & (angle.t_ns < 16e9), 0, 0]
    assert np.mean(steady) == pytest.approx(math.atan(1.1 / 4.0), rel=0.03)
    # Outer less inner wheel: the angle turned times the track over the rolling radius, in slots; counts round down
    # twice each, and wheels slip by a few per cent of the difference.
    slots = counts.values[-1, 0] - counts.values[3, 0]
    heading = np.interp(counts.t_ns[[3, -1]], truth.t_ns, np.unwrap(truth.column("heading_rad")[:, 0]))
    expected = np.diff(heading)[0] * 1.20 / 0.4635 * 360.0 / (2.0 * math.pi)
    assert slots[1] - slots[0] == pytest.approx(expected, rel=0.05, abs=2.0)
