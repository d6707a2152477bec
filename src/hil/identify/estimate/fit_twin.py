"""Output-error identification through the twin: any parameters, any signals, payloads included."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.identify.estimate.calibration import redrawn, weigh
from hil.identify.estimate.checks import check_answers
from hil.identify.estimate.directions import UNTOLD, analyse
from hil.identify.estimate.fit import Curves, Outcome, checked
from hil.identify.estimate.gridsearch import grid_search
from hil.identify.estimate.names import FORCE_GAIN
from hil.identify.estimate.outputerror import OutputErrorFit, expected_noise, fit
from hil.identify.estimate.result import Identification, estimates
from hil.identify.estimate.twinproblem import TwinProblem
from hil.identify.replay import Stretch
from hil.runs import Run

Array = NDArray[np.float64]
SEPARATE: Final = (
    "weigh the cabin and fix mass.m in the rig file, or record a second run with a known payload "
    "([payload] in run.toml), or record the drives' forces"
)
LACKING: Final = 3.0
"""Times its noise that a signal's residual may be before the reader is told [R]."""


@dataclass(frozen=True, slots=True)
class TwinOptions:
    """What to fit, and to which signals."""

    parameters: tuple[str, ...] = ()
    """Names; empty: mass, principal moments, each actuator's friction, an axis's force bias."""
    quantities: tuple[str, ...] = ("position", "force")
    grid: Mapping[str, tuple[float, float, int]] | None = None
    """Search these (lowest, highest, points) before the local fit."""
    draws: int = 8
    """Replays at other arrival times of the setpoints, for the intervals."""
    seed: int = 0


def default_parameters(rig: RigFile) -> tuple[str, ...]:
    """What `TwinOptions` fits unless told."""
    body = {
        "axis_1dof": ("mass.m",),
    }.get(rig.kind, ("mass.m", "mass.inertia.xx", "mass.inertia.yy", "mass.inertia.zz"))
    fields = ["viscous", "coulomb"]
    if (
        rig.kind == "axis_1dof"
    ):  # where gravity does not tell a constant force from the sensor's bias
        fields.append("force.sensor_bias.offset")
    each = [f"{a}.{field}" for a in rig.actuator_names for field in fields]
    return (*body, *each)


def identify_twin(runs: Sequence[Run], rig: RigFile, options: TwinOptions | None = None) -> Outcome:
    """Identify by the twin. IdentificationError says what is missing."""
    options = options or TwinOptions()
    pieces, notes = checked(runs, rig)
    names = options.parameters or default_parameters(rig)
    problem = TwinProblem(rig, pieces, names, options.quantities)
    nominal = problem.predict(np.array([[x.value for x in problem.numbers]]))[0]
    check_answers([(name, problem.measured[part], nominal[part]) for name, part in problem.signals])
    best = None
    method = "twin"
    if options.grid is not None:
        found = grid_search(problem, options.grid)
        method, best = "grid", found.best
        if len(found.alike) > 1:
            notes.append(
                f"{len(found.alike)} of {len(found.points)} grid points explain the data as well as the "
                f"best one: {_ranges(problem, options.grid, found.alike)}"
            )
    best = best or fit(problem)
    shift, spread = timing_spread(rig, pieces, problem, best, options)
    best = replace(best, values=best.values - shift, covariance=best.covariance + spread)
    return Outcome(
        identification_of(problem, best, method, tuple(r.path.name for r in runs), notes),
        _curves(rig, pieces, problem, best),
    )


def timing_spread(
    rig: RigFile,
    pieces: Sequence[Stretch],
    problem: TwinProblem,
    best: OutputErrorFit,
    options: TwinOptions,
) -> tuple[Array, Array]:
    """Mean (P,) and covariance (P, P) of shifts of the fit by arrival times that the record leaves open.

    To first order.
    """
    reference = problem.predict(best.values[None, :])[0]
    scale, slopes = problem.scale, problem.jacobian(best.values)
    gain = np.linalg.pinv(best.jacobian * scale, rcond=1e-7)
    shifts, misfits = [np.zeros(len(scale))], [_misfit(problem, reference)]
    rng = np.random.default_rng(options.seed)
    for _ in range(options.draws - 1):
        moved = [redrawn(rig, p, rng) for p in pieces]
        other = TwinProblem(rig, moved, problem.names, options.quantities)
        flat = other.predict(best.values[None, :])[0]
        shift = scale * (gain @ best.noise.whiten(problem, flat - reference))
        shifts.append(shift)
        refitted = flat - slopes @ shift
        misfits.append(_misfit(problem, refitted))
    return weigh(np.array(shifts), np.array(misfits))


def _misfit(problem: TwinProblem, flat: Array) -> float:
    """Mean over the signals of the logarithm of the mean square residual."""
    squares = [float(np.mean((flat - problem.measured)[part] ** 2)) for _, part in problem.signals]
    return float(np.mean(np.log(np.maximum(squares, 1e-30))))


