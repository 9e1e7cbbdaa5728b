"""Pieces of tracks: where something was said to be, how fast and whereto, row by row; how smooth a track is.

A receiver that jumps between two solutions, or a filter that is pulled about by it, shows in its track alone: in
accelerations and jerks that no machine makes, and in steps that are longer than speed and time explain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from twin.recording import Stream
from twin.signals import HEADING, NS_PER_S, POSITION, SPEED, BoolArray, FloatArray, IntArray

_COURSES = ("course_rad", HEADING)
_MEMORY = 3
"""Rows of the piece before that a third difference needs."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Track:
    """Rows (T,) in time; what is not known is NaN."""

    t_ns: IntArray
    east_m: FloatArray
    north_m: FloatArray
    speed_m_s: FloatArray
    course_rad: FloatArray

    @classmethod
    def of(cls, stream: Stream) -> Track:
        """Track of a stream (R = 1) of positions: of a receiver (with its course) or an estimator (with its heading).

        A sample that was lost has no position.
        """
        lost = np.full(len(stream), math.nan)
        valid = np.ones(len(stream), dtype=np.bool_) if stream.valid is None else stream.valid[:, 0]

        def column(*names: str) -> FloatArray:
            name = next((name for name in names if stream.has(name)), None)
            return lost if name is None else np.where(valid, stream.column(name)[:, 0], math.nan)

        return cls(
            t_ns=stream.t_ns,
            east_m=column(POSITION[0]),
            north_m=column(POSITION[1]),
            speed_m_s=column(SPEED),
            course_rad=column(*_COURSES),
        )

    @property
    def known(self) -> BoolArray:
        """Rows with a position."""
        return np.isfinite(self.east_m) & np.isfinite(self.north_m)

    def __len__(self) -> int:
        return len(self.t_ns)

    def rows(self, which: IntArray | BoolArray | slice) -> Track:
        """Some of the rows."""
        return Track(
            t_ns=self.t_ns[which],
            east_m=self.east_m[which],
            north_m=self.north_m[which],
            speed_m_s=self.speed_m_s[which],
            course_rad=self.course_rad[which],
        )

    def behind(self, before: Track | None) -> Track:
        """This track with another one's rows before it."""
        if before is None or not len(before):
            return self
        return Track(
            t_ns=np.concatenate([before.t_ns, self.t_ns]),
            east_m=np.concatenate([before.east_m, self.east_m]),
            north_m=np.concatenate([before.north_m, self.north_m]),
            speed_m_s=np.concatenate([before.speed_m_s, self.speed_m_s]),
            course_rad=np.concatenate([before.course_rad, self.course_rad]),
        )


class SmoothnessTally:
    """How smooth a track is, fed in pieces; nothing is said across gaps longer than ``longest_gap_s``.

    ``smoothness.rms_acceleration_m_s2`` and ``smoothness.rms_jerk_m_s3``: of second and third differences of the
    position; ``smoothness.largest_step_beyond_m``: the longest step between neighbours, less the way that the speed
    told at both ends makes in that time.
    """

    def __init__(self, longest_gap_s: float) -> None:
        self._gap_s = longest_gap_s
        self._before: Track | None = None
        self._accelerations, self._jerks = _MeanSquare(), _MeanSquare()
        self._beyond_m = math.nan

    def add(self, track: Track) -> None:
        """Take a piece."""
        begin = -1 if self._before is None or not len(self._before) else int(self._before.t_ns[-1])
        track = track.rows(track.known)
        highest = np.maximum.accumulate(np.concatenate([[begin], track.t_ns]))
        track = track.rows(track.t_ns > highest[:-1])  # a repeated or older row is no step
        kept = 0 if self._before is None else len(self._before)
        track = track.behind(self._before)
        self._before = track.rows(slice(-_MEMORY, None))
        if len(track) < 2:
            return
        dt = np.diff(track.t_ns) / NS_PER_S
        near = dt <= self._gap_s
        steps = np.column_stack([np.diff(track.east_m), np.diff(track.north_m)])
        new = np.arange(1, len(track)) >= kept  # steps that end in a new row
        self._take_steps(np.hypot(steps[:, 0], steps[:, 1]), dt, track.speed_m_s, near & new)
        velocity = steps / dt[:, np.newaxis]
        between = 0.5 * (dt[1:] + dt[:-1])
        acceleration = np.diff(velocity, axis=0) / between[:, np.newaxis]
        both = near[1:] & near[:-1]
        self._accelerations.add(acceleration[both & new[1:]])
        jerk = np.diff(acceleration, axis=0) / (0.5 * (between[1:] + between[:-1]))[:, np.newaxis]
        self._jerks.add(jerk[both[1:] & both[:-1] & new[2:]])

    def _take_steps(self, steps: FloatArray, dt: FloatArray, speed: FloatArray, wanted: BoolArray) -> None:
        beyond = (steps - 0.5 * (speed[1:] + speed[:-1]) * dt)[wanted]
        beyond = beyond[np.isfinite(beyond)]
        if len(beyond):
            self._beyond_m = float(np.fmax(self._beyond_m, beyond.max()))

    def figures(self) -> dict[str, float]:
        """Metrics by name."""
        return {
            "smoothness.rms_acceleration_m_s2": self._accelerations.root,
            "smoothness.rms_jerk_m_s3": self._jerks.root,
            "smoothness.largest_step_beyond_m": self._beyond_m,
        }


class _MeanSquare:
    """Root of the mean squared length of vectors (T, 2)."""

    def __init__(self) -> None:
        self._sum, self._count = 0.0, 0

    def add(self, vectors: FloatArray) -> None:
        self._sum += float((vectors**2).sum())
        self._count += len(vectors)

    @property
    def root(self) -> float:
        return math.sqrt(self._sum / self._count) if self._count else math.nan
