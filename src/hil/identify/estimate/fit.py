"""From runs to an identification: checks, estimator, intervals, and what cannot be told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.errors import IdentificationError
from hil.identify.estimate import linear
from hil.identify.estimate.adaptive import adapt
from hil.identify.estimate.calibration import calibrate, misfit, simulated, unexplained
from hil.identify.estimate.checks import (
    at_rest,
    check_force,
    check_motion,
    check_rig,
    check_signals,
    quiet_coordinates,
)
from hil.identify.estimate.directions import analyse
from hil.identify.estimate.names import is_rig_number, with_numbers
from hil.identify.estimate.prepare import cutoff_of, prepare
from hil.identify.estimate.regression import BodySet, Regression, regression
from hil.identify.estimate.result import Estimate, Identification, estimates
from hil.identify.estimate.stamps import placed
from hil.identify.replay import Stretch, stretches
from hil.runs import Run
from hil.units import with_unit

Array = NDArray[np.float64]
LinearMethod = Literal["ols", "wls", "iv", "adaptive"]


@dataclass(frozen=True, slots=True)
class LinearOptions:
    """How to fit the linear problem."""

    method: LinearMethod | None = None
    """None: iv where the runs hold setpoints, else wls. Without instruments noise in the positions makes
    inertia come out a little small."""
    body: BodySet = "principal"
    offsets: bool | None = None
    """A constant force a drive; None: where gravity does not act along the actuator."""
    cutoff_hz: float | None = None
    """None: a third of the sampling's Nyquist frequency, at most 20 Hz."""
    draws: int = 8
    """Replays that calibrate the estimator; 0 for none."""
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Curves:
    """One actuator's measured and predicted force on common instants, for pictures."""

    name: str
    t_s: Array
    velocity: Array
    measured: Array
    predicted: Array


@dataclass(frozen=True, slots=True)
class Outcome:
    """An identification with its evidence."""

    identification: Identification
    curves: tuple[Curves, ...] = field(repr=False)


def checked(runs: Sequence[Run], rig: RigFile) -> tuple[list[Stretch], list[str]]:
    """The stretches of `runs` and warnings; IdentificationError where one cannot be used."""
    pieces, notes = [], []
    for run in runs:
        check_rig(run, rig)
        if run.damage:
            notes.append(f"{run.path.name}: damaged: {run.damage}")
        pieces += stretches(run)
    for piece in pieces:
        notes += check_signals(piece, rig)
    return placed(rig, pieces), notes


def identify(runs: Sequence[Run], rig: RigFile, options: LinearOptions | None = None) -> Outcome:
    """Identify body and friction of `rig` by a linear method. IdentificationError says what is missing."""
    pieces, notes = checked(runs, rig)
    return identify_linear(
        pieces, rig, options or LinearOptions(), tuple(r.path.name for r in runs), notes
    )


def identify_linear(
    pieces: Sequence[Stretch],
    rig: RigFile,
    options: LinearOptions,
    runs: tuple[str, ...] = (),
    notes: Sequence[str] = (),
) -> Outcome:
    """As `identify`, on stretches that are already checked."""
    cutoff_hz = options.cutoff_hz or min(cutoff_of(p, rig) for p in pieces)
    offsets = rig.kind == "axis_1dof" if options.offsets is None else options.offsets
    if any(p.payload is not None for p in pieces):
        raise IdentificationError(
            "a payload was on the rig: least squares would book it as the platform's. Use the twin "
            "(--method twin), which knows it"
        )

    def problem_of(some: Sequence[Stretch]) -> Regression:
        prepared = [prepare(p, rig, cutoff_hz) for p in some]
        return regression(rig, prepared, cutoff_hz, body=options.body, offsets=offsets)

    problem = problem_of(pieces)
    reasons = check_motion(problem.prepared, rig)
    check_force(problem, rig)
    notes = [*notes, *at_rest(quiet_coordinates(problem.prepared, rig))]
    replayable = all(len(p.setpoints) == len(rig.actuators) for p in pieces)
    method = options.method or ("iv" if replayable else "wls")
    instruments = None
    if method == "iv":
        instruments = problem_of(simulated(rig, pieces, {}))
    found = linear.weighted(problem, instruments)
    sigma_n = np.ones_like(found.sigma_n) if method == "ols" else found.sigma_n
    shift, timing = np.zeros_like(found.values), np.zeros_like(found.covariance)
    moved = np.zeros_like(found.values)
    if options.draws and replayable:
        before = linear.solve(problem, sigma_n, instruments).values

        def replayed(
            at: Array, rng: np.random.Generator | None = None
        ) -> tuple[Array, list[Stretch]]:
            truth, own, effects = nearest_rig(rig, problem, at)
            return truth, simulated(with_numbers(rig, own), pieces, effects, rng)

        def artefact(at: Array, rng: np.random.Generator | None) -> tuple[Array, float]:
            truth, answers = replayed(at, rng)
            clean = problem_of(answers)
            return clean.y - clean.W @ truth, misfit(pieces, answers)

        def estimate(force: Array) -> Array:
            corrected = replace(problem, y=problem.y - force)
            return linear.solve(corrected, sigma_n, instruments).values

        calibration = calibrate(artefact, estimate, before, options.draws, options.seed)
        problem = replace(problem, y=problem.y - calibration.artefact)
        shift = calibration.shift
        after = linear.solve(problem, sigma_n, instruments).values + shift
        moved = after - before
        share = unexplained(rig, pieces, replayed(after)[1])
        timing = calibration.timing + share**2 * np.outer(moved, moved)
    elif options.draws:
        notes.append(
            "not corrected by the twin, for the runs hold no setpoints: intervals know of noise alone"
        )
    found = linear.solve(problem, sigma_n, instruments)
    values, covariance = found.values + shift, found.covariance + timing
    if method == "adaptive":
        run = adapt(problem, found.sigma_n)
        covariance = covariance + np.diag((run.values - found.values) ** 2)
        values = run.values + shift
        notes.append(
            f"adaptive law: dt eig(K Y'Y) up to {run.worst:.3g} (stable below 2); last pass moved no "
            f"parameter by more than {100 * run.settled.max():.2g} % of its size; intervals are those of "
            "weighted least squares, widened by what the law still lacks"
        )
    analysis = analyse(problem.names, covariance, problem.scale)
    rows = [(c.name, c.unit, c.nominal, c.scale) for c in problem.columns]
    answer = estimates(rows, values, covariance, found.dof, analysis, reasons)
    notes += _corrected(answer, moved)
    notes += _impossible(answer)
    predicted = problem.W @ values
    return Outcome(
        Identification(
            rig=rig.name, runs=runs, method=method, estimates=answer,
            fit=_shares(rig, problem, predicted), rank=analysis.rank, condition=analysis.condition,
            untold=tuple(d.text for d in analysis.untold), effective_samples=found.effective,
            notes=tuple(notes),
        ),
        _curves(rig, problem, predicted),
    )  # fmt: skip


