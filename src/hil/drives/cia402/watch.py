"""A started node's heartbeat, the state it tells, and emergencies that come in storms."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from hil.drives.cia402.codec import NmtState
from hil.drives.cia402.profile import Supervision402

STORM: Final = 20
"""Emergency messages in a second that are a storm."""
SETTLE_S: Final = 0.3
"""A node that was started gets so long until its heartbeat says so."""


class Watch:
    """One node's."""

    def __init__(self, supervision: Supervision402) -> None:
        self._quiet_s = supervision.heartbeat * (supervision.heartbeats_missed + 1)
        self._started_s = self._heard_s = 0.0
        self._state: NmtState | None = None
        self._emergencies: deque[float] = deque(maxlen=STORM)
        self._stormed_s = -math.inf

    def started(self, now_s: float) -> None:
        """It is started now."""
        self._started_s = self._heard_s = now_s
        self._state = None

    def heartbeat(self, now_s: float, state: NmtState) -> None:
        """It says that it is there, and in `state`."""
        self._heard_s, self._state = now_s, state

    def is_heard(self, now_s: float) -> bool:
        """Its heartbeat comes."""
        return now_s - self._heard_s <= self._quiet_s

    def trouble(self, now_s: float) -> tuple[str, str] | None:
        """Name and sentence of what is wrong with a started node; None where nothing is."""
        quiet_s = now_s - self._heard_s
        if quiet_s > self._quiet_s:
            return "drive_silent", f"has sent no heartbeat for {quiet_s:.2f} s"
        state = self._state
        if state is None or state is NmtState.OPERATIONAL or now_s - self._started_s <= SETTLE_S:
            return None
        return "drive_left_operational", f"is {state}, not operational"

    def is_storm(self, now_s: float) -> bool:
        """An emergency message came; whether a storm of them is to be told, once a second."""
        times = self._emergencies
        times.append(now_s)
        if len(times) < STORM or now_s - times[0] >= 1.0 or now_s - self._stormed_s <= 1.0:
            return False
        self._stormed_s = now_s
        return True
