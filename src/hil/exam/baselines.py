"""Baselines that sit the same exam: what a diagnosis must beat, and the oracle that it cannot.

All stand on the twin as `hil.gap` refits it: `random` names any effect; `best-training` the single effect
with the smallest error on the data it was fitted to; `naive-bic` the same if the Bayesian information
criterion with the raw number of samples says so; `oracle` is told the effect and only fits it, and says how
much evidence there is for it at all. Shrink is on held-out data.
"""

from __future__ import annotations

import copy
import hashlib
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.config import AnyRig, BicycleFile, Effect
from hil.config.bicycle import SIGNALS as ANGLES
from hil.exam.case import Case
from hil.gap import Nuisance, Problem, refit
from hil.gap.bicycle import RideProblem, locate_any
from hil.gap.bicycle.nuisances import ride_nuisances
from hil.gap.diagnose import as_found
from hil.gap.fits.heldout import score, split
from hil.gap.located.residual import Refit, cost
from hil.gap.located.result import Evidence, Located
from hil.gap.rounds.question import nuisances_of
from hil.sim import ParameterTable

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FITTED: Final = 4
"""Candidates of the linear picture that are fitted through the twin."""
TOUCHED: Final = 0.5
SPREAD: Final = 0.3
"""A fit may move a parameter by three times this share of its start."""


@dataclass(frozen=True, slots=True)
class Ground:
    """What a baseline stands on: a located gap, the samples it may fit, the twin without any effect."""

    evidence: Evidence
    train: Mask
    held: Mask
    nuisances: tuple[Nuisance, ...]
    best: Refit

    @classmethod
    def of(cls, case: Case) -> Ground:
        """Locate the gap, then refit the nuisances on the training samples alone."""
        known, healthy = _calibrated(case)
        located = locate_any(case.runs, case.rig, nuisances=known, healthy=healthy)
        e = located.evidence
        train = split(e.problem, e.noise, e.residual).train(e.problem)
        nuisances = tuple(known) if known is not None else _nuisances(case, e)
        best = refit(_only(e.problem, train), e.noise, nuisances, e.vector)
        kept = e.problem.kept
        return cls(e, train & kept, ~train & kept, nuisances, best)

    @property
    def vector(self) -> Array:
        """(P,) of the twin without an effect."""
        return self.best.vector

    @property
    def residual(self) -> Array:
        """(N,) that it leaves."""
        return self.best.residual

    def touched(self, residual: Array) -> tuple[str, ...]:
        """Signals in which `residual` differs visibly from that of the twin without an effect."""
        problem = self.evidence.problem
        floors = self.evidence.noise.floor(problem)
        change: dict[str, list[Array]] = {}
        for x in problem.series:
            rows = problem.kept[x.part]
            change.setdefault(x.signal, []).append((residual - self.residual)[x.part][rows])
        sizes = {s: float(np.sqrt(np.mean(np.concatenate(c) ** 2))) for s, c in change.items()}
        return tuple(s for s, size in sizes.items() if size > TOUCHED * floors[s])

    def white_sum(self, residual: Array) -> float:
        """Sum of squares of the whitened training residual."""
        problem = _only(self.evidence.problem, self.train)
        return float(np.sum(self.evidence.noise.whiten(problem, residual) ** 2))

    def cost(self, found: Refit, told: Collection[str] = ()) -> float:
        """What a refit leaves of the training samples and what its nuisances cost beside it, in nats; those
        named in `told` cost nothing."""
        problem = _only(self.evidence.problem, self.train)
        prior = {n.name: n for n in self.nuisances if n.name not in told}
        z = [(f.change - n.mean) / n.sd for f in found.fitted if (n := prior.get(f.name))]
        white = self.evidence.noise.whiten(problem, found.residual)
        return cost(white, np.array(z), problem.discount)

    def with_effects(self, effects: Sequence[Effect]) -> tuple[Refit, dict[str, float]]:
        """The twin with `effects` fitted from their values; the parameters found."""
        mine = _only(self.evidence.problem, self.train)
        start, mine.base = np.array(self.vector), np.array(mine.base)
        for e in effects:
            for p, value in e.parameters.items():
                i = mine.table.index(f"{e.location}.{e.effect}.{p}")
                start[i] = mine.base[i] = value
        moved = [n for e in effects for n in _moving(mine, e)]
        names = {n.name for n in moved}
        nuisances = [n for n in self.nuisances if n.name not in names]
        found = refit(mine, self.evidence.noise, (*nuisances, *moved), start)
        return found, {n: float(found.vector[mine.table.index(n)]) for n in names}


