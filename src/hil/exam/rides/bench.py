"""How large an effect shows in a ride: in what the nominal model, told lean, wheel and steer, leaves unsaid.

A rider who feels an effect rides another path, so that raw signals of two rides say nothing. What is
compared is therefore the model's residual: of the ride with the effect minus that of the healthy ride, both
without noise, over what noise alone makes of the healthy one.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from hil.bicycle.checks import check_ride
from hil.bicycle.manoeuvres import Manoeuvre
from hil.bicycle.recorded import prepare
from hil.config import BicycleFile, Effect
from hil.errors import HilError
from hil.exam.rides.record import record
from hil.exam.rides.world import Bicycle, ride
from hil.exam.world import Outside, Scatter
from hil.exam.world.play import WorldError
from hil.gap.bicycle import RideProblem
from hil.runs import Run, RunMeta
from hil.runs.table import check_table

Array = NDArray[np.float64]
DRAWS = 2


@dataclass(frozen=True, slots=True)
class RideBench:
    """A manoeuvre on a healthy bicycle, to measure effects against."""

    rig: BicycleFile
    scatter: Scatter
    manoeuvre: Manoeuvre
    seed: int
    healthy: dict[str, tuple[Array, Array]]
    """By signal: instants and the residual without noise."""
    floor: dict[str, float]

    @classmethod
    def of(cls, rig: BicycleFile, scatter: Scatter, manoeuvre: Manoeuvre, seed: int) -> RideBench:
        """Ride it healthy, record it without noise and twice with."""
        b = Bicycle(rig, scatter)
        ridden = ride(b, manoeuvre, seed)
        healthy = _residual(rig, record(b, ridden, None))
        power: dict[str, list[float]] = {s: [] for s in healthy}
        for draw in range(DRAWS):
            for s, (t, r) in _residual(rig, record(b, ridden, seed + 7919 * draw)).items():
                off = r - np.interp(t, *healthy[s])
                power[s].append(float(np.mean(off**2)))
        floor = {s: float(np.sqrt(np.mean(p))) for s, p in power.items()}
        return cls(rig, scatter, manoeuvre, seed, healthy, floor)

    def trace(
        self, effects: tuple[Effect, ...], outside: tuple[Outside, ...] = ()
    ) -> dict[str, float]:
        """By signal, the trace over the floor; WorldError where it cannot be ridden."""
        b = Bicycle(self.rig, self.scatter, effects, outside)
        found = _residual(self.rig, record(b, ride(b, self.manoeuvre, self.seed), None))
        out = {}
        for s, (t, r) in self.healthy.items():
            off = np.interp(t, *found[s]) - r
            out[s] = float(np.sqrt(np.mean(off**2))) / self.floor[s]
        return out


def _residual(rig: BicycleFile, table: pd.DataFrame) -> dict[str, tuple[Array, Array]]:
    run = Run(
        Path("bench"), RunMeta(rig=rig.name, mode="ride"), None, check_table(table, "bench", rig),
        pd.DataFrame({"t": []}), (), None, rig,
    )  # fmt: skip
    try:
        prepared = prepare(run, rig)
        faults = [f.text for f in check_ride(prepared) if f.verdict == "fault"]
        if faults:
            raise WorldError(f"{rig.name}: {faults[0]}")
        problem = RideProblem(rig, [prepared])
        residual = problem.residual(problem.base)
    except HilError as error:
        raise WorldError(str(error)) from error
    return {
        x.signal: (
            problem.t_s[x.part][problem.kept[x.part]],
            residual[x.part][problem.kept[x.part]],
        )
        for x in problem.series
    }
