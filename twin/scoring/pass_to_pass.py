"""Pass-to-pass error: how much the spacing of neighbouring passes is wrong, which is what shows as overlap and skips.

The passes are the parallel straights of a path driver (:func:`twin.control.planned_legs.parallel_passes`). They lie
along one A-B line, that of the first; e is an error across it, in its fixed left normal whichever way a pass is driven,
so that what is wrong alike in both directions (a bias of the receiver) cancels. At every whole metre along the line,
e_i and e_j of all pairs of passes that came there within 15 minutes of one another, 0 < |t_i - t_j| <= 900 s, give |e_i
- e_j| (the window after ISO 12188, as EGNOS user support quotes it): of these the median, the root mean square and the
95th percentile are told. The error of an estimate is that of its position, taken where the machine truly was; that of
the machine is its offset from its planned line.

The same e, of all passes together, tells how a track lies beside the lines: its mean (a constant offset, which a
cross-track error counts to the left one way and to the right the other), its standard deviation and largest deviation
about that mean, and its span from end to end: what a trial can tell that has lines but no place in the world
(paper 003).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.control.planned_legs import PlannedLeg, parallel_passes
from twin.scenario import Scenario
from twin.signals import NS_PER_S, FloatArray, IntArray

_BETWEEN = ("pass_to_pass.median_m", "pass_to_pass.rms_m", "pass_to_pass.p95_m")
_BESIDE = ("line.mean_error_m", "line.abs_mean_error_m", "line.sd_error_m", "line.max_abs_deviation_m", "line.span_m")
NAMES = (*_BETWEEN, *_BESIDE)
LONGEST_NS = 900 * NS_PER_S
_STEP_M = 1.0
_NOT_YET = -1


class PlannedPasses:
    """The parallel passes of a scenario, along their A-B line."""

    def __init__(self, legs: Sequence[PlannedLeg]) -> None:
        self.legs = parallel_passes(legs)
        first = self.legs[0] if self.legs else None
        self._along: FloatArray = np.array([1.0, 0.0]) if first is None else first.direction
        self.normal: FloatArray = np.array([-self._along[1], self._along[0]])
        """Unit vector (2,) to the left of the line."""
        self._origin: FloatArray = np.zeros(2) if first is None else np.array([first.east_m, first.north_m])
        self._numbers: IntArray = np.full(max((leg.index for leg in legs), default=0) + 2, -1)
        for number, leg in enumerate(self.legs):
            self._numbers[leg.index] = number

    def __len__(self) -> int:
        return len(self.legs)

    def numbers(self, segments: FloatArray) -> IntArray:
        """Which pass a machine is at, (T,), by the truth's ``segment``; -1 if it is at none."""
        return self._numbers[np.minimum(segments.astype(np.int64), len(self._numbers) - 1)]

    def stations(self, points_m: FloatArray) -> FloatArray:
        """Distance of points (..., 2) along the line, m."""
        return (points_m - self._origin) @ self._along

    def reach(self, number: int) -> tuple[int, int]:
        """First and last whole step of the line beside which a pass runs; the last is before the first if none is."""
        leg = self.legs[number]
        begin = np.array([leg.east_m, leg.north_m])
        ends = self.stations(np.stack([begin, begin + leg.length_m * leg.direction])) / _STEP_M
        return int(np.ceil(ends.min() - 1e-6)), int(np.floor(ends.max() + 1e-6))

    def off_the_lines(self, points_m: FloatArray, numbers: IntArray) -> FloatArray:
        """Offset of points (T, 2) from the planned line of their pass, in the fixed normal, m; NaN off the passes."""
        offset = np.full(len(points_m), np.nan)
        for number, leg in enumerate(self.legs):
            here = numbers == number
            offset[here] = np.copysign(1.0, leg.direction @ self._along) * leg.project(points_m[here])[1]
        return offset


def has_passes(scenario: Scenario) -> bool:
    """Whether there are passes to be compared."""
    return len(parallel_passes(scenario.planned_legs)) > 1


