"""What a planter sends on its CAN bus, by the architecture of its row-speed filter.

*Central*: every sampling unit sends its three accelerations and three turn rates, one filter runs somewhere, and every
receiving unit gets its own speed back. *Distributed*: each row unit runs its filter over its own IMU, so that only the
radar's speed (and GNSS values, if used) is broadcast and the row units send nothing; how many listen costs nothing.

Paper 000, section 4.4.1, counts the central payload: 4 sampling and 24 receiving units give (4 * 6 + 24) float32 =
192 bytes per iteration, 9.6 kB/s at 50 Hz and 1.92 kB/s at 10 Hz. (Its text says "48 bytes per iteration": a slip, that
is the number of values; its rates are those of 192 bytes.) It holds them against 8 kB/s, "about 25 % of the baud rate";
what the bus has to carry are frames, with some 67 bits around each.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from twin.config import Config
from twin.formats.can import MOST_DATA_BYTES, BusLoad, PeriodicMessage, bus_load, pack

Encoding = Literal["float32", "int16"]
_BYTES: dict[Encoding, int] = {"float32": 4, "int16": 2}
_IMU_VALUES = 6

Units = Annotated[int, Field(ge=0, le=1000)]


class BusConfig(Config):
    """A CAN bus between the units of a planter, and what the row-speed filter sends on it."""

    architecture: Literal["central", "distributed"]
    """Where the filter runs: one for all units, or one in each."""
    senders: Units | None = None
    """Sampling units, central architecture only: each sends three accelerations and three turn rates."""
    receivers: Units | None = None
    """Receiving units, central architecture only: each gets its own speed."""
    gnss_values: Annotated[int, Field(ge=0, le=64)] = 0
    """GNSS values broadcast to the units beside the radar's speed, distributed architecture only."""
    rate_hz: Annotated[float, Field(gt=0.0, le=10_000.0)]
    """How often everything is sent."""
    encoding: Encoding = "float32"
    """How a value is coded."""
    speed_encoding: Encoding | None = None
    """How a speed is coded, if not as the rest."""
    shared_frames: bool = False
    """Speeds of several receivers side by side in one frame; else each receiver is sent a frame of its own."""
    full_frames: bool = False
    """Fill every frame up to 8 bytes, as messages of ISO 11783 and J1939 are."""
    bit_rate: Annotated[float, Field(ge=10_000.0, le=1_000_000.0)] = 250_000.0
    """Bits per second of the bus."""

    @model_validator(mode="after")
    def _units_of_its_architecture(self) -> Self:
        units = {"senders": self.senders, "receivers": self.receivers}
        if self.architecture == "central":
            for key, value in units.items():
                if value is None:
                    raise ValueError(f"{key}: missing; a central architecture needs senders and receivers")
            if self.gnss_values:
                raise ValueError("gnss_values goes with architecture = 'distributed': the central filter has its own")
        else:
            for key, value in units.items():
                if value is not None:
                    raise ValueError(f"{key} goes with architecture = 'central': distributed units send nothing")
            if self.shared_frames:
                raise ValueError("shared_frames goes with architecture = 'central': a broadcast has no receivers")
        return self

    def messages(self) -> list[PeriodicMessage]:
        """All that is sent, node by node."""
        speed = self.speed_encoding or self.encoding
        if self.architecture == "distributed":
            gnss = [self._message(self.gnss_values, self.encoding)] if self.gnss_values else []
            return [self._message(1, speed), *gnss]
        receivers = self.receivers or 0
        sent = [self._message(_IMU_VALUES, self.encoding)] * (self.senders or 0)
        together = [self._message(receivers, speed)] if receivers else []
        return sent + (together if self.shared_frames else [self._message(1, speed)] * receivers)

    def _message(self, values: int, encoding: Encoding) -> PeriodicMessage:
        each = _BYTES[encoding]
        frames = pack(values, each)
        return PeriodicMessage(
            payload_bytes=values * each,
            frames=tuple(MOST_DATA_BYTES if self.full_frames else size for size in frames),
            rate_hz=self.rate_hz,
        )

    def load(self) -> BusLoad:
        """What it costs the bus."""
        return bus_load(self.messages(), bit_rate=self.bit_rate)
