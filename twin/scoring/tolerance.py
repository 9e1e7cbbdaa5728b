"""An estimator's errors against the tolerance of its family: honesty everywhere, re-acquisition after a loss."""

from __future__ import annotations

import numpy as np

from twin.families import Family
from twin.scenario import Scenario
from twin.scoring.honesty import Honesty, HonestyTally
from twin.scoring.reacquisition import FirstFixes, Reacquisition
from twin.signals import FloatArray, IntArray


def reacquisition_figures(family: Family) -> tuple[str, str]:
    """Names of the jump and of the recovery."""
    return family.jump, family.recovery


class ToleranceScorer:
    """What is measured of one estimator against the tolerance of its family, fed in pieces."""

    def __init__(self, scenario: Scenario, family: Family, fixes: FirstFixes | None) -> None:
        """Without ``fixes`` nothing is measured at re-acquisition."""
        assert family.tolerance is not None
        self.column = family.column
        self._family = family
        self._honesty = HonestyTally(scenario, family)
        self._reacquisition = Reacquisition(family.tolerance, fixes) if fixes is not None else None

    def add(self, t_ns: IntArray, errors: FloatArray, sigmas: FloatArray) -> None:
        """Take a piece: times (T,), errors and claimed sigmas (T, R) in the column's unit."""
        errors, sigmas = self._family.factor * errors, self._family.factor * sigmas
        self._honesty.add(t_ns, np.abs(errors), sigmas)
        if self._reacquisition is not None:
            self._reacquisition.add(t_ns, errors, sigmas)

    def metrics(self) -> dict[str, FloatArray]:
        """Jump and recovery, each of shape (R,), where they are measured."""
        if self._reacquisition is None:
            return {}
        values = self._reacquisition.jump(), self._reacquisition.recovery_s()
        return dict(zip(reacquisition_figures(self._family), values, strict=True))

    def honesty(self) -> Honesty:
        """What was counted of all members."""
        if self._reacquisition is None:
            return self._honesty.counted()
        return self._honesty.counted(self._reacquisition.claims, self._reacquisition.recovery_s())
