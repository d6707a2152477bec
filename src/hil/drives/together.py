"""Several buses and several families of one rig as one `DriveBus`.

Each part speaks of its own actuators and its own bus; here they are numbered as in the rig file, and
frames carry the number of their bus.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from hil.drives.driver import DriveBus, DriveDriver, DriveStatus, PowerGoal
from hil.drives.enquiry import Enquiry
from hil.drives.meaning import FrameMeaning, Meaning
from hil.errors import ConfigError
from hil.frames import BUS_SHIFT, EFF_MASK, Frame
from hil.signals import Event, Sample


@dataclass(frozen=True, slots=True)
class Part:
    """The drives of one family on one bus; `actuators` are their places in the rig file."""

    bus: int
    drives: DriveBus
    actuators: tuple[int, ...]

    def marked(self, frames: list[Frame]) -> list[Frame]:
        """The frames with the number of this part's bus."""
        if not self.bus:
            return frames
        return [Frame(i, d, ext, rtr, error, self.bus) for i, d, ext, rtr, error, _ in frames]


class OnBus:
    """A driver whose frames carry its bus."""

    def __init__(self, driver: DriveDriver, part: Part) -> None:
        self.driver = driver
        self.name = driver.name
        self.setpoint_kind = driver.setpoint_kind
        self.wire_kind = driver.wire_kind
        self.numbers = driver.numbers
        self._part = part

    @property
    def status(self) -> DriveStatus:
        """The drive as known now."""
        return self.driver.status

    @property
    def held(self) -> frozenset[int]:
        """Numbers of what hil itself writes."""
        return self.driver.held

    def enquire(self, enquiry: Enquiry) -> None:
        """Read or write an object besides."""
        self.driver.enquire(enquiry)

    def ids(self) -> frozenset[int]:
        """Keys of the frames that it looks at."""
        return frozenset(self._part.bus << BUS_SHIFT | i for i in self.driver.ids())

    def on_frame(self, now_s: float, frame: Frame) -> list[Sample | Event]:
        """Take a frame of its bus."""
        return self.driver.on_frame(now_s, frame) if frame.bus == self._part.bus else []

    def on_slot(self, now_s: float, goal: PowerGoal, setpoint: float | None) -> list[Frame]:
        """Frames of its slot."""
        return self._part.marked(self.driver.on_slot(now_s, goal, setpoint))

    def take_events(self) -> list[Event]:
        """Events not handed out yet."""
        return self.driver.take_events()


class TogetherMeaning:
    """The parts' readings of frames, by bus and identifier."""

    def __init__(self, parts: Sequence[Part]) -> None:
        self.lengths: dict[int, int] = {}
        self._writable = {
            a: p.drives.meaning.writable(i) for p in parts for i, a in enumerate(p.actuators)
        }
        self._of: dict[int, tuple[FrameMeaning, tuple[int, ...]]] = {}
        for part in parts:
            meaning = part.drives.meaning
            for can_id, length in meaning.lengths.items():
                key = part.bus << BUS_SHIFT | can_id
                self.lengths[key] = length
                self._of[key] = (meaning, part.actuators)

    def writable(self, i: int) -> frozenset[int]:
        """What the part of actuator i lets be written to its drive."""
        return self._writable[i]

    def meaning(self, can_id: int, data: bytes) -> Meaning:
        """What a frame asks, its actuator counted as in the rig file; `can_id` is the frame's key."""
        part, actuators = self._of[can_id]
        meant = part.meaning(can_id & EFF_MASK, data)
        if meant.actuator is None:
            return Meaning(*meant[:-1], actuators)
        if actuators[meant.actuator] == meant.actuator:
            return meant
        return Meaning(meant.ask, actuators[meant.actuator], *meant[2:])


class DrivesTogether:
    """All drives of a rig, in the order of its actuators; ConfigError where identifiers collide."""

    def __init__(self, rig_name: str, parts: Sequence[Part], imu_ids: Sequence[int] = ()) -> None:
        self._parts = tuple(parts)
        _check_identifiers(rig_name, self._parts, imu_ids)
        placed = {a: OnBus(d, p) for p in parts for a, d in zip(p.actuators, p.drives, strict=True)}
        self._drivers = tuple(placed[a] for a in sorted(placed))
        self.meaning = TogetherMeaning(self._parts)
        self._on_bus = {
            bus: tuple(p.drives for p in self._parts if p.bus == bus)
            for bus in {p.bus for p in self._parts}
        }
        self.is_synchronous = any(p.drives.is_synchronous for p in parts)

    def __len__(self) -> int:
        return len(self._drivers)

    def __getitem__(self, index: int) -> OnBus:
        return self._drivers[index]

    def __iter__(self) -> Iterator[OnBus]:
        return iter(self._drivers)

    def on_frame(self, now_s: float, frame: Frame) -> list[Sample | Event]:
        """Hand a received frame to the parts on its bus."""
        on_bus = self._on_bus.get(frame.bus, ())
        if len(on_bus) == 1:
            return on_bus[0].on_frame(now_s, frame)
        return [said for drives in on_bus for said in drives.on_frame(now_s, frame)]

    def on_sync(self, now_s: float) -> list[Frame]:
        """SYNC of every bus that has one."""
        return [f for p in self._parts for f in p.marked(p.drives.on_sync(now_s))]

    def on_cycle(self, now_s: float) -> list[Frame]:
        """Frames that concern whole buses."""
        return [f for p in self._parts for f in p.marked(p.drives.on_cycle(now_s))]

    def take_events(self) -> list[Event]:
        """Events of all parts."""
        return [e for p in self._parts for e in p.drives.take_events()]


def _check_identifiers(rig_name: str, parts: Sequence[Part], imu_ids: Sequence[int]) -> None:
    taken: dict[int, str] = dict.fromkeys(imu_ids, "the IMU")
    for part in parts:
        names = dict.fromkeys(part.drives.meaning.lengths, "our frames to " + part.drives[0].name)
        for driver in part.drives:
            names |= dict.fromkeys(driver.ids() - names.keys(), driver.name)
        for can_id, whose in names.items():
            key = part.bus << BUS_SHIFT | can_id
            if key in taken:
                raise ConfigError(
                    f"{rig_name}: identifier {can_id:#05x} on bus {part.bus} is {whose}'s and "
                    f"{taken[key]}'s: change actuators.drive.address, actuators.drive.bus or can.imu_base_id"
                )
            taken[key] = whose
