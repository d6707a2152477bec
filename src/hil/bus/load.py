"""How much of a CAN bus a frame and a schedule take.

Lengths after R. I. Davis, A. Burns, R. J. Bril, J. J. Lukkien, "Controller Area Network (CAN)
schedulability analysis: refuted, revisited and revised", Real-Time Systems 35 (2007), equation
for C_m [M]: g + 8 s + 13 + floor((g + 8 s - 1) / 4) bits, with g = 34 (11-bit identifier) or 54
(29-bit) bits exposed to stuffing and 13 that are not, the interframe space among them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from hil.errors import ConfigError
from hil.frames import Frame

SHARE_LIMIT: Final = 0.9
"""Share of the bus that a schedule may take: the rest is for repeats, log-ons and errors [M]."""

FASTEST_BPS: Final = 1_000_000
"""No classic CAN bus is faster."""

RECKONED_BITS: Final = 125
"""A frame of eight bytes, 11-bit identifier, as a drive and whoever reads a record reckon with it, who do
not know its bits: 111 and 14 of stuffing. The bus and what plays its traffic again take the 24 that there are
at worst (`bits`), 20 µs more at 500 kbit/s. Frames of a simulated ride have 7 to 13 by kind, 9 in the mean
[V]."""

_STUFFED: Final = {False: 34, True: 54}
_UNSTUFFED: Final = 13


@dataclass(frozen=True, slots=True)
class ScheduledFrame:
    """A frame of `length` data bytes that is sent every `period_s`."""

    name: str
    length: int
    period_s: float
    is_extended: bool = False


def bits(length: int, *, is_extended: bool = False, stuffed: bool = True) -> int:
    """Bits of a frame with `length` data bytes: at worst (`stuffed`) or without any stuff bit."""
    if not 0 <= length <= 8:
        raise ValueError(f"a classic CAN frame has 0 to 8 data bytes, not {length}")
    exposed = _STUFFED[is_extended] + 8 * length
    return exposed + _UNSTUFFED + ((exposed - 1) // 4 if stuffed else 0)


_WORST: Final = tuple(tuple(bits(n, is_extended=ext) for n in range(9)) for ext in (False, True))
"""By kind of identifier and length: counted with every frame of a running rig."""


def frame_bits(frame: Frame, *, stuffed: bool = True) -> int:
    """Bits of `frame`; a remote frame carries no data whatever its length says."""
    length = 0 if frame.is_remote else len(frame.data)
    if stuffed:
        return _WORST[frame.is_extended][length]
    return bits(length, is_extended=frame.is_extended, stuffed=False)


def frame_s(frame: Frame, bitrate_bps: int, *, stuffed: bool = True) -> float:
    """Seconds that `frame` holds the bus at `bitrate_bps` bit/s, interframe space included."""
    return frame_bits(frame, stuffed=stuffed) / bitrate_bps


def share(schedule: Sequence[ScheduledFrame], bitrate_bps: int, *, stuffed: bool = True) -> float:
    """Share of the bus, 1 = all of it, that `schedule` takes at worst (or without stuff bits)."""
    return sum(
        bits(item.length, is_extended=item.is_extended, stuffed=stuffed)
        / (bitrate_bps * item.period_s)
        for item in schedule
    )


def require_fits(
    schedule: Sequence[ScheduledFrame], bitrate_bps: int, *, limit: float = SHARE_LIMIT
) -> float:
    """The worst-case share of `schedule`; ConfigError when it is over `limit`."""
    worst = share(schedule, bitrate_bps)
    if worst > limit:
        largest = max(schedule, key=lambda item: share([item], bitrate_bps))
        remedy = "bus.cycle" if bitrate_bps >= FASTEST_BPS else "can.bitrate or bus.cycle"
        raise ConfigError(
            f"the schedule needs {worst:.0%} of a {bitrate_bps / 1000:g} kbit/s bus, at most "
            f"{limit:.0%} may be used; raise {remedy} (its {len(schedule)} frames "
            f"include {largest.name}, {largest.length} bytes every {largest.period_s * 1e3:g} ms)"
        )
    return worst
