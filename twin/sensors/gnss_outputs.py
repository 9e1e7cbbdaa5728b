"""What some GNSS receivers give beside position and speed: vertical speed, heading of two antennas."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from twin.config import Config, NonNegative, Positive
from twin.sensors.gnss_faults import Qualities
from twin.sensors.noise import GaussMarkov, Streams, WhiteNoise
from twin.signals import HEADING, FloatArray

VERTICAL_SPEED = "vertical_speed_m_s"
HEADING_SIGMA = "sigma_heading_rad"


class VerticalSpeed(Config):
    """Speed upwards, from Doppler; behind the same filter as the horizontal velocity. Errors are those under an open
    sky."""

    white_sigma_m_s: NonNegative
    """Error that is new in every sample."""
    correlated_sigma_m_s: NonNegative
    """Time-correlated error."""
    correlation_s: Positive
    """Its 1/e time."""


class AntennaHeading(Config):
    """Heading from two antennas along the mount's x axis."""

    white_sigma_rad: NonNegative
    """Error that is new in every sample."""
    correlated_sigma_rad: NonNegative
    """Time-correlated error (phase centres, multipath)."""
    correlation_s: Positive
    """Its 1/e time."""
    reported_sigma_rad: NonNegative
    """What the receiver claims."""
    qualities: Annotated[Qualities, Field(min_length=1)] = (4, 5)
    """NMEA qualities with which there is a heading; otherwise it is NaN."""


class ScalarError:
    """White plus Gauss-Markov error of one output of R receivers."""

    def __init__(
        self, *, white: float, correlated: float, tau_s: float, period_s: float, streams: Streams, process: str
    ) -> None:
        self._white = WhiteNoise(sigma=white, stream=streams.normal(f"{process}_white", 1))
        self._correlated = GaussMarkov(
            sigma=correlated,
            tau_s=tau_s,
            period_s=period_s,
            stream=streams.normal(f"{process}_correlated", 1),
            start=streams.once(f"{process}_correlated_start", 1),
        )

    def step(self) -> FloatArray:
        """Advance by one sample and return the error, (R,)."""
        error: FloatArray = (self._correlated.step() + self._white.step())[:, 0]
        return error


def vertical_speed_error(config: VerticalSpeed, *, period_s: float, streams: Streams) -> ScalarError:
    """Error of the vertical speed."""
    return ScalarError(
        white=config.white_sigma_m_s,
        correlated=config.correlated_sigma_m_s,
        tau_s=config.correlation_s,
        period_s=period_s,
        streams=streams,
        process=VERTICAL_SPEED,
    )


def heading_error(config: AntennaHeading, *, period_s: float, streams: Streams) -> ScalarError:
    """Error of the heading."""
    return ScalarError(
        white=config.white_sigma_rad,
        correlated=config.correlated_sigma_rad,
        tau_s=config.correlation_s,
        period_s=period_s,
        streams=streams,
        process=HEADING,
    )
