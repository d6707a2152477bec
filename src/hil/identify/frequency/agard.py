"""The measures of AGARD Advisory Report 144 of one rig: from its file, and from sinusoids and steps.

"Dynamic Characteristics of Flight Simulator Motion Systems" (1979) asks of every motion system excursion
limits, describing function, linearity and acceleration noise, hysteresis and dynamic threshold [F: abstract;
definitions M]. `docs/describing-functions.md` says how each is defined here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.errors import IdentificationError
from hil.identify.frequency.acceleration import acceleration
from hil.identify.frequency.agard_sines import SineMeasures, measure_sine
from hil.identify.frequency.agard_steps import Threshold, find_steps, measure_steps
from hil.identify.frequency.channels import channel
from hil.identify.frequency.windows import measuring_windows
from hil.rigs import build_rig
from hil.rigs.workspace import single_axis_ranges
from hil.runs import Run

Array = NDArray[np.float64]

MOVED: Final = 0.02
"""A coordinate takes part where its cue uses this share of the most used coordinate's limit."""


@dataclass(frozen=True, slots=True)
class Excursion:
    """How far, fast and hard one coordinate can go alone, from neutral; m or rad and seconds."""

    coordinate: str
    unit: str
    low: float
    high: float
    """Ends of travel, where the first actuator reaches its stroke's end."""
    velocity: float
    """At neutral, where the first actuator reaches its velocity_max."""
    acceleration: float
    """At neutral, where the first drive reaches force_max beside holding the weight, either way."""
    operational: float
    """Limit of the rig file's workspace, each way."""
    operational_velocity: float
    operational_acceleration: float
    """What cues may ask for."""


@dataclass(frozen=True, slots=True)
class AgardAnalysis:
    """All measures that the runs allow."""

    rig: str
    excursions: tuple[Excursion, ...]
    sines: tuple[SineMeasures, ...]
    thresholds: tuple[Threshold, ...]
    notes: tuple[str, ...] = ()


def excursions(rig: RigFile) -> tuple[Excursion, ...]:
    """Excursion limits of every coordinate alone, by geometry, drives and rig file."""
    m = build_rig(rig)
    ranges = single_axis_ranges(m)
    J = m.jacobian(m.neutral)
    speed = np.array([a.velocity_max for a in rig.actuators])
    force = np.array([a.force_max for a in rig.actuators])
    hold = m.inverse_dynamics(m.neutral, m.neutral, m.neutral)
    cue_velocity, cue_acceleration, _ = rig.cue_limits()
    out = []
    for k, name in enumerate(rig.coordinates):
        unit = np.zeros(m.n)
        unit[k] = 1.0
        per = m.inverse_dynamics(m.neutral, m.neutral, unit) - hold
        with np.errstate(divide="ignore"):
            velocity = float(np.min(speed / np.abs(J[:, k])))
            room = np.minimum((force - hold) / np.abs(per), (force + hold) / np.abs(per))
        out.append(
            Excursion(
                name,
                "rad" if rig.rotates(name) else "m",
                float(ranges[k, 0]),
                float(ranges[k, 1]),
                velocity,
                float(np.min(room)),
                rig.limits[k],
                cue_velocity[k],
                cue_acceleration[k],
            )
        )
    return tuple(out)


def agard(runs: Sequence[Run], rig: RigFile) -> AgardAnalysis:
    """Excursions of the rig, and the measures of each run: a sinusoid or acceleration steps of one
    coordinate. IdentificationError where a run is neither, or moves several coordinates."""
    sines: list[SineMeasures] = []
    thresholds: list[Threshold] = []
    notes: list[str] = []
    for run in runs:
        coordinate = _alone(run, rig)
        cue = channel(run, rig, f"cue.{coordinate}")
        pose = channel(run, rig, coordinate)
        felt = acceleration(run, rig, coordinate)
        name = run.path.name
        if felt.order == 2:
            notes.append(
                f"{name}: no IMU along {coordinate}: noise is only what harmonics of the pose tell"
            )
        steps = find_steps(cue)
        if steps is not None:
            thresholds += measure_steps(name, coordinate, steps, felt)
            continue
        windows = measuring_windows(run, cue, (pose, felt.channel), None)
        if not windows:
            raise IdentificationError(
                f"{name}: cue.{coordinate} is neither a sinusoid of some periods nor steps of acceleration"
            )
        told = all(f"{a}.setpoint" in run.table.columns for a in rig.actuator_names)
        setpoint = channel(run, rig, f"setpoint.{coordinate}") if told else None
        sines += [measure_sine(name, coordinate, w, cue, setpoint, pose, felt) for w in windows]
    sines.sort(key=lambda s: (s.coordinate, s.hz, s.commanded))
    return AgardAnalysis(rig.name, excursions(rig), tuple(sines), tuple(thresholds), tuple(notes))


def _alone(run: Run, rig: RigFile) -> str:
    """The one coordinate whose cue moves."""
    uses = {
        c: float(np.nanmax(np.abs(run.table[f"cue.{c}"]))) / limit
        for c, limit in zip(rig.coordinates, rig.limits, strict=True)
        if f"cue.{c}" in run.table.columns
    }
    most = max(uses.values(), default=0.0)
    moved = [c for c, use in uses.items() if use > MOVED * most and use > 0.0]
    if len(moved) != 1:
        said = " and ".join(moved) if moved else "no coordinate"
        raise IdentificationError(
            f"{run.path.name}: its cues move {said}: these measures are of one coordinate moved alone"
        )
    return moved[0]
