"""The daemon in simulated time: the same core, drivers, gate and recorder, in the deterministic world.

Ten minutes of operation take seconds and come out the same, to the bit, every time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np

from hil.bus.bitbus import BitBus
from hil.bus.faults import Fault
from hil.config import Effect, RigFile
from hil.daemon.core import RigCore
from hil.daemon.ipc import Sources
from hil.daemon.recording import keep
from hil.daemon.records import CommandRecord, Record, ReplyRecord
from hil.drives import build_drivers
from hil.drives.profiles import Profiles
from hil.errors import CommandRefused, RunError
from hil.runs import Recorder
from hil.signals import Cue
from hil.sim.rig import SimulatedRig
from hil.sim.world import Master, World

CONTROL: Final = "control"
STEP_S: Final = 0.05
"""Between two looks at the rig's state and the gateway's heartbeat."""
LONGEST_WAIT_S: Final = 30.0
EPOCH: Final = datetime(2026, 1, 1, tzinfo=UTC)
"""Wall clock of simulated runs, so that repeated runs give the same files."""


class SimulatedSession:
    """One rig with its daemon in one deterministic world; records go to `recorder` if there is one."""

    def __init__(
        self,
        rig: RigFile,
        profiles: Profiles,
        *,
        seed: int = 0,
        faults: Sequence[Fault] = (),
        recorder: Recorder | None = None,
        wake_jitter_s: float | None = None,
        others: Mapping[str, Master] | None = None,
        hidden: Sequence[Effect] = (),
    ) -> None:
        """`others` are further nodes that speak on the bus: sniffers, second masters, babblers. `hidden`
        effects are the simulated rig's alone: the daemon does not know of them."""
        bitrates = rig.can.bitrates
        streams = np.random.default_rng(seed).spawn(1 + len(bitrates))
        self.rig = rig
        self.simulated = SimulatedRig(rig, profiles, seed, hidden)
        self.bus = BitBus(rig.can.bitrate, streams[0], faults)
        """The rig's first bus, to which `faults` happen."""
        further = (BitBus(b, s) for b, s in zip(bitrates[1:], streams[2:], strict=True))
        self.buses = (self.bus, *further)
        self.core = RigCore(rig, build_drivers(rig, profiles), rig.bus.cycle)
        jitter_s = rig.bus.jitter if wake_jitter_s is None else wake_jitter_s
        self.world = World(
            self.simulated,
            self.buses,
            {CONTROL: self.core, **(others or {})},
            rng=streams[1],
            wake_jitter_s=jitter_s,
        )
        self.recorder = recorder
        self.on_record: Callable[[Record], None] | None = None
        self._sources = Sources(rig.actuator_names)
        self._replies: dict[int, ReplyRecord] = {}
        self._commands = 0
        self._beat_s = -STEP_S
        self._busy = (0.0, 0.0)

    @property
    def now_s(self) -> float:
        """Simulated time, s."""
        return self.world.now_s

    def run_until(self, end_s: float) -> None:
        """Let the world go on to `end_s`, keeping what the core has to tell."""
        while self.now_s < end_s:
            if self.now_s - self._beat_s >= STEP_S:
                self._beat_s = self.now_s
                self.core.gateway_alive(self.now_s)
                self._measure_load()
            self.world.run_until(min(end_s, self.now_s + STEP_S))
            self._collect()

    def cue(self, cue: Cue) -> None:
        """A cue arrives at `cue.received_s`: the world goes on until then."""
        self.run_until(cue.received_s)
        if self.recorder is not None:
            self.recorder.cue(cue)
        self.core.cue(cue.received_s, cue)

    def command(self, name: str, argument: str = "") -> ReplyRecord:
        """Give a command and let the world go on until it is answered."""
        self._commands += 1
        self.core.command(self.now_s, CommandRecord(self._commands, name, argument))
        end_s = self.now_s + 1.0
        while self._commands not in self._replies and self.now_s < end_s:
            self.run_until(self.now_s + self.rig.bus.cycle)
        return self._replies[self._commands]

    def wait_for(self, *states: str) -> None:
        """Let the world go on until the rig is in one of `states`; CommandRefused after 30 s."""
        end_s = self.now_s + LONGEST_WAIT_S
        while self.core.state not in states:
            if self.now_s >= end_s:
                raise CommandRefused(
                    f"{self.rig.name} is {self.core.state} after {LONGEST_WAIT_S:g} s, "
                    f"not {' or '.join(states)}"
                )
            self.run_until(self.now_s + STEP_S)

    def arm(self) -> None:
        """Wait until the rig is parked, then arm it; CommandRefused with its reason if it refuses."""
        self.wait_for("parked")
        self.run_until(self.now_s + 0.2)
        reply = self.command("arm")
        if not reply.ok:
            raise CommandRefused(f"{self.rig.name}: {reply.text}")

    def leave(self) -> None:
        """Park, switch the drives off, as the daemon does when it is told to end."""
        self.core.end()
        while self.core.armed:
            self.run_until(self.now_s + STEP_S)
        self.run_until(self.now_s + 0.2)

    def _collect(self) -> None:
        records = self.core.take_records()
        if self.recorder is not None:
            keep(self.recorder, ((r, None) for r in records), self.rig, self._sources)
        for record in records:
            if isinstance(record, ReplyRecord):
                self._replies[record.command_id] = record
            if self.on_record is not None:
                self.on_record(record)

    def _measure_load(self) -> None:
        busy_s, at_s = max(bus.totals.busy_s for bus in self.buses), self.now_s
        if at_s - self._busy[1] >= 0.5:
            self.core.bus_load = (busy_s - self._busy[0]) / (at_s - self._busy[1])
            self._busy = (busy_s, at_s)


def record_ride(
    rig: RigFile,
    rig_text: str,
    profiles: Profiles,
    cues: Iterable[Cue],
    folder: Path,
    *,
    seed: int = 0,
    note: str = "",
    on_record: Callable[[Record], None] | None = None,
    hidden: Sequence[Effect] = (),
) -> Path:
    """Prepare, arm, ride `cues`, park, switch off; returns the run folder.

    `cues` count their `received_s` from the moment the rig is ready; `hidden` effects are the simulated
    rig's alone. RunError if the disk filled up.
    """
    recorder = Recorder(folder, rig_text, rig, 0.0, started=EPOCH, note=note)
    session = SimulatedSession(rig, profiles, seed=seed, recorder=recorder, hidden=hidden)
    session.on_record = on_record
    try:
        session.arm()
        start_s = session.now_s
        for cue in cues:
            session.cue(cue_at(cue, start_s))
        session.leave()
    finally:
        recorder.close("the simulated session has ended")
    if recorder.stopped is not None and recorder.stopped.severity != "info":
        raise RunError(recorder.stopped.text)
    return recorder.path


def cue_at(cue: Cue, start_s: float) -> Cue:
    """`cue` with its times counted from `start_s`."""
    return Cue(cue.client, cue.seq, cue.t_client_s + start_s, cue.received_s + start_s, cue.poses)
