"""Logs made up on known tracks, through the whole replay: figures, order, memory, what is left on disk."""

from __future__ import annotations

import math
import tracemalloc
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.logs import MOUNT, MadeUpLog, fix, receiver
from twin.errors import BadInputError
from twin.estimators import AdaptedEstimator
from twin.logreplay import LogReplay, choose, read_settings, replay_log, replaying, streams
from twin.logreplay.result import result_of
from twin.recording import Stream
from twin.signals import NS_PER_S, EstimatorSetup, Measurement, SensorInfo

SPEED = 2.0


class Walk:
    """Steady filter of a random walk east and north, for a receiver with white noise: consistent by construction."""

    columns = ("position_e_m", "position_n_m", "innovation_e_m", "innovation_n_m", "nis_position")
    step_m, noise_m = 0.5, 1.0

    def __init__(self, setup: EstimatorSetup) -> None:
        self.x = np.array(setup.start_e_n_heading[:2])
        self.before = 0.5 * (self.step_m**2 + math.sqrt(self.step_m**4 + 4.0 * self.step_m**2 * self.noise_m**2))
        self.news = np.full(3, math.nan)
        self.heard: list[tuple[str, float]] = []

    def process(self, sample) -> None:
        self.heard.append((sample.sensor, sample.t))
        if sample.sensor != "gnss":
            return
        innovation = sample.values[:2] - self.x
        s = self.before + self.noise_m**2
        self.x = self.x + self.before / s * innovation
        self.news = np.array([*innovation, innovation @ innovation / s])

    def estimate(self, _t: float) -> dict[str, float | tuple[float, float]]:
        after = self.before * self.noise_m**2 / (self.before + self.noise_m**2)
        told, self.news = self.news, np.full(3, math.nan)
        places = {name: (float(x), math.sqrt(after)) for name, x in zip(self.columns[:2], self.x, strict=True)}
        return places | dict(zip(self.columns[2:], told.tolist(), strict=True))


def walk_log(count: int, seed: int = 1) -> tuple[MadeUpLog, MadeUpLog]:
    """A receiver with a noise of 1 m on a random walk, and the walk itself."""
    rng = np.random.default_rng(seed)
    truth = np.cumsum(0.5 * rng.standard_normal((count, 2)), axis=0)
    noisy = truth + rng.standard_normal((count, 2))
    log = [fix(t, *noisy[t].tolist(), sigma_m=1.0, quality=1.0) for t in range(count)]
    reference = [fix(t, *truth[t].tolist(), sigma_m=0.0, quality=4.0) for t in range(count)]
    return MadeUpLog(log), MadeUpLog(reference, name="truth")


def replayed(log: MadeUpLog, *, folder: Path | None = None, reference: MadeUpLog | None = None) -> LogReplay:
    choices = choose([], plugins={"walk": partial(AdaptedEstimator, Walk)})
    return replay_log(log, choices, folder=folder, reference=reference)


def test_a_consistent_filter_is_found_consistent_white_and_honest() -> None:
    log, reference = walk_log(6000)
    found = replayed(log, reference=reference).metrics
    assert found["walk.consistency.nis_position_updates"] == 6000.0
    # Bounds that hold 95 times of 100 are widened to four sigma.
    assert found["walk.consistency.nis_position"] == pytest.approx(2.0, abs=4.0 * 2.0 / math.sqrt(6000.0))
    for direction in ("e", "n"):
        assert abs(found[f"walk.innovation.lag1_{direction}"]) < 2.0 * found[f"walk.innovation.lag1_bound_{direction}"]
    # Errors of the filter are correlated over three epochs or so: half a per cent of 12 000 squares becomes two.
    assert found["walk.reference.error_over_sigma"] == pytest.approx(1.0, abs=0.05)
    assert found["gnss.reference.error_over_sigma"] == pytest.approx(1.0, abs=0.03)
    assert found["gnss.reference.rmse_m"] == pytest.approx(math.sqrt(2.0), rel=0.03)
    before = 0.5 * (0.25 + math.sqrt(0.0625 + 1.0))
    assert found["walk.reference.rmse_m"] == pytest.approx(math.sqrt(2.0 * before / (before + 1.0)), rel=0.05)
    assert found["walk.smoothness.rms_acceleration_m_s2"] < 0.6 * found["gnss.smoothness.rms_acceleration_m_s2"]


