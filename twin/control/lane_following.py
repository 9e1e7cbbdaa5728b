"""Our driver of a lane: by an estimate of offset and heading, only as fast and as far as that can be relied on.

Steering is the path driver's feedback (:mod:`twin.control.path_following`): the curvature -w^2 e - 2 w sin(psi) makes
e'' + 2 w e' + w^2 e = 0 in distance, critically damped. With a delay of D metres the open loop (2 w s + w^2) / s^2
crosses one at 2.06 w, where its phase margin is 76 degrees; so it is stable for w D < 0.65 and calm below half of that.

The speed falls in proportion as the sigma of the offset grows beyond ``slow_sigma_m``, down to ``slowest_share``; at
``stop_sigma_m`` the machine stops: it could be anywhere then. It also slows to that share when the rows are not seen,
and stops when it has gone ``blind_m`` without them; they count as seen again after ``sure_s`` without a break. Both
ways it says why by the name of its state.
"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from twin.config import NonNegative, Positive
from twin.control.hearing import TRUTH
from twin.control.lane_keeping import (
    STANDING,
    STOPPED_AT_END,
    STOPPED_AT_SIGN,
    LaneDriver,
    LaneDriverConfig,
)
from twin.signals import LANE_HEADING, LANE_OFFSET, NS_PER_S, ROWS_SEEN, Knowledge, Said

DRIVING = "driving"
SLOW_BLIND = "slow: rows not seen"
SLOW_UNSURE = "slow: offset not sure"
STOPPED_BLIND = "stopped: rows lost"
STOPPED_UNSURE = "stopped: offset not sure"
_LARGEST_OFFSET_M = 3.0
_SILENT_S = 0.5


class LaneFollowingConfig(LaneDriverConfig):
    """Options of :class:`LaneFollowing`."""

    states: ClassVar = (
        STANDING,
        DRIVING,
        SLOW_BLIND,
        SLOW_UNSURE,
        STOPPED_BLIND,
        STOPPED_UNSURE,
        STOPPED_AT_SIGN,
        STOPPED_AT_END,
    )
    steers_by: ClassVar = (LANE_OFFSET, LANE_HEADING, ROWS_SEEN)

    kind: Literal["lane_following"]
    steering_bandwidth_1_m: Annotated[float, Field(gt=0.0, le=20.0)] = 1.5
    """Bandwidth w of the steering feedback, per metre driven."""
    largest_rate_deg_s: Annotated[float, Field(gt=0.0, le=360.0)] = 60.0
    """Yaw rate that is asked for at most."""
    blind_m: NonNegative = 1.0
    """How far it may go on without seeing the rows."""
    sure_s: NonNegative = 1.0
    """How long the rows have to be seen again to be trusted."""
    slowest_share: Annotated[float, Field(gt=0.0, le=1.0)] = 0.5
    """Of the speed, when it is slow."""
    slow_sigma_m: Positive = 0.06
    """Sigma of the offset beyond which it is slower."""
    stop_sigma_m: Positive = 0.12
    """Sigma of the offset at which it stops."""

    @model_validator(mode="after")
    def _sigmas_in_order(self) -> Self:
        if self.slow_sigma_m >= self.stop_sigma_m:
            raise ValueError(f"slow_sigma_m = {self.slow_sigma_m:g} must be less than stop_sigma_m")
        return self


class LaneFollowing(LaneDriver):
    """Driver of :class:`LaneFollowingConfig`."""

    def __init__(self, config: LaneFollowingConfig, *, start_e_n_heading: tuple[float, float, float]) -> None:
        super().__init__(config, start_e_n_heading=start_e_n_heading)
        self._config = config
        self._blind_m = 0.0
        self._seen_s = math.inf

    def steer(self, knowledge: Knowledge, interval_s: float) -> tuple[str, float, float]:
        """Return the state to be in, the speed wanted (m/s) and the yaw rate (rad/s)."""
        config = self._config
        said = self.followed(knowledge)
        if said is None or (self._waits and said.values.get(ROWS_SEEN, 1.0) == 0.0):
            return STANDING, 0.0, 0.0
        seen = said.values.get(ROWS_SEEN, 1.0) > 0.0
        silent = knowledge.t_ns - said.t_ns > _SILENT_S * NS_PER_S
        self._seen_s = self._seen_s + interval_s if seen and not silent else 0.0
        self._blind_m = 0.0 if self._seen_s >= config.sure_s else self._blind_m + self.speed_m_s * interval_s
        state, share = self._judge(
            said.values.get(f"{LANE_OFFSET}.sigma", 0.0 if config.follows == TRUTH else math.nan)
        )
        return state, share * config.speed_m_s, self._rate(said)

    @property
    def _waits(self) -> bool:
        """Whether it has not begun yet: it does not set out without having seen the rows."""
        return self.state == STANDING

    def _judge(self, sigma_m: float) -> tuple[str, float]:
        """State, and the share of the speed that is right in it."""
        config = self._config
        blind = self._seen_s < config.sure_s
        if not sigma_m < config.stop_sigma_m:  # not a number is no assurance
            return (STOPPED_BLIND if blind else STOPPED_UNSURE), 0.0
        unsure = (sigma_m - config.slow_sigma_m) / (config.stop_sigma_m - config.slow_sigma_m)
        share = 1.0 - max(0.0, unsure) * (1.0 - config.slowest_share)
        if blind:
            if self._blind_m >= config.blind_m:
                return STOPPED_BLIND, 0.0
            return SLOW_BLIND, min(share, config.slowest_share)
        return (SLOW_UNSURE, share) if unsure > 0.0 else (DRIVING, 1.0)

    def _rate(self, said: Said) -> float:
        """Yaw rate for the speed driven now, rad/s."""
        w = self._config.steering_bandwidth_1_m
        offset, heading = said.values[LANE_OFFSET], said.values[LANE_HEADING]
        if math.isnan(offset) or math.isnan(heading):
            return 0.0
        offset = min(max(offset, -_LARGEST_OFFSET_M), _LARGEST_OFFSET_M)
        curvature = -w * w * offset - 2.0 * w * math.sin(heading)
        largest = math.radians(self._config.largest_rate_deg_s)
        return min(max(self.speed_m_s * curvature, -largest), largest)
