"""Whether the daemon's shaping lets a motion through as it was designed: guard and shaper, in a loop."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline

from hil.config import RigFile
from hil.control.guard import CueGuard
from hil.control.shaping import CueShaper
from hil.control.streaming import cues, motion_of
from hil.control.trajectory import CueTrajectory
from hil.identify.experiments.signals import Array
from hil.rigs import Manipulator
from hil.signals import Cue

CUE_HZ: Final = 100.0
AHEAD_S: Final = 0.12
SETTLE_S: Final = 0.5
"""After the soft start, and at the end until everything rests."""
DEVIATION: Final = 0.01
"""Of a coordinate's peak: shaping passes a cue inside all limits, so that only what is read between its
poses may differ; more is not the design."""
STILL: Final = 2.0e-5
"""Deviations below this, m or rad, are no motion."""


@dataclass(frozen=True, slots=True)
class Shaped:
    """What shaping makes of a motion."""

    deviation: Array
    """(n,) largest |shaped - designed| of each coordinate, m or rad."""
    peak: Array
    """(n,) largest |designed|."""
    held_back: str
    """The first rule by which guard or shaper changed the motion, and when; empty where none did."""

    @property
    def relative(self) -> float:
        """Largest deviation of a coordinate that moves, as a share of its peak."""
        moving = self.peak > STILL
        return float(np.max(self.deviation[moving] / self.peak[moving], initial=0.0))

    @property
    def is_as_designed(self) -> bool:
        """Nothing held the motion back, and it is the designed one."""
        small = self.deviation <= np.maximum(DEVIATION * self.peak, STILL)
        return not self.held_back and bool(np.all(small))

    def __str__(self) -> str:
        if self.held_back:
            return f"shaping would hold it back: {self.held_back}"
        return f"shaping would change it by {100.0 * self.relative:.2g} % of its peak"


def lead_s(rig: RigFile) -> float:
    """How long the first pose is held, s: the rig's soft start must be over before anything moves."""
    return rig.cue.ramp_in + SETTLE_S


def experiment_cues(
    trajectory: CueTrajectory, rig: RigFile, client: str = "experiment"
) -> Iterator[Cue]:
    """Cues whose poses are the very rows of `trajectory`; its first row is at `lead_s(rig)`."""
    step_s = trajectory.step_s
    ahead_s = min(AHEAD_S, 0.9 * rig.cue.future)
    offsets = [k * step_s for k in range(int(ahead_s / step_s + 1.0e-9) + 1)]
    first_s, last_s = float(trajectory.t_s[0]), float(trajectory.t_s[-1])
    return cues(
        motion_of(trajectory), first_s - lead_s(rig), last_s + SETTLE_S, client, CUE_HZ, offsets
    )


def shaped(trajectory: CueTrajectory, rig: RigFile, manipulator: Manipulator) -> Shaped:
    """Shape `trajectory` cycle by cycle, as the daemon would; no further than to where it is held back."""
    guard, shaper = CueGuard(rig), CueShaper(rig, manipulator)
    shaper.reset(np.asarray(rig.parked_pose))
    shaper.follow()
    start_s, cycle_s = lead_s(rig) - float(trajectory.t_s[0]), rig.bus.cycle
    held_back = ""
    made: list[tuple[float, Array]] = []
    cycle = 0
    for cue in experiment_cues(trajectory, rig):
        while cycle * cycle_s < cue.received_s - 1.0e-9 and not held_back:
            reference = shaper.step(cycle * cycle_s)
            made.append((reference.t_s - start_s, reference.pose))
            cycle += 1
            if shaper.counts:
                held_back = f"{next(iter(shaper.counts))} at {made[-1][0]:.2f} s"
        verdict = guard.check(cue, cue.received_s)
        if verdict.name != "accepted":
            held_back = f"{verdict.name} at {cue.received_s - start_s:.2f} s"
        if held_back or verdict.cue is None:
            break
        shaper.accept(verdict.cue)
    t = np.array([t_s for t_s, _ in made])
    inside = (t >= trajectory.t_s[0]) & (t <= trajectory.t_s[-1])
    poses = np.array([pose for _, pose in made])[inside]
    designed = CubicSpline(trajectory.t_s, trajectory.poses, axis=0)(t[inside])
    return Shaped(
        np.max(np.abs(poses - designed), axis=0, initial=0.0),
        np.max(np.abs(trajectory.poses), axis=0),
        held_back,
    )
