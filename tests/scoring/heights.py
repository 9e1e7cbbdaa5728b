"""Made-up truth, estimates and fixes of a height, at 50 Hz, whose figures can be worked out by hand."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.small_scenario import small_scenario
from twin.recording import Stream
from twin.scenario import Scenario, resolve
from twin.scoring.scorer import Scorer

STEP_NS = 20_000_000
Array = NDArray[np.float64]


def lossy(duration_s: float, loss: tuple[float, float] | None, **scoring: Any) -> Scenario:
    """A scenario with a window in which something is missing."""
    window = {} if loss is None else {"loss": {"from_s": loss[0], "to_s": loss[1]}}
    return resolve(small_scenario(duration_s=duration_s, scoring={**window, **scoring}), where="test")


def times(duration_s: float) -> Array:
    """Epochs in seconds."""
    return np.arange(0, round(duration_s * 50)) / 50.0


def heights(duration_s: float) -> Stream:
    """A truth that goes up and down."""
    t_s = times(duration_s)
    values = 0.1 * np.sin(t_s)[:, np.newaxis, np.newaxis]
    return Stream(columns=("height_m",), t_ns=np.round(t_s * 1e9).astype(np.int64), values=values)


def estimate_of(truth: Stream, errors_m: Array, sigmas_m: Array | float = np.nan) -> Stream:
    """An estimate with these errors and sigmas, (T,) or (T, R)."""
    errors_m = errors_m.reshape(len(truth), -1)
    sigmas = np.broadcast_to(np.reshape(sigmas_m, (-1, 1)) if np.ndim(sigmas_m) == 1 else sigmas_m, errors_m.shape)
    values = np.stack([truth.values[:, :, 0] + errors_m, sigmas], axis=-1)
    return Stream(columns=("height_m", "height_m.sigma"), t_ns=truth.t_ns, values=values)


def fixes_at(duration_s: float, *first_s: float, until_s: float = 0.0) -> Stream:
    """Samples at 10 Hz: a true fix until one time, none for a while, then one from a member's own time on."""
    t_s = np.arange(0, round(duration_s * 10)) / 10.0
    true = (t_s[:, np.newaxis] < until_s) | (t_s[:, np.newaxis] >= np.array(first_s) - 1e-6)
    return Stream(
        columns=("true_fix",), t_ns=np.round(t_s * 1e9).astype(np.int64), values=true[:, :, np.newaxis].astype(float)
    )


def part(stream: Stream, begin_ns: int, end_ns: int) -> Stream:
    """What a stream has from one time on until before another."""
    rows = (stream.t_ns >= begin_ns) & (stream.t_ns < end_ns)
    return Stream(columns=stream.columns, t_ns=stream.t_ns[rows], values=stream.values[rows])


def scored(scenario: Scenario, truth: Stream, estimate: Stream, fixes: Stream | None = None, piece_s: float = 1e4):
    """A scorer that was fed in pieces of some seconds."""
    columns = {"one": estimate.columns}
    scorer = Scorer(scenario, truth.columns, columns, runs=range(estimate.values.shape[1]))
    piece_ns = round(piece_s * 1e9)
    for begin in range(0, int(truth.t_ns[-1]) + 1, piece_ns):
        bounds = begin, begin + piece_ns
        scorer.add(
            part(truth, *bounds), {"one": part(estimate, *bounds)}, None if fixes is None else part(fixes, *bounds)
        )
    return scorer
