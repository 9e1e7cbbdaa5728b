"""What each guidance filter costs in a replay of 10 Hz sentences: `make benchmark`.

A round is ten minutes of sentences from file to figures; six of them are an hour. ``log_alone`` is what reading costs
without any filter. Time of the process is measured, not that of the clock on the wall: others share the machine.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from twin.formats.geodetic import Origin
from twin.formats.logs import open_log
from twin.formats.nmea import framed
from twin.logreplay import choose, replay_log

pytestmark = pytest.mark.slow

EPOCHS = 6000
CHOICES: dict[str, list[str]] = {
    "log_alone": [],
    "guidance_gps": ["guidance_gps"],
    "guidance_pv": ["guidance_pv"],
    "constant_velocity": ["cv=guidance_kinematic:model=constant_velocity"],
    "double": ["double=guidance_kinematic:model=double"],
    "guidance_imm": ["guidance_imm"],
    "guidance_filter": ["guidance_filter"],
}
SPEED_M_S, PASS_M, RADIUS_M = 2.0, 200.0, 6.0


def way() -> Iterator[tuple[float, float, float]]:
    """East, north (m) and heading (rad) every tenth of a second on passes with half circles between them."""
    east = north = 0.0
    heading, left, side, turning = 0.5 * math.pi, PASS_M, 1.0, False
    while True:
        yield east, north, heading
        step = 0.1 * SPEED_M_S
        heading += side * step / RADIUS_M if turning else 0.0
        east, north, left = east + step * math.cos(heading), north + step * math.sin(heading), left - step
        if left <= 0.0:
            turning = not turning
            left = math.pi * RADIUS_M if turning else PASS_M
            side = side if turning else -side


def sentences(count: int) -> Iterator[str]:
    """GGA, RMC and GST of a receiver on that way, a minute fixed and a minute float."""
    rng = np.random.default_rng(1)
    origin = Origin(latitude_deg=52.0, longitude_deg=13.0, height_m=40.0)
    for k, (east, north, heading) in zip(range(count), way(), strict=False):
        fixed = (k // 600) % 2 == 0
        sigma = 0.01 if fixed else 0.2
        noise = sigma * 0.3 * rng.standard_normal(2)
        place = _place(origin, east + noise[0], north + noise[1])
        clock = f"{8 + k // 36000:02d}{k // 600 % 60:02d}{k % 600 / 10.0:05.2f}"
        course = math.degrees(0.5 * math.pi - heading) % 360.0
        yield framed(f"GNGGA,{clock},{place},{4 if fixed else 5},12,0.8,50.000,M,40.0,M,1.0,0001")
        yield framed(f"GNRMC,{clock},A,{place},{SPEED_M_S / 0.514444:.3f},{course:.2f},010623,,,{'RF'[not fixed]}")
        yield framed(f"GNGST,{clock},1.0,{sigma:.3f},{sigma:.3f},0.0,{sigma:.3f},{sigma:.3f},{2.0 * sigma:.3f}")


def _place(origin: Origin, east_m: float, north_m: float) -> str:
    metres = 111_320.0
    latitude = origin.latitude_deg + north_m / metres
    longitude = origin.longitude_deg + east_m / (metres * math.cos(math.radians(origin.latitude_deg)))
    parts = []
    for angle, width in ((latitude, 2), (longitude, 3)):
        degrees, ticks = divmod(round(angle * 60e7), 60 * 10**7)  # of 1e-7 minutes, so that no 60.0000000 is written
        parts.append(f"{degrees:0{width}d}{ticks * 1e-7:010.7f}")
    return f"{parts[0]},N,{parts[1]},E"


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("replay") / "passes.nmea"
    path.write_text("".join(sentences(EPOCHS)), newline="")
    return path


@pytest.mark.parametrize("name", CHOICES)
@pytest.mark.benchmark(timer=time.process_time)
def test_ten_minutes_of_sentences(name: str, log: Path, tmp_path: Path, benchmark: Any) -> None:
    def replay() -> dict[str, int]:
        return replay_log(open_log(log), choose(CHOICES[name])).counts

    benchmark.extra_info["epochs"] = EPOCHS
    assert benchmark.pedantic(replay, rounds=2, warmup_rounds=1) == {"gnss": EPOCHS}
