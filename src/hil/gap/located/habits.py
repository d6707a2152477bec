"""What drives may do that a rig file seldom knows: habits, not faults.

- They rest at setpoints. A drive that draws a line to each setpoint may start it from where the line before
  would be by now, or from what its last tick asked for (`bus.interpolation`). The latter stands still for a
  tick each cycle: force that is sampled in step with setpoints then looks like drag in proportion to speed,
  on a healthy rig.
- They feed the static force forward beside their cascade (law "cascade_static"). Their integrators have less
  to do, so that a load that changes with the pose leaves less of an error in the position.

A record is asked how much of the difference that a habit makes it holds. Where that is nothing, the drives
have no such habit; where it is something, both twins are worth a look.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from hil.config import RigFile
from hil.gap.located.residual import counted
from hil.gap.located.result import Located
from hil.gap.located.sanity import Finding
from hil.gap.record.problem import Problem

HELD: Final = 0.1
"""Share of a habit, either way (when within a cycle force is sampled is not told exactly), from which on a
record may hold it [set on tuning seeds: 0.03 at most where drives do not rest and nothing is viscous]."""
TOLD: Final = 0.01
"""Of what calibration leaves, in energy, that it must explain."""


@dataclass(frozen=True, slots=True)
class Habit:
    """One habit: what it is in a rig file, and what the reader is told of it."""

    key: str
    """In a rig file: "table.key", of every actuator where the table is theirs."""
    value: str
    """What stands there for drives that have it."""
    step: str
    """What is done once more, in words."""
    free: str
    """Ending of the nuisances that it moves of itself: they are free where a record is asked."""
    may: Callable[[RigFile], bool]
    """Whether drives of a rig file could have it and do not."""
    twin: Callable[[RigFile], RigFile]
    """The rig file with drives that have it."""
    text: Callable[[RigFile], str]
    """What is said of drives of a rig file that were found to have it."""

    def found(self, rig: RigFile) -> Finding:
        """What the reader must know where drives of `rig` were found to have it."""
        told = f'{self.text(rig)}: the twin does so with them; "{self.value}" belongs into the rig file'
        return Finding("warning", self.key, told)


def _may_rest(rig: RigFile) -> bool:
    bus = rig.bus
    return (
        bus.interpolation == "linear"
        and not bus.retimed
        and bus.position_loop > bus.speed_loop
        and bus.cycle > 1.5 * bus.position_loop
    )


def _resting(rig: RigFile) -> RigFile:
    bus = rig.bus.model_copy(update={"interpolation": RESTS.value})
    return rig.model_copy(update={"bus": bus})


def _may_feed(rig: RigFile) -> bool:
    return all(a.law == "cascade" and a.static_ff > 0.0 for a in rig.actuators)


def _feeding(rig: RigFile) -> RigFile:
    actuators = (a.model_copy(update={"law": FEEDS.value}) for a in rig.actuators)
    return rig.model_copy(update={"actuators": tuple(actuators)})


RESTS: Final = Habit(
    "bus.interpolation", "linear_rests", "drives that rest for a tick at each setpoint",
    "transport_delay.delay", _may_rest, _resting,
    lambda rig: (
        f"the drives stand still for a tick of {1e3 * rig.bus.position_loop:g} ms at each setpoint, unlike "
        f'"{rig.bus.interpolation}"'
    ),
)  # fmt: skip
"""Drives that rest are later by about half a tick: how late setpoints are is free."""
FEEDS: Final = Habit(
    "actuators.law", "cascade_static", "drives that feed the static force forward", "", _may_feed, _feeding,
    lambda rig: (
        f"the drives feed {rig.actuators[0].static_ff:g} of the static force forward beside their cascade"
    ),
)  # fmt: skip
HABITS: Final = (RESTS, FEEDS)


def seems_to(habit: Habit, located: Located) -> bool:
    """Whether what calibration left holds some of what drives with a habit would do differently, beside all
    that the nuisances may do."""
    e = located.evidence
    problem, noise = e.problem, e.noise
    if not habit.may(problem.rig):
        return False
    other = Problem(
        habit.twin(problem.rig), problem.sent, clocks=problem.clocks, settle_s=problem.settle_s
    )
    change = other.predict(e.vector)[0] - problem.predict(e.vector)[0]
    kept = problem.kept
    white = noise.whiten(problem, e.residual)[kept]
    spread = max(1.0, 1.4826 * float(np.median(np.abs(white))))
    counts = np.sqrt(counted(white / spread))
    sd = np.array([f.prior_sd for f in located.nuisances])
    columns = [noise.whiten(problem, change)[kept], noise.whiten(problem, e.jacobian)[kept] * sd]
    a, b = np.column_stack(columns) * counts[:, None], white * counts
    known = [not (habit.free and f.name.endswith(habit.free)) for f in located.nuisances]
    prior = problem.discount * np.diag([0.0, *np.asarray(known, dtype=float)])
    normal, right = a.T @ a + prior, a.T @ b
    with_it = np.linalg.lstsq(normal, right, rcond=None)[0]
    without = np.linalg.lstsq(normal[1:, 1:], right[1:], rcond=None)[0]
    left = float(np.sum((b - a @ with_it) ** 2))
    before = float(np.sum((b - a[:, 1:] @ without) ** 2))
    return abs(float(with_it[0])) > HELD and left < (1.0 - TOLD) * before
