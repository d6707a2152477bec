"""A bus of bare Python between our drivers and nodes, in simulated time, for both families.

Frames take a fixed time each way and never collide: arbitration is another module's affair.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from typing import Protocol

from hil.config import RigFile
from hil.configfile import load_rig, parse_settings
from hil.drives.driver import DriveBus, DrivePhase
from hil.frames import Frame
from hil.signals import Event, Sample


def changed(tables: dict[str, object], changes: dict[str, object]) -> dict[str, object]:
    """Tables of a file with some of them, or single keys of some, changed."""
    for key, value in changes.items():
        before = tables[key]
        tables[key] = {**before, **value} if isinstance(value, dict) else value
    return tables


def rig_of(name: str, **changes: object) -> RigFile:
    """A shipped rig file with tables changed: `safety={"drive_watchdog": 0.2}`."""
    return parse_settings(changed(load_rig(name).model_dump(), changes), RigFile, name)


class Node(Protocol):
    """Somebody on the bus besides us."""

    @property
    def next_due_s(self) -> float: ...

    def on_frame(self, now_s: float, frame: Frame) -> list[tuple[float, Frame]]: ...

    def on_time(self, now_s: float) -> list[tuple[float, Frame]]: ...


class Line:
    """Our master `bus` and its `nodes`; what was sent, heard, measured and told."""

    def __init__(self, rig: RigFile, bus: DriveBus, nodes: Sequence[Node], frame_s: float) -> None:
        self.rig, self.bus, self.nodes = rig, bus, nodes
        self.now_s = 0.0
        self.samples: list[Sample] = []
        self.events: list[Event] = []
        self.sent: list[tuple[float, Frame]] = []
        self.heard: list[tuple[float, Frame]] = []
        self.master_speaks = True
        self.cycle = 0
        self._frame_s = frame_s
        self._queue: list[tuple[float, int, bool, Frame]] = []
        self._count = 0

    def phases(self) -> set[DrivePhase]:
        return {d.phase for d in self.bus}

    def named(self, name: str) -> list[Event]:
        return [e for e in self.events if e.name == name]

    def inject(self, frame: Frame) -> None:
        """A frame from somebody else reaches the master now."""
        self._take(self.now_s, frame)

    def answer(self, frames: Sequence[tuple[float, Frame]]) -> None:
        """Frames that a node sends, each at its instant."""
        for at_s, frame in frames:
            self._push(at_s + self._frame_s, False, frame)

    def send(self, now_s: float, frames: Sequence[Frame]) -> None:
        """Frames that the master sends."""
        for frame in frames:
            self.sent.append((now_s, frame))
            self._push(now_s + self._frame_s, True, frame)

    def drain(self, end_s: float) -> None:
        """Let time pass to `end_s`."""
        while True:
            node_s = min(n.next_due_s for n in self.nodes)
            frame_s = self._queue[0][0] if self._queue else float("inf")
            at_s = min(node_s, frame_s)
            if at_s > end_s:
                break
            self.now_s = max(self.now_s, at_s)
            if frame_s <= node_s:
                _, _, to_nodes, frame = heapq.heappop(self._queue)
                if to_nodes:
                    for node in self.nodes:
                        self.answer(node.on_frame(self.now_s, frame))
                else:
                    self._take(self.now_s, frame)
            else:
                for node in self.nodes:
                    if node.next_due_s <= self.now_s:
                        self.answer(node.on_time(self.now_s))
        self.now_s = max(self.now_s, end_s)

    def _push(self, at_s: float, to_nodes: bool, frame: Frame) -> None:
        self._count += 1
        heapq.heappush(self._queue, (at_s, self._count, to_nodes, frame))

    def _take(self, now_s: float, frame: Frame) -> None:
        self.heard.append((now_s, frame))
        for item in self.bus.on_frame(now_s, frame):
            if isinstance(item, Sample):
                self.samples.append(item)
            else:
                self.events.append(item)
