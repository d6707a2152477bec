"""Whether the experiment that `hil gap next` proposes leaves one candidate, against a generic multisine.

    python -m benchmarks.next_experiment [--seconds 16] [--seeds 3] [--json FILE]

For each pair of effects of the axis and either of them as the truth: a short slow record of it is made with
the twin's noise, and both are fitted to it, on ever quieter sways until both explain it: an ambiguous case.
From that the experiment is proposed. It and the multisine (0.1 to 3 Hz, half the limits) are recorded on the
same rig, both effects are fitted anew with all nuisances free, and weighed as a diagnosis weighs them.
Counted: how often the true one is left alone (probability above 0.95), out of all ambiguous cases.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hil.config import RigFile
from hil.configfile import load_rig
from hil.gap.catalogue.nuisances import default_nuisances
from hil.gap.fits.evidence import weigh
from hil.gap.fits.fit import fit
from hil.gap.fits.fitted import Calibrated, Fit, calibrated
from hil.gap.floor.draws import draws
from hil.gap.floor.noise import find_noise
from hil.gap.located.residual import refit
from hil.gap.next import Sketch, generic_multisine, propose
from hil.gap.next.score import recorded
from hil.gap.record.leaf import Leaf
from hil.gap.record.problem import Problem

Truth = Mapping[str, float]
SIGNALS = ("axis.position", "axis.force")
CLEAR = 0.95

A = "axis."
EFFECTS: dict[str, Truth] = {
    "coulomb_friction": {A + "coulomb_friction.force": 14.0},
    "asymmetric_friction": {
        A + "asymmetric_friction.positive": 30.0, A + "asymmetric_friction.negative": 8.0,
    },
    "stribeck_friction": {
        A + "stribeck_friction.velocity": 0.01, A + "stribeck_friction.coulomb": 14.0,
        A + "stribeck_friction.static": 40.0,
    },
    "viscous_friction": {A + "viscous_friction.coefficient": 200.0},
    "transport_delay": {A + "transport_delay.delay": 0.003},
    "payload_mass": {"platform.payload_mass.mass": 30.0},
    "force_constant": {A + "force_constant.scale": 0.8},
    "backlash": {A + "backlash.gap": 0.00006},
    "sensor_latency": {A + "position.sensor_latency.delay": 0.003},
    "actuator_inertia": {A + "actuator_inertia.mass": 12.0},
    "hysteresis": {A + "hysteresis.force": 25.0, A + "hysteresis.displacement": 0.002},
}  # fmt: skip
PAIRS = (
    ("coulomb_friction", "asymmetric_friction"), ("viscous_friction", "transport_delay"),
    ("payload_mass", "force_constant"), ("stribeck_friction", "coulomb_friction"),
    ("sensor_latency", "transport_delay"), ("payload_mass", "actuator_inertia"),
    ("hysteresis", "coulomb_friction"), ("backlash", "hysteresis"),
)  # fmt: skip


SWAYS = (0.25, 0.12, 0.06, 0.03, 0.015)
"""Of half the limits: ever quieter records, until one leaves the question open."""


def quiet_record(rig: RigFile, share: float) -> Sketch:
    """A record that may leave the question open: a slow sway that uses little of the rig."""
    made = generic_multisine(rig, 12.0, seed=5)
    slow = type(made.trajectory)(
        made.trajectory.coordinates, made.trajectory.t_s, share * made.trajectory.poses
    )
    return Sketch("sway", f"0.1 to 3 Hz at {0.5 * share:g} of the limits", slow)


def record(sketch: Sketch, rig: RigFile, truth: Truth, seed: int) -> Problem:
    """A recording of `sketch` on a rig that has `truth`, with noise, jitter and rounding."""
    rng = np.random.default_rng(seed)
    blank = Problem(rig, recorded(sketch, rig, SIGNALS, rng))
    vector = np.array(blank.base)
    for name, value in truth.items():
        vector[blank.table.index(name)] = value
    late, sensed = draws(blank, vector, rng, 1)
    measured = blank.predict(vector)[0] + late[0] + sensed[0]
    pieces = []
    for s, piece in enumerate(blank.sent):
        mine = {x.signal: measured[x.part] for x in blank.series if x.stretch == s}
        pieces.append(piece.with_samples(mine))
    return Problem(rig, pieces)


def judge(
    problem: Problem, pair: Sequence[str], starts: Mapping[str, Truth]
) -> tuple[dict[str, float], dict[str, Fit]]:
    """Probability of each effect of the pair by the diagnosis's own fits and evidence, and the fits."""
    rng = np.random.default_rng(1)
    nuisances = default_nuisances(problem.rig, problem.signals)
    guess = find_noise(problem, problem.base, rng, count=2)
    best = refit(problem, guess, nuisances)
    noise = find_noise(problem, best.vector, rng, residual=best.residual)
    c: Calibrated = calibrated(problem, noise, nuisances, best)
    fits: dict[str, Fit] = {}
    for effect in pair:
        names = tuple(starts[effect])
        leaf = Leaf(effect, names[0].rsplit(".", 2)[0], names, (), "axis")
        found = fit(c, (leaf,), starts[effect], rounds=5)
        if found is not None:
            fits[effect] = found
    none = fit(c, (), {})
    if none is None:
        raise AssertionError("the calibrated twin stood a moment ago")
    weighed, _ = weigh(c, [none, *fits.values()])
    return {w.fit.leaves[0].effect: w.probability for w in weighed if w.fit.leaves}, fits


