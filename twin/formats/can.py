"""CAN 2.0B data frames with 29-bit identifiers: how many bits they are, and the load of periodic messages on a bus.

A frame of ``s`` data bytes (ISO 11898-1, extended format), in the order of the wire:

====================================================  =========
start of frame                                                1
identifier: 11 base bits, SRR, IDE, 18 extension bits        31
RTR, r1, r0, length code                                  3 + 4
data                                                      8 s
CRC sequence                                                 15
*end of what is stuffed*                              54 + 8 s
CRC delimiter, ACK slot, ACK delimiter, end of frame    1+1+1+7
intermission before the next frame                            3
**all**                                               67 + 8 s
====================================================  =========

After five equal bits a complementary one is stuffed. It counts for the next five, so after the first five each further
four bits can cost one: into n bits at most floor((n - 1) / 4) are stuffed (Davis, Burns, Bril and Lukkien 2007,
"Controller Area Network (CAN) schedulability analysis", who bound a frame's time by the same count).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

MOST_DATA_BYTES = 8
_STUFFED_BITS = 54
_UNSTUFFED_BITS = 13


def nominal_bits(data_bytes: int) -> int:
    """Bits of a frame without any stuffed ones, intermission included.

    Raises:
        ValueError: ``data_bytes`` is not from 0 to 8.
    """
    return _stuffed_part(data_bytes) + _UNSTUFFED_BITS


def worst_bits(data_bytes: int) -> int:
    """Bits of a frame with the most stuffed ones that any content can cause, intermission included.

    Raises:
        ValueError: ``data_bytes`` is not from 0 to 8.
    """
    return nominal_bits(data_bytes) + most_stuffed(_stuffed_part(data_bytes))


def most_stuffed(bits: int) -> int:
    """Bits stuffed into ``bits`` (at least one) bits at worst: 00000 1111 0000 1111 ..."""
    return (bits - 1) // 4


def _stuffed_part(data_bytes: int) -> int:
    if not 0 <= data_bytes <= MOST_DATA_BYTES:
        raise ValueError(f"a CAN frame has 0 to {MOST_DATA_BYTES} data bytes, not {data_bytes}")
    return _STUFFED_BITS + 8 * data_bytes


def pack(values: int, bytes_each: int) -> list[int]:
    """Data bytes of the frames that carry some values: as many whole values to a frame as it holds.

    Raises:
        ValueError: a value does not fit into a frame.
    """
    if not 0 < bytes_each <= MOST_DATA_BYTES:
        raise ValueError(f"a value of {bytes_each} bytes does not fit into a frame of {MOST_DATA_BYTES}")
    in_a_frame = MOST_DATA_BYTES // bytes_each
    full, rest = divmod(values, in_a_frame)
    return [in_a_frame * bytes_each] * full + ([rest * bytes_each] if rest else [])


@dataclass(frozen=True, slots=True, kw_only=True)
class PeriodicMessage:
    """Frames that one node sends again and again."""

    payload_bytes: int
    """Of information, without any filling."""
    frames: tuple[int, ...]
    """Data bytes of each of its frames, filling included."""
    rate_hz: float


@dataclass(frozen=True, slots=True, kw_only=True)
class BusLoad:
    """What periodic messages cost a bus. A load above 100 % cannot be carried."""

    payload_kb_s: float
    """Information carried, in 1000 bytes a second."""
    frames_per_s: float
    load_nominal_percent: float
    """Share of the bit rate without stuffed bits: no content can cost less."""
    load_worst_percent: float
    """Share of the bit rate with the most stuffed bits: no content can cost more."""


def bus_load(messages: Iterable[PeriodicMessage], *, bit_rate: float) -> BusLoad:
    """Load of a bus by all messages sent on it, bit rate in bit/s."""
    payload = frames = nominal = worst = 0.0
    for message in messages:
        payload += message.rate_hz * message.payload_bytes
        frames += message.rate_hz * len(message.frames)
        nominal += message.rate_hz * sum(map(nominal_bits, message.frames))
        worst += message.rate_hz * sum(map(worst_bits, message.frames))
    return BusLoad(
        payload_kb_s=payload / 1000.0,
        frames_per_s=frames,
        load_nominal_percent=100.0 * nominal / bit_rate,
        load_worst_percent=100.0 * worst / bit_rate,
    )
