"""What the planter's filter costs its bus: paper 000's figures, and the frames around them."""

from typing import Any

import pytest
from pydantic import ValidationError

from tests.small_scenario import small_scenario
from twin.errors import BadInputError
from twin.formats.can import BusLoad
from twin.formats.planter_bus import BusConfig
from twin.scenario import resolve
from twin.scoring import bus


def _load(**changes: Any) -> BusLoad:
    given = {"architecture": "central", "senders": 4, "receivers": 24, "rate_hz": 50.0, **changes}
    return BusConfig.model_validate(given).load()


def test_the_papers_payload() -> None:
    """Section 4.4.1: (4 * 6 + 24 * 1) float32 = 192 bytes per iteration."""
    assert sum(message.payload_bytes for message in BusConfig(
        architecture="central", senders=4, receivers=24, rate_hz=50.0).messages()) == 192  # fmt: skip
    assert _load().payload_kb_s == pytest.approx(9.6)
    assert _load(rate_hz=10.0).payload_kb_s == pytest.approx(1.92)


@pytest.mark.parametrize(
    ("changes", "nominal_bits", "worst_bits", "frames"),
    [
        # 4 * 3 frames of 8 bytes and 24 of 4 bytes: 79 % and 96 % of 250 kbit/s at 50 Hz.
        ({}, 12 * 131 + 24 * 99, 12 * 160 + 24 * 120, 36),
        # int16 in frames of 8 + 4 and 24 times 2 bytes; the receivers' own frames cost most.
        ({"encoding": "int16"}, 4 * (131 + 99) + 24 * 83, 4 * (160 + 120) + 24 * 100, 32),
        # The same with four speeds to a frame, all frames filled: 14 of 8 bytes, 37 %.
        ({"encoding": "int16", "shared_frames": True, "full_frames": True}, 14 * 131, 14 * 160, 14),
        # Only the speeds as int16: 12 + 6 frames of 8 bytes, 47 %.
        ({"speed_encoding": "int16", "shared_frames": True}, 18 * 131, 18 * 160, 18),
        ({"senders": 24}, 72 * 131 + 24 * 99, 72 * 160 + 24 * 120, 96),
    ],
)
@pytest.mark.parametrize("rate_hz", [50.0, 10.0, 7.5])
def test_a_central_filter(
    changes: dict[str, Any], nominal_bits: int, worst_bits: int, frames: int, rate_hz: float
) -> None:
    load = _load(**changes, rate_hz=rate_hz)
    assert load.load_nominal_percent == pytest.approx(100.0 * nominal_bits * rate_hz / 250_000)
    assert load.load_worst_percent == pytest.approx(100.0 * worst_bits * rate_hz / 250_000)
    assert load.frames_per_s == pytest.approx(frames * rate_hz)


def test_what_these_frames_come_to() -> None:
    int16 = {"encoding": "int16", "shared_frames": True, "full_frames": True}
    percent = {
        "50 Hz": _load().load_nominal_percent,
        "50 Hz, worst": _load().load_worst_percent,
        "int16": _load(**int16).load_nominal_percent,
        "speeds int16": _load(speed_encoding="int16", shared_frames=True).load_nominal_percent,
        "10 Hz": _load(rate_hz=10.0).load_nominal_percent,
        "10 Hz, int16": _load(rate_hz=10.0, **int16).load_nominal_percent,
        "24 senders": _load(senders=24).load_nominal_percent,
        "24 senders, 10 Hz": _load(senders=24, rate_hz=10.0).load_nominal_percent,
    }
    assert {key: round(value) for key, value in percent.items()} == {
        "50 Hz": 79,
        "50 Hz, worst": 96,
        "int16": 37,
        "speeds int16": 47,
        "10 Hz": 16,
        "10 Hz, int16": 7,
        "24 senders": 236,
        "24 senders, 10 Hz": 47,
    }


def test_a_distributed_filter_broadcasts_the_speed_alone() -> None:
    load = BusConfig(architecture="distributed", rate_hz=50.0).load()
    assert load.payload_kb_s == pytest.approx(0.2)
    assert load.frames_per_s == pytest.approx(50.0)
    assert load.load_nominal_percent == pytest.approx(100.0 * 99 * 50 / 250_000)
    # Two float32 of a GNSS receiver are one more frame, of 8 bytes.
    with_gnss = BusConfig(architecture="distributed", rate_hz=50.0, gnss_values=2).load()
    assert with_gnss.load_nominal_percent == pytest.approx(100.0 * (99 + 131) * 50 / 250_000)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"architecture": "central", "senders": 4}, "receivers: missing"),
        ({"architecture": "central", "receivers": 4}, "senders: missing"),
        ({"architecture": "central", "senders": 4, "receivers": 4, "gnss_values": 1}, "gnss_values goes with"),
        ({"architecture": "distributed", "senders": 4}, "senders goes with"),
        ({"architecture": "distributed", "shared_frames": True}, "shared_frames goes with"),
        ({"architecture": "distributed", "rate_hz": 0.0}, "greater than 0"),
        ({"architecture": "distributed", "encoding": "int8"}, "'float32' or 'int16'"),
    ],
)
def test_a_bus_that_cannot_be_is_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        BusConfig.model_validate({"rate_hz": 50.0, **given})


def test_a_scenario_names_the_bus_that_is_wrong() -> None:
    wrong = {"now": {"architecture": "central", "senders": 4, "rate_hz": 50.0}}
    with pytest.raises(BadInputError, match=r"test: bus\.now: receivers: missing"):
        resolve(small_scenario(bus=wrong), where="test")
    with pytest.raises(BadInputError, match=r"bus\.now\.bitrate: unknown key; did you mean 'bit_rate'"):
        resolve(small_scenario(bus={"now": {"bitrate": 5.0}}), where="test")


def test_metrics_have_the_names_that_were_announced() -> None:
    config = {"architecture": "distributed", "rate_hz": 10.0}
    scenario = resolve(small_scenario(bus={"one": config, "other": config}), where="test")
    assert list(bus.metrics(scenario)) == bus.metric_names(scenario)
    assert bus.metrics(scenario)["bus.one.frames_per_s"] == 10.0
    assert {f"bus.other.{name}" for name in ("payload_kb_s", "load_nominal_percent", "load_worst_percent")} <= set(
        bus.metric_names(scenario)
    )
