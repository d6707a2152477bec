"""What persons ask of single drives while the rig runs: objects read, and written while the drives are off.

A request is a line of text, `ACTUATOR read NUMBER` or `ACTUATOR write NUMBER BYTES`, both in hexadecimal.
Nothing is written while the rig is armed or drives are powered; nothing, ever, that hil itself writes to the
drive and has verified. The rig is not armed while a write is under way; of a write and an arm in one cycle
the later one is refused.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from hil.daemon.records import CommandRecord, ReplyRecord
from hil.drives.driver import DriveBus, DriveDriver, DrivePhase
from hil.drives.enquiry import Enquiry
from hil.errors import ProtocolError
from hil.safety import Gate

TIMEOUT_S: Final = 3.0
"""An answer later than this is none: the gateway waits a little longer."""
MOST: Final = 8
"""Enquiries that may wait at a time."""
LONGEST: Final = 400
"""Bytes of an answer that a reply holds, in hexadecimal."""


class _Waiting(NamedTuple):
    command_id: int
    enquiry: Enquiry
    until_s: float
    who: str


class Enquiries:
    """The enquiries that wait for their drives."""

    def __init__(self, drives: DriveBus, gate: Gate) -> None:
        self._drives = {driver.name: (i, driver) for i, driver in enumerate(drives)}
        self._gate = gate
        self._waiting: list[_Waiting] = []

    @property
    def is_writing(self) -> bool:
        """Whether a write is under way."""
        return any(w.enquiry.data is not None for w in self._waiting)

    def begin(self, now_s: float, command: CommandRecord, *, is_arming: bool) -> ReplyRecord | None:
        """Take a request; its reply where it is refused at once. `is_arming`: the next cycle may arm."""
        try:
            i, driver, enquiry = self._parse(command.argument)
            self._judge(i, driver, enquiry, is_arming=is_arming)
        except ProtocolError as error:
            return ReplyRecord(command.command_id, False, str(error))
        driver.enquire(enquiry)
        until_s = now_s + TIMEOUT_S
        self._waiting.append(_Waiting(command.command_id, enquiry, until_s, driver.name))
        return None

    def replies(self, now_s: float) -> list[ReplyRecord]:
        """Replies to what has been answered, or has not in time."""
        if not self._waiting:
            return []
        replies, left = [], []
        for w in self._waiting:
            if not w.enquiry.is_done and now_s > w.until_s:
                w.enquiry.failed(f"not done within {TIMEOUT_S:g} s, and withdrawn")
            if not w.enquiry.is_done:
                left.append(w)
            elif w.enquiry.error is not None:
                replies.append(ReplyRecord(w.command_id, False, f"{w.who}: {w.enquiry.error}"))
            else:
                replies.append(ReplyRecord(w.command_id, True, w.enquiry.result[:LONGEST].hex()))
        self._waiting = left
        return replies

    def _parse(self, text: str) -> tuple[int, DriveDriver, Enquiry]:
        words = text.split()
        if len(words) not in (3, 4) or words[1] != ("read", "write")[len(words) - 3]:
            raise ProtocolError(
                f"{text!r} is neither 'ACTUATOR read NUMBER' nor a write with bytes"
            )
        if words[0] not in self._drives:
            raise ProtocolError(f"there is no actuator {words[0]!r}")
        i, driver = self._drives[words[0]]
        try:
            number, data = int(words[2], 16), [bytes.fromhex(w) for w in words[3:]]
        except ValueError:
            raise ProtocolError(f"{' '.join(words[2:])!r} is not hexadecimal") from None
        if number not in driver.numbers:
            raise ProtocolError(f"{driver.name} has numbers up to {driver.numbers[-1]:x}")
        return i, driver, Enquiry(number, *data)

    def _judge(self, i: int, driver: DriveDriver, enquiry: Enquiry, *, is_arming: bool) -> None:
        if len(self._waiting) >= MOST:
            raise ProtocolError("too many enquiries wait for their drives")
        if driver.status.phase is DrivePhase.ABSENT:
            raise ProtocolError(f"{driver.name} is not on the bus: {driver.status.waiting_for}")
        if enquiry.data is None:
            return
        if enquiry.number in driver.held:
            raise ProtocolError(
                f"{driver.name}: that is what hil itself writes and has verified: change the rig file or the "
                "drive file"
            )
        if self._gate.armed:
            raise ProtocolError("nothing is written while the rig is armed: disarm it first")
        if is_arming:
            raise ProtocolError("nothing is written while the rig is being armed or parked")
        broken = self._gate.refuses_write(i, enquiry.number)
        if broken:
            raise ProtocolError(f"{driver.name}: {broken}")