def sit_baseline(name: str, case: Case, answer: Mapping[str, Any] | None) -> dict[str, Any]:
    """The baseline's answer to a case, as a diagnosis; `answer`: for the oracle alone."""
    if name == "random":
        return _random(case)
    ground = Ground.of(case)
    if name == "oracle":
        assert answer is not None
        return _oracle(case, ground, answer)
    return _fitted(case, ground, name == "naive-bic")


def _oracle(case: Case, ground: Ground, answer: Mapping[str, Any]) -> dict[str, Any]:
    effects = [Effect.model_validate(e) for e in answer["effects"]]
    if not effects:
        return _said(case, ground, answer["verdict"], [], ground.residual)
    found, values = ground.with_effects(effects)
    causes = [_cause(e, values, 1.0) for e in effects]
    said = _said(case, ground, "identified", causes, found.residual)
    return {**said, "nats": ground.cost(ground.best) - ground.cost(found, values)}


def _calibrated(case: Case) -> tuple[list[Nuisance] | None, Located | None]:
    """What healthy records of a driven rig leave to calibration, as for a diagnosis; None without them."""
    if not case.references or isinstance(case.rig, BicycleFile):
        return None, None
    healthy = locate_any(case.references, case.rig)
    return as_found(healthy, _nuisances(case, healthy.evidence)), healthy


def _nuisances(case: Case, e: Evidence) -> tuple[Nuisance, ...]:
    if isinstance(case.rig, BicycleFile):
        assert isinstance(e.problem, RideProblem)
        return ride_nuisances(case.rig, e.problem)
    return nuisances_of(e.problem)


def _fitted(case: Case, ground: Ground, by_bic: bool) -> dict[str, Any]:
    n = int(ground.train.sum())
    alone = ground.white_sum(ground.residual)
    best: tuple[float, Effect, Array, dict[str, float]] | None = None
    for effect in _candidates(case.rig, ground)[:FITTED]:
        found, values = ground.with_effects([effect])
        error = ground.white_sum(found.residual)
        score = n * math.log(error / n) + len(values) * math.log(n) if by_bic else error
        if best is None or score < best[0]:
            best = (score, effect, found.residual, values)
    if best is None or (by_bic and best[0] >= n * math.log(alone / n)):
        return _said(case, ground, "no_gap", [], ground.residual)
    return _said(case, ground, "identified", [_cause(best[1], best[3], 1.0)], best[2])


def _candidates(rig: AnyRig, ground: Ground) -> list[Effect]:
    """Every effect at every place, sized to fit; best first by what it takes off the error, linearly."""
    e = ground.evidence
    problem = _only(e.problem, ground.train)
    base = problem.measured - ground.residual
    A = e.noise.whiten(problem, ground.best.jacobian)
    A = A * np.array([n.sd for n in ground.nuisances])
    white = e.noise.whiten(problem, ground.residual)
    normal = np.linalg.inv(A.T @ A + np.eye(A.shape[1]))
    white = white - A @ (normal @ (A.T @ white))
    known = {n.name for n in ground.nuisances}
    seen: list[tuple[float, Effect]] = []
    for location, effect in _leaves(rig, problem, known):
        start = _start(problem, location, effect)
        row = np.array(ground.vector)
        for p, value in start.items():
            row[problem.table.index(f"{location}.{effect}.{p}")] = value
        column = e.noise.whiten(
            problem, np.nan_to_num(problem.predict(np.array([ground.vector, row]))[1] - base)
        )
        column = column - A @ (normal @ (A.T @ column))
        size = float(column @ column)
        if size < 1.0:
            continue
        share = float(column @ white) / size
        gain = share * float(column @ white)
        line = Effect(
            effect=effect,
            location=location,
            parameters=_scaled(problem, location, effect, start, share),
        )
        seen.append((gain, line))
    return [line for _, line in sorted(seen, key=lambda x: -x[0])]


