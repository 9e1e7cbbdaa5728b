"""What a GNSS receiver has to offer of the height through a loss, as its configuration and its faults say.

For the bound of :mod:`twin.scoring.height_bound`: without what differs from run to run (lost sets of corrections,
times of acquisition), and with what a filter that knows everything makes of faults: wrong and stuck heights are not
used, late samples are as good as any.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from twin.fix_quality import RTK_FIXED
from twin.sensors.faults import OutageFault, StuckFault
from twin.sensors.gnss_config import GnssConfig
from twin.sensors.gnss_faults import (
    CorrectionsLostFault,
    CorrectionsOldFault,
    SatellitesMaskedFault,
    WrongFixFault,
)
from twin.sensors.gnss_outputs import VERTICAL_SPEED
from twin.sensors.gnss_states import OPEN_SKY, FixState, dilution

_UP = 2
_HEIGHT = "position_u_m"


@dataclass(frozen=True, slots=True, kw_only=True)
class Fixes:
    """Height of an RTK fix, 1 sigma."""

    correlated_m: float
    correlation_s: float
    white_m: float
    age_drift_m_s: float = 0.0
    age_drift_correlation_s: float = 100.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Lesser:
    """Height in a lesser state, 1 sigma."""

    name: str
    correlated_m: float
    correlation_s: float
    white_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """What one sample of the receiver offers."""

    fix_age_s: float | None = None
    """Age of the corrections of a fix; None without a fix."""
    lesser: Lesser | None = None
    """A height that is no fix."""
    speed: bool = True
    """Whether there is a vertical speed."""
    dilution: float = 1.0
    """Factor on all errors but the drift with age, of few satellites in view."""


class Supply:
    """A receiver through the loss that begins at ``begin_s`` of the run."""

    def __init__(self, config: GnssConfig, fix: FixState, *, begin_s: float) -> None:
        self.fixes = Fixes(
            correlated_m=fix.correlated_sigma_m[_UP],
            correlation_s=fix.correlation_s[_UP],
            white_m=fix.white_sigma_m[_UP],
            age_drift_m_s=fix.age_drift_m_s[_UP],
            age_drift_correlation_s=config.age_drift_correlation_s,
        )
        self._config, self._begin_s = config, begin_s
        self._names = list(config.states)
        self._place, self._entered_s, self._entry = self._names.index(config.state or self._names[0]), 0.0, 1.0

    def at(self, since_s: float) -> Seen:
        """What is seen so long after the begin; times have to be asked for in order."""
        t_s = self._begin_s + since_s
        faults = [each for each in self._config.faults if each.inside is None and each.near is None]
        open_now = [
            fault
            for fault in faults
            if since_s >= 0.0 and fault.from_s <= t_s and (fault.to_s is None or t_s < fault.to_s)
        ]
        satellites = min(
            (fault.satellites for fault in open_now if isinstance(fault, SatellitesMaskedFault)), default=OPEN_SKY
        )
        age_s = self._age_s(t_s, [fault.from_s for fault in open_now if _stops_corrections(fault)])
        place = self._place_of(age_s, satellites)
        self._enter(place, since_s)
        if place == len(self._names):
            return Seen(speed=False)
        state = self._config.states[self._names[place]]
        common = Seen(
            speed=not any(_silences(fault, VERTICAL_SPEED) for fault in open_now),
            dilution=float(dilution([state], satellites)[0]),
        )
        if any(_silences(fault, _HEIGHT) or isinstance(fault, WrongFixFault) for fault in open_now):
            return common
        if state.quality == RTK_FIXED:
            return replace(common, fix_age_s=age_s)
        return replace(common, lesser=self._lesser(self._names[place], state, since_s))

    def _age_s(self, t_s: float, stopped_s: Sequence[float]) -> float:
        interval = self._config.corrections_interval_s
        if interval is None:
            return 0.0
        heard_s = min([t_s, *stopped_s]) - self._config.corrections_delay_s
        return t_s - math.floor(heard_s / interval + 1e-9) * interval

    def _place_of(self, age_s: float, satellites: int) -> int:
        """Place on the ladder of the best state whose conditions hold; the way down takes no time."""
        if self._config.state is not None:
            return self._names.index(self._config.state)
        for place, state in enumerate(self._config.states.values()):
            fresh = state.until_age_s is None or age_s < state.until_age_s
            if fresh and satellites >= state.satellites_needed:
                return place
        return len(self._names)

    def _enter(self, place: int, since_s: float) -> None:
        """Note when a state is entered, and with which part of its error: all of it on the way up."""
        if place != self._place:
            from_better = self._place < place < len(self._names)
            self._entry = self._config.states[self._names[place]].entry_ratio if from_better else 1.0
            self._place, self._entered_s = place, since_s

    def _lesser(self, name: str, state: FixState, since_s: float) -> Lesser:
        grown = 1.0 - (1.0 - self._entry) * math.exp(-(since_s - self._entered_s) / state.growth_s)
        return Lesser(
            name=name,
            correlated_m=state.correlated_sigma_m[_UP] * grown,
            correlation_s=state.correlation_s[_UP],
            white_m=state.white_sigma_m[_UP],
        )


def supply_of(config: GnssConfig, *, begin_s: float) -> Supply | None:
    """The receiver's supply; None if it cannot fix."""
    fixes = [state for state in config.states.values() if state.quality == RTK_FIXED]
    if not fixes or config.usual_state is not fixes[0]:
        return None
    return Supply(config, fixes[0], begin_s=begin_s)


def _silences(fault: object, column: str) -> bool:
    if isinstance(fault, OutageFault):
        return True
    return isinstance(fault, StuckFault) and (not fault.columns or column in fault.columns)


def _stops_corrections(fault: object) -> bool:
    return isinstance(fault, CorrectionsLostFault) or (isinstance(fault, CorrectionsOldFault) and fault.growth == 1.0)
