"""Made-up drives along a planned path, at 50 Hz, and estimates of them with known errors."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.small_scenario import small_scenario
from twin.control.planned_legs import PlannedPiece
from twin.recording import Stream
from twin.scenario import Scenario, resolve
from twin.scoring.scorer import Scorer

Array = NDArray[np.float64]
STEP_NS = 20_000_000
SPEED_M_S = 2.0

UP_AND_DOWN = [
    {"straight_m": 60.0},
    {"turn_deg": 180.0, "radius_m": 1.5, "raised": True},
    {"straight_m": 60.0},
    {"turn_deg": -180.0, "radius_m": 1.5, "raised": True},
    {"straight_m": 60.0},
]
"""Three passes 3 m apart, each to the left of the one before (the first goes east)."""


def guided(path: list[dict[str, Any]] | None = None, **changes: Any) -> Scenario:
    """A scenario that judges guidance, with the machine's rear axle starting at the origin, eastwards."""
    changes["scoring"] = {"guidance": True, **changes.get("scoring", {})}
    changes.setdefault("duration_s", 200.0)
    return resolve(
        small_scenario(driver={"speed_m_s": SPEED_M_S, "path": path or UP_AND_DOWN}, **changes), where="test"
    )


def driven(
    scenario: Scenario,
    *,
    left_m: float | dict[int, float] = 0.0,
    speed_m_s: float = SPEED_M_S,
    rate_hz: float = 50.0,
) -> Stream:
    """A truth that follows the legs, some metres to the left of them (of all, or by leg); stops last 40 s."""
    rows: list[tuple[float, ...]] = []
    for leg in scenario.planned_legs:
        beside = left_m if isinstance(left_m, float) else left_m.get(leg.index, 0.0)
        standing = PlannedPiece(
            east_m=leg.east_m, north_m=leg.north_m, heading_rad=leg.heading_rad, length_m=0.0, curvature_1_m=0.0
        )
        for piece in leg.pieces or (standing,):
            rows += _along(piece, beside, speed_m_s, rate_hz, leg.index)
    names = ("position_e_m", "position_n_m", "heading_rad", "speed_m_s", "yaw_rate_rad_s", "segment")
    t_ns = np.arange(len(rows), dtype=np.int64) * round(1e9 / rate_hz)
    return Stream(columns=names, t_ns=t_ns, values=np.array(rows)[:, np.newaxis])


def _along(
    piece: PlannedPiece, beside_m: float, speed_m_s: float, rate_hz: float, index: int
) -> list[tuple[float, ...]]:
    rows: list[tuple[float, ...]] = []
    count = max(1, round((piece.length_m / speed_m_s if piece.length_m else 40.0) * rate_hz))
    for step in range(count):
        along = piece.length_m * step / count
        turned = piece.curvature_1_m * along
        chord = along * float(np.sinc(turned / 2.0 / math.pi))
        course, heading = piece.heading_rad + turned / 2.0, piece.heading_rad + turned
        east = piece.east_m + chord * math.cos(course) - beside_m * math.sin(heading)
        north = piece.north_m + chord * math.sin(course) + beside_m * math.cos(heading)
        speed = speed_m_s if piece.length_m else 0.0
        wrapped = math.remainder(heading, 2.0 * math.pi)
        rows.append((east, north, wrapped, speed, speed * piece.curvature_1_m, float(index)))
    return rows


def estimate_of(truth: Stream, east_m: Array | float, north_m: Array | float, **others: Array | float) -> Stream:
    """An estimate of the position with these errors, numbers or (T,) or (T, R), and other columns."""
    columns: dict[str, Array | float] = {
        "position_e_m": truth.column("position_e_m") + _tall(east_m),
        "position_n_m": truth.column("position_n_m") + _tall(north_m),
        **others,
    }
    tall = np.broadcast_arrays(*(_tall(value) for value in columns.values()), np.zeros((len(truth), 1)))[:-1]
    return Stream(columns=tuple(columns), t_ns=truth.t_ns, values=np.stack(tall, axis=-1))


def _tall(values: Array | float) -> Array:
    return np.reshape(values, (-1, 1)) if np.ndim(values) < 2 else np.asarray(values)


def part(stream: Stream, begin_ns: int, end_ns: int) -> Stream:
    """What a stream has from one time on until before another."""
    rows = (stream.t_ns >= begin_ns) & (stream.t_ns < end_ns)
    return Stream(columns=stream.columns, t_ns=stream.t_ns[rows], values=stream.values[rows])


def scored(scenario: Scenario, truth: Stream, estimate: Stream, *, piece_s: float = 1e5, whole: bool = False) -> Scorer:
    """A scorer fed in pieces of some seconds, of the estimate alone if the ``whole`` truth is given at once."""
    scorer = Scorer(scenario, truth.columns, {"one": estimate.columns}, runs=range(estimate.values.shape[1]))
    for begin in range(0, int(truth.t_ns[-1]) + 1, round(piece_s * 1e9)):
        bounds = begin, begin + round(piece_s * 1e9)
        scorer.add(truth if whole else part(truth, *bounds), {"one": part(estimate, *bounds)})
    return scorer


def figures(scenario: Scenario, truth: Stream, estimate: Stream) -> dict[str, float]:
    """Metrics of a single run."""
    return {name.removeprefix("one."): float(v[0]) for name, v in scored(scenario, truth, estimate).metrics().items()}
