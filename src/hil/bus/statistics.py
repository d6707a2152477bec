"""What passed on a bus: counts, rates and gaps by identifier, and the share of its bit time. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from hil.bus.load import frame_bits
from hil.frames import Frame


@dataclass(slots=True)
class IdStatistics:
    """The frames of one identifier."""

    can_id: int
    is_extended: bool
    first_s: float
    last_s: float
    count: int = 1
    longest_gap_s: float = 0.0

    @property
    def rate_hz(self) -> float:
        """Mean rate between the first and the last; 0 where there was but one."""
        span_s = self.last_s - self.first_s
        return (self.count - 1) / span_s if span_s > 0.0 else 0.0


class BusStatistics:
    """Counts every frame of a bus of `bitrate_bps` bit/s; frames may repeat identifiers in any order."""

    def __init__(self, bitrate_bps: int) -> None:
        self._bitrate_bps = bitrate_bps
        self._ids: dict[tuple[int, bool], IdStatistics] = {}
        self._bits = 0
        self._first_s: float | None = None
        self._last_s = 0.0
        self.frames = 0
        self.errors = 0
        """Error frames of the controller; they are not on the bus."""

    def add(self, t_s: float, frame: Frame) -> None:
        """A frame passed at `t_s`."""
        if frame.is_error:
            self.errors += 1
            return
        self.frames += 1
        self._bits += frame_bits(frame)
        self._first_s = t_s if self._first_s is None else self._first_s
        self._last_s = t_s
        key = (frame.can_id, frame.is_extended)
        seen = self._ids.get(key)
        if seen is None:
            self._ids[key] = IdStatistics(*key, t_s, t_s)
            return
        seen.count += 1
        seen.longest_gap_s = max(seen.longest_gap_s, t_s - seen.last_s)
        seen.last_s = t_s

    @property
    def duration_s(self) -> float:
        """From the first frame to the last."""
        return 0.0 if self._first_s is None else self._last_s - self._first_s

    @property
    def load(self) -> float:
        """Share of the bit time that the frames took at worst (all stuff bits), 0..1."""
        return self._bits / self._bitrate_bps / self.duration_s if self.duration_s > 0.0 else 0.0

    def ids(self) -> list[IdStatistics]:
        """By identifier, which on a bus is by priority."""
        return [self._ids[key] for key in sorted(self._ids)]
