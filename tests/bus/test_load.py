from __future__ import annotations

import pytest

from hil.bus.load import ScheduledFrame, bits, frame_bits, frame_s, require_fits, share
from hil.errors import ConfigError
from hil.frames import Frame


def _crc15(sequence: list[int]) -> list[int]:
    register = 0
    for bit in sequence:
        register = (register << 1) & 0x7FFF ^ (0x4599 if bit ^ (register >> 14) else 0)
    return [(register >> n) & 1 for n in range(14, -1, -1)]


def _on_the_wire(frame: Frame) -> int:
    """Bits of a standard data frame, counted one by one: stuffed start to CRC, then the rest."""
    sequence = [0] + [(frame.can_id >> n) & 1 for n in range(10, -1, -1)] + [0, 0, 0]
    sequence += [(len(frame.data) >> n) & 1 for n in range(3, -1, -1)]
    sequence += [(byte >> n) & 1 for byte in frame.data for n in range(7, -1, -1)]
    sequence += _crc15(sequence)
    stuffed, last, run = 0, None, 0
    for bit in sequence:
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:
            stuffed, last, run = stuffed + 1, 1 - bit, 1
    delimiters_ack_end_space = 1 + 2 + 7 + 3
    return len(sequence) + stuffed + delimiters_ack_end_space


def test_lengths_are_the_published_ones() -> None:
    assert bits(8) == 135
    assert bits(8, is_extended=True) == 160
    assert [bits(n) for n in range(9)] == [55 + 10 * n for n in range(9)]
    assert bits(8, stuffed=False) == 111
    assert bits(0, stuffed=False) == 47


@pytest.mark.parametrize("can_id", [0x000, 0x0DD, 0x295, 0x371, 0x555, 0x7FF])
@pytest.mark.parametrize("byte", [0x00, 0xFF, 0x55, 0x0F, 0xF8, 0x3C])
@pytest.mark.parametrize("length", [0, 1, 4, 8])
def test_a_frame_counted_bit_by_bit_lies_between_both_lengths(
    can_id: int, byte: int, length: int
) -> None:
    frame = Frame(can_id, bytes([byte] * length))
    counted = _on_the_wire(frame)
    assert frame_bits(frame, stuffed=False) <= counted <= frame_bits(frame)


def test_a_remote_frame_carries_no_data() -> None:
    assert frame_bits(Frame(0x123, bytes(8), is_remote=True)) == bits(0)


def test_time_on_the_bus() -> None:
    assert frame_s(Frame(0x123, bytes(8)), 500_000) == pytest.approx(270e-6)


@pytest.mark.parametrize(
    ("bitrate_bps", "expected_s"), [(1_000_000, 1.68e-3), (500_000, 3.35e-3), (250_000, 6.70e-3)]
)
def test_six_axes_need_what_the_bus_budget_says(bitrate_bps: int, expected_s: float) -> None:
    cycle_s = 0.01
    schedule = [ScheduledFrame("SYNC", 0, cycle_s)]
    schedule += [ScheduledFrame(f"{n}", 8, cycle_s) for n in range(12)]
    assert share(schedule, bitrate_bps) * cycle_s == pytest.approx(expected_s, abs=0.006e-3)


def test_a_schedule_that_fits_is_let_through_with_its_share() -> None:
    schedule = [ScheduledFrame("control", 8, 0.01)]
    assert require_fits(schedule, 500_000) == pytest.approx(0.027)


def test_a_schedule_that_does_not_fit_is_refused_in_a_sentence() -> None:
    schedule = [ScheduledFrame(f"leg{n} setpoint", 8, 0.001) for n in range(6)]
    with pytest.raises(ConfigError) as refusal:
        require_fits(schedule, 500_000)
    text = str(refusal.value)
    assert "162%" in text
    assert "500 kbit/s" in text
    assert "leg0 setpoint" in text
    assert "can.bitrate" in text


def test_an_impossible_length_is_refused() -> None:
    with pytest.raises(ValueError, match="0 to 8"):
        bits(9)
