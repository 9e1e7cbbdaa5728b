"""Machines that drive parallel passes, for tests of guidance filters: kinematics and sensor errors, without a world.

Every member is a world of its own: a course with its own weave, its own slip, its own errors of every sensor.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from twin.signals import NS_PER_S, Estimator, EstimatorSetup, FloatArray, Measurement, Mount, SensorInfo

COLUMNS = {
    "gnss": (
        "position_e_m",
        "position_n_m",
        "position_u_m",
        "speed_m_s",
        "course_rad",
        "sigma_e_m",
        "sigma_n_m",
        "sigma_u_m",
        "quality",
        "satellites",
        "hdop",
        "vdop",
        "age_s",
    ),
    "imu": ("accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2", "gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s"),
    "yaw_gyro": ("yaw_rate_rad_s",),
    "wheel_encoders": ("left_slots", "right_slots"),
    "radar": ("speed_m_s",),
    "odometry": ("speed_m_s", "yaw_rate_rad_s"),
    "angle_transducer": ("steering_angle_rad",),
}
ALL = ("gnss", "yaw_gyro", "wheel_encoders", "angle_transducer")
WHEELBASE_M, TRACK_M, RADIUS_M, SLOTS = 1.1, 1.2, 0.4635, 360
SLOT_M = 2.0 * np.pi * RADIUS_M / SLOTS
ARM_M = (1.5, 0.1, 2.5)
SHEET = {
    "gnss": {
        "position_noise_m": 2.5,
        "single_position_correlated_sigma_m": 2.12,
        "single_position_correlation_s": 1200.0,
        "single_position_white_sigma_m": 0.05,
        "position_resolution_m": 0.0185,
        "speed_noise_m_s": 0.1,
        "speed_noise_ratio": 0.0,
        "velocity_lag_s": 0.0,
        "latency_s": 0.0,
    },
    "yaw_gyro": {
        "noise_rad_s": 0.002,
        "bias_rad_s": 0.005,
        "bias_random_walk_rad_s_rts": 2.4e-5,
        "scale_error_ratio": 0.003,
    },
    "angle_transducer": {"offset_sigma_rad": 0.02, "noise_rad": 0.01},
    "wheel_encoders": {"slots_per_turn": float(SLOTS), "missed_slot_probability": 0.0},
}
"""Like a LEA-5S at a rate of 1 Hz, and a vibrating gyro."""


def make_setup(
    *kinds: str,
    runs: int = 1,
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
    rates: Mapping[str, float] | None = None,
    sheets: Mapping[str, Mapping[str, float]] | None = None,
    arm: tuple[float, float, float] = ARM_M,
    wheelbase_m: float = WHEELBASE_M,
    wheel_radius_m: float = RADIUS_M,
) -> EstimatorSetup:
    infos = {
        kind: SensorInfo(
            name=kind,
            kind=kind,
            columns=COLUMNS[kind],
            mount=Mount(body="base", xyz_m=arm if kind == "gnss" else (0.0, 0.0, 0.5)),
            rate_hz=(rates or {}).get(kind, 1.0 if kind == "gnss" else 10.0),
            datasheet={**SHEET.get(kind, {}), **(sheets or {}).get(kind, {})},
        )
        for kind in kinds
    }
    return EstimatorSetup(
        name="guide",
        runs=runs,
        sensors=infos,
        reference=Mount(body="base", xyz_m=(0.0, 0.0, 0.0)),
        rows_y_m=(),
        start_e_n_heading=start,
        wheelbase_m=wheelbase_m,
        wheel_radius_m=wheel_radius_m,
    )


def measure(kind: str, t_s: float, values: object, *, late_s: float = 0.0, valid: object = None) -> Measurement:
    array = np.array(values, dtype=float)
    array = array[np.newaxis] if array.ndim == 1 else array
    t_ns = round(t_s * NS_PER_S)
    return Measurement(
        sensor=kind,
        t_ns=t_ns,
        t_available_ns=t_ns + round(late_s * NS_PER_S),
        columns=COLUMNS[kind],
        values=array,
        valid=np.ones(len(array), dtype=bool) if valid is None else np.asarray(valid, dtype=bool),
    )


def fix(
    t_s: float,
    east: object,
    north: object,
    *,
    speed: object = np.nan,
    course: object = np.nan,
    sigma: object = 2.5,
    quality: object = 1.0,
    late_s: float = 0.0,
    valid: object = None,
) -> Measurement:
    parts = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(each, dtype=float)) for each in (east, north, 0.0, speed, course)),
        *(np.atleast_1d(np.asarray(each, dtype=float)) for each in (sigma, sigma, sigma, quality, 9.0, 1.0, 1.7, 1.0)),
    )
    return measure("gnss", t_s, np.stack(parts, axis=-1), late_s=late_s, valid=valid)


@dataclass(frozen=True, kw_only=True)
class Solution:
    """How a receiver solves from some time on, and what it reports."""

    begin_s: float
    quality: float
    slow_m: float
    slow_s: float
    white_m: float
    reported_m: float


@dataclass(frozen=True, kw_only=True)
class Passes:
    """R worlds in which a machine drives passes to and fro, turning in half circles between them."""

    runs: int = 1
    seed: int = 0
    passes: int = 2
    length_m: float = 50.0
    spacing_m: float = 4.0
    speed_m_s: float = 1.1
    heading: float = 0.0
    stand_s: float = 5.0
    dt_s: float = 0.1
    gnss_every: int = 10
    every_other: int = 1
    """Steps between two samples of all other sensors; where there are more, they sample when a fix arrives."""
    weave_rad: float = 0.02
    kinds: Sequence[str] = ALL
    sheets: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    slip_ratio: float = 0.02
    """Of every wheel way, 1 sigma, constant in a world."""
    slip_noise: float = 0.01
    """Of a wheel's way, 1 sigma, new every step."""
    steering_offset_rad: float = 0.02
    steering_noise_rad: float = 0.01
    slip_angle_rad: float = 0.0
    """Of the front wheel, 1 sigma, drawn once a second."""
    sway_m: float = 0.0
    """How far the antenna is swung to the side, 1 sigma, drawn once a second."""
    late_s: float = 0.0
    solutions: Sequence[Solution] | None = None
    """In order of time; without any, what the data sheet says of single positions."""
    jump_s: float | None = None
    jump_m: tuple[float, float] = (0.0, 0.0)
    """Step of the receiver's error at that time."""
    lost_s: tuple[float, float] | None = None
    """From and until when corrections do not come; they are 1 s old otherwise."""
    drift_m_s: float = 0.0
    """What the position is off per second of their age, 1 sigma, constant in a world."""
    diluted_s: float | None = None
    """From then on the dilution of precision, and the noise of the velocity, are twice as large."""

    def sheet(self, kind: str) -> dict[str, float]:
        return {**SHEET.get(kind, {}), **self.sheets.get(kind, {})}

    def setup(self) -> EstimatorSetup:
        return make_setup(
            *self.kinds,
            runs=self.runs,
            start=(0.0, 0.0, self.heading),
            rates=dict.fromkeys(self.kinds, 1.0 / (self.dt_s * self.every_other))
            | {"gnss": 1.0 / (self.dt_s * self.gnss_every)},
            sheets=self.sheets,
        )

    # --- the truth ---------------------------------------------------------------------------------------------------

    @cached_property
    def plan(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Speed (T,), planned yaw rate (T,), and which pass it is (T,), -1 in turns and at rest."""
        straight = round(self.length_m / self.speed_m_s / self.dt_s)
        turn = round(np.pi * 0.5 * self.spacing_m / self.speed_m_s / self.dt_s)
        rest = round(self.stand_s / self.dt_s)
        speed, rate, which = [np.zeros(rest)], [np.zeros(rest)], [np.full(rest, -1)]
        for number in range(self.passes):
            speed.append(np.full(straight, self.speed_m_s))
            rate.append(np.zeros(straight))
            which.append(np.full(straight, number))
            if number < self.passes - 1:
                side = 1.0 if number % 2 == 0 else -1.0
                speed.append(np.full(turn, self.speed_m_s))
                rate.append(np.full(turn, side * np.pi / (turn * self.dt_s)))
                which.append(np.full(turn, -1))
        return np.concatenate(speed), np.concatenate(rate), np.concatenate(which)

    @cached_property
    def truth(self) -> FloatArray:
        """(T, R, 5) after each step: east, north, heading (not wrapped), speed, yaw rate."""
        speed, rate, _ = self.plan
        rng = np.random.default_rng([self.seed, 1])
        way = np.cumsum(speed)[:, np.newaxis] * self.dt_s
        waves = np.array([23.0, 11.0, 5.0])
        phases = rng.uniform(0.0, 2.0 * np.pi, (3, 1, self.runs))
        weave = self.weave_rad * sum(
            np.sin(2.0 * np.pi * way / wave + phase) - np.sin(phase) for wave, phase in zip(waves, phases, strict=True)
        )
        heading = self.heading + np.cumsum(rate)[:, np.newaxis] * self.dt_s + weave
        before = np.concatenate([np.full((1, self.runs), self.heading), heading[:-1]])
        turned = heading - before
        chord = speed[:, np.newaxis] * self.dt_s * np.sinc(0.5 * turned / np.pi)
        middle = before + 0.5 * turned
        return np.stack(
            [
                np.cumsum(chord * np.cos(middle), axis=0),
                np.cumsum(chord * np.sin(middle), axis=0),
                heading,
                np.broadcast_to(speed[:, np.newaxis], heading.shape),
                turned / self.dt_s,
            ],
            axis=-1,
        )

    @property
    def steps(self) -> int:
        return len(self.plan[0])

    @cached_property
    def solved(self) -> list[Solution]:
        """How the receiver solves, in order of time."""
        if self.solutions is not None:
            return list(self.solutions)
        sheet = self.sheet("gnss")
        slow, tau, white = (
            sheet[f"single_position_{name}"] for name in ("correlated_sigma_m", "correlation_s", "white_sigma_m")
        )
        return [Solution(begin_s=0.0, quality=1.0, slow_m=slow, slow_s=tau, white_m=white, reported_m=2.5)]

    @cached_property
    def gnss_error(self) -> FloatArray:
        """(T, R, 2) correlated and white error of positions; every solution has a slow error of its own."""
        rng = np.random.default_rng([self.seed, 2])
        error = np.empty((self.steps, self.runs, 2))
        begins = [round(each.begin_s / self.dt_s) for each in self.solved]
        for each, begin, end in zip(self.solved, begins, [*begins[1:], self.steps], strict=True):
            keep = np.exp(-self.dt_s / each.slow_s)
            now = each.slow_m * rng.normal(size=(self.runs, 2))
            for step in range(begin, end):
                now = keep * now + each.slow_m * np.sqrt(1.0 - keep * keep) * rng.normal(size=(self.runs, 2))
                error[step] = now + each.white_m * rng.normal(size=(self.runs, 2))
        if self.jump_s is not None:
            error[round(self.jump_s / self.dt_s) :] += self.jump_m
        drift = self.drift_m_s * np.random.default_rng([self.seed, 7]).normal(size=(self.runs, 2))
        return error + self.age_s[:, np.newaxis, np.newaxis] * drift

    @cached_property
    def age_s(self) -> FloatArray:
        """(T,) of corrections."""
        t_s = (np.arange(self.steps) + 1) * self.dt_s
        begin_s, end_s = self.lost_s or (np.inf, np.inf)
        return 1.0 + np.where((t_s > begin_s) & (t_s < end_s), t_s - begin_s, 0.0)

    @cached_property
    def dilution(self) -> FloatArray:
        """(T, 1) of precision."""
        t_s = (np.arange(self.steps) + 1) * self.dt_s
        return np.where(t_s < (self.diluted_s or np.inf), 1.0, 2.0)[:, np.newaxis]

    @cached_property
    def steering_offset(self) -> FloatArray:
        """(R,) of the steering angle, rad."""
        return self.steering_offset_rad * np.random.default_rng([self.seed, 4]).normal(size=self.runs)

    def each_second(self, stream: int) -> FloatArray:
        """(T, R) drawn once a second, sigma 1."""
        second = (np.arange(self.steps) * self.dt_s).astype(int)
        return np.random.default_rng([self.seed, stream]).normal(size=(second[-1] + 1, self.runs))[second]

    def told(self, name: str) -> FloatArray:
        """(T, 1) what the receiver says of its solution."""
        t_s = (np.arange(self.steps) + 1) * self.dt_s
        index = np.searchsorted([each.begin_s for each in self.solved], t_s, side="right") - 1
        return np.array([getattr(each, name) for each in self.solved])[index][:, np.newaxis]

    # --- what is measured --------------------------------------------------------------------------------------------

    @cached_property
    def _samples(self) -> dict[str, FloatArray]:
        """(T, R, n) by kind."""
        truth, rng = self.truth, np.random.default_rng([self.seed, 3])
        east, north, heading, speed, rate = np.moveaxis(truth, -1, 0)
        shape = east.shape
        sheet, gyro = self.sheet("gnss"), self.sheet("yaw_gyro")
        cosine, sine = np.cos(heading), np.sin(heading)
        position = np.stack(
            [east + ARM_M[0] * cosine - ARM_M[1] * sine, north + ARM_M[0] * sine + ARM_M[1] * cosine], axis=-1
        )
        lsb = np.array(
            [sheet.get(f"{axis}_resolution_m", sheet["position_resolution_m"]) for axis in ("east", "north")]
        )
        position = position + (self.sway_m * self.each_second(5))[..., np.newaxis] * np.stack([-sine, cosine], axis=-1)
        position = np.round((position + self.gnss_error) / lsb) * lsb
        along, aside = speed - ARM_M[1] * rate, ARM_M[0] * rate
        velocity = np.stack([along * cosine - aside * sine, along * sine + aside * cosine], axis=-1)
        velocity = velocity + sheet["speed_noise_m_s"] * self.dilution[..., np.newaxis] * rng.normal(
            size=velocity.shape
        )
        reported = np.broadcast_to(self.told("reported_m"), shape)
        quality = np.broadcast_to(self.told("quality"), shape)
        age = self.age_s[:, np.newaxis]
        rest = [quality, *(np.broadcast_to(each, shape) for each in (9.0, self.dilution, 1.7 * self.dilution, age))]
        gnss = np.stack(
            [
                position[..., 0],
                position[..., 1],
                np.zeros(shape),
                np.hypot(velocity[..., 0], velocity[..., 1]),
                np.arctan2(velocity[..., 1], velocity[..., 0]),
                reported,
                reported,
                reported,
                *rest,
            ],
            axis=-1,
        )
        bias = gyro["bias_rad_s"] * rng.normal(size=self.runs)
        walk = gyro["bias_random_walk_rad_s_rts"] * np.sqrt(self.dt_s)
        bias = bias + walk * np.cumsum(rng.normal(size=shape), axis=0)
        scale = 1.0 + gyro["scale_error_ratio"] * rng.normal(size=self.runs)
        yaw_rate = scale * rate + bias + gyro["noise_rad_s"] * rng.normal(size=shape)
        wheel = 1.0 + self.slip_ratio * rng.normal(size=self.runs)
        ways = np.stack([speed - 0.5 * TRACK_M * rate, speed + 0.5 * TRACK_M * rate], axis=-1) * self.dt_s
        ways = ways * wheel[:, np.newaxis] * (1.0 + self.slip_noise * rng.normal(size=ways.shape))
        slots = np.floor(np.cumsum(ways, axis=0) / SLOT_M + rng.uniform(size=(self.runs, 2)))
        steering = np.arctan(WHEELBASE_M * rate / np.maximum(speed, 0.1))
        steering = steering + self.steering_offset + self.slip_angle_rad * self.each_second(6)
        steering = steering + self.steering_noise_rad * rng.normal(size=shape)
        imu = np.zeros((*shape, 6))
        imu[..., 5] = yaw_rate
        pace = 0.5 * SLOT_M * np.diff(slots, axis=0, prepend=slots[:1]).sum(axis=-1) / self.dt_s
        return {
            "gnss": gnss,
            "yaw_gyro": yaw_rate[..., np.newaxis],
            "imu": imu,
            "wheel_encoders": slots,
            "angle_transducer": steering[..., np.newaxis],
            "radar": pace[..., np.newaxis],
            "odometry": np.stack([pace, yaw_rate], axis=-1),
        }

    def measurements(self, step: int, member: int | None = None) -> Iterator[Measurement]:
        """What arrives at the end of a step, of all members or of one."""
        picked = slice(None) if member is None else slice(member, member + 1)
        t_s = (step + 1) * self.dt_s
        for kind in self.kinds:
            if kind == "gnss":
                late = round(self.late_s / self.dt_s)
                if (step + 1 - late) % self.gnss_every == 0 and step >= late:
                    values = self._samples[kind][step - late, picked]
                    yield measure(kind, t_s - late * self.dt_s, values, late_s=late * self.dt_s)
            elif self.every_other == 1:
                yield measure(kind, t_s, self._samples[kind][step, picked])
            elif (step + 1 - round(self.late_s / self.dt_s)) % self.every_other == 0:
                values = self._samples[kind][step, picked]
                if kind == "yaw_gyro":
                    values = self._samples[kind][max(0, step + 1 - self.every_other) : step + 1, picked].mean(axis=0)
                yield measure(kind, t_s, values)


def drive(world: Passes, estimator: Estimator, *, member: int | None = None, every: int = 1) -> tuple[FloatArray, ...]:
    """Feed an estimator; return values (T, R, n), sigmas (T, R, n) and covariance (T, R, m, m) of every n-th step."""
    values, sigmas, covariances = [], [], []
    for step in range(world.steps):
        for measurement in world.measurements(step, member):
            estimator.process(measurement)
        if (step + 1) % every == 0:
            said = estimator.estimate(round((step + 1) * world.dt_s * NS_PER_S))
            values.append(said.values)
            sigmas.append(said.sigmas)
            covariances.append(np.zeros(0) if said.covariance is None else said.covariance)
    return np.array(values), np.array(sigmas), np.array(covariances)


def pass_to_pass(world: Passes, positions: FloatArray) -> FloatArray:
    """Cross-track error of the second pass less that of the first (n, R), at equal stations along the line.

    ``positions`` (T, R, 2) are estimates at every step.
    """
    which = world.plan[2]
    normal = np.array([-np.sin(world.heading), np.cos(world.heading)])
    along = np.array([np.cos(world.heading), np.sin(world.heading)])
    errors = (positions - world.truth[..., :2]) @ normal
    stations = world.truth[..., :2] @ along
    out = []
    grid = np.linspace(0.2, 0.95, 16) * world.length_m
    for run in range(positions.shape[1]):
        first, second = (np.flatnonzero(which == number) for number in (0, 1))
        at_first = np.interp(grid, stations[first, run], errors[first, run])
        back = second[::-1]
        at_second = np.interp(grid, stations[back, run], errors[back, run])
        out.append(at_second - at_first)
    return np.array(out).T
