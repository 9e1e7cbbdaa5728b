"""Faults that act inside a GNSS receiver: its corrections, its sky, its fix state, what it says of itself.

They have no effect on samples afterwards; the receiver looks at their windows at every sample
(:mod:`twin.sensors.gnss_disturbances`).
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, Strict, model_validator

from twin.config import NonNegative, Positive, Probability, Vector3
from twin.sensors.fault_config import FaultConfig, FaultContext

Qualities = Annotated[tuple[Annotated[int, Field(ge=0, le=8)], ...], Strict(strict=False)]
"""NMEA GGA field 6; a TOML array."""


class ReceiverFault(FaultConfig):
    """A fault inside a GNSS receiver."""

    def effect(self, context: FaultContext) -> None:  # noqa: ARG002
        """None: the receiver itself asks for the fault."""
        return


class CorrectionsLostFault(ReceiverFault):
    """No corrections arrive; what is sent meanwhile is lost for good."""

    kind: Literal["corrections_lost"]


class CorrectionsOldFault(ReceiverFault):
    """Corrections arrive late, by ``delay_s`` and ``growth`` times the time since the window opened.

    The receiver never goes back to older corrections than it has, so that their age grows by a second a second at most:
    with a growth of 1 nothing new comes at all until the window closes and the backlog arrives at once.
    """

    kind: Literal["corrections_old"]
    delay_s: NonNegative = 0.0
    growth: Probability = 1.0
    """Seconds of delay per second; from 0 to 1."""


class SatellitesMaskedFault(ReceiverFault):
    """Trees or a building leave no more than ``satellites`` in view."""

    kind: Literal["satellites_masked"]
    satellites: Annotated[int, Field(ge=0)]


class WrongAmbiguitiesFault(ReceiverFault):
    """Ambiguities fixed wrongly: a constant offset under quality 4 and its small sigma; speeds are as ever."""

    offset_m: Vector3 | None = None
    """East, north, up; without it, drawn for each run and each time anew."""
    either_sign: bool = False
    """``offset_m`` points this way or the opposite one, drawn for each run and each time anew."""
    sigma_m: Vector3 | None = None
    """Standard deviation of the drawn offset; default 0.2, 0.2, 0.38 m: about a wavelength of L1, vertical x 1.9."""

    @model_validator(mode="after")
    def _check_offset(self) -> Self:
        if self.offset_m is not None and self.sigma_m is not None:
            raise ValueError("offset_m and sigma_m exclude one another")
        if self.either_sign and self.offset_m is None:
            raise ValueError("either_sign goes with offset_m; an offset that is drawn has either sign anyway")
        return self


class WrongFixFault(WrongAmbiguitiesFault):
    """The receiver is in quality 4 while the window is open, whatever it lacks, and off by an offset."""

    kind: Literal["wrong_fix"]


class BadReacquisitionFault(WrongAmbiguitiesFault):
    """Each time the receiver comes back to quality 4 in the window, its first fixes are off, all by the same offset.

    Every run fixes again at its own time; it is right again after a while, as a receiver that checks its ambiguities
    against the next satellites.
    """

    kind: Literal["bad_reacquisition"]
    for_s: Positive = 1.0
    """How long after coming back fixes are off; at most, with ``for_least_s``."""
    for_least_s: Positive | None = None
    """With it, that time is drawn evenly from here to ``for_s``, for each run and each time anew."""

    @model_validator(mode="after")
    def _check_time(self) -> Self:
        if self.for_least_s is not None and self.for_least_s > self.for_s:
            raise ValueError(f"for_least_s = {self.for_least_s:g}: longer than for_s = {self.for_s:g}")
        return self


class ZeroCovarianceFault(ReceiverFault):
    """All reported sigmas are zero, as from a driver that does not fill them in."""

    kind: Literal["zero_covariance"]


class FlappingQualityFault(ReceiverFault):
    """The receiver jumps between fix states at random, its error with it; begins in the first one."""

    kind: Literal["flapping_quality"]
    qualities: Annotated[Qualities, Field(min_length=2)]
    """Between which NMEA qualities."""
    changes_hz: Positive
    """Changes per second on average; no more than one a sample."""

    @model_validator(mode="after")
    def _check_qualities(self) -> Self:
        if len(set(self.qualities)) < len(self.qualities):
            raise ValueError("qualities: each may stand there once")
        return self


AnyReceiverFault = (
    CorrectionsLostFault
    | CorrectionsOldFault
    | SatellitesMaskedFault
    | WrongFixFault
    | BadReacquisitionFault
    | ZeroCovarianceFault
    | FlappingQualityFault
)

RECEIVER_FAULTS = frozenset(
    {
        "corrections_lost",
        "corrections_old",
        "satellites_masked",
        "wrong_fix",
        "bad_reacquisition",
        "zero_covariance",
        "flapping_quality",
    }
)
"""Kinds of all of them."""
