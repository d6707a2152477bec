"""A motion known beforehand, streamed to a running rig in its own time for as long as the rig follows."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Final

from hil.client.rig import RigClient
from hil.errors import CommandRefused, RigNotReached
from hil.messages import CommandReply, cue_message
from hil.signals import Cue

FOLLOWING: Final = ("ready", "engaged")
"""States in which a fresh cue moves the rig, or will at once."""


def need_following(client: RigClient) -> None:
    """CommandRefused unless the rig is in a state that follows cues; RigNotReached if it is silent."""
    state = next(client.states())
    if state.state not in FOLLOWING:
        why = f" ({state.fault})" if state.fault else ""
        raise CommandRefused(
            f"{client.rig} is {state.state}{why}; arm it first: `hil command {client.rig} arm`"
        )


def stream(
    client: RigClient,
    cues: Iterable[Cue],
    coordinates: Sequence[str],
    on_progress: Callable[[float], None] = lambda t_s: None,
) -> CommandReply:
    """Send `cues`, each at its own time after now, then park; returns what the rig answered to that.

    `coordinates`: the names of the cues' own, in their order. Parks too where it is interrupted.
    `on_progress` is told the time of each cue, s. CommandRefused once the rig no longer follows, with the
    state that it went to and why; then it is left as it is: somebody may have stopped it, or moves it.
    """
    events = client.events()
    start_s = time.monotonic()
    try:
        for cue in cues:
            time.sleep(max(0.0, start_s + cue.t_client_s - time.monotonic()))
            client.cues(cue_message(cue, coordinates).poses, start_s + cue.t_client_s)
            state = client.state()
            if state is not None and state.state not in FOLLOWING:
                told = [e.text for e in events.waiting() if e.severity != "info"]
                why = _once((state.fault, *told)) or "it was told to"
                raise CommandRefused(
                    f"{client.rig} went to {state.state} {cue.t_client_s:.1f} s into the motion: {why}"
                )
            on_progress(cue.t_client_s)
    except BaseException:
        with suppress(RigNotReached):
            client.command("finish")
        raise
    reply = client.command("finish")
    if not reply.ok:
        raise CommandRefused(f"{client.rig}: {reply.message}")
    return reply


def _once(said: Sequence[str]) -> str:
    """The first of `said` and the last three others, none of them twice: several causes tell the same."""
    first, *others = said
    new = [text for text in dict.fromkeys(others) if text not in first]
    return "; ".join(filter(None, (first, *new[-3:])))
