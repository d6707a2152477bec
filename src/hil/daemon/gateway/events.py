"""Events of the rig and of the gateway: to clients, into the recording, the metrics and the log."""

from __future__ import annotations

import sys
import time
from typing import Literal

import structlog

from hil import messages
from hil.daemon.gateway.recording import Recording
from hil.daemon.metrics import Metrics
from hil.daemon.zenoh_session import RigSession
from hil.messages import EventMessage
from hil.signals import Event

Severity = Literal["info", "warning", "fault"]


class Events:
    """Where every event goes. The log is one line an event on standard error, for the journal."""

    def __init__(
        self, rig: str, session: RigSession, recording: Recording, metrics: Metrics
    ) -> None:
        self._session = session
        self._recording = recording
        self._metrics = metrics
        self._repeats = RepeatLimiter()
        self._log = structlog.wrap_logger(
            structlog.PrintLogger(sys.stderr),
            processors=[structlog.processors.add_log_level, structlog.processors.LogfmtRenderer()],
        ).bind(rig=rig)

    def tell(self, event: Event) -> None:
        """An event of control's or our own."""
        self._metrics.event(event.severity, event.name)
        payload = messages.encode(EventMessage(event.t_s, event.severity, event.name, event.text))
        self._session.publish("event", payload, is_stream=False)
        self._recording.put(lambda recorder: recorder.event(event))
        log = {"info": self._log.info, "warning": self._log.warning, "fault": self._log.error}
        log[event.severity](event.text, name=event.name)

    def say(self, severity: Severity, name: str, text: str) -> None:
        """An event of the gateway's, now."""
        self.tell(Event(time.monotonic(), severity, name, text))

    def complain(self, name: str, who: str, text: str) -> None:
        """A warning about what somebody keeps doing wrong: one a second, with the count."""
        held_back = self._repeats.lets(f"{name} {who}", time.monotonic())
        if held_back is not None:
            more = f" ({held_back} more like it)" if held_back else ""
            self.say("warning", name, f"from {who}: {text}{more}")


class RepeatLimiter:
    """Lets one of a kind through each second and counts the rest, so that logs stay readable."""

    def __init__(self, period_s: float = 1.0) -> None:
        self._period_s = period_s
        self._seen: dict[str, tuple[float, int]] = {}

    def lets(self, kind: str, now_s: float) -> int | None:
        """None if `kind` came within the period; else how many were held back since the last."""
        last = self._seen.get(kind)
        if last is not None and now_s - last[0] < self._period_s:
            self._seen[kind] = (last[0], last[1] + 1)
            return None
        if len(self._seen) > 1000:
            self._seen.clear()
        self._seen[kind] = (now_s, 0)
        return last[1] if last is not None else 0
