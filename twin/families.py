"""Families of errors: what of an estimate is compared with the truth, in which unit, and what is told of it first.

A family is stated once, here. From it follow its metrics, named ``<family>.<figure>{phase}_<unit>``, what
``scoring.limits`` may time, the headline figures of tables, and by what the worst member of an ensemble is found. A
family of one column is one entry; one whose error is made of several (rows, east and north) has a function in
:mod:`twin.scoring.measures` too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from twin.signals import HEADING, HEIGHT, LANE_HEADING, LANE_OFFSET, LEVEL_WITHIN_M, SPEED, YAW_RATE

_LAST = 99
CROSS_TRACK = "cross_track_m"
"""Not a column of any stream: how far left of the driven track an estimate puts the machine, made of the position's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerance:
    """How wrong an estimate may be before the machine does damage by it, in the family's unit.

    A family with a tolerance is watched through a loss (first excess, jump at re-acquisition, recovery) and held to
    the sigma it claims (:mod:`twin.scoring.honesty`).
    """

    error: float
    """An error beyond this does damage."""
    settled_sigma: float
    """An estimator has recovered when the error is within ``error`` and it claims this sigma, or a smaller one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """One kind of error."""

    name: str
    unit: str
    """Suffix of its metrics."""
    factor: float = 1.0
    """From the column's unit (SI, rad) to ``unit``."""
    column: str = ""
    """What is compared; empty where the error is made of several columns."""
    title: str = ""
    """Of the plot of its errors over time in a stress test, with the unit in brackets; none is drawn without."""
    figures: tuple[str, ...] = ()
    """Figures of a family of one column, in the order of its metrics."""
    shown: tuple[str, ...] = ()
    """Figures that the table of a run shows."""
    shown_of_many: tuple[str, ...] = ()
    """Figures that the table of a stress test shows, in the loss if there is one."""
    worst: str = ""
    """Figure that finds the worst members."""
    worst_rank: int = _LAST
    """Of an estimator's families the one with the smallest rank finds its worst members; of equals the first."""
    summary: tuple[str, ...] = ()
    """Figures that may sum up an estimator in a line; the first that it has does."""
    summary_rank: int = _LAST
    """Of an estimator's families the one with the smallest rank sums it up; of equals the first."""
    may_be_limited: bool = False
    """Whether ``scoring.limits`` may name it."""
    tolerance: Tolerance | None = None

    def metric(self, figure: str, phase: str = "{phase}") -> str:
        """Name of a metric: of a figure and a phase's suffix (by default the place where it goes)."""
        return f"{self.name}.{figure}{phase}_{self.unit}"

    @property
    def time_to_limit(self) -> str:
        """Metric of the first excess of a scenario's limit since a loss."""
        return f"{self.name}.time_to_limit_s"

    @property
    def time_to_tolerance(self) -> str:
        """Metric of the first excess of the tolerance since a loss; metres are told in mm, without a point."""
        assert self.tolerance is not None
        error, unit = self.tolerance.error, self.unit
        told = f"{1000.0 * error:g}mm" if unit == "m" else f"{error:g}{unit}"
        return f"{self.name}.time_to_{told}_s"

    @property
    def jump(self) -> str:
        """Metric of the largest change of the error from one epoch to the next at re-acquisition."""
        return f"{self.name}.jump_at_reacquisition_{self.unit}"

    @property
    def recovery(self) -> str:
        """Metric of the time from the first true fix after a loss until the estimator has recovered."""
        return f"{self.name}.recovery_s"


_SIZES = ("mean_abs_error", "max_abs_error")
_DEGREES = math.degrees(1.0)

FAMILIES: tuple[Family, ...] = (
    Family(
        name="row_speed",
        unit="m_s",
        title="Largest row-speed error [m/s]",
        shown=("mean_abs_error", "mean_abs_error_turns"),
        shown_of_many=_SIZES,
        worst="max_abs_error",
        worst_rank=2,
        summary=("mean_abs_error_turns", "mean_abs_error"),
        summary_rank=0,
        may_be_limited=True,
    ),
    Family(
        name="row_position",
        unit="m",
        title="Largest row-position error [m]",
        shown_of_many=("max_error",),
        worst="max_error",
        worst_rank=0,
        may_be_limited=True,
    ),
    Family(
        name="position",
        unit="m",
        title="Horizontal position error [m]",
        shown=("rmse",),
        shown_of_many=("max_error",),
        worst="max_error",
        worst_rank=1,
        summary=("rmse",),
        summary_rank=2,
        may_be_limited=True,
    ),
    Family(
        name="heading",
        unit="deg",
        factor=_DEGREES,
        column=HEADING,
        title="Heading error [deg]",
        figures=_SIZES,
        shown=("mean_abs_error",),
        summary=("mean_abs_error",),
        summary_rank=3,
    ),
    Family(name="lane_offset", unit="m", column=LANE_OFFSET, figures=_SIZES),
    Family(name="lane_heading", unit="deg", factor=_DEGREES, column=LANE_HEADING, figures=_SIZES),
    Family(
        name="speed", unit="m_s", column=SPEED, figures=_SIZES, summary=("mean_abs_error",), summary_rank=1
    ),
    Family(name="yaw_rate", unit="rad_s", column=YAW_RATE, figures=_SIZES),
    # Levelling is judged by 30 mm (TD/T 1033-2012, as paper 002 does). Settled is half of that: 95 % within 30 mm.
    Family(
        name="height",
        unit="mm",
        factor=1000.0,
        column=HEIGHT,
        figures=("rmse", "max_abs_error", "mean_error", "p95_abs_error"),
        shown=("rmse", "max_abs_error", "rmse_loss", "max_abs_error_loss"),
        shown_of_many=("rmse", "max_abs_error"),
        worst="max_abs_error",
        summary=("rmse_loss", "rmse"),
        may_be_limited=True,
        tolerance=Tolerance(error=1000.0 * LEVEL_WITHIN_M, settled_sigma=500.0 * LEVEL_WITHIN_M),
    ),
    # Guidance is judged by 0.1 m across the track: a choice, twice the standard deviation (4 to 6 cm) of a tractor
    # guided by RTK (Bell, Comput. Electron. Agric. 25:53). Settled is half of that: 95 % within 0.1 m. Only judged
    # where a scenario is about guidance. After the height, which is what a machine that gives both is about.
    Family(
        name="cross_track",
        unit="m",
        column=CROSS_TRACK,
        title="Cross-track error [m]",
        figures=("mean_error", "rmse", "p95_abs_error", "max_abs_error"),
        shown=("mean_error_straights", "rmse_straights", "max_abs_error_straights"),
        shown_of_many=("rmse", "max_abs_error"),
        worst="max_abs_error",
        worst_rank=0,
        summary=("rmse_straights",),
        summary_rank=0,
        may_be_limited=True,
        tolerance=Tolerance(error=0.10, settled_sigma=0.05),
    ),
)  # fmt: skip


def family_named(name: str) -> Family:
    """The family of this name.

    Raises:
        KeyError: there is none.
    """
    return _BY_NAME[name]


_BY_NAME = {each.name: each for each in FAMILIES}
LIMITED = tuple(each.name for each in FAMILIES if each.may_be_limited)
"""Families that ``scoring.limits`` may name."""


def tolerated(columns: Sequence[str]) -> Family | None:
    """The first family with a tolerance among these columns that are compared; None without any."""
    return next((each for each in FAMILIES if each.tolerance is not None and each.column in columns), None)
