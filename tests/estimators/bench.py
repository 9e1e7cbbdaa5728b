"""A plate on a vertical rail for tests, without a world: setups, hand-like motion, and what its sensors say of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from twin.signals import NS_PER_S, Estimator, EstimatorSetup, FloatArray, Measurement, Mount, SensorInfo

STEP_NS = 20_000_000
STEP_S = STEP_NS / NS_PER_S
STEPS_PER_FIX = 5
DESIGN_M, ARM_M = 1.7, 0.45
"""Up of the design plane, and the antenna above the plate."""
GNSS_COLUMNS = (
    *("position_e_m", "position_n_m", "position_u_m", "speed_m_s", "course_rad"),
    *("sigma_e_m", "sigma_n_m", "sigma_u_m", "quality", "satellites", "hdop", "vdop", "age_s"),
)
AHRS_COLUMNS = (
    *("roll_rad", "pitch_rad", "heading_rad"),
    *("free_accel_e_m_s2", "free_accel_n_m_s2", "free_accel_u_m_s2"),
)
WHITE_M_S2 = 60e-6 * 9.80665 * np.sqrt(25.0)
"""60 ug/sqrt(Hz), one-sided, in one sample at 50 Hz."""


def make_setup(*kinds: str, runs: int = 1, **changes: object) -> EstimatorSetup:
    infos = {
        "gnss": SensorInfo(
            name="gnss", kind="gnss", columns=GNSS_COLUMNS, mount=Mount(body="plate", xyz_m=(0, 0, ARM_M)), rate_hz=10.0
        ),
        "ahrs": SensorInfo(
            name="ahrs",
            kind="ahrs",
            columns=AHRS_COLUMNS,
            mount=Mount(body="plate", xyz_m=(0.1, 0.0, 0.0)),
            rate_hz=50.0,
            datasheet={"free_accel_noise_m_s2": float(WHITE_M_S2)},
        ),
    }
    keys = {
        "name": "height",
        "runs": runs,
        "sensors": {kind: infos[kind] for kind in kinds},
        "reference": Mount(body="plate", xyz_m=(0.0, 0.0, 0.0)),
        "rows_y_m": (),
        "start_e_n_heading": (0.0, 0.0, 0.0),
        "design_height_m": DESIGN_M,
    }
    return EstimatorSetup(**keys | changes)  # type: ignore[arg-type]


def gnss(
    t_ns: int, height: FloatArray, *, quality=4.0, age=1.0, sigma=0.015, latency_ns: int = 80_000_000, valid=None
) -> Measurement:
    """A sample of the receiver for heights (R,) of the plate above the design plane."""
    height = np.atleast_1d(np.asarray(height, dtype=float))
    values = np.full((len(height), len(GNSS_COLUMNS)), np.nan)
    values[:, GNSS_COLUMNS.index("position_u_m")] = height + DESIGN_M + ARM_M
    values[:, GNSS_COLUMNS.index("sigma_u_m")] = sigma
    values[:, GNSS_COLUMNS.index("quality")] = quality
    values[:, GNSS_COLUMNS.index("age_s")] = age
    return Measurement(
        sensor="gnss",
        t_ns=t_ns,
        t_available_ns=t_ns + latency_ns,
        columns=GNSS_COLUMNS,
        values=values,
        valid=np.ones(len(height), dtype=bool) if valid is None else np.asarray(valid),
    )


def ahrs(t_ns: int, accel: FloatArray, *, valid=None) -> Measurement:
    """A sample of the AHRS for upward free accelerations (R,)."""
    accel = np.atleast_1d(np.asarray(accel, dtype=float))
    values = np.zeros((len(accel), len(AHRS_COLUMNS)))
    values[:, AHRS_COLUMNS.index("free_accel_u_m_s2")] = accel
    return Measurement(
        sensor="ahrs",
        t_ns=t_ns,
        t_available_ns=t_ns,
        columns=AHRS_COLUMNS,
        values=values,
        valid=np.ones(len(accel), dtype=bool) if valid is None else np.asarray(valid),
    )


def motions(duration_s: float, *, stand_s: float, runs: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """Heights and speeds (T, R) of a plate that is moved otherwise in each run."""
    rng = np.random.default_rng(seed)
    height, speed = zip(*(strokes(duration_s, stand_s=stand_s, rng=rng) for _ in range(runs)), strict=True)
    return np.stack(height, axis=1), np.stack(speed, axis=1)


def strokes(duration_s: float, *, stand_s: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Height and speed (T,) at 50 Hz of a plate pulled up and pushed down by hand, from its middle, after standing.

    Strokes from one random height to another within +-0.17 m, each with the bell-shaped speed of a hand's movement
    (minimum jerk), at peaks of 0.1 to 0.4 m/s, with short rests between them.
    """
    count = round(duration_s / STEP_S) + 1
    height, speed = np.zeros(count), np.zeros(count)
    at, now = 0.0, round(stand_s / STEP_S)
    while now < count - 1:
        to = rng.uniform(-0.17, 0.17)
        lasts = max(1.875 * abs(to - at) / rng.uniform(0.1, 0.4), 0.3)
        share = np.arange(1, round(lasts / STEP_S) + 1) * STEP_S / lasts
        part = slice(now + 1, now + 1 + len(share))
        room = len(height[part])
        height[part] = (at + (to - at) * share**3 * (10.0 - 15.0 * share + 6.0 * share**2))[:room]
        speed[part] = ((to - at) * 30.0 * share**2 * (1.0 - share) ** 2 / lasts)[:room]
        at, now = float(height[min(now + len(share), count - 1)]), now + len(share)
        rest = round(rng.uniform(0.0, 0.4) / STEP_S)
        height[now + 1 : now + 1 + rest], now = at, now + rest
    return height, speed


