"""Records rides from the sensor nodes: from button to button, or for as long as it is told."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from hil.bicycle.live import LiveRide, LiveState
from hil.bus.port import BusPort
from hil.config import BicycleFile
from hil.configfile import rig_toml
from hil.drives.bicycle_nodes import Button, NodesReceiver, Pressed
from hil.errors import RunError
from hil.frames import StampedFrame
from hil.runs import Recorder
from hil.signals import Event, Sample

SILENT_S = 1.0
"""A node that says nothing for so long is told once: its cable, its power."""


@dataclass(slots=True)
class Told:
    """What a person should hear: one sentence, the event that it is, and the state where there is one."""

    text: str = ""
    state: LiveState | None = None
    event: Event | None = None


class Acquisition:
    """One recorder for one bicycle, fed with frames and time. Opens a run at each start."""

    def __init__(
        self, rig: BicycleFile, folder: Path, tell: Callable[[Told], None], *, live: bool = True
    ) -> None:
        self._rig = rig
        self._folder = folder
        self._tell = tell
        self._is_live = live
        if live:
            LiveRide(rig)  # the first one loads compiled code, which may take seconds
        self._nodes = NodesReceiver(rig)
        self._recorder: Recorder | None = None
        self._live: LiveRide | None = None
        self._last: dict[str, float] = {}
        self._silent: set[str] = set()
        self.paths: list[Path] = []
        """Of the runs recorded so far."""

    @property
    def is_recording(self) -> bool:
        """Whether a run is open."""
        return self._recorder is not None

    def start(self, now_s: float, note: str = "") -> None:
        """Open a run; does nothing while one is open."""
        if self._recorder is not None:
            return
        text = rig_toml(self._rig)
        self._recorder = Recorder(self._folder, text, self._rig, now_s, note=note)
        self._live = LiveRide(self._rig) if self._is_live else None
        self._nodes = NodesReceiver(self._rig)
        self._last = dict.fromkeys(self._nodes.received, now_s)
        self._silent.clear()
        self.paths.append(self._recorder.path)
        self._event(Event(now_s, "info", "ride_started", f"recording into {self._recorder.path}"))

    def stop(self, now_s: float, reason: str) -> None:
        """Close the run; does nothing where none is open."""
        if self._recorder is None:
            return
        n = self._nodes
        lost = ", ".join(f"{k} {v}" for k, v in {**n.lost, "imu": n.imu.lost}.items())
        self._event(Event(now_s, "info", "ride_ended", f"{reason}; frames lost: {lost}"))
        self._close(reason)

    def on_frame(self, stamped: StampedFrame) -> None:
        """Take in a frame of the bus."""
        now_s, frame = stamped
        if self._recorder is not None:
            self._recorder.frame(stamped, is_sent=False)
        for said in self._nodes.on_frame(now_s, frame):
            if isinstance(said, Pressed):
                self._on_button(said)
            elif self._recorder is not None:
                self._on_sample(said)

    def on_time(self, now_s: float) -> None:
        """Say what can be said by now; call it ten times a second."""
        if self._recorder is None:
            return
        for node, last in self._last.items():
            if now_s - last > SILENT_S and node not in self._silent:
                self._silent.add(node)
                text = f"{node} has said nothing for {SILENT_S:g} s: its power, its cable, its identifier"
                self._event(Event(now_s, "warning", "node_silent", text))
        if self._live is not None:
            for state in self._live.states():
                self._tell(Told(state=state))
        if self._recorder.stopped is not None:
            self._close("")

    def _on_button(self, pressed: Pressed) -> None:
        if pressed.button is Button.STOP:
            self.stop(pressed.t_s, "stopped by the panel")
            return
        is_ride = pressed.button is Button.START
        try:
            self.start(pressed.t_s, "ride" if is_ride else "calibration: upright and still")
        except RunError as error:
            self._event(Event(pressed.t_s, "warning", "not_recording", f"not recording: {error}"))

    def _on_sample(self, sample: Sample) -> None:
        assert self._recorder is not None
        self._recorder.sample(sample)
        if sample.quantity in self._last:
            self._last[sample.quantity] = sample.received_s
            self._silent.discard(sample.quantity)
        if self._live is not None:
            self._live.add(sample)

    def _close(self, reason: str) -> None:
        """Close the run, and tell of one that the disk has ended; its reason stands in `run.toml`."""
        assert self._recorder is not None
        self._recorder.close(reason)
        ended = self._recorder.stopped
        self._recorder, self._live = None, None
        if ended is not None and ended.severity != "info":
            self._event(ended)

    def _event(self, event: Event) -> None:
        if self._recorder is not None:
            self._recorder.event(event)
        self._tell(Told(event.text, event=event))


async def acquire(
    acquisition: Acquisition,
    port: BusPort,
    clock: Callable[[], float],
    seconds: float | None,
    *,
    wait: bool,
) -> None:
    """Record what comes over `port` for `seconds`, or until cancelled; `wait`: for the start button."""
    loop = asyncio.get_running_loop()
    failed: asyncio.Future[None] = loop.create_future()

    def on_frames() -> None:
        try:
            for stamped in port.receive():
                acquisition.on_frame(stamped)
        except Exception as error:  # noqa: BLE001 - handed to whoever awaits
            if not failed.done():
                failed.set_exception(error)

    begun_s = clock()
    if not wait:
        acquisition.start(begun_s)
    loop.add_reader(port.fileno(), on_frames)
    reason = "stopped by its operator"
    try:
        while seconds is None or clock() - begun_s < seconds:
            done, _ = await asyncio.wait([failed], timeout=0.1)
            if done:
                reason = f"the bus failed: {failed.exception()}"
                failed.result()
            acquisition.on_time(clock())
        reason = f"{seconds:g} s were over"
    finally:
        loop.remove_reader(port.fileno())
        acquisition.stop(clock(), reason)
