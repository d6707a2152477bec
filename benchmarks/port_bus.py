"""Our ports as buses of python-can: other people's masters and drives on a hub, in benchmarks and tests."""

from __future__ import annotations

import select
import time

import can

from hil.bus.port import BusPort, open_port
from hil.frames import Frame


class PortBus(can.BusABC):  # type: ignore[misc]  # mypy skips that library
    """A port of ours as a bus of python-can, so that other people's programs can sit on a hub."""

    def __init__(self, url: str, bitrate_bps: int = 1_000_000) -> None:
        self.port: BusPort = open_port(url, bitrate_bps=bitrate_bps)
        self._waiting: list[Frame] = []
        self._can_protocol = can.CanProtocol.CAN_20
        super().__init__(channel=url)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._waiting:
            select.select([self.port], [], [], timeout)
            self._waiting += [stamped.frame for stamped in self.port.receive()]
        if not self._waiting:
            return None, False
        frame = self._waiting.pop(0)
        message = can.Message(
            timestamp=time.time(),
            arbitration_id=frame.can_id,
            data=frame.data,
            is_extended_id=False,
        )
        return message, False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send it."""
        self.port.send(Frame(msg.arbitration_id, bytes(msg.data)))

    def shutdown(self) -> None:
        """Leave."""
        super().shutdown()
        self.port.close()
