"""Do the intervals hold? Share of simulated experiments whose intervals contain the truth.

Each experiment draws mass, moments and friction of the rig, another random-phase multisine, other noise and
jitter, and is identified from nothing but its samples: `python -m benchmarks interval_coverage`. An hour and
more; by parts, rig by rig: `--save rows.json --parts stewart`.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import numpy as np
from tests.identify.estimate_data import multisine, play

from benchmarks.figure import Cell, Options, Table
from benchmarks.parts import Part, measured
from hil.config import RigFile
from hil.configfile import load_rig
from hil.identify.estimate import LinearOptions
from hil.identify.estimate.fit import identify_linear
from hil.identify.estimate.fit_twin import default_parameters, identification_of
from hil.identify.estimate.names import number
from hil.identify.estimate.outputerror import fit
from hil.identify.estimate.result import Estimate
from hil.identify.estimate.twinproblem import TwinProblem
from hil.identify.replay import Stretch

METHODS = ("wls", "iv", "twin")
RIGS = {"axis": 6.0, "motorcycle": 8.0, "stewart": 8.0}
"""Seconds of an experiment."""
TOP_HZ = 3.0
EXPERIMENTS = 200
DRAWN = (0.8, 1.25)
"""The truth, in parts of the rig file's number."""


def experiment(
    rig: RigFile, seed: int, duration_s: float, methods: Iterable[str] = METHODS
) -> dict[str, dict[str, list[tuple[float, ...]]]]:
    """By method and parameter (legs' friction together): (within 90 %, within 95 %, error in deviations)."""
    rng = np.random.default_rng(seed)
    names = [n for n in default_parameters(rig) if "bias" not in n]
    drawn = rng.uniform(*DRAWN, len(names))
    truth = {n: float(x * number(rig, n).scale) for n, x in zip(names, drawn, strict=True)}
    poses = multisine(rig, duration_s, seed, TOP_HZ)
    piece = play(rig, poses, truth=truth, seed=seed + 10**6)
    out: dict[str, dict[str, list[tuple[float, ...]]]] = {}
    for method in methods:
        found = {e.name: e for e in identified(rig, piece, names, method)}
        rows = out.setdefault(method, {})
        for name, true in truth.items():
            e = found[name]
            inside = (lo <= true <= hi for lo, hi in (e.ci90, e.ci95))
            kind = name if name.startswith("mass.") else name.partition(".")[2]
            rows.setdefault(kind, []).append(
                (*(float(x) for x in inside), (e.value - true) / e.std)
            )
    return out


def identified(rig: RigFile, piece: Stretch, names: list[str], method: str) -> tuple[Estimate, ...]:
    """What `method` finds. Arrival times of setpoints are known here: they are not drawn."""
    if method == "twin":
        problem = TwinProblem(rig, [piece], names)
        return identification_of(problem, fit(problem), "twin", ()).estimates
    options = LinearOptions("iv" if method == "iv" else "wls", draws=1)
    return identify_linear([piece], rig, options).identification.estimates


def coverage(
    name: str, method: str, experiments: int
) -> dict[str, tuple[float, float, float, float]]:
    """By parameter: share within 90 % and 95 %, mean and spread of the error in standard deviations."""
    rig = load_rig(name)
    each: dict[str, list[tuple[float, ...]]] = {}
    for seed in range(experiments):
        for kind, rows in experiment(rig, seed, RIGS[name], (method,))[method].items():
            each.setdefault(kind, []).extend(rows)
    out = {}
    for kind, found in each.items():
        table = np.array(found)
        in90, in95, mean = table.mean(axis=0).tolist()
        out[kind] = (in90, in95, mean, float(table[:, 2].std()))
    return out


def row(name: str, method: str, experiments: int) -> tuple[Cell, ...]:
    """All parameters together, and the one that fares worst."""
    found = coverage(name, method, experiments)
    worst = min(found, key=lambda kind: found[kind][1])
    both = np.mean([shares[:2] for shares in found.values()], axis=0)
    return (float(both[0]), float(both[1]), worst, *found[worst][1:])


def measure(options: Options = Options()) -> list[Table]:  # noqa: B008 - a frozen value
    """Every rig and method."""
    experiments = 3 if options.quick else EXPERIMENTS
    blank = Table(
        f"intervals that hold the truth, {experiments} simulated experiments of 6 to 8 s",
        ("of 90 %", "of 95 %", "worst", "its 95 %", "its mean error / std", "its spread / std"),
        {},
        "mean over the parameters (legs' friction together), and the parameter that fares worst",
    )
    parts = [
        Part(f"{name}-{method}", blank, f"{name} {method}", partial(row, name, method, experiments))
        for name in RIGS
        for method in METHODS
    ]
    return measured(parts, options)
