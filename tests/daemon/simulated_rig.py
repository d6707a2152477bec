"""Helpers for tests that let rig and daemon run in simulated time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from hil.config import RigFile
from hil.configfile import load_drive, load_rig, parse_settings
from hil.daemon.records import EventRecord, FrameRecord, Record, StateRecord
from hil.daemon.simulated import SimulatedSession
from hil.drives.profile import LustProfile
from hil.signals import Cue, TimedPose

PROFILES = {"lust_cdd3000": load_drive("lust_cdd3000", LustProfile)}


def rig_file(name: str = "motorcycle", **tables: dict) -> RigFile:
    """A shipped rig file with some keys of some tables changed."""
    values = load_rig(name).model_dump()
    for table, changes in tables.items():
        values[table].update(changes)
    return parse_settings(values, RigFile, name)


class Session(SimulatedSession):
    """A session that remembers what the core told."""

    def __init__(self, rig: RigFile | None = None, profiles=PROFILES, **options) -> None:
        super().__init__(rig or rig_file(), profiles, **options)
        self.records: list[Record] = []
        self.on_record = self.records.append
        self._seq = 0

    def of(self, kind: type) -> list:
        return [r for r in self.records if isinstance(r, kind)]

    def events(self) -> list[str]:
        return [e.name for e in self.of(EventRecord)]

    def text_of(self, name: str) -> str:
        return next(e.text for e in self.of(EventRecord) if e.name == name)

    def sent(self) -> list[FrameRecord]:
        return [r for r in self.of(FrameRecord) if r.is_sent]

    def state(self) -> StateRecord:
        return self.of(StateRecord)[-1]

    def ride(
        self,
        seconds: float,
        pose: Callable[[float], tuple[float, ...]] | None = None,
        client: str = "rider",
        hz: float = 50.0,
    ) -> None:
        """Cues of `pose(t)`, or of a gentle sway, for so long."""
        start_s = self.now_s
        for k in range(round(seconds * hz)):
            t_s = k / hz
            values = (pose or self.sway)(t_s)
            self._seq += 1
            at_s = start_s + t_s
            self.cue(Cue(client, self._seq, at_s, at_s + 0.002, (TimedPose(0.0, values),)))

    def sway(self, t_s: float) -> tuple[float, ...]:
        return tuple(
            0.2 * limit * math.sin(2.0 * math.pi * 0.4 * t_s + k)
            for k, limit in enumerate(self.rig.limits)
        )

    def engaged(self, seconds: float = 3.0) -> Session:
        """This session, armed and riding for so long."""
        self.arm()
        self.ride(seconds)
        assert self.core.state == "engaged"
        return self

    def powered(self) -> bool:
        return any(self.simulated.plant.mode(i) != "off" for i in range(len(self.rig.actuators)))

    def positions(self) -> Iterator[float]:
        return (self.simulated.plant.position(i) for i in range(len(self.rig.actuators)))
