"""Looks at the data before anything is fitted: wrong rig, unit, sign, clipped or dead signals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.errors import IdentificationError
from hil.identify.estimate.prepare import Prepared
from hil.identify.estimate.regression import Regression
from hil.identify.replay import Stretch
from hil.runs import Run

Array = NDArray[np.float64]
CLIPPED: Final = 0.01
"""Share of samples at a limit from which on a record is refused."""
REPEATS: Final = 6
"""Equal extreme values in a row that no moving drive gives [R]."""
LEAST_MOVING: Final = 0.02
"""Share of the time that an actuator must move for its friction to be judged."""
QUIET: Final = 0.02
"""Share of its limits on position and on speed below which a coordinate counts as at rest [R]."""
TOO_LITTLE: Final = (
    "too little excitation to identify anything. Play a chirp or a multisine (hil experiment), with a "
    "larger --amplitude or --share"
)


def check_rig(run: Run, rig: RigFile) -> None:
    """IdentificationError where `run` was made with another rig than `rig` describes."""
    if run.meta.rig != rig.name:
        raise IdentificationError(
            f"{run.path.name}: is a run of the rig {run.meta.rig!r}, not of {rig.name!r}: give its own "
            "rig file with --rig"
        )
    if run.rig is None:
        return
    for what, a, b in (
        ("kind", run.rig.kind, rig.kind),
        ("actuators", run.rig.actuator_names, rig.actuator_names),
        ("geometry", run.rig.geometry, rig.geometry),
    ):
        if a != b:
            raise IdentificationError(
                f"{run.path.name}: was recorded with another {what} than the rig file {rig.name!r} "
                "now has: give the rig file of the rig that ran with --rig"
            )


def check_signals(piece: Stretch, rig: RigFile) -> list[str]:
    """Warnings about `piece`; IdentificationError for what no estimator may be given."""
    notes = []
    for a in rig.actuators:
        _, position = piece.samples.get(f"{a.name}.position", (None, np.empty(0)))
        _check_stroke(piece.name, a.name, position, a.stroke)
        _, force = piece.samples.get(f"{a.name}.force", (None, np.empty(0)))
        if not len(force):
            continue
        at_limit = float(np.mean(np.abs(force) >= 0.98 * a.force_max))
        flat = _flat(force)
        if max(at_limit, flat) > CLIPPED:
            why = (
                f"stands at the drive's limit of {a.force_max:g} N"
                if at_limit >= flat
                else f"is clipped at {force[np.argmax(np.abs(force))]:g} N"
            )
            raise IdentificationError(
                f"{piece.name}: {a.name}.force {why} in {100 * max(at_limit, flat):.1f} % of its samples: "
                "what it does not show cannot be identified. Play a smaller or slower motion, or raise the "
                "range of the signal"
            )
        if at_limit > 0.0:
            notes.append(f"{piece.name}: {a.name}.force touches the drive's limit for a moment")
    return notes


def check_force(problem: Regression, rig: RigFile) -> None:
    """Sign and unit of each actuator's force against what the rig file predicts of the same motion.

    IdentificationError only for what no wrong parameter makes: opposite sign, or a factor above 20.
    """
    known = problem.W @ problem.nominal
    for i, name in enumerate(rig.actuator_names):
        rows = problem.keep[:, i]
        if rows.sum() < 20:
            continue
        force, expected = (
            _total(problem, i)[rows],
            (_total(problem, i) - problem.y[:, i] + known[:, i])[rows],
        )
        power = float(np.sqrt((force @ force) * (expected @ expected)))
        if power <= 0.0:
            raise IdentificationError(f"{name}.force is 0 throughout: does the drive answer it?")
        alike = float(force @ expected) / power
        factor = float(force @ expected) / float(expected @ expected)
        if alike < -0.5:
            raise IdentificationError(
                f"{name}: force and position have opposite signs (correlation {alike:.2f} with what the rig "
                f"file predicts): turn the sign of {name}.force or of {name}.position"
            )
        if alike > 0.7 and not 0.05 < factor < 20.0:
            guess = "kN" if factor < 1.0 else "mN"
            raise IdentificationError(
                f"{name}.force is {factor:.3g} times what the rig file predicts: is it in N? It looks like "
                f"{guess} or A"
            )


def check_answers(signals: Sequence[tuple[str, Array, Array]]) -> None:
    """Sign and unit of measured signals against what the twin of the rig file answers to the same setpoints.

    `signals`: name, measured, predicted. IdentificationError for opposite sign and for factors that no wrong
    parameter makes.
    """
    for name, measured, predicted in signals:
        power = float(np.sqrt((measured @ measured) * (predicted @ predicted)))
        if power <= 0.0:
            continue
        alike = float(measured @ predicted) / power
        factor = float(measured @ predicted) / float(predicted @ predicted)
        if alike < -0.5:
            raise IdentificationError(
                f"{name} has the opposite sign of what the rig file predicts (correlation {alike:.2f}): "
                "turn it"
            )
        most, unit = (
            (4.0, "m/s² or rad/s") if ".imu." in f".{name}" else (20.0, "SI units (m, rad, N)")
        )
        if alike > 0.7 and not 1.0 / most < factor < most:
            raise IdentificationError(
                f"{name} is {factor:.3g} times what the rig file predicts: is it in {unit}?"
            )


def check_motion(prepared: Sequence[Prepared], rig: RigFile) -> dict[str, str]:
    """Reasons, by parameter's name, why these data cannot tell it: actuators that stood still.

    IdentificationError where no coordinate moved at all.
    """
    reasons: dict[str, str] = {}
    still = []
    for i, name in enumerate(rig.actuator_names):
        share = float(np.mean(np.concatenate([p.moving[:, i] for p in prepared])))
        if share < LEAST_MOVING:
            still.append(name)
            for field in ("viscous", "coulomb"):
                reasons[f"{name}.{field}"] = f"{name} never moved: friction there cannot be judged"
    runs = ", ".join(p.name for p in prepared)
    if len(still) == len(rig.actuators):
        raise IdentificationError(
            f"{runs}: no actuator moved faster than its noise "
            f"({1e3 * float(prepared[0].slowest_m_s.max()):.2g} mm/s): {TOO_LITTLE}"
        )
    quiet = quiet_coordinates(prepared, rig)
    if len(quiet) == len(rig.coordinates):
        uses = ", ".join(f"{name} {100.0 * use:.2g} %" for name, use in quiet.items())
        raise IdentificationError(
            f"{runs}: no coordinate used {100.0 * QUIET:g} % of its limits ({uses}): {TOO_LITTLE}"
        )
    return reasons


def quiet_coordinates(prepared: Sequence[Prepared], rig: RigFile) -> dict[str, float]:
    """Coordinates that hardly moved, with the share of their limits that they used: span or speed."""
    found = {}
    speeds = rig.cue_limits()[0]
    for k, name in enumerate(rig.coordinates):
        span = max(float(np.ptp(p.q[:, k])) for p in prepared)
        speed = max(float(np.max(np.abs(p.qd[:, k]))) for p in prepared)
        share = max(span / rig.limits[k], speed / speeds[k])
        if share < QUIET:
            found[name] = share
    return found


def at_rest(quiet: Mapping[str, float]) -> list[str]:
    """A sentence about each coordinate that hardly moved."""
    return [
        f"{name} never moved ({100.0 * share:.2g} % of its limits): what only {name} shows, such as its "
        "moment of inertia, cannot be told"
        for name, share in quiet.items()
    ]


def _total(problem: Regression, i: int) -> Array:
    measured: Array = np.concatenate([p.force[:, i] for p in problem.prepared])
    return measured


def _flat(values: Array) -> float:
    """Share of samples that repeat the record's extreme REPEATS times in a row or more, while others vary."""
    if np.ptp(values) == 0.0:
        return 0.0
    worst = 0
    for extreme in (values.max(), values.min()):
        at = np.concatenate([[False], values == extreme, [False]])
        edges = np.flatnonzero(np.diff(at.astype(int)))
        lengths = edges[1::2] - edges[::2]
        worst = max(worst, int(lengths[lengths >= REPEATS].sum()))
    return worst / len(values)


def _check_stroke(run: str, name: str, position: Array, stroke: tuple[float, float]) -> None:
    low, high = stroke
    slack = 0.1 * (high - low)
    outside = (position < low - slack) | (position > high + slack)
    if not len(position) or outside.mean() <= CLIPPED:
        return
    middle = float(np.median(position[outside]))
    guess = "the rig file is of another rig, or positions count from another zero"
    for factor, unit in ((1e-3, "mm"), (np.pi / 180.0, "degrees")):
        if low - slack <= middle * factor <= high + slack:
            guess = f"it looks like {unit}: hil takes m and rad"
            break
    raise IdentificationError(
        f"{run}: {name}.position lies around {middle:.4g}, outside the stroke {low:g}..{high:g}: {guess}"
    )
