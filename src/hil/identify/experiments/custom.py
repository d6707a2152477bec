"""The motion of a custom experiment: read from its file, and that file kept beside the description."""

from __future__ import annotations

import hashlib
from pathlib import Path

from hil.control.trajectory import CueTrajectory
from hil.errors import RunError
from hil.identify.experiments.plans import Custom
from hil.runs.cuefile import read_cue_file
from hil.runs.folder import CUSTOM_CSV


def read_custom(plan: Custom) -> tuple[Custom, CueTrajectory]:
    """The plan with its file's SHA-256 filled in, and the motion; RunError where it cannot be read.

    A plan that already has one must find the same file: a description never means another motion.
    """
    path = Path(plan.file)
    trajectory = read_cue_file(path).trajectory
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    if plan.sha256 and plan.sha256 != digest:
        raise RunError(f"{path}: is not the file that this experiment was designed with")
    return plan.model_copy(update={"sha256": digest}), trajectory


def keep_custom(plan: Custom, folder: Path) -> Custom:
    """Copy the plan's file into `folder`; returns the plan with that copy's name, which is played again.

    Where the file has gone or changed since it was read there is nothing to copy: the plan stays as it is.
    OSError if the disk refuses.
    """
    try:
        content = Path(plan.file).read_bytes()
    except OSError:
        return plan
    if hashlib.sha256(content).hexdigest() != plan.sha256:
        return plan
    kept = folder / CUSTOM_CSV
    if not (kept.exists() and kept.samefile(plan.file)):
        kept.write_bytes(content)
    return plan.model_copy(update={"file": CUSTOM_CSV})