def table_of(rig: RigFile, p: Mapping[str, float], fits: Mapping[str, Fit]) -> dict[str, Any]:
    """The part of a diagnosis that `hil gap next` reads."""
    causes = []
    for effect, found in fits.items():
        parameters = {
            n.rsplit(".", 1)[1]: {"value": float(v)}
            for n, v in zip(found.names, found.values, strict=True)
        }
        causes.append({"effect": effect, "location": found.leaves[0].location, "probability": p[effect],
                       "class": 0, "parameters": parameters})  # fmt: skip
    return {"format": "hil-diagnosis/1", "rig": rig.name, "verdict": "ambiguous", "causes": causes,
            "effects": [], "gap": {"signals": {s: {} for s in SIGNALS}}}  # fmt: skip


def open_case(
    rig: RigFile, pair: tuple[str, str], truth: str, seed: int
) -> tuple[float, dict[str, float], dict[str, Fit]] | None:
    """The liveliest sway of a rig with `truth` that both explain: its share, probabilities and fits."""
    for share in SWAYS:
        problem = record(quiet_record(rig, share), rig, EFFECTS[truth], seed)
        before, fits = judge(problem, pair, EFFECTS)
        if len(fits) == len(pair) and max(before.values()) <= CLEAR:
            return share, before, fits
    return None


def run(
    seconds: float, pairs: Sequence[tuple[str, str]], seeds: Sequence[int] = (0,)
) -> list[dict[str, Any]]:
    """One row a pair, seed and truth."""
    rig, rows = load_rig("axis"), []
    for seed, pair, which in itertools.product(seeds, pairs, range(2)):
        truth = pair[which]
        row: dict[str, Any] = {"pair": list(pair), "truth": truth, "seed": seed}
        case = open_case(rig, pair, truth, seed)
        if case is None:
            rows.append({**row, "ambiguous": False})
        else:
            share, before, fits = case
            proposal = propose(
                table_of(rig, before, fits), rig, seconds=seconds, count=10, seed=seed
            )
            usual = generic_multisine(rig, proposal.sketch.trajectory.duration_s, seed)
            after = {}
            for name, sketch in (("proposed", proposal.sketch), ("generic", usual)):
                p, _ = judge(record(sketch, rig, EFFECTS[truth], seed + 7), pair, EFFECTS)
                after[name] = p.get(truth, 0.0)
            rows.append({**row, "ambiguous": True, "sway": share, "before": before,
                         "kind": proposal.sketch.kind, "motion": proposal.sketch.text,
                         "payload_kg": proposal.sketch.payload_kg, "expected": proposal.split.right,
                         "splits": bool(proposal.split.apart()), "after": after})  # fmt: skip
        print(json.dumps(rows[-1]), flush=True)
    return rows


def main() -> None:
    """Print one line a pair and truth, then the count."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=16.0)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--pairs", type=int, default=len(PAIRS), help="so many of the list")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    rows = run(given.seconds, PAIRS[: given.pairs], range(given.seeds))
    open_ones = [r for r in rows if r["ambiguous"]]
    for name in ("proposed", "generic"):
        alone = sum(r["after"][name] > CLEAR for r in open_ones)
        mean = np.mean([r["after"][name] for r in open_ones]) if open_ones else np.nan
        print(
            f"{name}: the true one is left alone in {alone} of {len(open_ones)}, "
            f"its mean probability {mean:.2f}"
        )
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
