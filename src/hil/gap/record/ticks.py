"""Ticks of the drives' own clocks or of the bus, and setpoints moved to where they act at them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from hil.config import RigFile
from hil.identify.replay import Stretch

Array = NDArray[np.float64]
Key = tuple[int, str]
"""A drive in a record: stretch and actuator."""

ALONE: Final = 9
"""Frames one after the other, of which fewer than half may be late by chance."""


@dataclass(frozen=True, slots=True)
class Ticks:
    """Ticks of a drive in one stretch: at `phase_s` plus whole periods when it begins, off by `rate` s/s."""

    phase_s: float
    rate: float
    origin_s: float
    late_s: float = 0.0
    """By how much frames arrive later than the rig file's setpoint delay says."""

    def place(self, t: Array) -> Array:
        """Where the ticks lie at instants `t`, s beside whole periods."""
        return np.asarray(self.phase_s + self.rate * (t - self.origin_s))

    def later(self, by_s: float) -> Ticks:
        """The same ticks, where these lie `by_s` earlier beside whole periods."""
        return replace(self, phase_s=self.phase_s - self.rate * by_s)

    def delayed(self, by_s: float) -> Ticks:
        """The same ticks, at which the same frames act `by_s` later."""
        return replace(self, phase_s=self.phase_s + by_s, late_s=self.late_s + by_s)


@dataclass(frozen=True, slots=True)
class AtSync:
    """A drive that takes each setpoint at the SYNC that comes next, whenever in the cycle its frame came."""

    cycle_s: float
    ticks: Ticks | None = None
    """Of its own clock, where it acts at the first of those after SYNC."""
    late: tuple[float, ...] = ()
    """When the frames were sent that act a tick after that, s."""
    untold: tuple[float, ...] = ()
    """When those were sent of which nothing tells whether they do, s."""
    share: float = 0.0
    """Of the frames that are told, that of the late ones: those untold are as late as that on average."""
    wait_s: float = 0.0
    """By how much setpoints act later than the rig file's setpoint delay after SYNC."""

    def delayed(self, by_s: float) -> AtSync:
        """The same drive, at which all acts `by_s` later."""
        return replace(self, wait_s=self.wait_s + by_s)

    def drawn(self, rng: np.random.Generator) -> AtSync:
        """The same drive, with untold frames that are late by chance."""
        late = np.array(self.untold)[rng.random(len(self.untold)) < self.share]
        return replace(self, late=(*self.late, *late.tolist()), untold=(), share=0.0)

    def regular(self, t: Array) -> Array:
        """Send instants (K,) without what they jitter by: a straight line through the cycles they fall in."""
        if len(t) < 2:
            return t
        frames = np.arange(len(t))
        # a frame that is late alone has skipped no cycle, and none is counted twice for the next
        late = median_filter((t - t[0]) / self.cycle_s - frames, ALONE, mode="nearest")
        cycles = frames + np.concatenate([[0.0], np.cumsum(np.round(np.diff(late)))])
        slope, start = np.polyfit(cycles, t - t[0], 1)
        return np.asarray(t[0] + start + slope * cycles)


Clocks = Mapping[Key, Ticks | AtSync]


def acting(rig: RigFile, t_sent: Array, ticks: Ticks | AtSync | None) -> Array:
    """Send instants as the smooth twin must be told them, so that each acts at its drive's tick or SYNC."""
    if ticks is None:
        return t_sent
    if isinstance(ticks, AtSync):
        late = np.isin(t_sent, ticks.late) + ticks.share * np.isin(t_sent, ticks.untold)
        sent = np.maximum.accumulate(ticks.regular(t_sent) + rig.bus.position_loop * late)
        return acting(rig, sent, ticks.ticks) + ticks.wait_s
    if rig.bus.retimed:  # the first frame starts the drive's clock, and all act by that
        return np.asarray(t_sent + ticks.late_s)
    tick, delay = rig.bus.position_loop, rig.bus.setpoint_delay
    there = t_sent + delay + ticks.late_s
    place = ticks.place(there)
    acts = np.ceil((there - place) / tick - 1e-6) * tick + place
    return np.asarray(np.maximum.accumulate(acts - delay - 0.5 * tick))


def at_ticks(rig: RigFile, pieces: Sequence[Stretch], clocks: Clocks) -> list[Stretch]:
    """Stretches whose setpoints act at the ticks of the drives' clocks, where those are known; SYNC keeps
    loops in step."""
    out = []
    for k, p in enumerate(pieces):
        own = {a: clocks.get((k, a)) for a in p.setpoints}
        told = {a: (acting(rig, t, own[a]), v) for a, (t, v) in p.setpoints.items()}
        out.append(replace(p, setpoints=told, ticked={a for a, c in own.items() if c is not None}))
    return out
