"""A CAN bus in injected time: bit time, arbitration, bounded transmit queues, scripted faults.

The hub runs it against the clock, the deterministic world in simulated time: both show the same
bus. Nodes are named; each has a queue that it empties in order, as a SocketCAN interface does,
and the heads of all queues contend whenever the bus falls free (ISO 11898-1 [M]).
"""

from __future__ import annotations

import heapq
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from hil.bus.faults import Fault, Flood, FrameFault, NodeOff
from hil.bus.load import frame_bits
from hil.bus.state import ERR_BUS_OFF, ERR_RESTARTED, controller_error
from hil.bus.strikes import Strikes
from hil.errors import BusBusy, BusError, BusOff
from hil.frames import Frame

QUEUE_FRAMES: Final = 32
"""Default bound of a node's transmit queue: two cycles of a six-axis rig's master."""


class Delivery(NamedTuple):
    """`frame` reached `receiver` at `t_s`, the end of its transmission."""

    t_s: float
    receiver: str
    frame: Frame


@dataclass(frozen=True, slots=True)
class BusTotals:
    """What the bus has carried so far. The load over a while is the growth of `busy_s` in it."""

    frames: int
    bits: int
    busy_s: float
    refused: int
    """Frames refused because a queue was full or a node off the bus."""
    struck: tuple[int, ...]
    """Strikes of each frame fault of the script."""


@dataclass(slots=True)
class _Pending:
    t_s: float
    priority: int
    order: int
    bits: int
    sender: str | None
    frame: Frame
    repeated: bool = False


@dataclass(slots=True)
class _Babbler:
    fault: Flood
    head: _Pending


