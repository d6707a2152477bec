"""Whether drives may rest for a tick at each setpoint, which a rig file seldom knows.

A drive that draws a line to each setpoint may start it from where the line before would be by now, or from
what its last tick asked for (`bus.interpolation`). The latter stands still for a tick each cycle: force that
is sampled in step with setpoints then looks like drag in proportion to speed, on a healthy rig. So a record
is asked how much of the difference between the two it holds. Where that is nothing, the drives do not rest;
where it is something, both are worth a look.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from hil.config import RigFile
from hil.gap.located.residual import counted
from hil.gap.located.result import Located
from hil.gap.located.sanity import Finding
from hil.gap.record.problem import Problem

KEY: Final = "interpolation"
"""In a rig file's table `bus`."""
RESTING: Final = "linear_rests"
"""Its value for drives that rest."""
HELD: Final = 0.1
"""Share of the rest, either way (when within a cycle force is sampled is not told exactly), from which on a
record may hold it [set on tuning seeds: 0.03 at most where drives do not rest and nothing is viscous]."""
TOLD: Final = 0.01
"""Of what calibration leaves, in energy, that it must explain."""


def may_rest(rig: RigFile) -> bool:
    """Whether drives of `rig` draw lines from ticks of theirs that others could rest for."""
    bus = rig.bus
    return (
        bus.interpolation == "linear"
        and not bus.retimed
        and bus.position_loop > bus.speed_loop
        and bus.cycle > 1.5 * bus.position_loop
    )


def resting_twin(rig: RigFile) -> RigFile:
    """`rig` with drives that rest for a tick at each setpoint."""
    bus = rig.bus.model_copy(update={KEY: RESTING})
    return rig.model_copy(update={"bus": bus})


def rest_found(rig: RigFile) -> Finding:
    """What the reader must know where drives of `rig` were found to rest."""
    return Finding(
        "warning", f"bus.{KEY}",
        f"the drives stand still for a tick of {1e3 * rig.bus.position_loop:g} ms at each setpoint, unlike "
        f'"{rig.bus.interpolation}": the twin rests with them; "{RESTING}" belongs into the rig file',
    )  # fmt: skip


def seems_to_rest(located: Located) -> bool:
    """Whether what calibration left holds some of what drives that rest would do differently, beside all that
    the nuisances may do.

    How late setpoints are is free: drives that rest are later by about half a tick.
    """
    e = located.evidence
    problem, noise = e.problem, e.noise
    if not may_rest(problem.rig):
        return False
    resting = Problem(
        resting_twin(problem.rig), problem.sent, clocks=problem.clocks, settle_s=problem.settle_s
    )
    change = resting.predict(e.vector)[0] - problem.predict(e.vector)[0]
    kept = problem.kept
    white = noise.whiten(problem, e.residual)[kept]
    spread = max(1.0, 1.4826 * float(np.median(np.abs(white))))
    counts = np.sqrt(counted(white / spread))
    sd = np.array([f.prior_sd for f in located.nuisances])
    columns = [noise.whiten(problem, change)[kept], noise.whiten(problem, e.jacobian)[kept] * sd]
    a, b = np.column_stack(columns) * counts[:, None], white * counts
    known = [not f.name.endswith("transport_delay.delay") for f in located.nuisances]
    prior = problem.discount * np.diag([0.0, *np.asarray(known, dtype=float)])
    normal, right = a.T @ a + prior, a.T @ b
    with_it = np.linalg.lstsq(normal, right, rcond=None)[0]
    without = np.linalg.lstsq(normal[1:, 1:], right[1:], rcond=None)[0]
    left = float(np.sum((b - a @ with_it) ** 2))
    before = float(np.sum((b - a[:, 1:] @ without) ** 2))
    return abs(float(with_it[0])) > HELD and left < (1.0 - TOLD) * before
