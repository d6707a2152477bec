"""Cues as records of a fixed size: long ones travel in parts, which are joined again."""

from __future__ import annotations

from hil.daemon.records import POSES_PER_RECORD, CueRecord
from hil.signals import Cue, TimedPose


def split_cue(cue: Cue) -> list[CueRecord]:
    """The records that carry `cue`, of at most 16 poses each."""
    poses = [(pose.dt_s, pose.pose) for pose in cue.poses]
    parts = [
        tuple(poses[k : k + POSES_PER_RECORD]) for k in range(0, len(poses), POSES_PER_RECORD)
    ] or [()]
    return [
        CueRecord(cue.client, cue.seq, cue.t_client_s, cue.received_s, part, len(parts), held)
        for part, held in enumerate(parts)
    ]


class CueJoiner:
    """Joins the parts of a cue again. A cue that lacks a part is dropped whole."""

    def __init__(self) -> None:
        self._parts: list[CueRecord] = []
        self.dropped = 0
        """Parts that came to nothing because another part of their cue was lost."""

    def add(self, record: CueRecord) -> Cue | None:
        """The cue if `record` completes one, else None."""
        if self._parts and not _follows(self._parts[-1], record):
            self.dropped += len(self._parts)
            self._parts = []
        if not self._parts and record.part != 0:
            self.dropped += 1
            return None
        self._parts.append(record)
        if len(self._parts) < record.parts:
            return None
        poses = tuple(TimedPose(dt_s, pose) for part in self._parts for dt_s, pose in part.poses)
        self._parts = []
        return Cue(record.client, record.seq, record.t_client_s, record.received_s, poses)


def _follows(last: CueRecord, record: CueRecord) -> bool:
    return (
        record.part == last.part + 1
        and (record.client, record.seq, record.parts) == (last.client, last.seq, last.parts)
        and record.received_s == last.received_s
    )
