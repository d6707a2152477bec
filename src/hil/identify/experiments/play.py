"""Plays a design on the simulated rig or through a running daemon, and keeps it with the recording."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import msgspec

from hil.client import RigClient
from hil.client.stream import FOLLOWING, need_following, stream
from hil.config import Effect, RigFile
from hil.daemon.records import EventRecord, Record
from hil.daemon.simulated import record_ride
from hil.drives.profiles import Profiles
from hil.errors import CommandRefused, RunError
from hil.identify.experiments.description import Played, write_experiment
from hil.identify.experiments.design import Design
from hil.identify.experiments.shaped import experiment_cues, lead_s
from hil.messages import CommandReply, CueMessage
from hil.runs.folder import RECORDING, read_meta
from hil.runs.mcapfile import McapSource
from hil.safety import state_settings

CLIENT: Final = "experiment"


def play_simulated(
    design: Design,
    rig: RigFile,
    rig_text: str,
    profiles: Profiles,
    runs: Path,
    *,
    seed: int = 0,
    effects: Sequence[Effect] = (),
    note: str = "",
) -> Path:
    """Play on the simulated rig in simulated time; returns the run folder.

    `effects` are given to the simulated rig only: neither the daemon nor the rig file kept with the run
    knows them.
    CommandRefused where the rig did not stay in motion to the end; such a run gets no description.
    """
    troubles: list[str] = []

    def watch(record: Record) -> None:
        if isinstance(record, EventRecord) and record.severity == "fault":
            troubles.append(record.text)

    folder = record_ride(
        rig,
        rig_text,
        profiles,
        experiment_cues(design.trajectory, rig, CLIENT),
        runs,
        seed=seed,
        note=note or _note(design),
        on_record=watch,
        hidden=effects,
    )
    if troubles:
        raise CommandRefused(
            f"{rig.name} did not play the motion to its end: {troubles[0]} ({folder})"
        )
    names = tuple(
        f"{e.location}.{e.effect}.{p}={value!r}"
        for e in effects
        for p, value in e.parameters.items()
    )
    _keep(folder, design, rig, Played(on="simulated", start_s=0.0, seed=seed, effects=names))
    return folder


def play_on_rig(
    design: Design,
    rig: RigFile,
    client: RigClient,
    runs: Path,
    *,
    endpoint: str = "",
    on_progress: Callable[[float], None] = lambda t_s: None,
) -> Path:
    """Stream to the daemon that `client` is connected to, at `endpoint`; park; returns the run folder.

    `runs` is the folder into which that daemon records, as seen from here; it begins a recording for
    the experiment alone. CommandRefused where the rig is not armed, or leaves motion before the end:
    such a run gets no description.
    """
    need_following(client)
    _record(client, on=False)
    # Other rigs may record into `runs`, too.
    folder = runs / Path(_record(client, on=True).folder).name
    # Before anything moves: the motion would be played in vain.
    if not (folder / RECORDING).is_file():
        raise RunError(
            f"{folder}: is not here; name the folder of the recordings of {rig.name}'s daemon with --runs"
        )
    try:
        motion = experiment_cues(design.trajectory, rig, CLIENT)
        stream(client, motion, rig.coordinates, on_progress)
    finally:
        _await_parked(client, rig)
        _record(client, on=False)
        _record(client, on=True)
    _keep(folder, design, rig, Played(on="rig", start_s=0.0, endpoint=endpoint))
    return folder


def motion_start_s(folder: Path, rig: RigFile) -> float:
    """When a recorded stream's motion began, as `t` of the run's table, s.

    The stream's own clock is placed by the quickest of its cues, as the daemon places it.
    """
    meta = read_meta(folder)
    if meta.started is None:
        raise RunError(f"{folder}: run.toml does not say when it started")
    zero_ns = round(meta.started.timestamp() * 1e9)
    decode = msgspec.json.Decoder(CueMessage).decode
    sent: list[float] = []
    offset_s = float("inf")
    for message in McapSource(folder / RECORDING):
        if message.topic == "/cue":
            cue = decode(message.data)
            sent.append(cue.t)
            offset_s = min(offset_s, 1e-9 * (message.log_time_ns - zero_ns) - cue.t)
    if not sent:
        raise RunError(f"{folder}: holds no cue: the motion never reached the rig")
    return sent[0] + offset_s + lead_s(rig)


def _keep(folder: Path, design: Design, rig: RigFile, played: Played) -> None:
    start_s = round(motion_start_s(folder, rig), 6)
    played = played.model_copy(update={"start_s": start_s})
    description = design.description.model_copy(update={"played": played})
    write_experiment(folder, description, design.trajectory)


def _note(design: Design) -> str:
    return f"{design.description.plan.kind} of {', '.join(design.description.coordinates)}"


def _await_parked(client: RigClient, rig: RigFile) -> None:
    end_s = time.monotonic() + state_settings(rig).park_time_s
    for state in client.states():
        if state.state not in (*FOLLOWING, "parking") or time.monotonic() > end_s:
            return


def _record(client: RigClient, *, on: bool) -> CommandReply:
    reply = client.command("record", on=on)
    if not reply.ok:
        raise CommandRefused(f"{client.rig}: {reply.message}")
    return reply