def nearest_rig(
    rig: RigFile, problem: Regression, values: Array
) -> tuple[Array, dict[str, float], dict[str, float]]:
    """(parameters (P,), numbers of the rig file, effects) of a rig that can be, as near to `values` as
    halving the way from the rig file comes."""
    for share in (1.0, 0.5, 0.25, 0.0):
        at = problem.nominal + share * (values - problem.nominal)
        own, effects, possible = as_rig_values(rig, problem.names, at)
        if possible:
            break
    given = {**own, **effects}
    truth = np.array([given.get(n, v) for n, v in zip(problem.names, at, strict=True)])
    return truth, own, effects


def as_rig_values(
    rig: RigFile, names: Sequence[str], values: Array
) -> tuple[dict[str, float], dict[str, float], bool]:
    """(numbers of the rig file, effects, whether a rig can have them) of estimates by linear names.

    Ten body parameters become mass, centre of gravity and inertia about it; friction below 0 becomes 0.
    """
    by_name = dict(zip(names, values.tolist(), strict=True))
    own = {n: v for n, v in by_name.items() if is_rig_number(rig, n)}
    effects = {n: v for n, v in by_name.items() if n.endswith("sensor_bias.offset")}
    own.update(body_numbers(by_name))
    for name in own:
        if name.endswith((".viscous", ".coulomb")):
            own[name] = max(own[name], 0.0)
    changed = with_numbers(rig, own)
    inertia = np.array(changed.mass.inertia)
    possible = changed.mass.m > 0.0 and bool(np.linalg.eigvalsh(inertia)[0] > 0.0)
    return own, effects, possible


def body_numbers(values: Mapping[str, float]) -> dict[str, float]:
    """`mass.cog.*` and `mass.inertia.*` of mass, first moments and inertia about the origin, if given."""
    if "mass.first_moment.x" not in values or values["mass.m"] == 0.0:
        return {}
    m = values["mass.m"]
    cog = np.array([values[f"mass.first_moment.{c}"] for c in "xyz"]) / m
    out = {f"mass.cog.{c}": float(x) for c, x in zip("xyz", cog, strict=True)}
    spread = m * (cog @ cog * np.eye(3) - np.outer(cog, cog))
    for key in ("xx", "yy", "zz", "xy", "xz", "yz"):
        i, j = "xyz".index(key[0]), "xyz".index(key[1])
        out[f"mass.inertia.{key}"] = values[f"mass.origin_inertia.{key}"] - float(spread[i, j])
    return out


def _corrected(found: Sequence[Estimate], moved: Array) -> list[str]:
    """What parameters that the data tell would have been without the twin's correction `moved` (P,), where
    that is more than a standard deviation."""
    told = [
        with_unit(f"{e.name} {e.value - by:.4g}", e.unit)
        for e, by in zip(found, moved, strict=True)
        if e.identifiable and abs(by) > e.std
    ]
    if not told:
        return []
    return [
        "corrected by the twin: without that, force sampled in step with the setpoints would have made "
        f"{', '.join(told)}"
    ]


def _impossible(found: Sequence[Estimate]) -> list[str]:
    """Sentences on values that no rig can have; the scatter of what is not told says nothing."""
    positive = ("mass.m", ".xx", ".yy", ".zz", ".viscous", ".coulomb")
    return [
        f"{e.name} came out at {e.value:.4g}, which no rig has: treat everything here with suspicion"
        for e in found
        if e.ci95[1] < 0.0 and e.name.endswith(positive)
    ]


def _shares(rig: RigFile, problem: Regression, predicted: Array) -> dict[str, float]:
    """Relative force error of each actuator: norm of the residual over norm of the force."""
    out = {}
    for i, name in enumerate(rig.actuator_names):
        rows = problem.keep[:, i]
        force = np.concatenate([p.force[:, i] for p in problem.prepared])[rows]
        error = (problem.y - predicted)[rows, i]
        out[f"{name}.force"] = float(np.linalg.norm(error)) / max(
            float(np.linalg.norm(force)), 1e-300
        )
    return out


def _curves(rig: RigFile, problem: Regression, predicted: Array) -> tuple[Curves, ...]:
    t = np.concatenate([p.t_s for p in problem.prepared])
    out = []
    for i, name in enumerate(rig.actuator_names):
        force = np.concatenate([p.force[:, i] for p in problem.prepared])
        speed = np.concatenate([p.rho_dot[:, i] for p in problem.prepared])
        out.append(Curves(name, t, speed, force, force - problem.y[:, i] + predicted[:, i]))
    return tuple(out)
