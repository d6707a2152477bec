"""A LustBus and simulated drives on a bus of bare Python, in simulated time."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from hil.bus.load import RECKONED_BITS
from hil.config import RigFile
from hil.configfile import load_drive
from hil.drives.driver import DrivePhase, PowerGoal
from hil.drives.lust_cdd3000.bus import LustBus
from hil.drives.profile import LustProfile
from hil.sim.lust.drive import SimulatedCdd3000
from tests.drives import line
from tests.drives.line import Line, changed

FRAME_S = RECKONED_BITS / 500_000


def profile_of(**changes: object) -> LustProfile:
    """The shipped drive file with tables or keys changed: `layout={"kind": "posmod"}`."""
    tables = changed(load_drive("lust_cdd3000", LustProfile).model_dump(), changes)
    return LustProfile.model_validate(tables)


def rig_of(name: str = "axis", **changes: object) -> RigFile:
    """A shipped rig file with tables changed."""
    return line.rig_of(name, **changes)


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


class Exchange(Line):
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
        self.plant = plant or StandIn(rig)
        streams = np.random.default_rng(7).spawn(len(rig.actuators))
        self.drives = [
            SimulatedCdd3000(rig, i, self.plant, drives_profile or profile, streams[i])
            for i in range(len(rig.actuators))
        ]
        super().__init__(rig, LustBus(rig, profile), self.drives, FRAME_S)

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
        end = self.cycle + round(seconds / self.rig.bus.cycle)
        while self.cycle < end:
            start_s = self.cycle * self.rig.bus.cycle
            self.cycle += 1
            self.drain(start_s)
            if self.master_speaks:
                self.send(start_s, self.bus.on_cycle(start_s))
                for i, driver in enumerate(self.bus):
                    at_s = start_s + i * self.rig.bus.stagger
                    self.drain(at_s)
                    self.send(at_s, driver.on_slot(at_s, goal, wanted[i]))
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
