"""What concerns all CANLust drives of a bus together: the stride check, System Start and System Stop.

The stride. Every log-on identifier on the bus must belong to a drive of the rig file. One that would belong
to a drive at the other stride says that the drive file's stride is wrong: then every drive is refused, and
nothing is said on the bus. Drives are spoken to only after a time of listening in which each would have
logged on twice, so a wrong stride never reaches the wrong drive.

System Start goes out once all drives are configured, and again only when a drive has restarted and none is
enabled: from then on control words act, and every drive's watchdog runs. A drive that came up with a fault
needs it earlier, because before it the drive stores the reset and does not do it: then it goes out once every
drive has been told to be off. System Stop goes out once for a
drive that does not log on, while none is enabled: drives that ran before (under a daemon that died) log on
anew at System Stop, where their firmware does as the manual says (user manual CM-CAN1, 5-2).
"""

from __future__ import annotations

from collections.abc import Iterator

from hil.config import RigFile
from hil.drives.driver import DrivePhase
from hil.drives.lust_cdd3000.codec import encode_system
from hil.drives.lust_cdd3000.driver import LustDriver
from hil.drives.meaning import CanlustMeaning
from hil.drives.profile import GROUP, LustProfile
from hil.frames import Frame
from hil.signals import Event, Sample

_CONFIGURED = (DrivePhase.CONFIGURED, DrivePhase.READY)


class LustBus:
    """The drives of a rig, in the order of its actuators, and the bus that they share."""

    is_synchronous = False

    def __init__(self, rig: RigFile, profile: LustProfile) -> None:
        self._profile = profile
        self._drivers = tuple(LustDriver(rig, i, profile) for i in range(len(rig.actuators)))
        self.meaning = CanlustMeaning(rig, profile, self._drivers[0].setpoint_kind)
        self._by_id: dict[int, list[LustDriver]] = {}
        for driver in self._drivers:
            for can_id in driver.ids():
                self._by_id.setdefault(can_id, []).append(driver)
        base, stride = profile.ids.log_on, profile.ids.stride
        addresses = [rig.address(i) for i in range(len(self._drivers))]
        self._log_ons = frozenset(base + stride * a for a in addresses)
        self._other_stride = 3 - stride
        self._mismatches = {base + self._other_stride * a for a in addresses} - self._log_ons
        self._strangers: set[int] = set()
        self._stop_sent: set[str] = set()
        self._events: list[Event] = []

    def __len__(self) -> int:
        return len(self._drivers)

    def __getitem__(self, index: int) -> LustDriver:
        return self._drivers[index]

    def __iter__(self) -> Iterator[LustDriver]:
        return iter(self._drivers)

    def on_frame(self, now_s: float, frame: Frame) -> list[Sample | Event]:
        """Hand a received frame to the drivers that it concerns, and watch who logs on."""
        if frame.is_error or frame.is_extended:
            return []
        base = self._profile.ids.log_on
        if base <= frame.can_id < base + GROUP and frame.can_id not in self._log_ons:
            if not frame.is_remote:
                self._on_stranger(now_s, frame.can_id)
            return list(self.take_events())
        out: list[Sample | Event] = []
        for driver in self._by_id.get(frame.can_id, ()):
            out.extend(driver.on_frame(now_s, frame))
        return out

    def on_sync(self, now_s: float) -> list[Frame]:
        """CANLust has no common instant."""
        return []

    def on_cycle(self, now_s: float) -> list[Frame]:
        """System Start or System Stop where it is due. Call once each cycle, before the slots."""
        drivers = self._drivers
        if any(d.phase is DrivePhase.ENABLED for d in drivers):
            return []
        for driver in drivers:
            if driver.phase is not DrivePhase.ABSENT:
                self._stop_sent.discard(driver.name)
        if all(d.phase in _CONFIGURED for d in drivers) and not all(d.started for d in drivers):
            return self._start(now_s, "all drives are configured")
        if all(d.told for d in drivers) and any(d.needs_start for d in drivers):
            return self._start(now_s, "a drive is to be reset, and all are told to be off")
        listen_s = self._profile.timing.listen
        late = [d for d in drivers if d.absent_for(now_s) > listen_s]
        if not late or all(d.name in self._stop_sent for d in late):
            return []
        names = ", ".join(d.name for d in late)
        self._stop_sent.update(d.name for d in drivers)
        for driver in drivers:
            driver.system_stopped(now_s)
        self._say(
            now_s,
            "system_stop",
            f"{names} did not log on: System Stop is sent, so that all do again",
        )
        return [encode_system(self._profile.ids, self._profile.system.stop)]

    def take_events(self) -> list[Event]:
        """Events of the bus and its drivers that `on_frame` has not handed out."""
        events, self._events = self._events, []
        for driver in self._drivers:
            events.extend(driver.take_events())
        return events

    def _start(self, now_s: float, why: str) -> list[Frame]:
        for driver in self._drivers:
            driver.system_started()
        self._say(now_s, "system_start", f"{why}: System Start is sent")
        return [encode_system(self._profile.ids, self._profile.system.start)]

    def _on_stranger(self, now_s: float, can_id: int) -> None:
        offset = can_id - self._profile.ids.log_on
        if can_id in self._mismatches and not any(
            d.phase in (DrivePhase.READY, DrivePhase.ENABLED) for d in self._drivers
        ):
            text = (
                f"cannot be armed: a drive logs on as {can_id:#x}, which is address "
                f"{offset // self._other_stride} at stride {self._other_stride}, but the drive file "
                f"says stride {self._profile.ids.stride}. Set ids.stride = {self._other_stride} there, "
                "or correct the addresses"
            )
            for driver in self._drivers:
                driver.refuse(now_s, "stride_mismatch", text)
        elif can_id not in self._strangers:
            self._strangers.add(can_id)
            self._say(
                now_s,
                "unknown_drive",
                f"a drive logs on as {can_id:#x} (address {offset // self._profile.ids.stride}), "
                "which no actuator of the rig file has",
                warning=True,
            )

    def _say(self, now_s: float, name: str, text: str, *, warning: bool = False) -> None:
        self._events.append(Event(now_s, "warning" if warning else "info", name, text))
