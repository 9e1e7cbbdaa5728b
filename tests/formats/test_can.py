"""Frame sizes against frames that are really encoded, bit by bit."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from twin.formats.can import PeriodicMessage, bus_load, most_stuffed, nominal_bits, pack, worst_bits

Bits = list[int]


def _bits(value: int, count: int) -> Bits:
    return [value >> index & 1 for index in reversed(range(count))]


def _crc_15(bits: Bits) -> int:
    """CRC-15/CAN: polynomial 0x4599, register at zero, as ISO 11898-1 writes it."""
    register = 0
    for bit in bits:
        inverted = bit ^ (register >> 14)
        register = register << 1 & 0x7FFF
        if inverted:
            register ^= 0x4599
    return register


def _stuffed(bits: Bits) -> Bits:
    """After five equal bits put a complementary one, which counts itself."""
    out: Bits = []
    run = 0
    for bit in bits:
        run = run + 1 if out and out[-1] == bit else 1
        out.append(bit)
        if run == 5:
            out.append(1 - bit)
            run = 1
    return out


def _header(identifier: int, data: bytes) -> Bits:
    base, extension = identifier >> 18, identifier & 0x3FFFF
    return [0, *_bits(base, 11), 1, 1, *_bits(extension, 18), 0, 0, 0, *_bits(len(data), 4)]


def _frame(identifier: int, data: bytes) -> Bits:
    """Everything on the wire until the next frame may begin: extended data frame, acknowledged, intermission."""
    before = _header(identifier, data) + [bit for byte in data for bit in _bits(byte, 8)]
    stuffed = _stuffed(before + _bits(_crc_15(before), 15))
    delimiter, acknowledged, end_of_frame, intermission = [1], [0, 1], [1] * 7, [1] * 3
    return stuffed + delimiter + acknowledged + end_of_frame + intermission


def test_the_check_sum_is_that_of_the_standard() -> None:
    """The published check value of CRC-15/CAN over the characters 1 to 9."""
    assert _crc_15([bit for byte in b"123456789" for bit in _bits(byte, 8)]) == 0x059E


@given(st.integers(0, 2**29 - 1), st.binary(max_size=8))
@example(0, b"\x00" * 8)
@example(2**29 - 1, b"\xff" * 8)
@example(0x078787, bytes.fromhex("0f0f0f0f0f0f0f0f"))
@example(0x1E1E1E1E, bytes.fromhex("8787878787878787"))
@example(0x1C3C3C3C, bytes.fromhex("3c3c3c3c3c3c3c3c"))
def test_every_frame_is_within_its_bounds(identifier: int, data: bytes) -> None:
    length = len(_frame(identifier, data))
    assert nominal_bits(len(data)) <= length <= worst_bits(len(data))


@pytest.mark.parametrize("size", range(9))
def test_without_stuffing_a_frame_has_its_nominal_bits(size: int) -> None:
    data = bytes([0xAA] * size)
    unstuffed = len(_header(0x0AAAAAAA, data)) + 8 * size + 15 + 13
    assert nominal_bits(size) == unstuffed == 67 + 8 * size


@given(st.integers(1, 118))
def test_the_bound_on_stuffed_bits_is_reached_and_never_exceeded(bits: int) -> None:
    worst = [0] * 5 + [1 - group % 2 for group in range(30) for _ in range(4)]
    assert len(_stuffed(worst[:bits])) - bits == most_stuffed(bits)


@given(st.lists(st.integers(0, 1), min_size=1, max_size=118))
def test_no_bits_cause_more_stuffing_than_the_bound(bits: Bits) -> None:
    assert len(_stuffed(bits)) - len(bits) <= most_stuffed(len(bits))


def test_a_real_frame_comes_near_its_worst_case() -> None:
    """Fixed bits and CRC keep a frame off the bound, but payload and identifier made for it get most of the way."""
    worst_of = max(
        len(_frame(identifier, bytes([pattern] * 8)))
        for identifier in (0x00F0F0F0, 0x1E1E1E1E, 0x078787, 0x1C3C3C3C)
        for pattern in (0x0F, 0x1E, 0x3C, 0x78, 0xF0, 0xE1, 0xC3, 0x87)
    )
    # 54 + 64 bits: 39 of the header (patterned but for SRR, IDE, RTR, r1, r0, length), 64 of data, 15 of CRC.
    # The data alone can hold (64 - 1) // 4 = 15 of the 29.
    assert nominal_bits(8) + 15 <= worst_of <= worst_bits(8)


def test_sizes_of_frames_that_are_often_met() -> None:
    assert [nominal_bits(size) for size in (0, 2, 4, 8)] == [67, 83, 99, 131]
    assert [worst_bits(size) for size in (0, 2, 4, 8)] == [80, 100, 120, 160]


@pytest.mark.parametrize("size", [-1, 9])
def test_a_frame_of_another_size_does_not_exist(size: int) -> None:
    with pytest.raises(ValueError, match="0 to 8 data bytes"):
        nominal_bits(size)


@pytest.mark.parametrize(
    ("values", "bytes_each", "frames"),
    [(6, 4, [8, 8, 8]), (6, 2, [8, 4]), (1, 4, [4]), (1, 2, [2]), (24, 2, [8] * 6), (3, 3, [6, 3]), (0, 4, [])],
)
def test_values_are_packed_whole(values: int, bytes_each: int, frames: list[int]) -> None:
    assert pack(values, bytes_each) == frames


def test_a_value_larger_than_a_frame_is_refused() -> None:
    with pytest.raises(ValueError, match="does not fit"):
        pack(1, 9)


def test_loads_add_up() -> None:
    slow = PeriodicMessage(payload_bytes=8, frames=(8,), rate_hz=10.0)
    fast = PeriodicMessage(payload_bytes=10, frames=(8, 4), rate_hz=100.0)
    load = bus_load([slow, fast], bit_rate=500_000.0)
    assert load.payload_kb_s == pytest.approx(0.08 + 1.0)
    assert load.frames_per_s == pytest.approx(210.0)
    assert load.load_nominal_percent == pytest.approx(100.0 * (10 * 131 + 100 * (131 + 99)) / 500_000)
    assert load.load_worst_percent == pytest.approx(100.0 * (10 * 160 + 100 * (160 + 120)) / 500_000)
    assert bus_load([], bit_rate=250_000.0).load_worst_percent == 0.0
