"""Two ways to one drive's objects: over the bus, by a desk of ours, or through the daemon that runs the rig.

Both families: SDO transfers of a CiA 402 drive, parameter requests of a LUST drive.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

from hil.client import RigClient
from hil.config import RigFile
from hil.drives.cia402 import codec as canopen
from hil.drives.cia402.meaning import number_of
from hil.drives.cia402.sdo import Transfer
from hil.drives.lust_cdd3000 import codec as lust
from hil.drives.profile import LustProfile
from hil.drives.profiles import DriveProfile, Profiles
from hil.errors import CommandRefused, ConfigError, DriveError
from hil.frames import Frame

ANSWER_S: Final = 0.3
TRIES: Final = 3
ABSENT: Final = "is it powered, on this bus, at this bit rate and address, and of this family?"


class NoAnswer(DriveError):
    """The drive says nothing at all."""


class Access(Protocol):
    """A drive whose objects can be read and written; DriveError says why one was not."""

    profile: DriveProfile

    def transfer(self, transfer: Transfer) -> bytes:
        """Do an SDO transfer; returns what was read."""

    def exchange(self, request: lust.Request) -> int:
        """Put a question on the parameter channel; returns the answer's value."""


class Bus(Protocol):
    """What a way over the bus needs: frames out through the gate, frames in, and whose drive it is."""

    rig: RigFile
    profile: DriveProfile

    def send(self, frame: Frame) -> None:
        """One frame, through the gate."""

    def ask(self, frame: Frame, take: Callable[[Frame], bool], within_s: float) -> bool:
        """Send a frame and hand what comes to `take` until it says that this was it."""


class OverBus:
    """The rig's only drive, `actuators[0]`, over `bus`."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self.profile = bus.profile
        self._address = bus.rig.address(0)
        self._name = bus.rig.actuators[0].name

    def transfer(self, transfer: Transfer) -> bytes:
        """Do an SDO transfer; asked again where no answer comes."""
        ids = canopen.node_ids(self._address)
        who = f"{self._name} (node {self._address})"

        def take(frame: Frame) -> bool:
            if frame.can_id != ids.sdo_answer or not transfer.fits(frame.data):
                return False
            abort = transfer.take(frame.data)
            if abort is not None:
                self._bus.send(Frame(ids.sdo_request, abort))
            return True

        for _ in range(TRIES):
            while not transfer.is_done and self._bus.ask(
                Frame(ids.sdo_request, transfer.request), take, ANSWER_S
            ):
                pass
            if transfer.is_done:
                break
        if not transfer.is_done:
            raise NoAnswer(f"{who} does not answer: {transfer}; {ABSENT}")
        if transfer.error is not None:
            raise DriveError(f"{who}: {transfer.error}")
        return transfer.result

    def exchange(self, request: lust.Request) -> int:
        """Put a question on the parameter channel, again where the drive wants it repeated."""
        assert isinstance(self.profile, LustProfile)
        ids = lust.frame_ids(self.profile.ids, self._address)
        found: list[lust.Answer] = []

        def take(frame: Frame) -> bool:
            if frame.can_id != ids.answer:
                return False
            answer = lust.decode_answer(frame.data)
            if answer.number == request.number:
                found.append(answer)
            return bool(found)

        for _ in range(TRIES):
            asked = lust.encode_request(ids.request, request)
            if self._bus.ask(asked, take, ANSWER_S) and found:
                answer = found.pop()
                if not answer.status & lust.AnswerStatus.REPEAT_ACTION:
                    if answer.status:
                        raise DriveError(
                            f"{self._name}: parameter {request.number}: {answer.status}"
                        )
                    return answer.value
        raise NoAnswer(f"{self._name} does not answer: parameter {request.number}; {ABSENT}")


class ThroughDaemon:
    """A drive of a rig that a daemon runs: it asks between its own requests, and refuses what is not safe."""

    def __init__(self, client: RigClient, rig: RigFile, profiles: Profiles, actuator: str) -> None:
        if actuator not in rig.actuator_names:
            known = ", ".join(rig.actuator_names)
            raise ConfigError(f"{rig.name} has no actuator {actuator!r}, only {known}")
        drive = rig.actuators[rig.actuator_names.index(actuator)].drive
        self.profile: DriveProfile = profiles[drive.profile]
        self._client, self._actuator = client, actuator

    def transfer(self, transfer: Transfer) -> bytes:
        """Have the daemon do an SDO transfer."""
        return self._ask(number_of(transfer.index, transfer.sub), transfer.data)

    def exchange(self, request: lust.Request) -> int:
        """Have the daemon put a question on the parameter channel."""
        is_write = request.mode == lust.Mode.WRITE
        data = request.value.to_bytes(4, "little", signed=True) if is_write else None
        return int.from_bytes(self._ask(request.number, data), "little", signed=True)

    def _ask(self, number: int, data: bytes | None) -> bytes:
        what = f"read {number:x}" if data is None else f"write {number:x} {data.hex()}"
        reply = self._client.command("object", request=f"{self._actuator} {what}")
        if not reply.ok:
            kind = DriveError if data is None else CommandRefused
            raise kind(reply.message)
        return bytes.fromhex(reply.message)
