"""What concerns all CANopen drives of a bus together: SYNC, our heartbeat, and strangers among the nodes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from hil.config import RigFile
from hil.drives.cia402 import codec
from hil.drives.cia402.driver import Cia402Driver
from hil.drives.cia402.meaning import Cia402Meaning
from hil.drives.cia402.profile import Cia402Profile
from hil.drives.profiles import Profiles
from hil.errors import ConfigError
from hil.frames import Frame
from hil.signals import Event, Sample

HEARTBEATS: Final = 4
"""Of ours within the time in which the drives expect one."""
SYNC: Final = Frame(codec.SYNC_ID)


class CanopenBus:
    """The drives of one bus, in the order of `rig`'s actuators; `rig` is the part of a rig on that bus."""

    is_synchronous = True

    def __init__(self, rig: RigFile, profiles: Profiles) -> None:
        self._rig = rig
        files = [_canopen(profiles, a.drive.profile) for a in rig.actuators]
        for i, actuator in enumerate(rig.actuators):
            if not 1 <= rig.address(i) <= codec.LARGEST_NODE:
                raise ConfigError(
                    f"{rig.name}: {actuator.name} has actuators.drive.address {rig.address(i)}; CANopen has "
                    f"nodes 1 to {codec.LARGEST_NODE}"
                )
        self._drivers = tuple(Cia402Driver(rig, i, p) for i, p in enumerate(files))
        self._by_id = {can_id: d for d in self._drivers for can_id in d.ids()}
        masters = frozenset(p.supervision.master_node for p in files)
        for i, actuator in enumerate(rig.actuators):
            if rig.address(i) in masters:
                raise ConfigError(
                    f"{rig.name}: {actuator.name} has node {rig.address(i)}, which is our own heartbeat's "
                    "(supervision.master_node in the drive file): change one of them"
                )
        self.meaning = Cia402Meaning(rig, profiles, masters)
        self._beats = [
            Frame(codec.HEARTBEAT_BASE + node, codec.encode_heartbeat(codec.NmtState.OPERATIONAL))
            for node in sorted(masters)
        ]
        self._listen_s = max(p.timing.listen for p in files)
        self._period_s = rig.safety.drive_watchdog / HEARTBEATS
        self._first_s: float | None = None
        self._beat_s: float | None = None
        self._is_quiet = False
        self._strangers: set[int] = set()
        self._events: list[Event] = []

    def __len__(self) -> int:
        return len(self._drivers)

    def __getitem__(self, index: int) -> Cia402Driver:
        return self._drivers[index]

    def __iter__(self) -> Iterator[Cia402Driver]:
        return iter(self._drivers)

    def on_frame(self, now_s: float, frame: Frame) -> list[Sample | Event]:
        """Hand a received frame to the driver that it concerns, and watch who boots."""
        driver = self._by_id.get(frame.can_id)
        if driver is not None:
            return driver.on_frame(now_s, frame)
        if not frame.is_error and not frame.is_extended and not frame.is_remote:
            self._watch_strangers(now_s, frame.can_id)
        return []

    def on_sync(self, now_s: float) -> list[Frame]:
        """SYNC, as soon as a drive has been started."""
        if not any(d.started for d in self._drivers):
            return []
        for driver in self._drivers:
            driver.on_sync(now_s)
        return [SYNC]

    def on_cycle(self, now_s: float) -> list[Frame]:
        """Our heartbeat where it is due, once we have listened.

        It stops while a drive does not go off: then the drives' own watchdogs take the power, as from a dead
        daemon, those of the others on the bus too.
        """
        if self._first_s is None:
            self._first_s = now_s
        if now_s - self._first_s < self._listen_s:
            return []
        deaf = [d.name for d in self._drivers if d.is_deaf(now_s)]
        if deaf and not self._is_quiet:
            text = f"{', '.join(deaf)} not off although told so: our heartbeat stops, so that watchdogs do it"
            self._events.append(Event(now_s, "warning", "heartbeat_stopped", text))
        self._is_quiet = bool(deaf)
        if deaf:
            return []
        if self._beat_s is not None and now_s - self._beat_s < self._period_s:
            return []
        self._beat_s = now_s
        return self._beats

    def take_events(self) -> list[Event]:
        """Events of the bus and its drivers that `on_frame` has not handed out."""
        events, self._events = self._events, []
        for driver in self._drivers:
            events.extend(driver.take_events())
        return events

    def _watch_strangers(self, now_s: float, can_id: int) -> None:
        node = can_id - codec.HEARTBEAT_BASE
        if 1 <= node <= codec.LARGEST_NODE and node not in self._strangers:
            self._strangers.add(node)
            text = f"node {node} is on the bus, which no actuator of the rig file has"
            self._events.append(Event(now_s, "warning", "unknown_drive", text))


def _canopen(profiles: Profiles, name: str) -> Cia402Profile:
    profile = profiles[name]
    if not isinstance(profile, Cia402Profile):
        raise ConfigError(f"drive file {name!r} is of protocol {profile.protocol}, not canopen")
    return profile
