"""Vehicles that drive straights and bends, and a receiver on them, for tests of guidance filters without a world."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import lfilter

from tests.estimators.bench import gauss_markov
from twin.geometry import Path
from twin.signals import NS_PER_S, Estimator, EstimatorSetup, FloatArray, Measurement, Mount, SensorInfo

COLUMNS = (
    *("position_e_m", "position_n_m", "position_u_m", "speed_m_s", "course_rad"),
    *("sigma_e_m", "sigma_n_m", "sigma_u_m", "quality", "satellites", "hdop", "vdop", "age_s"),
)
FINE_HZ = 100
STEERING_S = 1.0
"""How long a driver takes to turn the wheel into a bend or out of it."""
TRANSITION_S = 4.0
"""How long an entry or an exit counts as one."""
STRAIGHT, CURVE, ENTRY, EXIT = "straight", "curve", "entry", "exit"


def make_setup(
    *more: SensorInfo, runs: int = 1, rate_hz: float = 5.0, arm=(0.0, 0.0, 0.0), columns=COLUMNS, **changes: object
) -> EstimatorSetup:
    receiver = SensorInfo(
        name="gps",
        kind="gnss",
        columns=columns,
        mount=Mount(body="body", xyz_m=arm),
        rate_hz=rate_hz,
        datasheet={"speed_noise_m_s": 0.05},
    )
    keys: dict[str, object] = {
        "name": "guide",
        "runs": runs,
        "sensors": {info.name: info for info in (receiver, *more)},
        "reference": Mount(body="body", xyz_m=(0.0, 0.0, 0.0)),
        "rows_y_m": (),
        "start_e_n_heading": (0.0, 0.0, 0.0),
    }
    return EstimatorSetup(**keys | changes)  # type: ignore[arg-type]


def fix(t_s: float, position: FloatArray, *, speed=5.0, course=0.0, valid=None, **told: float) -> Measurement:
    """A fix for positions (R, 3), at once."""
    position = np.atleast_2d(np.asarray(position, dtype=float))
    values = np.full((len(position), len(COLUMNS)), np.nan)
    values[:, :3] = position
    usual = {"speed_m_s": speed, "course_rad": course, "quality": 1.0, "hdop": 1.0, "vdop": 1.7}
    for name, value in (usual | told).items():
        values[:, COLUMNS.index(name)] = value
    t_ns = round(t_s * NS_PER_S)
    good = np.ones(len(position), dtype=bool) if valid is None else np.asarray(valid)
    return Measurement(sensor="gps", t_ns=t_ns, t_available_ns=t_ns, columns=COLUMNS, values=values, valid=good)


@dataclass(frozen=True, kw_only=True)
class Drive:
    """One vehicle at :data:`FINE_HZ`."""

    position: FloatArray
    """(T, 2)."""
    heading: FloatArray
    speed: FloatArray
    curvature: FloatArray
    """Of the bends, without what the driver's hand adds."""
    phase: np.ndarray
    """(T,) names of phases, "" while it stands and starts."""
    planned: Path


def drive(
    seed: int, *, bends: int = 4, stand_s: float = 20.0, wander_m_s2: float = 0.1, wander_s: float = 1.0
) -> Drive:
    """A vehicle that stands, and then drives at 20 to 40 km/h, bends of 25 to 60 m radius between straights.

    It is no faster than 2.5 m/s^2 across allow in its tightest bend. The driver's hand adds lateral accelerations of
    ``wander_m_s2``, forgotten within ``wander_s``.
    """
    rng = np.random.default_rng(seed)
    radii = rng.uniform(25.0, 60.0, bends)
    speed = min(rng.uniform(20.0, 40.0) / 3.6, float(np.sqrt(2.5 * radii.min())))
    angles = np.radians(rng.uniform(60.0, 180.0, bends)) * rng.choice([-1.0, 1.0], bends)
    lengths_s = rng.uniform(10.0, 20.0, bends + 1)
    dt = 1.0 / FINE_HZ
    curvature, phase = [np.zeros(round(lengths_s[0] / dt))], [_named(STRAIGHT, lengths_s[0])]
    pieces = [(speed * speed / 2.0 + lengths_s[0] * speed, 0.0)]  # it starts at 1 m/s^2
    steps = (np.arange(10) + 0.5) / 10.0
    for radius, angle, length_s in zip(radii, angles, lengths_s[1:], strict=True):
        hold_s = abs(angle) * radius / speed - STEERING_S
        ramp = np.linspace(0.0, 1.0, round(STEERING_S / dt), endpoint=False)
        shape = np.concatenate([ramp, np.ones(round(hold_s / dt)), 1.0 - ramp])
        curvature += [np.sign(angle) / radius * shape, np.zeros(round(length_s / dt))]
        entry_s = min(TRANSITION_S, STEERING_S + hold_s)
        phase += [_named(ENTRY, entry_s), _named(CURVE, STEERING_S + hold_s - entry_s)]
        phase += [_named(EXIT, TRANSITION_S), _named(STRAIGHT, STEERING_S + length_s - TRANSITION_S)]
        bend, step_m = np.sign(angle) / radius, STEERING_S * speed / len(steps)
        pieces += [(step_m, bend * part) for part in steps]
        pieces += [(hold_s * speed, bend)] if hold_s > 0.0 else []
        pieces += [(step_m, bend * part) for part in steps[::-1]] + [(length_s * speed, 0.0)]
    bent = np.concatenate(curvature)
    start = round(stand_s / dt)
    gains = np.arange(1, round(speed / 1.0 / dt) + 1) * dt
    speeds = np.concatenate([np.zeros(start), gains, np.full(len(bent), speed)])
    bent = np.concatenate([np.zeros(start + len(gains)), bent])
    hand = gauss_markov(wander_m_s2, wander_s, dt, count=len(bent), runs=1, rng=rng)[:, 0] / speed**2
    turned = np.cumsum((bent + hand) * speeds * dt)
    middle = turned - 0.5 * (bent + hand) * speeds * dt
    ways = np.stack([np.cos(middle), np.sin(middle)], axis=-1) * (speeds * dt)[:, np.newaxis]
    names = np.concatenate([_named("", (start + len(gains)) * dt), *phase])
    count = min(len(names), len(bent))
    return Drive(
        position=np.cumsum(ways, axis=0)[:count],
        heading=turned[:count],
        speed=speeds[:count],
        curvature=bent[:count],
        phase=names[:count],
        planned=Path(east_m=0.0, north_m=0.0, heading_rad=0.0, pieces=[(float(a), float(b)) for a, b in pieces]),
    )


