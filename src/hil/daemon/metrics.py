"""What a rig counts, for Prometheus: a registry of its own, served only where a port is given."""

from __future__ import annotations

from threading import Thread
from typing import Any, Final

from prometheus_client import CollectorRegistry, Counter, Enum, Gauge, Histogram, start_http_server

from hil.daemon.records import RIG_STATES, StateRecord
from hil.errors import ConfigError

LATENESS_BUCKETS_S: Final = (1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 1e-1)


class Metrics:
    """All metrics of one gateway, labelled with the rig's name."""

    def __init__(self, rig: str) -> None:
        self.registry = CollectorRegistry()
        common: dict[str, Any] = {"registry": self.registry, "namespace": "hil"}
        label = ("rig",)

        def counter(name: str, text: str, *labels: str) -> Counter:
            return Counter(name, text, (*label, *labels), **common)

        def gauge(name: str, text: str) -> Gauge:
            return Gauge(name, text, label, **common).labels(rig)

        self._rig = rig
        frames = counter("frames", "CAN frames", "direction")
        self._sent, self._received = frames.labels(rig, "sent"), frames.labels(rig, "received")
        self._cues = counter("cues", "cues from clients", "outcome")
        self._events = counter("events", "events", "severity", "name")
        self._commands = counter("commands", "commands from clients", "name", "outcome")
        self._shown = ""
        self._state = Enum(
            "state", "state of the rig", label, states=list(RIG_STATES), **common
        ).labels(rig)
        self._lateness = Histogram(
            "lateness_seconds", "how late cycles began", label, buckets=LATENESS_BUCKETS_S, **common
        ).labels(rig)
        self._tracking = gauge("tracking_error", "largest tracking error of an actuator, m or rad")
        self._overruns = gauge("overruns", "cycles missed since the start")
        self._slot_use = gauge("slot_use", "share of parameter slots that carried a pair")
        self._bus_load = gauge("bus_load", "share of the bus's bit time in use")
        self.record_drops = gauge("record_drops", "values that the recorder could not take")
        self.log_drops = gauge("log_drops", "log lines that standard error could not take")
        self.is_recording = gauge("recording", "1 while a recording is written")
        self.clients = gauge("clients", "clients that show a liveliness token")

    def frame(self, *, is_sent: bool) -> None:
        """Count a frame."""
        (self._sent if is_sent else self._received).inc()

    def cue(self, *, is_accepted: bool) -> None:
        """Count a cue that was passed on to control, or refused."""
        self._cues.labels(self._rig, "accepted" if is_accepted else "refused").inc()

    def event(self, severity: str, name: str) -> None:
        """Count an event."""
        self._events.labels(self._rig, severity, name).inc()

    def command(self, name: str, *, ok: bool) -> None:
        """Count a command."""
        self._commands.labels(self._rig, name, "done" if ok else "refused").inc()

    def state(self, record: StateRecord) -> None:
        """Take over the state of a cycle."""
        if record.state != self._shown:
            self._shown = record.state
            self._state.state(record.state)
        self._lateness.observe(record.lateness_s)
        self._tracking.set(record.tracking_error)
        self._overruns.set(record.overruns)
        self._slot_use.set(record.pairs / record.slots if record.slots else 0.0)
        self._bus_load.set(record.bus_load)


class MetricsServer:
    """Serves a registry over HTTP on loopback; ConfigError if the port is taken."""

    def __init__(self, registry: CollectorRegistry, port: int) -> None:
        self._server: Any
        self._thread: Thread
        try:
            self._server, self._thread = start_http_server(port, "127.0.0.1", registry)
        except OSError as error:
            raise ConfigError(f"metrics: port {port} cannot be served: {error.strerror}") from error
        self.port: int = self._server.server_port

    def close(self) -> None:
        """Stop serving and give the port back."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()
