"""CANLust a second time, with python-can and cantools and nothing of hil: a master and a drive.

All they know of the protocol is drives/lust_cdd3000/frames.dbc and the numbers below, which stand in the
user manual CM-CAN1 and in drives/lust_cdd3000/drive.toml. What speaks with these does not only agree with
itself.
"""

from __future__ import annotations

import struct
import threading
import time
from pathlib import Path
from typing import Any

import can
import cantools

DBC = Path(__file__).parents[2] / "drives" / "lust_cdd3000" / "frames.dbc"
WRITE, READ = 2, 5
DISABLE, PREPARE, ENABLE, RESET = 0x00, 0x06, 0x0F, 0x80
SWITCHED_OFF, READY, ENABLED = 0x0240, 0x0231, 0x0237  # manual 7-4
WATCHDOG, POSITION = 574, 400


class Node:
    """Sends and receives messages of the DBC by name and signal."""

    def __init__(self, channel: str) -> None:
        self.messages: Any = cantools.database.load_file(DBC)
        self.bus = can.Bus(interface="socketcan", channel=channel)

    def send(self, name: str, **signals: int) -> None:
        message = self.messages.get_message_by_name(name)
        data = message.encode(
            {signal.name: signals.get(signal.name, 0) for signal in message.signals}
        )
        self.bus.send(can.Message(arbitration_id=message.frame_id, data=data, is_extended_id=False))

    def receive(self, timeout_s: float) -> tuple[str, dict[str, int]] | None:
        """The next message that the DBC knows, or None."""
        frame = self.bus.recv(timeout_s)
        if frame is None:
            return None
        try:
            message = self.messages.get_message_by_frame_id(frame.arbitration_id)
        except KeyError:  # the IMU's
            return None
        return message.name, message.decode(
            bytes(frame.data), decode_choices=False
        ) if message.length else {}

    def close(self) -> None:
        self.bus.shutdown()


class Master(Node):
    """Asks a drive at address 1, one thing at a time."""

    def wait(self, name: str, timeout_s: float = 10.0) -> dict[str, int]:
        """The signals of the next message of that name."""
        deadline_s = time.monotonic() + timeout_s
        while time.monotonic() < deadline_s:
            got = self.receive(0.1)
            if got is not None and got[0] == name:
                return got[1]
        raise AssertionError(f"no {name} within {timeout_s} s")

    def parameter(self, number: int, value: int | None = None) -> int:
        """Read parameter `number`, or write `value` to it."""
        self.send(
            "REQUEST_1", Number=number, Mode=READ if value is None else WRITE, Value=value or 0
        )
        answer = self.wait("ANSWER_1")
        assert (answer["Number"], answer["Result"]) == (number, 0), answer
        return answer["Value"]

    def control(self, word: int, reference: int = 0) -> dict[str, int]:
        """One control frame; the status that answers it."""
        self.send("CONTROL_1", ControlWord=word, Reference=reference)
        return self.wait("STATUS_1")


class Drive(Node):
    """A drive at address 1 whose position follows its reference; runs in a thread of its own."""

    def __init__(self, channel: str, gains: tuple[float, float, float]) -> None:
        super().__init__(channel)
        self.parameters = {WATCHDOG: 0, 300: 2, POSITION: 0, 401: 0, 402: 0, 403: 0}
        self.parameters |= {410: 0, 411: 0, 412: 0}
        for number, gain in zip((420, 421, 422), gains, strict=True):
            self.parameters[number] = struct.unpack("<i", struct.pack("<f", gain))[0]
        self.status = SWITCHED_OFF
        self.controls: list[tuple[float, int, int]] = []
        """Time, control word and reference of each control frame."""
        self._started = self._addressed = False
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self) -> Drive:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self.close()

    def report(self, code: int) -> None:
        """Send an error frame."""
        self.send("ERROR_1", Code=code)

    def _serve(self) -> None:
        log_on_s = time.monotonic()
        while not self._over.is_set():
            if not self._addressed and time.monotonic() >= log_on_s:
                log_on_s += 0.1
                self.send("LOGON_1")
            got = self.receive(0.02)
            if got is not None:
                self._take(*got)

    def _take(self, name: str, signals: dict[str, int]) -> None:
        if name == "SYSTEM":
            self._started = signals["Start"] == 1
            self._addressed = self._started
        elif name == "REQUEST_1":
            self._addressed = True
            self._answer(signals["Number"], signals["Mode"], signals["Value"])
        elif name == "CONTROL_1":
            self._addressed = True
            self._obey(signals["ControlWord"], signals["Reference"])

    def _answer(self, number: int, mode: int, value: int) -> None:
        if number not in self.parameters:
            self.send("ANSWER_1", Number=number, Result=0x20)
            return
        if mode == WRITE:
            self.parameters[number] = value
        self.send("ANSWER_1", Number=number, Value=self.parameters[number])

    def _obey(self, word: int, reference: int) -> None:
        self.controls.append((time.monotonic(), word, reference))
        if self._started:
            self.status = {
                DISABLE: SWITCHED_OFF,
                PREPARE: READY,
                ENABLE: SWITCHED_OFF if self.status == SWITCHED_OFF else ENABLED,
            }.get(word, self.status)
        if self.status == ENABLED:
            self.parameters[POSITION] += round(0.7 * (reference - self.parameters[POSITION]))
        self.send("STATUS_1", StatusWord=self.status, Referenced=1)
