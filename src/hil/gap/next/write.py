"""A proposal as files that `hil experiment` plays: its description, and its motion beside it."""

from __future__ import annotations

from pathlib import Path

import tomlkit

from hil.errors import RunError
from hil.gap.next.propose import Proposal
from hil.identify.experiments import Custom, Design, design
from hil.identify.experiments.custom import read_custom
from hil.runs.cuefile import write_cue_file
from hil.runs.folder import Payload


def write_proposal(path: Path, proposal: Proposal) -> Design:
    """Write `path` (an experiment's description) and its motion beside it as .csv; returns the design.

    It is what guard and shaper let through as designed. RunError if the disk refuses, LimitViolation where no
    size of the motion passes.
    """
    rig = proposal.rig
    csv = path.with_suffix(".csv")
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
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise RunError(f"{path}: cannot be written: {error.strerror}") from error
    return made
