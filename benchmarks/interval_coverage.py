"""Do the intervals hold? Share of simulated experiments whose intervals contain the truth.

Each experiment draws mass and friction of the axis, another random-phase multisine, other noise and jitter,
and is identified from nothing but its samples: `python -m benchmarks interval_coverage`.
"""

from __future__ import annotations

import numpy as np
from tests.identify.estimate_data import multisine, play

from benchmarks.figure import Options, Table
from hil.configfile import load_rig
from hil.identify.estimate import LinearOptions
from hil.identify.estimate.fit import identify_linear
from hil.identify.estimate.fit_twin import identification_of
from hil.identify.estimate.outputerror import fit
from hil.identify.estimate.result import Identification
from hil.identify.estimate.twinproblem import TwinProblem

NAMES = ("mass.m", "axis.viscous", "axis.coulomb")
METHODS = ("wls", "iv", "twin")
DURATION_S = 6.0
TOP_HZ = 3.0
EXPERIMENTS = 200


def experiment(
    seed: int, methods: tuple[str, ...] = METHODS
) -> dict[str, dict[str, tuple[float, ...]]]:
    """By method and parameter: (within 90 %, within 95 %, error in standard deviations)."""
    rig = load_rig("axis")
    rng = np.random.default_rng(seed)
    truth = dict(
        zip(NAMES, rng.uniform((76.0, 60.0, 10.0), (124.0, 250.0, 50.0)).tolist(), strict=True)
    )
    piece = play(rig, multisine(rig, DURATION_S, seed, TOP_HZ), truth=truth, seed=seed + 10**6)
    out = {}
    for method in methods:
        result: Identification
        if method == "twin":
            problem = TwinProblem(rig, [piece], NAMES)
            result = identification_of(problem, fit(problem), "twin", ())
        elif method == "wls":
            result = identify_linear([piece], rig, LinearOptions("wls", draws=1)).identification
        else:
            result = identify_linear([piece], rig, LinearOptions("iv", draws=1)).identification
        out[method] = {
            n: (
                float(result[n].ci90[0] <= truth[n] <= result[n].ci90[1]),
                float(result[n].ci95[0] <= truth[n] <= result[n].ci95[1]),
                (result[n].value - truth[n]) / result[n].std,
            )
            for n in NAMES
        }
    return out


def coverage(experiments: int, methods: tuple[str, ...] = METHODS) -> Table:
    """The table over `experiments` seeds."""
    found = [experiment(seed, methods) for seed in range(experiments)]
    rows: dict[str, tuple[float, ...]] = {}
    for method in methods:
        for name in NAMES:
            each = np.array([f[method][name] for f in found])
            rows[f"{method} {name}"] = (
                float(each[:, 0].mean()),
                float(each[:, 1].mean()),
                float(each[:, 2].mean()),
                float(each[:, 2].std()),
            )
    return Table(
        f"intervals that hold the truth, {experiments} simulated experiments of {DURATION_S:g} s",
        ("of 90 %", "of 95 %", "mean error / std", "spread of error / std"),
        rows,
    )


def measure(options: Options = Options()) -> list[Table]:  # noqa: B008 - a frozen value
    """Every method."""
    return [coverage(3 if options.quick else EXPERIMENTS)]
