"""What a receiver's quality does over a log, and what its changes do to tracks.

Quality is field 6 of GGA. Of each quality: how long it lasted; of each pair: how often one followed the other, and the
*jump* of every track there: the step from the last row of the old quality to the first of the new, less the way that
speed and course told in the last row of the old make in that time (where they are not told: the velocity of the step
before). What is told after the change does not count: a speed worked out from positions has the jump in it, and would
take a part of it for motion. An acceleration or a turn within the step is part of the jump for all tracks alike.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping

import numpy as np

from twin.scoring.tracks import Track
from twin.signals import NS_PER_S, BoolArray, FloatArray, IntArray

QUALITIES = {
    0: "none",
    1: "single",
    2: "dgps",
    3: "pps",
    4: "fixed",
    5: "float",
    6: "estimated",
    7: "manual",
    8: "simulated",
}
"""Names in metrics of what GGA's field 6 says."""
_MEMORY = 2
"""Rows of the piece before that a jump needs."""


def quality_name(code: float) -> str:
    """Name of a quality in metrics; ``unknown`` where there is none."""
    return "unknown" if math.isnan(code) else QUALITIES.get(int(code), f"code{int(code)}")


class TransitionTally:
    """Times of qualities, transitions and jumps of tracks, fed in pieces of rows that all share.

    A row's quality lasts until the next row, but no longer than ``longest_gap_s``.
    """

    def __init__(self, longest_gap_s: float) -> None:
        self._gap_s = longest_gap_s
        self._before: tuple[FloatArray, dict[str, Track]] | None = None
        self._seconds: dict[str, float] = {}
        self._counts: Counter[tuple[str, str]] = Counter()
        self._jumps: dict[tuple[str, str, str], _Jumps] = {}

    def add(self, quality: FloatArray, tracks: Mapping[str, Track]) -> None:
        """Take a piece: quality (T,), NaN where unknown, and tracks of T rows at the same times."""
        kept = 0
        tracks = dict(tracks)
        if self._before is not None:
            qualities, before = self._before
            kept = len(qualities)
            quality = np.concatenate([qualities, quality])
            tracks = {name: track.behind(before[name]) for name, track in tracks.items()}
        self._before = quality[-_MEMORY:], {name: track.rows(slice(-_MEMORY, None)) for name, track in tracks.items()}
        t_ns = next(iter(tracks.values())).t_ns
        ends = np.arange(max(kept, 1), len(quality))  # rows that end a new step
        self._take_times(quality, t_ns, ends)
        at = ends[_differs(quality[ends], quality[ends - 1])]
        for index in at.tolist():
            self._counts[quality_name(quality[index - 1]), quality_name(quality[index])] += 1
        for name, track in tracks.items():
            for index, jump in zip(at.tolist(), jumps(track, at).tolist(), strict=True):
                pair = quality_name(quality[index - 1]), quality_name(quality[index])
                self._jumps.setdefault((name, *pair), _Jumps()).add(jump)

    def _take_times(self, quality: FloatArray, t_ns: IntArray, ends: IntArray) -> None:
        lasted = np.clip((t_ns[ends] - t_ns[ends - 1]) / NS_PER_S, 0.0, self._gap_s)
        before = quality[ends - 1]
        for code in np.unique(before):
            same = np.isnan(before) if np.isnan(code) else before == code
            name = quality_name(code)
            self._seconds[name] = self._seconds.get(name, 0.0) + float(lasted[same].sum())

    def receiver_figures(self) -> dict[str, float]:
        """Times and counts by name."""
        whole = sum(self._seconds.values())
        found: dict[str, float] = {}
        for name, seconds in sorted(self._seconds.items()):
            found[f"quality.{name}_s"] = seconds
            found[f"quality.{name}_percent"] = 100.0 * seconds / whole if whole else math.nan
        return found | {f"quality.{old}_to_{new}_count": float(n) for (old, new), n in sorted(self._counts.items())}

    def track_figures(self, track: str) -> dict[str, float]:
        """Mean and largest jump of one track, by name; of the transitions at which it had a position on both sides."""
        found: dict[str, float] = {}
        for (name, old, new), held in sorted(self._jumps.items()):
            if name == track and held.count:
                found[f"quality.{old}_to_{new}_mean_jump_m"] = held.total_m / held.count
                found[f"quality.{old}_to_{new}_max_jump_m"] = held.largest_m
        return found


class _Jumps:
    def __init__(self) -> None:
        self.count, self.total_m, self.largest_m = 0, 0.0, 0.0

    def add(self, jump_m: float) -> None:
        if math.isfinite(jump_m):
            self.count += 1
            self.total_m += jump_m
            self.largest_m = max(self.largest_m, jump_m)


def jumps(track: Track, at: IntArray) -> FloatArray:
    """Jump of a track (T,) at the steps that end in the rows ``at`` (N,), each at least 1; NaN where not known.

    The way in the plane between what the velocity before the step, told or else of the step before it, lets expect and
    where the track went.
    """
    dt = (track.t_ns[at] - track.t_ns[at - 1]) / NS_PER_S
    place = np.column_stack([track.east_m, track.north_m])
    told = track.speed_m_s[:, np.newaxis] * np.column_stack([np.cos(track.course_rad), np.sin(track.course_rad)])
    before = np.maximum(at - 2, 0)
    earlier_dt = (track.t_ns[at - 1] - track.t_ns[before]) / NS_PER_S
    earlier = (place[at - 1] - place[before]) / np.where(earlier_dt > 0.0, earlier_dt, math.nan)[:, np.newaxis]
    velocity = np.where(np.isfinite(told[at - 1]), told[at - 1], earlier)
    left = place[at] - place[at - 1] - velocity * dt[:, np.newaxis]
    return np.hypot(left[:, 0], left[:, 1])


def _differs(first: FloatArray, second: FloatArray) -> BoolArray:
    differs: BoolArray = (first != second) & ~(np.isnan(first) & np.isnan(second))
    return differs
