"""`hil replay`: a recorded run through the control code once more."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.console import JsonFlag, err, out, write_json
from hil.config import RigFile
from hil.configfile import load_rig
from hil.daemon.replay import Comparison, Difference, replay_run
from hil.drives.describe_rig import RigDescriber
from hil.errors import RunError
from hil.runs.folder import RunMeta, read_meta, read_profiles, read_rig, require_rig


def replay(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.", show_default=False)],
    rig: Annotated[
        str | None,
        typer.Option("--rig", help="Another rig file than the one kept with the run: what if?"),
    ] = None,
    most: Annotated[int, typer.Option(help="Differences to show.", min=0)] = 10,
    json: JsonFlag = False,
) -> None:
    """Feed a recording through the control code: does every frame come out the same?

    Exit code 0 if so, 1 if not. The rig does not answer a replay: from the first difference on, the recorded
    answers are those to other setpoints.
    """
    meta = read_meta(run)
    settings = load_rig(rig) if rig is not None else read_rig(run, meta)
    if settings is None:
        raise RunError(f"{run}: keeps no rig file; name one with --rig")
    require_rig(settings, meta, run)
    profiles = read_profiles(run, settings)
    with err.status("replaying"):
        found = replay_run(run, settings, profiles)
    describer = RigDescriber(settings, profiles)
    start_s = meta.recording.start_s if meta.recording else 0.0
    shown = found.differences[:most]
    if json:
        write_json(_as_json(found, shown, settings, describer, start_s))
    else:
        for line in _lines(found, shown, settings, describer, start_s, meta):
            out.print(line, soft_wrap=True)
    if not found.is_same:
        raise typer.Exit(1)


def _lines(
    found: Comparison,
    shown: list[Difference],
    rig: RigFile,
    describer: RigDescriber,
    start_s: float,
    meta: RunMeta,
) -> list[str]:
    lines = [
        f"{found.same} of {found.frames} frames came out the same, in {found.duration_s:.1f} s and "
        f"{found.inputs} inputs of {meta.rig}"
    ]
    if found.damage:
        lines.append(f"the journal is damaged: {found.damage}")
    if found.lost:
        lines.append(f"{found.lost} inputs are not in the recording: differences may come of that")
    if found.is_same:
        return lines
    lines.append(f"{found.changed} differ, {found.missing} are missing, {found.extra} are new")
    for i, (kind, off, t_s) in sorted(found.largest.items()):
        lines.append(
            f"  {rig.actuator_names[i]}: setpoints differ by up to {off:.3g} {_unit(kind)}, "
            f"at {t_s - start_s:.3f} s"
        )
    if shown:
        lines.append("first differences:")
    for difference in shown:
        lines.append(f"  {difference.t_s - start_s:10.6f} s")
        for sign, frame in (("-", difference.recorded), ("+", difference.replayed)):
            if frame is not None:
                said = describer.describe(frame)
                lines.append(f"    {sign} {frame!s:<22} {said.source} {said.name}: {said.text}")
    return lines


def _unit(kind: str) -> str:
    return "(m or rad)" if kind == "position" else "(N or N·m)"


def _as_json(
    found: Comparison,
    shown: list[Difference],
    rig: RigFile,
    describer: RigDescriber,
    start_s: float,
) -> dict[str, object]:
    def said(difference: Difference) -> dict[str, object]:
        entry: dict[str, object] = {"t": difference.t_s - start_s}
        for key in ("recorded", "replayed"):
            frame = getattr(difference, key)
            if frame is not None:
                what = describer.describe(frame)
                entry[key] = {"frame": str(frame), "source": what.source, "text": what.text}
        return entry

    return {
        "is_same": found.is_same,
        "frames": found.frames,
        "same": found.same,
        "changed": found.changed,
        "missing": found.missing,
        "extra": found.extra,
        "inputs": found.inputs,
        "lost": found.lost,
        "damage": found.damage,
        "duration": found.duration_s,
        "largest": {
            rig.actuator_names[i]: {"kind": kind, "difference": off, "t": t_s - start_s}
            for i, (kind, off, t_s) in sorted(found.largest.items())
        },
        "differences": [said(difference) for difference in shown],
    }