def identification_of(
    problem: TwinProblem,
    best: OutputErrorFit,
    method: str,
    runs: tuple[str, ...],
    notes: Sequence[str] = (),
) -> Identification:
    """The result of a finished output-error fit."""
    notes = list(notes)
    notes += [
        f"{n} stands at its bound: the model lacks something, or the data" for n in best.at_bound
    ]
    notes += _left_over(problem, best)
    notes += _contradictions(best)
    analysis = analyse(problem.names, best.covariance, problem.scale)
    reasons = _gauge_reasons(problem, best)
    if reasons:
        notes += _ratios(problem, best, list(reasons))
    rows = [(x.name, x.unit, x.value, x.scale) for x in problem.numbers]
    shares: dict[str, list[float]] = {}
    for name, part in problem.signals:
        e, y = best.residual[part], problem.measured[part]
        shares.setdefault(name, []).append(float(np.std(e)) / max(float(np.std(y)), 1e-300))
    return Identification(
        rig=problem.rig.name, runs=runs, method=method,
        estimates=estimates(rows, best.values, best.covariance, best.dof, analysis, reasons),
        fit={name: float(np.mean(x)) for name, x in shares.items()},
        rank=analysis.rank - bool(reasons), condition=analysis.condition,
        untold=(
            *((_gauge_text(list(reasons)),) if reasons else ()),
            *(d.text for d in analysis.untold),
        ),
        effective_samples=float(len(best.white)), notes=tuple(notes),
    )  # fmt: skip


def _left_over(problem: TwinProblem, best: OutputErrorFit) -> list[str]:
    """A warning where residuals are far from noise: what a model lacks may shift all signals alike."""
    times: dict[str, float] = {}
    for name, part in problem.signals:
        rms = float(np.sqrt(np.mean(best.residual[part] ** 2)))
        times[name] = max(times.get(name, 0.0), rms / expected_noise(problem, name))
    far = {name: x for name, x in times.items() if x > LACKING}
    if not far:
        return []
    worst = max(far, key=far.__getitem__)
    return [
        f"the twin leaves up to {far[worst]:.0f} times the rig file's sensor noise ({worst}; "
        f"{len(far)} of {len(times)} signals above {LACKING:g}): something is not modelled, or the "
        "setpoints' stamps are not when they got through. The intervals reckon with what the residuals show, "
        "not with a parameter that is wrong throughout: compare with --method iv"
    ]


def _contradictions(best: OutputErrorFit) -> list[str]:
    """What kinds of signal say apart, where the twin cannot follow them all with one value."""
    out = []
    for name, said in best.torn.items():
        each = ", ".join(f"{value:.4g} by {kind} alone" for kind, value in said.items())
        out.append(
            f"{name}: the signals contradict each other ({each}), so the model lacks something; the interval "
            "is as wide as that. Take the signals you trust (--signals)"
        )
    return out


def force_scale_deviation(problem: TwinProblem, best: OutputErrorFit) -> float:
    """Standard deviation of the logarithm of the scale of all forces and masses, from these signals alone.

    Infinite where positions follow from ratios of forces only: multiplying every mass, friction and gain by
    the same number changes nothing that an encoder sees [V].
    """
    step = 0.02
    change = problem.force_scale(best.values, 1.0 + step) - problem.force_scale(best.values, 1.0)
    slope = best.noise.whiten(problem, change / step)
    variance = 2.0 * best.cost / best.dof
    return float(np.sqrt(variance / max(float(slope @ slope), 1e-300)))


def _gauge_reasons(problem: TwinProblem, best: OutputErrorFit) -> dict[str, str]:
    """Reasons for parameters that carry N or kg, where the signals do not tell the scale of forces."""
    carried = [
        x.name for x in problem.numbers if x.unit.startswith(("N", "kg")) or x.name == FORCE_GAIN
    ]
    if not carried or force_scale_deviation(problem, best) < UNTOLD:
        return {}
    return {
        name: (
            f"positions tell {name} only in proportion to "
            f"{_list([c for c in carried if c != name]) or 'the drives gains'} and to the rig file's "
            f"friction and rotor masses; {SEPARATE}"
        )
        for name in carried
    }


def _gauge_text(names: Sequence[str]) -> str:
    return " = ".join(f"log {n}" for n in names) + " (all forces and masses alike)"


def _ratios(problem: TwinProblem, best: OutputErrorFit, names: Sequence[str]) -> list[str]:
    """What the data do tell of inseparable parameters: ratios to the first gain, or to the first of them."""
    base = FORCE_GAIN if FORCE_GAIN in names else names[0]
    b = problem.names.index(base)
    out = []
    for name in names:
        k = problem.names.index(name)
        if k == b or best.values[b] == 0.0:
            continue
        ratio = best.values[k] / best.values[b]
        slope = np.zeros(len(problem.names))
        slope[k], slope[b] = 1.0 / best.values[b], -ratio / best.values[b]
        std = float(np.sqrt(max(float(slope @ best.covariance @ slope), 0.0)))
        out.append(
            f"{name} / {base} = {ratio:.5g} ± {1.96 * std:.2g} (95 %): this ratio the data do tell"
        )
    return out


def _list(names: Sequence[str]) -> str:
    return ", ".join(names)


def _ranges(
    problem: TwinProblem, grid: Mapping[str, tuple[float, float, int]], alike: Array
) -> str:
    columns = {n: alike[:, problem.names.index(n)] for n in grid}
    return ", ".join(f"{n} from {c.min():.4g} to {c.max():.4g}" for n, c in columns.items())


def _curves(
    rig: RigFile, pieces: Sequence[Stretch], problem: TwinProblem, best: OutputErrorFit
) -> tuple[Curves, ...]:
    predicted = problem.stretch_samples(best.values)
    out = []
    for name in rig.actuator_names:
        parts = []
        for piece, answer in zip(pieces, predicted, strict=True):
            if f"{name}.force" not in answer:
                continue
            t, force = piece.samples[f"{name}.force"]
            at, x = piece.samples.get(f"{name}.position", (t, np.zeros_like(t)))
            speed = np.interp(t, at, np.gradient(x, at))
            parts.append((t, speed, force, answer[f"{name}.force"]))
        if parts:
            out.append(Curves(name, *(np.concatenate(c) for c in zip(*parts, strict=True))))
    return tuple(out)
