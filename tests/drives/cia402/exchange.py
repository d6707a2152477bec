"""A bus of bare Python between our CANopen master and nodes, in simulated time: frames take 0.1 ms."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from hil.config import RigFile
from hil.configfile import load_rig, parse_settings
from hil.drivefiles import load_profile
from hil.drives.cia402.bus import CanopenBus
from hil.drives.cia402.profile import Cia402Profile
from hil.drives.driver import DrivePhase, PowerGoal
from hil.frames import Frame
from hil.signals import Event, Sample
from hil.sim.cia402 import SimulatedCia402
from tests.drives.exchange import StandIn

FRAME_S = 1e-4


def profile_of(**changes: object) -> Cia402Profile:
    """The shipped drive file with tables changed, and its EDS."""
    shipped = load_profile("cia402")
    assert isinstance(shipped, Cia402Profile)
    tables = shipped.model_dump()
    for key, value in changes.items():
        tables[key] = {**tables[key], **value} if isinstance(value, dict) else value
    return Cia402Profile.model_validate(tables).with_objects(shipped.objects)


def rig_of(name: str = "axis_canopen", **changes: object) -> RigFile:
    """A shipped rig file with tables changed."""
    tables = load_rig(name).model_dump()
    for key, value in changes.items():
        tables[key] = {**tables[key], **value} if isinstance(value, dict) else value
    return parse_settings(tables, RigFile, name)


def with_drive(rig: RigFile, **changes: object) -> RigFile:
    """All drives of `rig` with keys of actuators.drive changed."""
    changed = [
        a.model_copy(update={"drive": a.drive.model_copy(update=changes)}) for a in rig.actuators
    ]
    return rig.model_copy(update={"actuators": tuple(changed)})


class Node(Protocol):
    """Somebody on the bus besides us."""

    @property
    def next_due_s(self) -> float: ...

    def on_frame(self, now_s: float, frame: Frame) -> list[tuple[float, Frame]]: ...

    def on_time(self, now_s: float) -> list[tuple[float, Frame]]: ...


class Exchange:
    """Our master of one bus and its nodes. `run` lets time pass in cycles, as the control loop does."""

    def __init__(
        self,
        rig: RigFile | None = None,
        profile: Cia402Profile | None = None,
        *,
        theirs: Cia402Profile | None = None,
        nodes: Sequence[Node] | None = None,
        plant: object | None = None,
    ) -> None:
        self.rig = rig or rig_of()
        self.profile = profile or profile_of()
        names = {a.drive.profile for a in self.rig.actuators}
        self.bus = CanopenBus(self.rig, dict.fromkeys(names, self.profile))
        self.plant = plant or StandIn(self.rig)
        streams = np.random.default_rng(3).spawn(len(self.rig.actuators))
        self.drives = [
            SimulatedCia402(self.rig, i, self.plant, theirs or self.profile, streams[i])
            for i in range(len(self.rig.actuators))
        ]
        self.nodes: Sequence[Node] = self.drives if nodes is None else nodes
        self.now_s = 0.0
        self.samples: list[Sample] = []
        self.events: list[Event] = []
        self.sent: list[tuple[float, Frame]] = []
        self.heard: list[tuple[float, Frame]] = []
        self.master_speaks = True
        self._cycle = 0
        self._queue: list[tuple[float, int, bool, Frame]] = []
        self._count = 0

    def run(
        self,
        seconds: float,
        goal: PowerGoal = PowerGoal.OFF,
        setpoints: Callable[[float], Sequence[float]] | None = None,
        *,
        until: Callable[[], bool] | None = None,
    ) -> bool:
        """Let `seconds` pass, or less where `until` comes true; returns whether it did."""
        end = self._cycle + round(seconds / self.rig.bus.cycle)
        while self._cycle < end:
            start_s = self._cycle * self.rig.bus.cycle
            self._cycle += 1
            self._drain(start_s)
            if self.master_speaks:
                self._send(start_s, self.bus.on_sync(start_s))
                self._send(start_s, self.bus.on_cycle(start_s))
                wanted = setpoints(start_s) if setpoints else [None] * len(self.bus)
                for driver, value in zip(self.bus, wanted, strict=True):
                    self._send(start_s, driver.on_slot(start_s, goal, value))
                self.events += self.bus.take_events()
            if until is not None and until():
                return True
        return False

    def reach(
        self, phase: DrivePhase, goal: PowerGoal = PowerGoal.OFF, within_s: float = 3.0
    ) -> None:
        """Run until every drive is in `phase`."""
        assert self.run(within_s, goal, until=lambda: self.phases() == {phase}), [
            d.status for d in self.bus
        ]

    def enable(self) -> None:
        """Up to force, where the drives stand."""
        self.reach(DrivePhase.READY)
        self.reach(DrivePhase.ENABLED, PowerGoal.ON, 0.5)

    def phases(self) -> set[DrivePhase]:
        return {d.phase for d in self.bus}

    def error(self) -> str:
        """Why the only drive is in fault."""
        return self.bus[0].status.error or ""

    def named(self, name: str) -> list[Event]:
        return [e for e in self.events if e.name == name]

    def inject(self, frame: Frame) -> None:
        """A frame reaches the master now."""
        self._take(self.now_s, frame)

    def _send(self, now_s: float, frames: Sequence[Frame]) -> None:
        for frame in frames:
            self.sent.append((now_s, frame))
            self._push(now_s + FRAME_S, True, frame)

    def _push(self, at_s: float, to_nodes: bool, frame: Frame) -> None:
        self._count += 1
        heapq.heappush(self._queue, (at_s, self._count, to_nodes, frame))

    def _drain(self, end_s: float) -> None:
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
                        self._answer(node.on_frame(self.now_s, frame))
                else:
                    self._take(self.now_s, frame)
            else:
                for node in self.nodes:
                    if node.next_due_s <= self.now_s:
                        self._answer(node.on_time(self.now_s))
        self.now_s = max(self.now_s, end_s)

    def _answer(self, frames: Sequence[tuple[float, Frame]]) -> None:
        for at_s, frame in frames:
            self._push(at_s + FRAME_S, False, frame)

    def _take(self, now_s: float, frame: Frame) -> None:
        self.heard.append((now_s, frame))
        for item in self.bus.on_frame(now_s, frame):
            if isinstance(item, Sample):
                self.samples.append(item)
            else:
                self.events.append(item)