def _leaves(rig: AnyRig, problem: Problem, known: set[str]) -> list[tuple[str, str]]:
    signals = {*problem.signals, *(ANGLES if isinstance(rig, BicycleFile) else ())}
    has_imu = any(s.startswith("imu.") for s in signals)
    out: dict[tuple[str, str], None] = {}
    for p in problem.table.entries:
        if p.name in known or (
            p.effect.startswith("sensor_") and p.location not in signals | {"imu"}
        ):
            continue
        if p.location == "imu" and not has_imu:
            continue
        out[(p.location, p.effect)] = None
    return list(out)


def _start(problem: Problem, location: str, effect: str) -> dict[str, float]:
    """Each parameter of an effect at the size at which it matters."""
    out = {}
    for p in problem.table.entries:
        if p.location == location and p.effect == effect:
            away = p.scale if p.search == "reciprocal" else p.neutral + p.scale
            if p.upper < away:
                away = p.neutral - p.scale
            out[p.parameter] = float(
                away if p.parameter not in ("period", "velocity") else p.neutral
            )
    return out


def _scaled(
    problem: Problem, location: str, effect: str, start: Mapping[str, float], share: float
) -> dict[str, float]:
    """The start moved to the share of its size that fits, within bounds."""
    out = {}
    for name, value in start.items():
        p = problem.table[f"{location}.{effect}.{name}"]
        if p.search == "reciprocal":
            new = value / min(max(share, 0.02), 50.0)
        else:
            new = p.neutral + (value - p.neutral) * min(max(share, -50.0), 50.0)
        out[name] = float(min(max(new, p.lower), p.upper if math.isfinite(p.upper) else 1e12))
    return out


def _moving(problem: Problem, effect: Effect) -> list[Nuisance]:
    """The parameters of an effect as what a fit may move about its present values."""
    out = []
    for name, value in effect.parameters.items():
        p = problem.table[f"{effect.location}.{effect.effect}.{name}"]
        away = abs(value) if p.search == "reciprocal" else abs(value - p.neutral)
        if away > 0.0:
            out.append(Nuisance(p.name, SPREAD * away, p.unit))
    return out


def _random(case: Case) -> dict[str, Any]:
    """A verdict by the toss of a coin that only the case's name decides."""
    seed = int(hashlib.sha256(case.id.encode()).hexdigest()[:12], 16)
    rng = np.random.default_rng(seed)
    names = sorted({(p.location, p.effect) for p in ParameterTable(case.rig).entries})
    location, effect = names[rng.integers(len(names))]
    verdict = str(rng.choice(["no_gap", "identified", "unknown"]))
    cause = {
        "effect": effect,
        "location": location,
        "probability": 1.0 / len(names),
        "parameters": {},
    }
    return _shell(case, verdict, [cause] if verdict == "identified" else [])


def _cause(effect: Effect, values: Mapping[str, float], probability: float) -> dict[str, Any]:
    full = {
        p: {"value": values.get(f"{effect.location}.{effect.effect}.{p}", v), "ci": None}
        for p, v in effect.parameters.items()
    }
    return {
        "effect": effect.effect, "location": effect.location, "probability": probability, "parameters": full,
    }  # fmt: skip


def _said(
    case: Case, ground: Ground, verdict: str, causes: list[dict[str, Any]], residual: Array
) -> dict[str, Any]:
    e = ground.evidence
    signals = ground.touched(residual) or e.problem.signals
    found = score(
        e.problem,
        e.noise,
        ground.residual,
        residual,
        ground.held,
        signals,
        np.random.default_rng(0),
    )
    gap = {
        "metric": "rms of held-out samples over the floor, signals that the effect touches",
        "before": found.before, "after": found.after, "noise_floor": found.floor,
        "shrink": found.shrink, "shrink_ci": found.shrink_ci,
    }  # fmt: skip
    return {**_shell(case, verdict, causes), "gap": gap}


def _shell(case: Case, verdict: str, causes: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "format": "hil-diagnosis/1", "rig": case.rig.name, "runs": [r.path.name for r in case.runs],
        "verdict": verdict, "causes": causes, "effects": causes,
    }  # fmt: skip


def _only(problem: Problem, rows: Mask) -> Problem:
    """The same problem of which only `rows` count."""
    out = copy.copy(problem)
    out.kept = problem.kept & rows
    return out