def test_a_sigma_of_zero_claims_nothing() -> None:
    noisy, truth = walk_log(200)
    sent = [fix(t, *each.values[0, :2].tolist(), sigma_m=float(t % 2)) for t, each in enumerate(noisy.measurements())]
    told = [fix(t, *each.values[0, :2].tolist(), sigma_m=0.1) for t, each in enumerate(truth.measurements())]
    found = replayed(MadeUpLog(sent), reference=MadeUpLog(told, name="truth")).metrics
    assert found["gnss.reference.epochs"] == 200.0
    # Of the half that claims something, errors are about as large as claimed.
    assert found["gnss.reference.error_over_sigma"] == pytest.approx(1.0, abs=0.2)


def test_a_covariance_that_is_announced_and_not_told_is_unknown(tmp_path: Path) -> None:
    class Announced(Walk):
        state_columns = ("position_e_m", "position_n_m")

    log, reference = walk_log(200)
    choices = choose([], plugins={"walk": partial(AdaptedEstimator, Announced)})
    found = replay_log(log, choices, folder=tmp_path, reference=reference).metrics
    said = Stream.from_arrow(pq.read_table(tmp_path / "estimates" / "walk.parquet"))
    assert np.isnan(said.column("cov(position_e_m,position_n_m)")).all()
    plain = replayed(walk_log(200)[0], reference=walk_log(200)[1]).metrics
    assert found["walk.reference.mean_nees"] == plain["walk.reference.mean_nees"]


def test_blocks_do_not_change_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = replayed(*(walk_log(1000)[:1]), reference=walk_log(1000)[1]).metrics
    monkeypatch.setattr(replaying, "BLOCK_ROWS", 37)
    pieces = replayed(*(walk_log(1000)[:1]), reference=walk_log(1000)[1]).metrics
    assert list(pieces) == list(whole)
    assert list(pieces.values()) == pytest.approx(list(whole.values()), rel=1e-9, abs=1e-9, nan_ok=True)


def test_the_folder_has_every_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(replaying, "BLOCK_ROWS", 64)
    found = replayed(walk_log(300)[0], folder=tmp_path)
    measured = Stream.from_arrow(pq.read_table(tmp_path / "measurements" / "gnss.parquet"))
    said = Stream.from_arrow(pq.read_table(tmp_path / "estimates" / "walk.parquet"))
    assert measured.t_ns.tolist() == said.t_ns.tolist() == [t * NS_PER_S for t in range(300)]
    assert said.has("position_e_m.sigma")
    result = result_of(found)
    assert result["log"]["measurements"] == {"gnss": 300}
    assert result["ended"] == {"reason": "end of log", "t_s": 299.0}
    assert (result["kind"], result["verdict"]) == ("log", None)
    assert not {"seed", "run", "checks", "published"} & set(result)


def test_a_silent_receiver_is_asked_about_at_other_sensors_samples() -> None:
    wheels = SensorInfo(name="wheels", kind="odometry", columns=("speed_m_s",), mount=MOUNT, rate_hz=10.0)

    def turn(t_s: float) -> Measurement:
        t_ns = round(t_s * NS_PER_S)
        values, valid = np.array([[SPEED]]), np.ones(1, dtype=bool)
        return Measurement(
            sensor="wheels", t_ns=t_ns, t_available_ns=t_ns, columns=("speed_m_s",), values=values, valid=valid
        )

    spoken = [0, 1, 2, 7, 8]
    sent = sorted(
        [*(fix(t, SPEED * t, 0.0) for t in spoken), *(turn(0.1 * k) for k in range(1, 90))], key=lambda m: m.t_ns
    )
    found = replayed(MadeUpLog(sent, sensors=[receiver(), wheels]))
    asked = found.sketch.streams["estimates/walk"].t_ns / NS_PER_S
    # Every fix, and from 1.5 s after the last one on about every second and a half.
    assert [t for t in asked if t in spoken] == spoken
    silent = asked[(asked > 2.0) & (asked < 7.0)]
    np.testing.assert_allclose(silent, [3.6, 5.2, 6.8])
    assert found.metrics["walk.consistency.nis_position_updates"] == len(spoken)
    assert found.metrics["gnss.quality.single_to_unknown_count"] == 1.0


def test_estimators_start_where_the_log_does() -> None:
    # It stands for 30 s, with a course that is noise, then drives north-west.
    course = 0.75 * math.pi
    way = [0.0] * 30 + [SPEED * t for t in range(1, 30)]
    sent = [
        fix(
            t,
            100.0 + s * math.cos(course),
            50.0 + s * math.sin(course),
            speed_m_s=SPEED if s else 0.02,
            course_rad=course if s else float(t),
        )
        for t, s in enumerate(way)
    ]
    assert replayed(MadeUpLog(sent)).start == pytest.approx((100.0, 50.0, course))
    # Without speed and course, the direction of the first ten metres.
    silent = [fix(t, 3.0 * t, -3.0 * t) for t in range(30)]
    assert replayed(MadeUpLog(silent)).start == pytest.approx((0.0, 0.0, -0.25 * math.pi))
    still = [fix(t, 1.0, 2.0) for t in range(30)]
    assert replayed(MadeUpLog(still)).start == (1.0, 2.0, 0.0)


