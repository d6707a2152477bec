"""The deterministic world: bus, simulated rig and masters in simulated time, repeatable to the bit.

A day of operation runs in minutes: time jumps from one thing that is due to the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Protocol

import numpy as np

from hil.bus.bitbus import BitBus
from hil.errors import BusBusy, BusError, BusOff
from hil.frames import Frame
from hil.sim.rig import SimulatedRig

RIG_NODE = "rig"


class Master(Protocol):
    """Somebody on the bus who decides in injected time: the daemon's core, a sniffer, an intruder."""

    @property
    def next_due_s(self) -> float:
        """Instant at which `on_due` wants to be called, s."""

    def on_due(self, now_s: float) -> Sequence[Frame]:
        """Time has come; returns the frames to send."""

    def on_frame(self, now_s: float, frame: Frame) -> Sequence[Frame]:
        """A frame was received; returns the frames to send."""

    def on_refused(self, now_s: float, frame: Frame, error: BusError) -> None:
        """The bus did not take `frame`: its queue is full or the node is off."""


class World:
    """Runs `masters` (name → master) against `simulated` over `buses`, which frames count in this order.

    `wake_jitter_s` is the standard deviation of the masters' late wake-ups (a host's scheduling), drawn
    from `rng` as its absolute value: nobody wakes early.
    """

    def __init__(
        self,
        simulated: SimulatedRig,
        buses: Sequence[BitBus],
        masters: dict[str, Master],
        *,
        rng: np.random.Generator,
        wake_jitter_s: float = 0.0,
    ) -> None:
        self.simulated = simulated
        self.buses = tuple(buses)
        self.masters = masters
        self.now_s = simulated.plant.now_s
        self._rng = rng
        self._jitter_s = wake_jitter_s
        self._wake: dict[str, tuple[float, float]] = {}
        for bus in self.buses:
            for node in (RIG_NODE, *masters):
                bus.attach(node)

    def run_until(self, end_s: float) -> None:
        """Let everything happen up to and including `end_s`."""
        while (due_s := self._next_due_s()) <= end_s:
            self.now_s = max(self.now_s, due_s)
            self._happen()
        self.now_s = end_s
        self.simulated.plant.advance(end_s)

    def _next_due_s(self) -> float:
        wakes = (self._wake_s(name) for name in self.masters)
        buses = (bus.next_due_s for bus in self.buses)
        return min(self.simulated.next_due_s, *buses, *wakes)

    def _happen(self) -> None:
        now_s = self.now_s
        for k, bus in enumerate(self.buses):
            for at_s, node, received in bus.advance(now_s):
                frame = received._replace(bus=k) if k else received
                if node == RIG_NODE:
                    self.simulated.on_frame(at_s, frame)
                else:
                    self._submit(node, self.masters[node].on_frame(at_s, frame))
        for frame in self.simulated.on_time(now_s):
            with suppress(BusBusy, BusOff):  # a drive's own queue: it speaks again next time
                self.buses[frame.bus].submit(RIG_NODE, frame, now_s)
        for name, master in self.masters.items():
            if self._wake_s(name) <= now_s:
                self._submit(name, master.on_due(now_s))

    def _submit(self, node: str, frames: Sequence[Frame]) -> None:
        for frame in frames:
            try:
                self.buses[frame.bus].submit(node, frame, self.now_s)
            except (BusBusy, BusOff) as error:
                self.masters[node].on_refused(self.now_s, frame, error)

    def _wake_s(self, name: str) -> float:
        """When `name` really wakes for what it has due: late by the host's jitter, drawn once."""
        due_s = self.masters[name].next_due_s
        if self._jitter_s == 0.0:
            return due_s
        drawn = self._wake.get(name)
        if drawn is None or drawn[0] != due_s:
            drawn = (due_s, due_s + abs(self._rng.normal(0.0, self._jitter_s)))
            self._wake[name] = drawn
        return drawn[1]
