"""A servo drive written with the durand package: its SDO server, NMT, PDOs, SYNC and heartbeat, not ours.

Only the power states and a motor that follows its target at once are added, as plainly as can be.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable
from typing import Any

from durand import MinimalNode
from durand.datatypes import DatatypeEnum
from durand.network import NetworkABC
from durand.object_dictionary import Record, Variable
from durand.scheduler import AbstractScheduler, set_scheduler

from hil.frames import Frame

Timed = list[tuple[float, Frame]]
SHUT_DOWN, SWITCHED_ON, ENABLED, DISABLED, FAULT = 0x0231, 0x0233, 0x0237, 0x0250, 0x0218


class Clock(AbstractScheduler):
    """durand's timers in simulated time."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self._queue: list[Any] = []
        self._count = itertools.count()

    def add(self, delay: float, callback: Callable, args: tuple = (), kwargs: Any = None) -> Any:
        entry = [self.now_s + delay, next(self._count), callback, args, kwargs or {}]
        heapq.heappush(self._queue, entry)
        return entry

    def cancel(self, entry: Any) -> None:
        entry[2] = None

    @property
    def lock(self) -> Any:
        raise NotImplementedError

    @property
    def next_s(self) -> float:
        return self._queue[0][0] if self._queue else float("inf")

    def advance(self, now_s: float) -> None:
        self.now_s = max(self.now_s, now_s)
        while self._queue and self._queue[0][0] <= now_s:
            _, _, callback, args, kwargs = heapq.heappop(self._queue)
            if callback is not None:
                callback(*args, **kwargs)


class Wire(NetworkABC):
    """durand's network: frames handed in, frames collected."""

    def __init__(self) -> None:
        self.subscriptions: dict[int, Callable] = {}
        self.out: list[Frame] = []

    def add_subscription(self, cob_id: int, callback: Callable) -> None:
        self.subscriptions[cob_id] = callback

    def remove_subscription(self, cob_id: int, callback: Any = None) -> None:
        self.subscriptions.pop(cob_id, None)

    def send(self, cob_id: int, msg: bytes) -> None:
        self.out.append(Frame(cob_id, bytes(msg)))


class ForeignDrive:
    """A node for `Exchange`, or for a real bus: frames in, frames out."""

    def __init__(self, node: int, *, vendor: int = 0xABC, product: int = 0x402) -> None:
        self.clock, self.wire = Clock(), Wire()
        set_scheduler(self.clock)
        self.node = MinimalNode(self.wire, node)
        od = self.od = self.node.object_dictionary
        od.write(0x1000, 0, 0x00020192)
        for sub, value in ((1, vendor), (2, product), (3, 0x10000)):
            od.write(0x1018, sub, value)
        consumer = Record(name="Consumer heartbeat time")
        consumer[1] = Variable(DatatypeEnum.UNSIGNED32, "rw", 0)
        od[0x1016] = consumer
        for index, kind, access, value in (
            (0x6007, DatatypeEnum.INTEGER16, "rw", 1),
            (0x6040, DatatypeEnum.UNSIGNED16, "rw", 0),
            (0x6041, DatatypeEnum.UNSIGNED16, "ro", DISABLED),
            (0x605A, DatatypeEnum.INTEGER16, "rw", 2),
            (0x6060, DatatypeEnum.INTEGER8, "rw", 0),
            (0x6061, DatatypeEnum.INTEGER8, "ro", 0),
            (0x6064, DatatypeEnum.INTEGER32, "ro", 0),
            (0x6065, DatatypeEnum.UNSIGNED32, "rw", 0),
            (0x6066, DatatypeEnum.UNSIGNED16, "rw", 0),
            (0x6071, DatatypeEnum.INTEGER16, "rw", 0),
            (0x6072, DatatypeEnum.UNSIGNED16, "rw", 0),
            (0x6077, DatatypeEnum.INTEGER16, "ro", 0),
            (0x607A, DatatypeEnum.INTEGER32, "rw", 0),
            (0x607E, DatatypeEnum.UNSIGNED8, "rw", 0),
            (0x607F, DatatypeEnum.UNSIGNED32, "rw", 0),
            (0x6502, DatatypeEnum.UNSIGNED32, "ro", 0x3E0),
        ):
            od[index] = Variable(kind, access, value)
            od.write(index, 0, value)
        for index, kinds in (
            (0x607D, (DatatypeEnum.INTEGER32,) * 2),
            (0x60C2, (DatatypeEnum.UNSIGNED8, DatatypeEnum.INTEGER8)),
        ):
            record = Record()
            for sub, kind in enumerate(kinds, start=1):
                record[sub] = Variable(kind, "rw", 0)
            od[index] = record
        od.update_callbacks[(0x6040, 0)].add(self._obey)
        od.update_callbacks[(0x607A, 0)].add(self._move)
        od.update_callbacks[(0x6060, 0)].add(lambda mode: od.write(0x6061, 0, mode))

    def _obey(self, word: int) -> None:
        state = self.od.read(0x6041, 0)
        if state == FAULT:
            new = DISABLED if word & 0x80 else FAULT
        elif not word & 0x02:
            new = DISABLED
        elif word & 0x0F == 0x06:
            new = SHUT_DOWN
        elif word & 0x0F == 0x07:
            new = SWITCHED_ON if state in (SHUT_DOWN, SWITCHED_ON, ENABLED) else state
        elif word & 0x0F == 0x0F:
            new = ENABLED if state in (SWITCHED_ON, ENABLED) else state
        else:
            new = state
        self.od.write(0x6041, 0, new)

    def _move(self, target: int) -> None:
        if self.od.read(0x6041, 0) == ENABLED:
            self.od.write(0x6064, 0, target)

    @property
    def position(self) -> int:
        return self.od.read(0x6064, 0)

    @property
    def next_due_s(self) -> float:
        return 0.0 if self.wire.out else self.clock.next_s

    def on_frame(self, now_s: float, frame: Frame) -> Timed:
        self.clock.advance(now_s)
        callback = self.wire.subscriptions.get(frame.can_id)
        if callback is not None:
            callback(frame.can_id, frame.data)
        return self.on_time(now_s)

    def on_time(self, now_s: float) -> Timed:
        self.clock.advance(now_s)
        out, self.wire.out = self.wire.out, []
        return [(now_s, frame) for frame in out]