@pytest.mark.parametrize("course", [0.0, 0.5 * math.pi, -2.0])
def test_estimators_start_where_the_reference_frame_is(course: float) -> None:
    ahead = np.array([math.cos(course), math.sin(course)])
    left = np.array([-ahead[1], ahead[0]])
    start = np.array([100.0, 50.0])
    places = [start + SPEED * t * ahead + 1.5 * ahead - 0.4 * left for t in range(9)]
    sent = [fix(t, *place.tolist(), speed_m_s=SPEED, course_rad=course) for t, place in enumerate(places)]
    told = read_settings(["vehicle.antenna_xyz_m=[1.5, -0.4, 2.0]"])
    choices = choose([], plugins={"walk": partial(AdaptedEstimator, Walk)})
    found = replay_log(MadeUpLog(sent), choices, settings=told)
    assert found.start == pytest.approx((100.0, 50.0, course))
    assert result_of(found)["log"]["start_e_n_heading"] == list(found.start)


def test_an_antenna_off_the_reference_frame_is_compared_as_antenna() -> None:
    class Rear:
        """Knows the track, 0.5 m behind the antenna."""

        columns = ("position_e_m", "position_n_m", "heading_rad")

        def __init__(self, _setup: EstimatorSetup) -> None:
            self.at = 0.0

        def process(self, sample) -> None:
            self.at = sample.t

        def estimate(self, _t: float) -> dict[str, float]:
            return {"position_e_m": 3.0, "position_n_m": SPEED * self.at - 0.5, "heading_rad": 0.5 * math.pi}

    sent = [fix(t, 3.0, SPEED * t) for t in range(20)]
    choices = choose([], plugins={"rear": partial(AdaptedEstimator, Rear)})
    told = read_settings(["vehicle.antenna_xyz_m=[0.5, 0.0, 2.0]"])
    found = replay_log(MadeUpLog(sent), choices, reference=MadeUpLog(sent), settings=told)
    assert found.metrics["rear.reference.max_m"] == pytest.approx(0.0, abs=1e-9)
    untold = replay_log(MadeUpLog(sent), choices, reference=MadeUpLog(sent))
    assert untold.metrics["rear.reference.max_m"] == pytest.approx(0.5)


@pytest.mark.parametrize(
    "sent", [[], [fix(0.0, 1.0, 1.0, valid=False)], [fix(0.0, math.nan, math.nan, quality=0.0)] * 3]
)
def test_a_log_without_anything_usable_is_bad_input(sent: list[Measurement]) -> None:
    log = MadeUpLog(sent)
    log.problems["checksum"] = 3
    with pytest.raises(BadInputError, match=r"made_up\.log: nothing in it can be used \(passed over: 3 x checksum\)"):
        replayed(log)


def test_a_name_of_a_sensor_is_not_one_for_an_estimator() -> None:
    with pytest.raises(BadInputError, match="the log has a sensor of that name"):
        replay_log(MadeUpLog([fix(0.0, 0.0, 0.0)]), choose(["gnss=guidance_gps"]))


def endless(count: int) -> Iterator[Measurement]:
    for k in range(count):
        quality = 4.0 if (k // 100) % 3 else 5.0
        yield fix(0.1 * k, 50.0 * math.cos(0.006 * k), 50.0 * math.sin(0.006 * k), quality=quality)


def test_memory_does_not_grow_with_the_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(replaying, "BLOCK_ROWS", 256)
    monkeypatch.setattr(streams, "GROUP_ROWS", 512)
    monkeypatch.setattr(streams.Thinned.__init__, "__defaults__", (256,))

    def peak(count: int) -> int:
        log, reference = (MadeUpLog(endless(count), sensors=[receiver(10.0)], name=name) for name in ("log", "other"))
        (tmp_path / str(count)).mkdir()
        tracemalloc.start()
        try:
            found = replay_log(log, choose(["guidance_gps"]), reference=reference, folder=tmp_path / str(count))
            assert found.counts == {"gnss": count}
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    peak(600)  # what is loaded and cached once
    # What is thinned holds between half of its rows and all of them, so that the peak is not the same to the byte; but
    # 20 numbers kept of each of 13 500 rows more would be 2.2 MB, twice of all that there is.
    assert peak(15_000) < 1.5 * peak(1_500)
