"""Sensors that sample when another's sentence arrives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from tests.sensors.motions import CONFIGS, DT_NS, MOUNT, STANDING, Log, constant, drive
from tests.sensors.test_gnss import PERFECT as RECEIVER
from tests.small_scenario import SMALL
from twin.errors import BadInputError
from twin.scenario import Scenario
from twin.sensors import Sensor, build_sensor

GPS = RECEIVER | {"rate_hz": 1.0, "latency_s": 0.2, "latency_jitter_s": 0.05, "time_jitter_s": 0.01}
GYRO = {"kind": "yaw_gyro", "rate_hz": 1.0, "triggered_by": "gps", "noise_density_rad_s_rthz": 0.01}


def build(name: str, tables: dict[str, dict[str, Any]], *, runs: range = range(1), seed: int = 1) -> Sensor:
    configs = {key: CONFIGS.validate_python({"mount": "here", **table}) for key, table in tables.items()}
    return build_sensor(configs[name], name=name, mount=MOUNT, dt_ns=DT_NS, seed=seed, runs=runs, among=configs)


def arrivals(log: Log) -> list[int]:
    return [m.t_available_ns for m in log.measurements]


def test_it_samples_when_the_sentence_arrives_and_stamps_that_instant() -> None:
    tables = {"gps": GPS, "gyro": GYRO}
    gps, gyro = (drive(build(name, tables), constant(2.0), 60.0) for name in tables)
    assert len(gyro.taken_ns) == 59
    assert gyro.taken_ns == arrivals(gps)[:59]
    assert [m.t_ns for m in gyro.measurements] == gyro.taken_ns
    np.testing.assert_array_equal(gyro.hidden("clock_error_s"), 0.0)
    # The receiver's clock is another: its stamps are even, the triggered sensor's are not.
    assert len(set(np.diff([m.t_ns for m in gps.measurements]).tolist())) == 1
    assert len(set(np.diff([m.t_ns for m in gyro.measurements]).tolist())) > 10


def test_the_mean_is_taken_since_the_trigger_before() -> None:
    begins: list[float] = []

    def watched(t0: float, t1: float) -> Any:
        begins.append(t0)
        return STANDING(t0, t1)

    log = drive(build("gyro", {"gps": GPS, "gyro": GYRO}), watched, 10.0)
    np.testing.assert_allclose(begins[1:], log.t_s[:-1], atol=1e-12)


def test_its_own_latency_comes_on_top() -> None:
    slow = GYRO | {"latency_s": 0.05, "latency_jitter_s": 0.02}
    log = drive(build("gyro", {"gps": GPS, "gyro": slow}), STANDING, 400.0)
    delay_s = (np.array(arrivals(log)) - np.array(log.taken_ns)) / 1e9
    assert delay_s.min() >= 0.05
    # 400 exponential delays of mean 20 ms: 1 ms; rounding up to a tick adds half of one.
    assert delay_s.mean() == pytest.approx(0.071, abs=0.004)


def test_sentences_out_of_order_trigger_in_order_of_arrival_and_once_a_tick() -> None:
    gps = GPS | {"rate_hz": 50.0, "latency_jitter_s": 0.1, "time_jitter_s": 0.0}
    tables = {"gps": gps, "gyro": GYRO | {"rate_hz": 50.0}}
    receiver, gyro = (drive(build(name, tables), STANDING, 20.0) for name in tables)
    came = arrivals(receiver)
    assert np.diff(came).min() < 0
    assert len(set(came)) < len(came)
    assert gyro.taken_ns == [t_ns for t_ns in sorted(set(came)) if t_ns <= 20_000_000_000]


def test_members_share_the_trigger_even_where_one_lost_the_sentence() -> None:
    lossy = GPS | {"dropout_probability": 0.5, "faults": [{"kind": "outage", "from_s": 5.0, "to_s": 9.0}]}
    with_loss, without = ({"gps": gps, "gyro": GYRO} for gps in (lossy, GPS))
    together = drive(build("gyro", with_loss, runs=range(5)), STANDING, 20.0)
    alone = drive(build("gyro", without, runs=range(3, 4)), STANDING, 20.0)
    assert together.taken_ns == alone.taken_ns
    np.testing.assert_array_equal(together.values("yaw_rate_rad_s")[:, 3], alone.values("yaw_rate_rad_s")[:, 0])
    other = drive(build("gyro", without, seed=2), STANDING, 20.0)
    assert other.taken_ns != alone.taken_ns


def test_triggers_can_be_chained() -> None:
    tables = {"gps": GPS, "gyro": GYRO | {"latency_s": 0.1}, "wheels": GYRO | {"triggered_by": "gyro"}}
    gps, wheels = (drive(build(name, tables), STANDING, 10.0) for name in ("gps", "wheels"))
    assert wheels.taken_ns == [t_ns + 100_000_000 for t_ns in arrivals(gps)][: len(wheels.taken_ns)]
    assert len(wheels.taken_ns) >= 9


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gyro": {"triggered_by": "gsp"}}, r"sensors.gyro.triggered_by: unknown sensor 'gsp' \(there are gps, gyro\)"),
        ({"gyro": {"triggered_by": "gyro"}}, "sensors trigger one another .gyro by gyro."),
        ({"gps": {"triggered_by": "gyro", "time_jitter_s": 0.0}}, "sensors trigger one another"),
        ({"gyro": {"rate_hz": 10.0}}, "sensors.gyro.rate_hz = 10: has to be the 1 Hz of 'gps'"),
    ],
)
def test_what_cannot_trigger_is_refused(changes: dict[str, dict[str, Any]], message: str) -> None:
    tables = {name: table | changes.get(name, {}) for name, table in {"gps": GPS, "gyro": GYRO}.items()}
    with pytest.raises(BadInputError, match=message):
        build("gyro", tables)
    mounted = {name: {"mount": "antenna", **table} for name, table in tables.items()}
    with pytest.raises(ValidationError, match=message):
        Scenario.model_validate(SMALL | {"soil": {}, "sensors": mounted, "estimators": {}})


def test_a_triggered_sensor_has_no_clock_that_jitters() -> None:
    with pytest.raises(ValidationError, match="time_jitter_s: a sensor with triggered_by"):
        CONFIGS.validate_python({"mount": "m", **GYRO, "time_jitter_s": 0.01})
