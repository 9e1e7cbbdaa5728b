"""What comes of a block of members, and how blocks of one world are put together."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from twin.scoring.consistency import NIS_PREFIX
from twin.scoring.envelopes import Envelope
from twin.scoring.honesty import Honesty
from twin.signals import COLLISION, NS_PER_S, FloatArray, IntArray

_ENVELOPE_PERIOD_NS = NS_PER_S // 5
_ORDINARY = ("duration", COLLISION)


@dataclass(kw_only=True)
class TaskResult:
    """What came of some members of one point in one world."""

    metrics: dict[str, FloatArray]
    """(R,) by name."""
    motion: dict[str, float]
    """What the machine did, and what its buses carry: the same for all members."""
    envelopes: dict[str, Envelope]
    honesty: dict[str, Honesty]
    """By estimator."""
    nees: dict[str, tuple[IntArray, FloatArray]]
    """By estimator: times (T,) and NEES of the world's first member (T,); nothing in blocks without it."""
    nis: dict[str, tuple[IntArray, FloatArray]]
    """By ``<estimator>.<column>``: ends of seconds (T,) and the first member's first NIS in each of them (T,)."""
    states: dict[str, int]
    """By estimator: number of states of its covariance."""
    ended_reason: str = "duration"
    ended_t_s: float = 0.0
    wall_s: dict[str, float] = field(default_factory=dict)

    @staticmethod
    def empty(ended_reason: str, ended_t_s: float) -> TaskResult:
        """A result of nobody yet."""
        return TaskResult(
            metrics={}, motion={}, envelopes={}, honesty={}, nees={}, nis={}, states={},
            ended_reason=ended_reason, ended_t_s=ended_t_s,
        )  # fmt: skip


def merge_envelopes(into: dict[str, Envelope], more: dict[str, Envelope]) -> None:
    """Add envelopes of other members; a world that ended before its time has fewer instants, and is left out."""
    for name, envelope in more.items():
        if name not in into:
            into[name] = Envelope.at(envelope.t_ns)
        if len(into[name].t_ns) == len(envelope.t_ns):
            into[name].merge(envelope)


def merge_honesty(into: dict[str, Honesty], more: dict[str, Honesty]) -> None:
    """Add what was counted of other members."""
    for name, found in more.items():
        if name not in into:
            into[name] = found.copy()
        else:
            into[name].merge(found)


def joined(blocks: Iterable[TaskResult]) -> TaskResult:
    """The members of all blocks of one world, which come in their order.

    Of members whose run ended before its time the first names the reason, one that touched a tree last.

    Raises:
        ValueError: there is no block.
    """
    whole: TaskResult | None = None
    pieces: list[dict[str, FloatArray]] = []
    for block in blocks:
        pieces.append(block.metrics)
        if whole is None:
            whole = dataclasses.replace(block, envelopes={}, honesty={}, wall_s=dict.fromkeys(block.wall_s, 0.0))
        merge_envelopes(whole.envelopes, block.envelopes)
        merge_honesty(whole.honesty, block.honesty)
        if whole.ended_reason == "duration" or (
            whole.ended_reason == COLLISION and block.ended_reason not in _ORDINARY
        ):
            whole.ended_reason, whole.ended_t_s = block.ended_reason, block.ended_t_s
        whole.wall_s = {key: whole.wall_s[key] + block.wall_s[key] for key in whole.wall_s}
    if whole is None:
        raise ValueError("no block")
    whole.metrics = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
    return whole


class Watcher:
    """Collects envelopes over all members of a task; NEES and NIS of the first member of the world, if it is there."""

    def __init__(self, t_ns: IntArray, result: TaskResult, *, with_first: bool) -> None:
        self._instants = t_ns[t_ns % _ENVELOPE_PERIOD_NS == 0]
        self._result = result
        self._with_first = with_first

    def note_states(self, states: dict[str, int]) -> None:
        """Keep the number of states of each estimator."""
        self._result.states = states

    def take(self, name: str, t_ns: IntArray, values: FloatArray) -> None:
        """Take a piece of a signal: ``<estimator>.<signal>`` at times (T,), (T, R)."""
        estimator, _, signal = name.partition(".")
        if signal == "nees" or signal.startswith(NIS_PREFIX):
            if self._with_first:
                self._take_first(estimator, signal, t_ns, values[:, 0])
            return
        if name not in self._result.envelopes:
            self._result.envelopes[name] = Envelope.at(self._instants)
        self._result.envelopes[name].add(t_ns, values)

    def _take_first(self, estimator: str, signal: str, t_ns: IntArray, values: FloatArray) -> None:
        known = ~np.isnan(values)
        if signal == "nees":
            times, before = self._result.nees.get(estimator, (np.empty(0, dtype=np.int64), np.empty(0)))
            self._result.nees[estimator] = np.append(times, t_ns[known]), np.append(before, values[known])
        else:
            key = f"{estimator}.{signal}"
            times, before = self._result.nis.get(key, (np.empty(0, dtype=np.int64), np.empty(0)))
            # One a second, at the end of its second, so that worlds with other arrivals have instants in common.
            ends, first = np.unique(-(-t_ns[known] // NS_PER_S) * NS_PER_S, return_index=True)
            new = ~np.isin(ends, times)
            self._result.nis[key] = np.append(times, ends[new]), np.append(before, values[known][first[new]])
