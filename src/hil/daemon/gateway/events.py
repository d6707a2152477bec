"""Events of the rig and of the gateway: to clients, into the recording, the metrics and the log."""

from __future__ import annotations

import time
from typing import Final

from hil import messages
from hil.daemon.gateway.recording import Recording
from hil.daemon.log import Log
from hil.daemon.metrics import Metrics
from hil.daemon.zenoh_session import RigSession
from hil.messages import EventMessage
from hil.signals import Event, Severity

MOST_KINDS: Final = 30
"""Kinds that are told apart within a period: clients choose names, and could choose ever new ones."""
OTHERS: Final = "others"
LONGEST: Final = 500
"""Characters of an event that a client brought about, and may have written part of."""


class Events:
    """Where every event goes."""

    def __init__(
        self, session: RigSession, recording: Recording, metrics: Metrics, log: Log
    ) -> None:
        self._session = session
        self._recording = recording
        self._metrics = metrics
        self._log = log
        self._log_lost = 0
        self._is_log_stalled = False
        self._repeats = RepeatLimiter()

    def tell(self, event: Event) -> None:
        """An event of control's or our own."""
        self._metrics.event(event.severity, event.name)
        payload = messages.encode(EventMessage(event.t_s, event.severity, event.name, event.text))
        self._session.publish("event", payload, is_stream=False)
        self._recording.put(lambda recorder: recorder.event(event))
        self._log.event(event.severity, event.name, event.text)

    def say(self, severity: Severity, name: str, text: str) -> None:
        """An event of the gateway's, now."""
        self.tell(Event(time.monotonic(), severity, name, text))

    def repeated(self, severity: Severity, name: str, kind: str, text: str) -> None:
        """An event that a client can bring about at will: one of a kind a second, with the count."""
        held_back = self._repeats.lets(f"{name} {kind}", time.monotonic())
        if held_back is not None:
            more = f" ({held_back} more like it)" if held_back else ""
            self.say(severity, name, f"{text[:LONGEST]}{more}")

    def complain(self, name: str, who: str, text: str) -> None:
        """A warning about what somebody keeps doing wrong."""
        self.repeated("warning", name, who, f"from {who}: {text}")

    def watch(self) -> None:
        """Report a log that nobody reads, once, and what is missing from it when somebody does."""
        lost = self._log.dropped - self._log_lost
        if lost and not self._is_log_stalled:
            self._is_log_stalled = True
            self.say("warning", "log_stalled", "nobody reads standard error: log lines are lost")
        elif self._is_log_stalled and not self._log.waiting:
            self._is_log_stalled, self._log_lost = False, self._log.dropped
            self.say("info", "log_back", f"standard error is read again: {lost} lines are lost")


class RepeatLimiter:
    """Lets one of a kind through each second and counts the rest, so that logs stay readable."""

    def __init__(self, period_s: float = 1.0) -> None:
        self._period_s = period_s
        self._seen: dict[str, tuple[float, int]] = {}

    def lets(self, kind: str, now_s: float) -> int | None:
        """None if `kind` came within the period; else how many were held back since the last."""
        if kind not in self._seen and len(self._seen) >= MOST_KINDS:
            self._seen = {
                known: seen
                for known, seen in self._seen.items()
                if now_s - seen[0] < self._period_s or known == OTHERS
            }
            if len(self._seen) >= MOST_KINDS:
                kind = OTHERS
        last = self._seen.get(kind)
        if last is not None and now_s - last[0] < self._period_s:
            self._seen[kind] = (last[0], last[1] + 1)
            return None
        self._seen[kind] = (now_s, 0)
        return last[1] if last is not None else 0
