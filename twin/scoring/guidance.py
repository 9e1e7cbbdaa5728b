"""What guidance along lines is judged by: of an estimator, and of the machine.

Of an estimator of a position: cross-track errors (:mod:`twin.scoring.cross_track`), pass-to-pass errors
(:mod:`twin.scoring.pass_to_pass`), steps (:mod:`twin.scoring.steps`), where a scenario judges guidance; and its
deviation at the places that a scenario names (:mod:`twin.scoring.places`).

Of the machine, in a scenario that judges guidance and has a path driver: ``truth.cross_track.*`` is the offset of its
rear axle from the planned line or arc of the segment that its driver is at, positive to the left, while it is
beside it (between its ends); standing and spinning do not count. *Straights* and *turns* are segments here, not yaw
rates: the end of a turn that is driven on the next straight is an error on that straight. ``truth.pass_to_pass.*`` is
made of the reference point's offsets from the planned lines, and ``truth.coverage.*`` of what the implement covered
(:mod:`twin.scoring.coverage`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from twin.control.planned_legs import PlannedLeg
from twin.families import CROSS_TRACK, family_named
from twin.recording import Stream
from twin.scenario import Scenario
from twin.scoring import coverage, pass_to_pass, places, steps
from twin.scoring.compared import Compared, as_rows, shared_columns
from twin.scoring.pass_to_pass import PassToPass, PlannedPasses
from twin.scoring.phases import phases
from twin.scoring.places import Places
from twin.scoring.steps import Steps
from twin.signals import POSITION, SPEED, BoolArray, FloatArray, nanoseconds

SEGMENT = "segment"
HEADLINES = ("pass_to_pass.rms_m", "pass_to_pass.p95_m", "coverage.overlap_percent", "coverage.skip_percent")
"""What tables show of an estimator, or of the machine, beside the figures of its families."""
_PLANE = POSITION[:2]
_AXLE = ("vehicle_e_m", "vehicle_n_m")
_FAMILY = family_named("cross_track")


def judged_columns(scenario: Scenario, truth: Sequence[str], estimate: Sequence[str]) -> list[str]:
    """What of an estimate is compared with the truth: columns of that name, and the offset across the track."""
    shared = shared_columns(truth, estimate)
    return [*shared, CROSS_TRACK] if scenario.judges_guidance and set(_PLANE) <= set(shared) else shared


def names(scenario: Scenario, truth: Sequence[str], estimate: Sequence[str]) -> list[str]:
    """Names of :meth:`GuidanceScorer.metrics` of an estimator with these columns."""
    if not set(_PLANE) <= set(shared_columns(truth, estimate)):
        return []
    found: list[str] = []
    if scenario.judges_guidance:
        found += pass_to_pass.NAMES if _has_passes(scenario, truth) else ()
        found += steps.NAMES
    return found + (places.names(scenario.scoring.places) if SEGMENT in truth else [])


def _has_passes(scenario: Scenario, truth: Sequence[str]) -> bool:
    return SEGMENT in truth and pass_to_pass.has_passes(scenario)


class GuidanceScorer:
    """Pass-to-pass errors, steps and deviations at places of one estimator, fed in pieces."""

    def __init__(self, scenario: Scenario, truth: Sequence[str]) -> None:
        self._scenario = scenario
        guided = scenario.judges_guidance
        self._passes = PlannedPasses(scenario.planned_legs) if guided and _has_passes(scenario, truth) else None
        self._between: PassToPass | None = None
        self._steps: Steps | None = None
        self._places: Places | None = None

    def add(self, truth: Stream, estimate: Stream, compared: Compared, straights: BoolArray) -> None:
        """Take the next piece; ``straights`` (T,) tells when the machine does not turn."""
        rows, at = as_rows(compared.at_estimate), as_rows(compared.at_truth)
        points = estimate.select(_PLANE)[rows]
        true = truth.select(_PLANE)[at, 0]
        errors = points - true[:, np.newaxis]
        runs = points.shape[1]
        if self._passes is not None:
            self._between = self._between or PassToPass(self._passes, runs)
            numbers = self._passes.numbers(truth.column(SEGMENT)[at, 0])
            self._between.add(compared.t_ns, numbers, self._passes.stations(true), errors @ self._passes.normal)
        if self._scenario.judges_guidance:
            self._steps = self._steps or Steps(runs)
            moves = np.abs(truth.column(SPEED)[at, 0]) > steps.MOVING_M_S if truth.has(SPEED) else True
            self._steps.add(compared.t_ns, points, straights & moves)
        if self._scenario.scoring.places and truth.has(SEGMENT):
            self._places = self._places or Places(self._scenario, runs)
            self._places.add(truth.column(SEGMENT)[at, 0], errors)

    def metrics(self) -> dict[str, FloatArray]:
        """Figures by :func:`names`, each of shape (R,)."""
        found: dict[str, FloatArray] = {}
        for part in (self._between, self._steps, self._places):
            found |= {} if part is None else part.metrics()
        return found


# --- the machine -----------------------------------------------------------------------------------------------------


def machine_names(scenario: Scenario, truth: Sequence[str]) -> list[str]:
    """Names of :func:`machine_metrics` of a run with these truth columns."""
    if not scenario.planned_legs or not {SEGMENT, *_PLANE} <= set(truth):
        return []
    found: list[str] = []
    if scenario.judges_guidance:
        found += [_FAMILY.metric(figure, phase) for figure in _FAMILY.figures for phase in _phase_names(scenario)]
        found += pass_to_pass.NAMES if _has_passes(scenario, truth) else ()
    found += coverage.names(scenario, truth)
    return [f"truth.{name}" for name in found]


def _phase_names(scenario: Scenario) -> list[str]:
    return ["", "_turns", "_straights", *(["_loss", "_after"] if scenario.loss_window_s is not None else [])]


def machine_metrics(truth: Stream, scenario: Scenario) -> dict[str, FloatArray]:
    """How well the machine kept to its path, and what it covered, each of shape (1,); NaN where there is nothing."""
    wanted = machine_names(scenario, truth.columns)
    if not wanted:
        return {}
    found: dict[str, float] = {}
    if scenario.judges_guidance:
        found |= _cross_track(truth, scenario)
        found |= _between_passes(truth, scenario) if _has_passes(scenario, truth.columns) else {}
    found |= coverage.metrics(truth, scenario)
    return {name: np.array([found[name.removeprefix("truth.")]]) for name in wanted}


def off_the_path(truth: Stream, legs: Sequence[PlannedLeg]) -> FloatArray:
    """Offset of the rear axle to the left of the segment the driver is at, (T,), m; NaN where it is beside none.

    The plan is the rear axle's; of a truth that does not tell it, the reference point's. Exact on straights and arcs.
    """
    axle = all(truth.has(name) for name in _AXLE)
    points, segments = truth.select(_AXLE if axle else _PLANE)[:, 0], truth.column(SEGMENT)[:, 0]
    offset = np.full(len(truth), math.nan)
    for leg in legs:
        here = np.flatnonzero(segments == leg.index)
        if leg.length_m > 0.0 and len(here):
            along, left = leg.project(points[here])
            beside = (along >= 0.0) & (along <= leg.length_m)
            offset[here[beside]] = left[beside]
    return offset


def _cross_track(truth: Stream, scenario: Scenario) -> dict[str, float]:
    legs = scenario.planned_legs
    offset = off_the_path(truth, legs)
    counted = (truth.t_ns >= nanoseconds(scenario.scoring.from_s)) & ~np.isnan(offset)
    bent = np.array([*(leg.is_arc for leg in legs), False])
    turning = bent[np.minimum(truth.column(SEGMENT)[:, 0].astype(np.int64), len(legs))]
    masks: Mapping[str, BoolArray] = {
        **phases(scenario, truth, np.arange(len(truth))),
        "_turns": turning,
        "_straights": ~turning,
    }
    found: dict[str, float] = {}
    for phase in _phase_names(scenario):
        values = offset[counted & masks[phase]]
        figures = _figures(values) if len(values) else [math.nan] * len(_FAMILY.figures)
        found |= {_FAMILY.metric(name, phase): value for name, value in zip(_FAMILY.figures, figures, strict=True)}
    return found


def _figures(values: FloatArray) -> list[float]:
    """Mean, root mean square, 95th percentile and largest size, as the family has them."""
    sizes = np.abs(values)
    rms = math.sqrt(float(np.mean(values**2)))
    return [float(values.mean()), rms, float(np.quantile(sizes, 0.95)), float(sizes.max())]


def _between_passes(truth: Stream, scenario: Scenario) -> dict[str, float]:
    passes = PlannedPasses(scenario.planned_legs)
    counted = np.flatnonzero(truth.t_ns >= nanoseconds(scenario.scoring.from_s))
    points = truth.select(_PLANE)[counted, 0]
    numbers = passes.numbers(truth.column(SEGMENT)[counted, 0])
    between = PassToPass(passes, 1)
    offset = passes.off_the_lines(points, numbers)
    between.add(truth.t_ns[counted], numbers, passes.stations(points), offset[:, np.newaxis])
    return {name: float(value[0]) for name, value in between.metrics().items()}