def gauss_markov(sigma: float, tau_s: float, period_s: float, *, count: int, runs: int, rng: np.random.Generator):
    """First-order Gauss-Markov processes (count, runs) in their steady state."""
    keep = np.exp(-period_s / tau_s)
    out = np.empty((count, runs))
    out[0] = sigma * rng.standard_normal(runs)
    for k in range(1, count):
        out[k] = keep * out[k - 1] + sigma * np.sqrt(1.0 - keep**2) * rng.standard_normal(runs)
    return out


@dataclass(frozen=True, kw_only=True)
class Bench:
    """A plate and its sensors in R runs, whose corrections may stop.

    The receiver is paper 002's: RTK while the corrections are younger than 10 s, then differential, with an error that
    a fix has no part in.
    """

    height: FloatArray
    """(T, R)."""
    speed: FloatArray
    """(T, R)."""
    seed: int
    lost_s: float = np.inf
    fix_m: float = 0.014
    fix_white_m: float = 0.0054
    age_drift_m_s: float = 0.0014
    differential_m: float = 0.4
    bias_m_s2: FloatArray | float = 0.0
    """Zero offset, (R,) or the same for all."""
    latency_ns: int = 85_000_000

    def measurements(self) -> Iterator[tuple[int, list[Measurement]]]:
        """For each step its time, and what arrives until then, in order of arrival."""
        rng, (count, runs) = np.random.default_rng(self.seed), self.height.shape
        fixes, period = (count - 1) // STEPS_PER_FIX + 1, STEPS_PER_FIX * STEP_S
        fix = gauss_markov(self.fix_m, 100.0, period, count=fixes, runs=runs, rng=rng)
        drift = gauss_markov(self.age_drift_m_s, 100.0, period, count=fixes, runs=runs, rng=rng)
        other = gauss_markov(self.differential_m, 100.0, period, count=fixes, runs=runs, rng=rng)
        waiting: list[Measurement] = []
        for k in range(1, count):
            t_ns = k * STEP_NS
            mean = (self.speed[k] - self.speed[k - 1]) / STEP_S
            arrived = [ahrs(t_ns, mean + self.bias_m_s2 + WHITE_M_S2 * rng.standard_normal(runs))]
            if k % STEPS_PER_FIX == 0:
                n, t_s = k // STEPS_PER_FIX, k * STEP_S
                age = 1.0 + t_s % 1.0 if t_s < self.lost_s else 1.0 + t_s - self.lost_s
                good = age < 10.0
                error = fix[n] + age * drift[n] + self.fix_white_m * rng.standard_normal(runs) if good else other[n]
                quality, sigma = (4.0, 0.015) if good else (2.0, 0.95)
                height = self.height[k] + error
                sample = gnss(t_ns, height, quality=quality, age=age, sigma=sigma, latency_ns=self.latency_ns)
                waiting.append(sample)
            arrived += [sample for sample in waiting if sample.t_available_ns <= t_ns]
            waiting = [sample for sample in waiting if sample.t_available_ns > t_ns]
            yield t_ns, sorted(arrived, key=lambda sample: sample.t_available_ns)


def errors_of(bench: Bench, estimators: dict[str, Estimator]) -> dict[str, FloatArray]:
    """Errors (T - 1, R) of each estimator's height, m."""
    errors: dict[str, list[FloatArray]] = {name: [] for name in estimators}
    for k, (t_ns, arrived) in enumerate(bench.measurements(), start=1):
        for name, estimator in estimators.items():
            for sample in arrived:
                estimator.process(sample)
            errors[name].append(estimator.estimate(t_ns).values[:, 0] - bench.height[k])
    return {name: np.array(each) for name, each in errors.items()}
