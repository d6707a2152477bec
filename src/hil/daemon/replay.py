"""Feeds a recorded run through the core once more and compares every frame that it sends.

The journal holds all that the core was told, with its instants to the bit: the same core decides the same.
Where it does not, software, rig file or drive file have changed since, or something undeclared decides.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from hil.config import RigFile
from hil.daemon.core import RigCore
from hil.daemon.cue_parts import CueJoiner
from hil.daemon.records import CommandRecord, CueRecord, FrameRecord, InputRecord, Record
from hil.daemon.wire import HEADER, decode
from hil.drives import build_drivers
from hil.drives.meaning import FrameMeaning
from hil.drives.profiles import Profiles
from hil.errors import BusBusy, BusOff, ProtocolError, RunError
from hil.frames import Frame
from hil.runs.journal import JournalSource

KEPT: Final = 1000
"""Differences that are kept to be shown; all are counted."""


@dataclass(frozen=True, slots=True)
class Difference:
    """One identifier's frame at one instant, as recorded and as it comes out now; None: none was sent."""

    t_s: float
    recorded: Frame | None
    replayed: Frame | None


@dataclass(slots=True)
class Comparison:
    """What a replay found."""

    frames: int = 0
    """Frames sent in the recording."""
    same: int = 0
    changed: int = 0
    """Sent at the same instant with other data."""
    missing: int = 0
    """Sent then, not now."""
    extra: int = 0
    """Sent now, not then."""
    inputs: int = 0
    lost: int = 0
    """Inputs that the recording lacks: the recorder could not keep up."""
    duration_s: float = 0.0
    differences: list[Difference] = field(default_factory=list)
    largest: dict[int, tuple[str, float, float]] = field(default_factory=dict)
    """By actuator: kind of setpoint, largest |recorded - replayed| (m, rad, N or N·m), its instant, s."""
    damage: str | None = None

    @property
    def is_same(self) -> bool:
        """Every frame came out the same, and no other."""
        return self.same == self.frames and not self.extra


def replay_run(folder: Path, rig: RigFile, profiles: Profiles) -> Comparison:
    """Replay the journal in `folder` with `rig` and its drive files.

    RunError where there is no journal, where it begins in the middle of the daemon's life, or where
    another version wrote it.
    """
    source = JournalSource(folder)
    comparison = Replay(rig, profiles).run(_records(source))
    comparison.damage = source.damage
    return comparison


class Replay:
    """One replay of one journal."""

    def __init__(self, rig: RigFile, profiles: Profiles) -> None:
        self._rig = rig
        self._profiles = profiles
        self._cues = CueJoiner()
        self._found = Comparison()
        self._told_s = 0.0
        self._start_s = 0.0
        self._recorded: list[Frame] = []
        self._replayed: list[Frame] = []

    def run(self, records: Iterable[Record]) -> Comparison:
        """Tell a fresh core all that `records` hold; compares as it goes."""
        stream = iter(records)
        first = next(stream, None)
        core, meaning = self._core(first)
        for record in stream:
            if isinstance(record, InputRecord):
                self._settle(meaning)
                self._count(record.number)
                self._told_s = record.t_s
                self._tell(core, record)
            elif isinstance(record, CueRecord):
                cue = self._cues.add(record)
                if cue is not None:
                    core.cue(self._told_s, cue)
            elif isinstance(record, CommandRecord):
                core.command(self._told_s, record)
            elif isinstance(record, FrameRecord) and record.is_sent:
                self._recorded.append(record.frame)
            elif isinstance(record, FrameRecord):
                self._settle(meaning)
                self._count(self._found.inputs + 1)
                core.on_frame(record.t_s, record.frame)
            core.take_records()
        self._settle(meaning)
        self._found.duration_s = self._told_s - self._start_s
        return self._found

    def _core(self, first: Record | None) -> tuple[RigCore, FrameMeaning]:
        if not isinstance(first, InputRecord) or first.what not in ("start", "listen"):
            raise RunError(
                "this recording begins in the middle of the daemon's life: what had been told to it "
                "before is not known, so it cannot be replayed"
            )
        self._count(first.number)
        self._start_s = first.t_s
        drives = build_drivers(self._rig, self._profiles)
        read_only = first.what == "listen"
        return RigCore(self._rig, drives, first.t_s, read_only=read_only), drives.meaning

    def _tell(self, core: RigCore, record: InputRecord) -> None:
        now_s = record.t_s
        match record.what:
            case "due":
                self._replayed = core.on_due(now_s)
            case "gateway":
                core.gateway_alive(now_s)
            case "refused":
                core.on_refused(now_s, record.frame, BusBusy("as recorded"))
            case "refused_off":
                core.on_refused(now_s, record.frame, BusOff("as recorded"))
            case "end":
                core.end()
            case "start" | "listen":
                core.start_at(now_s)

    def _count(self, number: int) -> None:
        """`number` of an input: what is missing before it was lost on the way to the recorder."""
        self._found.lost += number - self._found.inputs - 1
        self._found.inputs = number

    def _settle(self, meaning: FrameMeaning) -> None:
        """Compare what was sent at the last instant with what comes out now, identifier by identifier."""
        recorded = {frame.key: frame for frame in self._recorded}
        replayed = {frame.key: frame for frame in self._replayed}
        self._recorded, self._replayed = [], []
        if not recorded and not replayed:
            return
        found = self._found
        found.frames += len(recorded)
        for can_id in recorded | replayed:
            then, now = recorded.get(can_id), replayed.get(can_id)
            if then == now:
                found.same += 1
                continue
            if now is None:
                found.missing += 1
            elif then is None:
                found.extra += 1
            else:
                found.changed += 1
                self._measure(meaning, then, now)
            if len(found.differences) < KEPT:
                found.differences.append(Difference(self._told_s, then, now))

    def _measure(self, meaning: FrameMeaning, then: Frame, now: Frame) -> None:
        old = meaning.meaning(then.key, then.data)
        new = meaning.meaning(now.key, now.data)
        i, kind = old.actuator, old.kind
        if i is None or kind is None or old.setpoint is None or new.setpoint is None:
            return
        off = abs(old.setpoint - new.setpoint)
        if i not in self._found.largest or off > self._found.largest[i][1]:
            self._found.largest[i] = (kind, off, self._told_s)


def _records(source: JournalSource) -> Iterator[Record]:
    for stretch in source:
        try:
            yield from decode(HEADER + stretch)
        except ProtocolError as error:
            raise RunError(f"{source.path}: {error}") from error
