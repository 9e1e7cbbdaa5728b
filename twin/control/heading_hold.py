"""Chapter 2's controller of paper 001: three states, by nothing but a heading.

"Turn back": outside ``tolerance_deg`` of the lane's direction the robot stands and rotates itself back to it. "Drive":
inside, it goes straight on, with no yaw rate at all. "Stop": the camera sees the sign. An error within the tolerance is
never corrected, and nothing knows how far from the axis the robot is: at a constant heading error e it leaves the axis
by sin(e) per metre, up to 9 cm per metre at 5 degrees.

The paper's robot rotates "to make the yaw angle zero"; how fast is not said, the rate here is a choice. Ours is told
to stop turning at ``back_to_deg``: its motors' set-points lag by 0.1 s and the estimate comes late, so that at 45
degrees a second it rolls on by 2 to 4 degrees, which ends near zero. Section 2.4 has the robot rotate in one direction
when it sees the sign, chapter 2 has it stop; it stops here.
"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from twin.control.lane_keeping import (
    STANDING,
    STOPPED_AT_END,
    STOPPED_AT_SIGN,
    LaneDriver,
    LaneDriverConfig,
)
from twin.signals import HEADING, Knowledge

DRIVING, TURNING_BACK = "driving", "turning back"


class HeadingHoldConfig(LaneDriverConfig):
    """Options of :class:`HeadingHold`."""

    states: ClassVar = (STANDING, DRIVING, TURNING_BACK, STOPPED_AT_SIGN, STOPPED_AT_END)
    steers_by: ClassVar = (HEADING,)

    kind: Literal["heading_hold"]
    tolerance_deg: Annotated[float, Field(gt=0.0, le=90.0)] = 5.0
    """Heading error beyond which the robot turns back."""
    back_to_deg: Annotated[float, Field(gt=0.0, le=90.0)] = 2.5
    """Heading error at which it has turned back far enough."""
    turn_rate_deg_s: Annotated[float, Field(gt=0.0, le=360.0)] = 45.0
    """Rate of turning back, on the spot."""


class HeadingHold(LaneDriver):
    """Driver of :class:`HeadingHoldConfig`."""

    def __init__(self, config: HeadingHoldConfig, *, start_e_n_heading: tuple[float, float, float]) -> None:
        super().__init__(config, start_e_n_heading=start_e_n_heading)
        self._config = config

    def steer(self, knowledge: Knowledge, interval_s: float) -> tuple[str, float, float]:  # noqa: ARG002
        """Return the state to be in, the speed wanted (m/s) and the yaw rate (rad/s)."""
        config = self._config
        said = self.followed(knowledge)
        error = self.heading_error(said)
        if math.isnan(error):
            return STANDING, 0.0, 0.0
        beyond = config.back_to_deg if self.state == TURNING_BACK else config.tolerance_deg
        if abs(error) <= math.radians(beyond):
            return DRIVING, config.speed_m_s, 0.0
        return TURNING_BACK, 0.0, -math.copysign(math.radians(config.turn_rate_deg_s), error)
