"""A bus of bare Python between a LustBus and simulated drives, in simulated time.

Frames take `FRAME_S` each way and never collide: arbitration is another module's affair.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence

import numpy as np

from hil.config import RigFile
from hil.configfile import load_drive, load_rig
from hil.drives.driver import DrivePhase, PowerGoal
from hil.drives.lust_cdd3000.bus import LustBus
from hil.drives.profile import LustProfile
from hil.frames import Frame
from hil.signals import Event, Sample
from hil.sim.lust import SimulatedCdd3000

FRAME_S = 125 / 500_000


def profile_of(**changes: object) -> LustProfile:
    """The shipped drive file with tables or keys changed: `layout={"kind": "posmod"}`."""
    tables = load_drive("lust_cdd3000", LustProfile).model_dump()
    for key, value in changes.items():
        tables[key] = {**tables[key], **value} if isinstance(value, dict) else value
    return LustProfile.model_validate(tables)


def rig_of(name: str = "axis", **changes: object) -> RigFile:
    """A shipped rig file with tables changed: `safety={"drive_watchdog": 0.2}`."""
    tables = load_rig(name).model_dump(exclude={"geometry": {"kind"}})
    for key, value in changes.items():
        tables[key] = {**tables[key], **value} if isinstance(value, dict) else value
    return RigFile.model_validate(tables)


class StandIn:
    """A plant without mechanics: follows position setpoints at once, keeps what it is told."""

    def __init__(self, rig: RigFile) -> None:
        n = len(rig.actuators)
        self.rig = rig
        self.now_s = 0.0
        self.modes = ["off"] * n
        self.positions = [a.home for a in rig.actuators]
        self.forces = [0.0] * n
        self.gains: list[dict[str, float]] = [{} for _ in range(n)]
        self.parameters = np.ones(1)
        self.table = self

    def index(self, _name: str) -> int:
        return 0

    def advance(self, to_s: float) -> None:
        self.now_s = max(self.now_s, to_s)

    def set_mode(self, i: int, mode: str) -> None:
        self.modes[i] = mode

    def set_setpoint(self, i: int, value: float, _at_s: float) -> None:
        if self.modes[i] == "position":
            self.positions[i] = value
        elif self.modes[i] == "force":
            self.forces[i] = value

    def set_gains(self, i: int, **gains: float) -> None:
        self.gains[i] |= gains

    def position(self, i: int) -> float:
        return self.positions[i]

    def velocity(self, _i: int) -> float:
        return 0.0

    def answer(self, i: int, quantity: str, _at_s: float, noise: float) -> float:
        return {"position": self.positions[i], "force": self.forces[i]}.get(quantity, 0.0) + noise


class Exchange:
    """Master and drives on one bus. `run` lets time pass in cycles, as the control loop does."""

    def __init__(
        self,
        rig: RigFile,
        profile: LustProfile | None = None,
        *,
        drives_profile: LustProfile | None = None,
        plant: object | None = None,
    ) -> None:
        profile = profile or profile_of()
        self.rig = rig
        self.plant = plant or StandIn(rig)
        self.bus = LustBus(rig, profile)
        streams = np.random.default_rng(7).spawn(len(rig.actuators))
        self.drives = [
            SimulatedCdd3000(rig, i, self.plant, drives_profile or profile, streams[i])
            for i in range(len(rig.actuators))
        ]
        self.now_s = 0.0
        self.samples: list[Sample] = []
        self.events: list[Event] = []
        self.sent: list[tuple[float, Frame]] = []
        self.master_speaks = True
        self._cycle = 0
        self._queue: list[tuple[float, int, bool, Frame]] = []
        self._count = 0

    def run(
        self,
        seconds: float,
        goal: PowerGoal = PowerGoal.OFF,
        setpoints: Sequence[float | None] | None = None,
        *,
        until: Callable[[], bool] | None = None,
    ) -> bool:
        """Let `seconds` pass, or less where `until` comes true; returns whether it did."""
        wanted = setpoints or [None] * len(self.bus)
        end = self._cycle + round(seconds / self.rig.bus.cycle)
        while self._cycle < end:
            start_s = self._cycle * self.rig.bus.cycle
            self._cycle += 1
            self._drain(start_s)
            if self.master_speaks:
                self._send(start_s, self.bus.on_cycle(start_s))
                for i, driver in enumerate(self.bus):
                    at_s = start_s + i * self.rig.bus.stagger
                    self._drain(at_s)
                    self._send(at_s, driver.on_slot(at_s, goal, wanted[i]))
                self.events += self.bus.take_events()
            if until is not None and until():
                return True
        return False

    def arm(self) -> None:
        """Run until every drive is ready."""
        assert self.run(3.0, until=lambda: self.phases() == {DrivePhase.READY}), [
            d.status for d in self.bus
        ]

    def enable(self) -> None:
        """Arm, and enable every drive where it stands."""
        self.arm()
        assert self.run(0.5, PowerGoal.ON, until=lambda: self.phases() == {DrivePhase.ENABLED})

    def phases(self) -> set[DrivePhase]:
        return {d.phase for d in self.bus}

    def named(self, name: str) -> list[Event]:
        return [e for e in self.events if e.name == name]

    def inject(self, frame: Frame) -> None:
        """A frame from somebody else reaches the master now."""
        self._take(self.now_s, frame)

    def _send(self, now_s: float, frames: Sequence[Frame]) -> None:
        for frame in frames:
            self.sent.append((now_s, frame))
            self._push(now_s + FRAME_S, True, frame)

    def _push(self, at_s: float, to_drives: bool, frame: Frame) -> None:
        self._count += 1
        heapq.heappush(self._queue, (at_s, self._count, to_drives, frame))

    def _drain(self, end_s: float) -> None:
        while True:
            drive_s = min(d.next_due_s for d in self.drives)
            frame_s = self._queue[0][0] if self._queue else float("inf")
            at_s = min(drive_s, frame_s)
            if at_s > end_s:
                break
            self.now_s = max(self.now_s, at_s)
            if frame_s <= drive_s:
                at_s, _, to_drives, frame = heapq.heappop(self._queue)
                if to_drives:
                    for drive in self.drives:
                        self._answer(drive.on_frame(self.now_s, frame))
                else:
                    self._take(self.now_s, frame)
            else:
                for drive in self.drives:
                    if drive.next_due_s <= self.now_s:
                        self._answer(drive.on_time(self.now_s))
        self.now_s = max(self.now_s, end_s)

    def _answer(self, frames: Sequence[tuple[float, Frame]]) -> None:
        for at_s, frame in frames:
            self._push(at_s + FRAME_S, False, frame)

    def _take(self, now_s: float, frame: Frame) -> None:
        for item in self.bus.on_frame(now_s, frame):
            if isinstance(item, Sample):
                self.samples.append(item)
            else:
                self.events.append(item)