class PassToPass:
    """Differences between passes of errors that are fed in pieces, for R runs side by side."""

    def __init__(self, passes: PlannedPasses, runs: int) -> None:
        self._passes = passes
        self._first = [passes.reach(number)[0] for number in range(len(passes))]
        counts = [max(0, last - first + 1) for first, last in map(passes.reach, range(len(passes)))]
        self._errors: list[FloatArray] = [np.full((count, runs), np.nan) for count in counts]
        self._times: list[IntArray] = [np.full(count, _NOT_YET, dtype=np.int64) for count in counts]
        self._last: tuple[IntArray, IntArray, FloatArray, FloatArray] | None = None

    def add(self, t_ns: IntArray, numbers: IntArray, stations_m: FloatArray, errors_m: FloatArray) -> None:
        """Take the next piece: times, numbers of passes and stations (T,), errors across the line (T, R)."""
        if not len(t_ns):
            return
        new = t_ns, numbers, stations_m, errors_m
        if self._last is not None:
            new = tuple(np.concatenate(pair) for pair in zip(self._last, new, strict=True))  # type: ignore[assignment]
        self._last = new[0][-1:], new[1][-1:], new[2][-1:].copy(), new[3][-1:].copy()
        t_ns, numbers, stations_m, errors_m = new
        for number in np.unique(numbers[numbers >= 0]).tolist():
            here = (numbers[1:] == number) & (numbers[:-1] == number)
            self._note(number, np.flatnonzero(here), t_ns, stations_m / _STEP_M, errors_m)

    def _note(self, number: int, rows: IntArray, t_ns: IntArray, stations: FloatArray, errors_m: FloatArray) -> None:
        """Interpolate at the whole steps between each of these rows and the next; who came first stays."""
        begin, end = stations[rows], stations[rows + 1]
        low = np.ceil(np.minimum(begin, end)).astype(np.int64)
        passed = np.floor(np.maximum(begin, end)).astype(np.int64) - low + 1
        times, errors = self._times[number], self._errors[number]
        for extra in range(int(passed.max(initial=0))):
            step = low + extra
            at = step - self._first[number]
            found = np.flatnonzero((extra < passed) & (begin != end) & (at >= 0) & (at < len(times)))
            found = found[np.unique(at[found], return_index=True)[1]]
            found = found[times[at[found]] == _NOT_YET]
            row, place = rows[found], at[found]
            share = (step[found] - begin[found]) / (end[found] - begin[found])
            times[place] = t_ns[row] + np.round(share * (t_ns[row + 1] - t_ns[row])).astype(np.int64)
            errors[place] = errors_m[row] + share[:, np.newaxis] * (errors_m[row + 1] - errors_m[row])

    def metrics(self) -> dict[str, FloatArray]:
        """Figures by :data:`NAMES`, each (R,); NaN where no two passes could be compared, or an error is unknown."""
        found = self._differences()
        unknown = np.full(found.shape[1], np.nan)
        between = (unknown,) * len(_BETWEEN)
        if len(found):
            between = np.median(found, axis=0), np.sqrt(np.mean(found**2, axis=0)), np.quantile(found, 0.95, axis=0)
        here = np.concatenate([e[t != _NOT_YET] for e, t in zip(self._errors, self._times, strict=True)])
        beside = (unknown,) * len(_BESIDE)
        if len(here):
            mean = here.mean(axis=0)
            beside = mean, np.abs(mean), here.std(axis=0), np.abs(here - mean).max(axis=0), np.ptp(here, axis=0)
        return dict(zip(NAMES, (*between, *beside), strict=True))

    def _differences(self) -> FloatArray:
        """|e_i - e_j| of all pairs at all stations, (pairs, R)."""
        found = [self._errors[0][:0]]
        for one in range(len(self._passes)):
            for other in range(one + 1, len(self._passes)):
                begin = max(self._first[one], self._first[other])
                end = min(self._first[each] + len(self._times[each]) for each in (one, other))
                if begin < end:
                    found.append(self._differences_of(one, other, begin, end))
        return np.concatenate(found)

    def _differences_of(self, one: int, other: int, begin: int, end: int) -> FloatArray:
        """|e_i - e_j| of two passes at those stations from ``begin`` until before ``end`` that count, (stations, R)."""
        here, there = (slice(begin - self._first[each], end - self._first[each]) for each in (one, other))
        t_i, t_j = self._times[one][here], self._times[other][there]
        apart = np.abs(t_i - t_j)
        paired = (t_i != _NOT_YET) & (t_j != _NOT_YET) & (apart > 0) & (apart <= LONGEST_NS)
        differences: FloatArray = self._errors[one][here][paired] - self._errors[other][there][paired]
        return np.abs(differences)
