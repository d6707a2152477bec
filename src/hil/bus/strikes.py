"""Decides which frames the scripted faults strike, and what becomes of them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from hil.bus.faults import Corrupt, Delay, Drop, Duplicate, ForeignId, FrameFault, Truncate
from hil.frames import Frame


class Reception(NamedTuple):
    """What one node receives of a transmission: the frame as it arrives, and how late (s)."""

    receiver: str
    frame: Frame
    late_s: float = 0.0


@dataclass(slots=True)
class _Rule:
    fault: FrameFault
    matched: int = 0
    struck: int = 0

    def strikes(
        self,
        t_s: float,
        sender: str,
        frame: Frame,
        receivers: Collection[str],
        rng: np.random.Generator,
    ) -> bool:
        fault = self.fault
        if t_s < fault.after_s or (fault.until_s is not None and t_s >= fault.until_s):
            return False
        if fault.ids is not None and frame.can_id not in fault.ids:
            return False
        if fault.sender is not None and fault.sender != sender:
            return False
        if fault.receiver is not None and fault.receiver not in receivers:
            return False
        if fault.count is not None and self.struck >= fault.count:
            return False
        self.matched += 1
        if self.matched <= fault.skip:
            return False
        if fault.probability < 1.0 and rng.random() >= fault.probability:
            return False
        self.struck += 1
        return True


@dataclass(slots=True)
class Strikes:
    """The state of a fault script: how often each rule matched and struck. Random by `rng` only."""

    faults: Sequence[FrameFault]
    rng: np.random.Generator
    _rules: list[_Rule] = field(init=False)

    def __post_init__(self) -> None:
        self._rules = [_Rule(fault) for fault in self.faults]

    @property
    def counts(self) -> tuple[int, ...]:
        """How often each fault has struck, in the script's order."""
        return tuple(rule.struck for rule in self._rules)

    def receptions(
        self, t_s: float, sender: str, frame: Frame, receivers: Collection[str], *, repeated: bool
    ) -> tuple[list[Reception], bool]:
        """What the `receivers` get of `frame`, and whether the sender has to repeat it.

        `repeated` says that this is such a repetition, which is not repeated again.
        """
        received = [Reception(receiver, frame) for receiver in receivers]
        again = False
        for rule in self._rules:
            fault = rule.fault
            if (repeated and isinstance(fault, Duplicate)) or not rule.strikes(
                t_s, sender, frame, receivers, self.rng
            ):
                continue
            if isinstance(fault, Duplicate):
                again = True
                continue
            # One disturbance on the wire looks the same to everybody who hears it.
            struck = _struck(fault, frame, self.rng)
            received = [
                changed
                for item in received
                for changed in (
                    _changed(item, fault, struck)
                    if fault.receiver in (None, item.receiver)
                    else [item]
                )
            ]
            if fault.receiver is None and struck is not None:
                frame = struck
        return received, again


def _struck(fault: FrameFault, frame: Frame, rng: np.random.Generator) -> Frame | None:
    """The frame as the fault leaves it; None if it leaves nothing."""
    match fault:
        case Drop():
            return None
        case Corrupt() if frame.data:
            data = bytearray(frame.data)
            chosen = rng.choice(8 * len(data), size=min(fault.bits, 8 * len(data)), replace=False)
            for bit in chosen.tolist():
                data[bit // 8] ^= 1 << bit % 8
            return frame._replace(data=bytes(data))
        case Truncate():
            return frame._replace(data=frame.data[: fault.length])
        case ForeignId():
            return frame._replace(can_id=fault.can_id, is_extended=False)
        case _:
            return frame


def _changed(item: Reception, fault: FrameFault, struck: Frame | None) -> list[Reception]:
    if struck is None:
        return []
    late_s = item.late_s + (fault.by_s if isinstance(fault, Delay) else 0.0)
    return [Reception(item.receiver, struck, late_s)]
