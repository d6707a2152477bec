"""A fault of unknown size, and the size at which it shows so much above what a healthy bicycle leaves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from benchmarks.other_rides.bicycle import Bicycle, Outing, floors, traces
from benchmarks.other_rides.body import Body
from benchmarks.other_rides.sensing import Channel
from hil.config import BicycleFile

SEVERITIES: Final = (1, 3, 10)
ROUNDS: Final = 5
CLOSE: Final = 1.03

Parameters = dict[str, float]


@dataclass(frozen=True, slots=True)
class Fault:
    """`on` makes a bicycle faulty by a size between `least` and `most`: sane, well above scatter."""

    effect: str
    location: str
    least: float
    most: float
    on: Callable[[Bicycle, float], Bicycle]
    parameters: Callable[[float, BicycleFile, Bicycle, list[Outing]], Parameters]
    note: str = ""


@dataclass(frozen=True, slots=True)
class Sized:
    """A fault at a size: its trace by signal over the floor there, the largest of which is its severity."""

    fault: Fault
    size: float
    over_floor: dict[str, float]

    @property
    def ratio(self) -> float:
        """On the signal that it touches most."""
        return max(self.over_floor.values())

    @property
    def severity(self) -> int:
        """The nearest step, by ratio."""
        return min(SEVERITIES, key=lambda s: abs(np.log(s / max(self.ratio, 1e-9))))

    def describe(self) -> dict[str, Any]:
        """For the notes."""
        return {
            "effect": self.fault.effect,
            "location": self.fault.location,
            "size": self.size,
            "severity_reached": self.ratio,
            "over_floor": self.over_floor,
            "note": self.fault.note,
        }


def sized(
    rig: BicycleFile, bicycle: Bicycle, fault: Fault, severity: int, outings: list[Outing]
) -> Sized:
    """`fault` at the size that comes nearest to a severity within its bounds."""
    floor = floors(rig, bicycle, outings)
    size = float(np.sqrt(fault.least * fault.most))
    for _ in range(ROUNDS):
        trace = traces(rig, bicycle, fault.on(bicycle, size), outings)
        found = Sized(fault, size, {s: trace[s] / floor[s] for s in floor})
        better = float(np.clip(size * severity / found.ratio, fault.least, fault.most))
        if max(better / size, size / better) < CLOSE:
            break
        size = better
    return found


def of_body(change: Callable[[Body, float], Body]) -> Callable[[Bicycle, float], Bicycle]:
    """A fault that changes the body."""
    return lambda b, size: replace(b, body=change(b.body, size))


def of_channels(
    signals: tuple[str, ...], change: Callable[[Channel, float], Channel]
) -> Callable[[Bicycle, float], Bicycle]:
    """A fault that changes channels of the sensors."""

    def on(b: Bicycle, size: float) -> Bicycle:
        changed = {s: change(b.sensing.channels[s], size) for s in signals}
        return replace(b, sensing=replace(b.sensing, channels={**b.sensing.channels, **changed}))

    return on
