"""A bus of bare Python between our CANopen master and nodes, in simulated time: frames take 0.1 ms."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from hil.config import RigFile
from hil.drivefiles import load_profile
from hil.drives.cia402.bus import CanopenBus
from hil.drives.cia402.profile import Cia402Profile
from hil.drives.driver import DrivePhase, PowerGoal
from hil.sim.cia402.drive import SimulatedCia402
from tests.drives import line
from tests.drives.exchange import StandIn
from tests.drives.line import Line, Node, changed

FRAME_S = 1e-4


def profile_of(**changes: object) -> Cia402Profile:
    """The shipped drive file with tables changed, and its EDS."""
    shipped = load_profile("cia402")
    assert isinstance(shipped, Cia402Profile)
    tables = changed(shipped.model_dump(), changes)
    return Cia402Profile.model_validate(tables).with_objects(shipped.objects)


def rig_of(name: str = "axis_canopen", **changes: object) -> RigFile:
    """A shipped rig file with tables changed."""
    return line.rig_of(name, **changes)


def with_drive(rig: RigFile, **changes: object) -> RigFile:
    """All drives of `rig` with keys of actuators.drive changed."""
    changed = [
        a.model_copy(update={"drive": a.drive.model_copy(update=changes)}) for a in rig.actuators
    ]
    return rig.model_copy(update={"actuators": tuple(changed)})


class Exchange(Line):
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
        rig = rig or rig_of()
        self.profile = profile or profile_of()
        self.plant = plant or StandIn(rig)
        streams = np.random.default_rng(3).spawn(len(rig.actuators))
        self.drives = [
            SimulatedCia402(rig, i, self.plant, theirs or self.profile, streams[i])
            for i in range(len(rig.actuators))
        ]
        names = {a.drive.profile for a in rig.actuators}
        bus = CanopenBus(rig, dict.fromkeys(names, self.profile))
        super().__init__(rig, bus, self.drives if nodes is None else nodes, FRAME_S)

    def run(
        self,
        seconds: float,
        goal: PowerGoal = PowerGoal.OFF,
        setpoints: Callable[[float], Sequence[float]] | None = None,
        *,
        until: Callable[[], bool] | None = None,
    ) -> bool:
        """Let `seconds` pass, or less where `until` comes true; returns whether it did."""
        end = self.cycle + round(seconds / self.rig.bus.cycle)
        while self.cycle < end:
            start_s = self.cycle * self.rig.bus.cycle
            self.cycle += 1
            self.drain(start_s)
            if self.master_speaks:
                self.send(start_s, self.bus.on_sync(start_s))
                self.send(start_s, self.bus.on_cycle(start_s))
                wanted = setpoints(start_s) if setpoints else [None] * len(self.bus)
                for driver, value in zip(self.bus, wanted, strict=True):
                    self.send(start_s, driver.on_slot(start_s, goal, value))
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

    def error(self) -> str:
        """Why the only drive is in fault."""
        return self.bus[0].status.error or ""
