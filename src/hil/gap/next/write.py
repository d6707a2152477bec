"""A proposal as files that `hil experiment` plays: its description, and its motion beside it."""

from __future__ import annotations

from pathlib import Path

import tomlkit

from hil.errors import RunError
from hil.files import write_whole
from hil.gap.next.propose import Proposal
from hil.identify.experiments import Custom, Design, design
from hil.identify.experiments.custom import read_custom
from hil.runs.cuefile import write_cue_file
from hil.runs.folder import Payload


def write_proposal(path: Path, proposal: Proposal) -> Design:
    """Write `path` (an experiment's description) and its motion beside it as .csv; returns the design.

    It is what guard and shaper let through as designed. RunError if the disk refuses or one of them is there
    already, LimitViolation where no size of the motion passes; then there is neither.
    """
    csv = motion_beside(path)
    for file in (path, csv):
        if file.exists():
            raise RunError(f"{file}: exists already; a proposal never overwrites")
    try:
        return _write(path, csv, proposal)
    except BaseException:
        csv.unlink(missing_ok=True)
        raise


def motion_beside(path: Path) -> Path:
    """Where the motion of the experiment at `path` goes; RunError where that is no .toml."""
    if path.suffix != ".toml":
        raise RunError(f"{path}: an experiment is a .toml file, and its motion a .csv beside it")
    return path.with_suffix(".csv")


def _write(path: Path, csv: Path, proposal: Proposal) -> Design:
    rig = proposal.rig
    write_cue_file(csv, proposal.sketch.trajectory, rig.name, [proposal.sentence])
    plan, motion = read_custom(Custom(file=str(csv)))
    made = design(plan, rig, motion)
    payload = None
    if proposal.sketch.payload_kg:
        x, y, z = rig.mass.cog
        payload = Payload(mass=proposal.sketch.payload_kg, x=x, y=y, z=z)
    description = made.description.model_copy(
        update={
            "plan": plan.model_copy(update={"file": csv.name}),
            "purpose": proposal.sentence,
            "payload": payload,
        }
    )
    text = tomlkit.dumps(description.model_dump(mode="json", exclude_none=True))
    try:
        write_whole(path, text)
    except OSError as error:
        raise RunError(f"{path}: cannot be written: {error.strerror}") from error
    return made