def _low_pass(values: np.ndarray, tau_s: float) -> np.ndarray:
    if tau_s == 0.0:
        return values
    share = -np.expm1(-1.0 / (FINE_HZ * tau_s))
    return lfilter([share], [1.0, share - 1.0], values)


def _named(name: str, lasts_s: float) -> np.ndarray:
    return np.full(round(lasts_s * FINE_HZ), name, dtype="<U8")


@dataclass(frozen=True, kw_only=True)
class Bench:
    """Several drives with a receiver each, side by side on the ensemble axis.

    The receiver errs by a common part that wanders (``common_m``, ``common_s``) and by a part that is new in every fix.
    Errors are counted from the track that the common part shifts: that is the track the receiver can know of.
    """

    seeds: Iterable[int]
    rate_hz: float = 5.0
    white_m: float = 0.3
    common_m: float = 1.0
    common_s: float = 150.0
    wander_m_s2: float = 0.1
    wander_s: float = 1.0
    velocity_lag_s: float = 0.2
    """Of the receiver's velocity, behind a filter of first order."""
    drives: list[Drive] = field(init=False)
    shifted: FloatArray = field(init=False)
    """(K, R, 2) track and common error at the fixes."""
    seen: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        seeds = list(self.seeds)
        drives = [drive(seed, wander_m_s2=self.wander_m_s2, wander_s=self.wander_s) for seed in seeds]
        every, period = round(FINE_HZ / self.rate_hz), 1.0 / self.rate_hz
        count = min(len(one.position) for one in drives) // every
        positions = np.stack([one.position[every - 1 :: every][:count] for one in drives], axis=1)
        shifted, seen = np.empty_like(positions), np.empty_like(positions)
        for member, seed in enumerate(seeds):
            rng = np.random.default_rng([seed, 1])
            common = gauss_markov(self.common_m, self.common_s, period, count=count, runs=2, rng=rng)
            shifted[:, member] = positions[:, member] + common
            seen[:, member] = shifted[:, member] + self.white_m * rng.standard_normal((count, 2))
        self._set("drives", drives)
        self._set("shifted", shifted)
        self._set("seen", seen)

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def at_fixes(self, name: str) -> np.ndarray:
        """(K, R) of a quantity of the drives."""
        every = round(FINE_HZ / self.rate_hz)
        return np.stack([getattr(one, name)[every - 1 :: every][: len(self.seen)] for one in self.drives], axis=1)

    def fixes(self, members: slice = slice(None)) -> Iterable[Measurement]:
        rng = np.random.default_rng(7)
        every = round(FINE_HZ / self.rate_hz)
        true = [one.speed * np.exp(1j * one.heading) for one in self.drives]
        lagged = np.stack(
            [_low_pass(each, self.velocity_lag_s)[every - 1 :: every][: len(self.seen)] for each in true], 1
        )
        noise = 0.05 * rng.standard_normal((2, *lagged.shape))
        for k in range(len(self.seen)):
            velocity = lagged[k] + noise[0, k] + 1j * noise[1, k]
            position = np.column_stack([self.seen[k], np.zeros(len(self.drives))])
            yield fix(
                (k + 1) / self.rate_hz,
                position[members],
                speed=np.abs(velocity)[members],
                course=np.angle(velocity)[members],
            )

    def errors(self, estimator: Estimator, members: slice = slice(None)) -> FloatArray:
        """(K, R, 2) of the estimated positions, just after each fix."""
        out = []
        for k, sample in enumerate(self.fixes(members)):
            estimator.process(sample)
            out.append(estimator.estimate(sample.t_ns).values[:, :2] - self.shifted[k, members])
        return np.array(out)

    def across(self, errors: FloatArray) -> FloatArray:
        """(K, R) the part of errors that is to the left of the way."""
        heading = self.at_fixes("heading")
        left: FloatArray = errors[..., 1] * np.cos(heading) - errors[..., 0] * np.sin(heading)
        return left

    def rms(self, errors: FloatArray, phase: str) -> FloatArray:
        """(R,) of errors (K, R) in a phase."""
        where = self.at_fixes("phase") == phase
        return np.sqrt((errors**2 * where).sum(axis=0) / where.sum(axis=0))