class BitBus:
    """A bus of `bitrate_bps` bit/s between nodes that `attach`.

    Transmissions last as long as the longest frame of their kind (worst-case stuffing), so that
    a schedule that works here has no luck in it. `rng` decides the random faults alone.
    """

    def __init__(
        self,
        bitrate_bps: int,
        rng: np.random.Generator,
        faults: Sequence[Fault] = (),
        *,
        queue_frames: int = QUEUE_FRAMES,
    ) -> None:
        self.bitrate_bps = bitrate_bps
        self._queue_frames = queue_frames
        self._queues: dict[str, deque[_Pending]] = {}
        self._leaving: set[str] = set()
        self._strikes = Strikes([f for f in faults if isinstance(f, FrameFault)], rng)
        self._offs = [f for f in faults if isinstance(f, NodeOff)]
        self._order = 0
        self._babblers = [self._babbler(f) for f in faults if isinstance(f, Flood)]
        self._later: list[tuple[float, int, Delivery]] = []
        self._notices = _notices(self._offs)
        self._free_s = self._advanced_s = -math.inf
        self._next: tuple[float, _Pending] | None = None
        self._stale = True
        self._frames = self._bits = self._refused = 0

    def attach(self, node: str) -> None:
        """Add a node; BusError if there is one of that name."""
        if node in self._queues and node not in self._leaving:
            raise BusError(f"the bus already has a node {node!r}")
        self._queues.setdefault(node, deque())
        self._leaving.discard(node)

    def detach(self, node: str) -> None:
        """Let a node hear no more and go when its queue is sent, as a closed SocketCAN socket's is."""
        if self._queues[node]:
            self._leaving.add(node)
        else:
            del self._queues[node]

    def room(self, node: str) -> int:
        """Frames that `node` may submit before its queue is full."""
        return self._queue_frames - len(self._queues[node])

    def is_off(self, node: str, t_s: float) -> bool:
        """Whether the script has `node` off the bus at `t_s`."""
        return any(
            off.node == node and off.at_s <= t_s < off.at_s + (off.for_s or math.inf)
            for off in self._offs
        )

    def submit(self, node: str, frame: Frame, now_s: float) -> None:
        """Queue `frame` of `node` at `now_s`; BusBusy if the queue is full, BusOff if it is off."""
        if self._offs and self.is_off(node, max(now_s, self._advanced_s)):
            self._refused += 1
            raise BusOff(f"node {node!r} has left the bus")
        if self.room(node) <= 0:
            self._refused += 1
            raise BusBusy(f"the transmit queue of node {node!r} holds {self._queue_frames} frames")
        self._queues[node].append(self._pending(now_s, node, frame))
        self._stale = True

    @property
    def next_due_s(self) -> float:
        """When `advance` will next have something to do; infinity if the bus is at rest."""
        due_s = self._end_s()
        if self._later:
            due_s = min(due_s, self._later[0][0])
        if self._notices:
            due_s = min(due_s, self._notices[0][0])
        return due_s

    def advance(self, now_s: float) -> list[Delivery]:
        """All deliveries up to and including `now_s`, in the order of their times.

        A frame submitted afterwards with an earlier time still contends as of that time, unless
        its turn has been played already.
        """
        deliveries: list[Delivery] = []
        self._advanced_s = max(self._advanced_s, now_s)
        while (due_s := self.next_due_s) <= now_s and due_s < math.inf:
            if self._notices and self._notices[0][0] <= due_s:
                self._notice(deliveries)
            elif self._later and self._later[0][0] <= due_s:
                deliveries.append(heapq.heappop(self._later)[2])
            elif self._next is not None:
                self._finish(*self._next, deliveries)
        return deliveries

    @property
    def totals(self) -> BusTotals:
        """What was carried, refused and struck so far."""
        return BusTotals(
            self._frames,
            self._bits,
            self._bits / self.bitrate_bps,
            self._refused,
            self._strikes.counts,
        )

    def _pending(self, t_s: float, sender: str | None, frame: Frame) -> _Pending:
        self._order += 1
        return _Pending(t_s, arbitration(frame), self._order, frame_bits(frame), sender, frame)

    def _babbler(self, fault: Flood) -> _Babbler:
        frame = Frame(fault.can_id, bytes.fromhex(fault.data))
        return _Babbler(fault, self._pending(fault.at_s, None, frame))

    def _end_s(self) -> float:
        """End of the transmission under way or next to come, chosen anew if that may have changed.

        It is settled only when it has ended: until then a frame of equal or earlier time may
        still be submitted and win.
        """
        if self._stale:
            heads = [queue[0] for queue in self._queues.values() if queue]
            heads += [babbler.head for babbler in self._babblers]
            self._next = None
            if heads:
                start_s = max(self._free_s, min(head.t_s for head in heads))
                winner = min(
                    (head for head in heads if head.t_s <= start_s),
                    key=lambda head: (head.priority, head.order),
                )
                self._next = (start_s + winner.bits / self.bitrate_bps, winner)
            self._stale = False
        return self._next[0] if self._next is not None else math.inf

    def _finish(self, end_s: float, sent: _Pending, deliveries: list[Delivery]) -> None:
        self._stale = True
        self._free_s = end_s
        self._frames += 1
        self._bits += sent.bits
        receivers = [
            name
            for name in self._queues
            if name != sent.sender
            and name not in self._leaving
            and not (self._offs and self.is_off(name, end_s))
        ]
        again = False
        if self._strikes.faults:
            received, again = self._strikes.receptions(
                end_s, sent.sender or "", sent.frame, receivers, repeated=sent.repeated
            )
            for receiver, frame, late_s in received:
                self._deliver(Delivery(end_s + late_s, receiver, frame), late_s, deliveries)
        else:
            deliveries += [Delivery(end_s, receiver, sent.frame) for receiver in receivers]
        if sent.sender is not None:
            queue = self._queues[sent.sender]
            queue.popleft()
            if again:
                queue.appendleft(replace(sent, t_s=end_s, repeated=True))
            self._let_go(sent.sender)
        else:
            self._babble_on(sent, end_s)

    def _let_go(self, node: str) -> None:
        if node in self._leaving and not self._queues[node]:
            self._leaving.remove(node)
            del self._queues[node]

    def _deliver(self, delivery: Delivery, late_s: float, deliveries: list[Delivery]) -> None:
        if late_s > 0.0:
            self._order += 1
            heapq.heappush(self._later, (delivery.t_s, self._order, delivery))
        else:
            deliveries.append(delivery)

    def _babble_on(self, sent: _Pending, end_s: float) -> None:
        for babbler in [b for b in self._babblers if b.head is sent]:
            t_s = max(sent.t_s + babbler.fault.period_s, end_s)
            if babbler.fault.until_s is not None and t_s >= babbler.fault.until_s:
                self._babblers.remove(babbler)
            else:
                babbler.head = self._pending(t_s, None, sent.frame)

    def _notice(self, deliveries: list[Delivery]) -> None:
        t_s, node, error_class = self._notices.popleft()
        if node in self._queues:
            if error_class == ERR_BUS_OFF:
                self._queues[node].clear()
                self._stale = True
                self._let_go(node)
            deliveries.append(Delivery(t_s, node, controller_error(error_class)))


def arbitration(frame: Frame) -> int:
    """The bits that decide who may send, as a number: the lower one wins (0 is dominant).

    Eleven identifier bits, RTR or SRR, IDE, then eighteen more and RTR in an extended frame, so
    that of equal first bits data comes before remote and standard before extended.
    """
    remote = int(frame.is_remote)
    if not frame.is_extended:
        return frame.can_id << 21 | remote << 20
    head, tail = divmod(frame.can_id, 1 << 18)
    return head << 21 | 0b11 << 19 | tail << 1 | remote


def _notices(offs: Sequence[NodeOff]) -> deque[tuple[float, str, int]]:
    """When which node learns from its controller that it is off, and that it is back."""
    notices = [(off.at_s, off.node, ERR_BUS_OFF) for off in offs]
    notices += [(off.at_s + off.for_s, off.node, ERR_RESTARTED) for off in offs if off.for_s]
    return deque(sorted(notices))
