"""Commands that waited while control started or hung: who gave them thinks by now that nobody heard."""

from __future__ import annotations

from typing import Final

from hil.daemon.records import CommandRecord, EventRecord, ReplyRecord

OLD_S: Final = 2.0
"""A command that waited so long is not done any more: whoever gave it may stand beside the rig."""
CALMING: Final = frozenset({"stop", "park", "finish", "disarm"})
"""Commands that are never too late."""


def too_late(
    command: CommandRecord, now_s: float, said_s: float
) -> tuple[EventRecord, ReplyRecord] | None:
    """What is told where `command`, read at `now_s`, is not done any more; None where it is done. `said_s`:
    when the gateway sent the heartbeat before it."""
    late_s = now_s - said_s
    if late_s < OLD_S or command.name in CALMING:
        return None
    text = (
        f"{command.name} came {late_s:.1f} s late, as control was starting or hung, and is not done"
    )
    return (
        EventRecord(now_s, "warning", "command_late", text),
        ReplyRecord(command.command_id, False, f"{text}: give it once more"),
    )
