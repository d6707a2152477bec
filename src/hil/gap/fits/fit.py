"""Candidates fitted through the twin: their parameters by Gauss and Newton, the nuisances along with them.

Sensitivities to nuisances are those of the calibrated twin; those to the candidate's own parameters are
computed anew at each step. Every trial is a replay of the whole record, so a fit that is reported is what
the twin really answers, not what a linear picture of it promises.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from hil.gap.catalogue.bank import ABSOLUTE, shifted
from hil.gap.fits.about import TURNS, about, is_swinging
from hil.gap.fits.fitted import Calibrated, Fit, loss, spread_of, weight
from hil.gap.located.instants import read_elsewhere
from hil.gap.located.residual import nuisance_sensitivities, reach
from hil.gap.record.leaf import Leaf
from hil.gap.record.problem import LATENCY
from hil.sim.parameters import Parameter

Array = NDArray[np.float64]

ROUNDS: Final = 6
SETTLED: Final = 0.02
"""Share of what is left, by which a round gains where a fit goes on."""
FAR: Final = 0.01
"""Squared prior deviations of a step of nuisances from which on it tells of their sensitivities."""
SHORTER: Final = (1.0, 0.4, 0.1)
"""Shares of a round's step that are tried, until one leaves less."""
LEAST_LEFT: Final = 0.02
"""Nats of a judged sample: where less is left, a round's gain is counted as a share of that."""
CALMER: Final = 0.8
"""Times the spread of what is left before: a round that brings it there goes on, whatever it gained."""
NEARER: Final = (1.0, 0.3, 0.05)
"""Shares of a start's way that are tried."""
NARROWEST: Final = {"displacement": 3e-5}
"""A narrower hysteresis is none: friction begins at once in the twin."""
BY_VALUE: Final[Mapping[str, float]] = {
    "limit": 0.02, "period": 1e-3, "displacement": 0.1, "velocity": 0.1,
}  # fmt: skip
"""Parameters of which only the value itself means something, and the share of it that differences are taken
over."""
GAP_STEP: Final = (0.1, 2e-6)
"""The same of a gap, and m at least."""
PHASE_STEP_RAD: Final = 0.1
DELAY_STEP_S: Final = 5e-4
LATENCY_STEP_S: Final = 1e-4
HARDLY: Final = 0.5
"""Of a parameter's way from neutral, by which data leave one free that they hardly tell of."""
WEAK: Final = 10.0
"""Prior spread of a candidate's parameter in its own scales: keeps what data do not hold from running off."""


def own_nuisances(c: Calibrated, leaves: Sequence[Leaf]) -> list[int]:
    """Nuisances that are parameters of `leaves` and so are not held by their priors any more."""
    mine = {p for leaf in leaves for p in leaf.parameters}
    return [k for k, n in enumerate(c.nuisances) if n.name in mine]


def fit(
    c: Calibrated,
    leaves: Sequence[Leaf],
    start: Mapping[str, float],
    z: Array | None = None,
    rounds: int = ROUNDS,
    settled: float = SETTLED,
    found: Collection[str] = (),
) -> Fit | None:
    """Fit the parameters named in `start` (values as for a twin without effects), but those that are chosen
    and never fitted; None where the twin cannot stand there. `z` (K,): nuisances to start from, by default
    where calibration left them. `settled`: a round that gains less than this share of what is left ends the
    fit. `found`: parameters that stand where another fit put them, about which nothing is tried."""
    problem = c.problem
    own = own_nuisances(c, leaves)
    held = [k for k in range(len(c.nuisances)) if k not in own]
    A = c.jacobian[:, held][c.train]
    sd = np.array([c.nuisances[k].sd for k in held])
    names = [n for n in start if problem.table[n].scale > 0.0]
    entries = [problem.table[n] for n in names]
    index = [problem.table.index(n) for n in names]
    vector, answer, z = _begin(c, start, found, held, c.z if z is None else z)
    if not np.all(np.isfinite(answer)):
        return None
    x = np.array([p.to_search(float(vector[i])) for p, i in zip(entries, index, strict=True)])
    ends = [_ends(p) for p in entries]
    scale = np.array([step_size(p, s) for p, s in zip(entries, x, strict=True)])
    residual = problem.measured - answer
    white = c.noise.whiten(problem, residual)
    covariance: Array = np.diag((WEAK * scale) ** 2)
    least, most = reach(problem, c.nuisances)
    lower = np.concatenate([least[held], [e[0] for e in ends]])
    upper = np.concatenate([most[held], [e[1] for e in ends]])
    spread = spread_of(c, white)
    stalled, is_elsewhere_tried = 0, False
    for _ in range(2 * rounds if is_swinging(names) else rounds):
        cost = _total(c, white, z, spread)
        A = _with_latencies(c, A, held, vector, residual)
        B = sensitivities(c, vector, answer, names)
        J = np.hstack([A, B[c.train] * scale])
        here = np.concatenate([z, x / scale])
        stiff = np.full(len(held), np.sqrt(c.problem.discount))
        ridge = np.concatenate([stiff, np.full(len(x), 1.0 / WEAK)])
        new, information = _robust_step(
            J, white[c.train], here, ridge,
            lower / _units(held, scale), upper / _units(held, scale), spread,
        )  # fmt: skip
        inverse = np.asarray(np.linalg.pinv(information), dtype=np.float64)
        covariance = inverse[len(held) :, len(held) :] * np.outer(scale, scale)
        gained = 0.0
        for share in SHORTER:
            point = here + share * (new - here)
            trial = _at(c, vector, held, sd, point[: len(held)] - z, index, entries,
                        point[len(held) :] * scale)  # fmt: skip
            answer_new = problem.answers(trial)[0]
            if not np.all(np.isfinite(answer_new)):
                continue
            left = problem.measured - answer_new
            white_new = c.noise.whiten(problem, left)
            cost_new = _total(c, white_new, point[: len(held)], spread)
            step = point - here
            told = A @ step[: len(held)] + J[:, len(held) :] @ step[len(held) :]
            A = _as_moved(A, (white - white_new)[c.train] - told, step[: len(held)])
            if cost_new < cost:
                gained = cost - cost_new
                vector, answer, residual, white = trial, answer_new, left, white_new
                z, x = point[: len(held)], point[len(held) :] * scale
                break
        before, spread = spread, spread_of(c, white)
        enough = settled * max(cost / max(c.train.sum(), 1), LEAST_LEFT) * c.train.sum()
        stalled = 0 if gained > enough or spread < CALMER * before else stalled + 1
        if stalled > 1 or (stalled == 1 and share == 1.0):
            # settled, or corrected sensitivities have not helped either
            if not is_elsewhere_tried:
                is_elsewhere_tried = True
                trial, moved = read_elsewhere(
                    problem, c.noise, [c.nuisances[k] for k in held], vector, z,
                    partial(_nats, c, spread),
                )  # fmt: skip
                answer_new = problem.answers(trial)[0]
                white_new = c.noise.whiten(problem, problem.measured - answer_new)
                if _total(c, white_new, moved, spread) < _total(c, white, z, spread) - enough:
                    vector, answer, white, z = trial, answer_new, white_new, moved
                    residual, stalled = problem.measured - answer, 0
                    continue
            break
    full_z = np.array(c.z)
    full_z[held] = z
    full_z[own] = 0.0
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known = deviation * np.sqrt(c.problem.discount)
    bound = tuple(p.name for p, s, u in zip(entries, x, known, strict=True) if _is_stuck(p, s, u))
    values = np.array([vector[i] for i in index])
    return Fit(
        tuple(leaves), tuple(names), values, deviation, vector, residual, white, full_z, bound
    )


def _with_latencies(
    c: Calibrated, A: Array, held: Sequence[int], vector: Array, residual: Array
) -> Array:
    """Sensitivities (M, K), those to latencies as they are at `vector`: what a force's latency does changes
    with every jump that a sample comes near, and one replay tells all of them."""
    late = [row for row, k in enumerate(held) if c.nuisances[k].name.endswith(LATENCY)]
    if not late:
        return A
    some = [c.nuisances[held[row]] for row in late]
    fresh = c.noise.whiten(c.problem, nuisance_sensitivities(c.problem, some, vector, residual))
    out = np.array(A)
    out[:, late] = fresh[c.train] * np.array([n.sd for n in some])
    return out


def _as_moved(A: Array, missed: Array, step: Array) -> Array:
    """Sensitivities (M, K) to nuisances, corrected so that `step` (K,) makes what it did, `missed` (M,) over
    what they said [M: Broyden]: they were found where calibration stood, which may be far off."""
    size = float(step @ step)
    return A + np.outer(missed, step / size) if size > FAR else A


def _begin(
    c: Calibrated,
    start: Mapping[str, float],
    found: Collection[str],
    held: Sequence[int],
    z: Array,
) -> tuple[Array, Array, Array]:
    """Parameter vector, answer and held nuisances to start from: a start worse than none is drawn nearer.

    Amplitudes come from a linear picture, which may promise too much of what these data hardly hold.
    """
    spread = spread_of(c, c.white)
    unmoved = _total(c, c.white, c.z[held], spread)
    z = np.clip(z, *reach(c.problem, c.nuisances))
    best: tuple[float, Array, Array, Array] | None = None
    for share in NEARER:
        vector = np.array(c.vector)
        moved = np.array(c.z[held])
        for row, k in enumerate(held):
            step = share * (float(z[k]) - float(c.z[k]))
            moved[row] += step
            vector[c.problem.table.index(c.nuisances[k].name)] += c.nuisances[k].sd * step
        for n, value in start.items():
            i = c.problem.table.index(n)
            p = c.problem.table[n]
            now = float(c.vector[i])
            aim = shifted(c.problem, n, now, value)
            is_linear = p.search == "linear" and p.parameter not in ABSOLUTE and np.isfinite(now)
            is_linear = is_linear and p.scale > 0.0
            vector[i] = now + share * (aim - now) if is_linear else aim
        answer = c.problem.answers(vector)[0]
        if np.all(np.isfinite(answer)):
            white = c.noise.whiten(c.problem, c.problem.measured - answer)
            cost = _total(c, white, moved, spread)
            if best is None or cost < best[0]:
                best = (cost, vector, answer, moved)
            if cost <= unmoved:
                break
    if best is None:
        return vector, answer, moved
    return _scanned(c, {n: v for n, v in start.items() if n not in found}, best, spread)


def _scanned(
    c: Calibrated,
    start: Mapping[str, float],
    best: tuple[float, Array, Array, Array],
    spread: float,
) -> tuple[Array, Array, Array]:
    """A start with a rugged cost: the best of some about it."""
    for turn in range(TURNS):
        rows = about(c.problem.table, start, best[1], turn)
        if not len(rows):
            break
        for row, answer in zip(rows, c.problem.answers(rows), strict=True):
            if np.all(np.isfinite(answer)):
                white = c.noise.whiten(c.problem, c.problem.measured - answer)
                cost = _total(c, white, best[3], spread)
                if cost < best[0]:
                    best = (cost, row, answer, best[3])
    return best[1:]


def _ends(p: Parameter) -> list[float]:
    """Bounds in the search coordinate."""
    lower = max(p.lower, NARROWEST.get(p.parameter, -np.inf))
    return sorted((p.to_search(lower), p.to_search(p.upper)))


def _is_stuck(p: Parameter, x: float, deviation: float) -> bool:
    """Whether a parameter wants more than its bounds allow; one that wants to vanish has what it wants, and
    one that data leave free by HARDLY of its way from neutral wants nothing."""
    near, neutral = 1e-6 * max(abs(x), 1e-9), p.to_search(p.neutral)
    if np.isfinite(neutral) and deviation > HARDLY * abs(x - neutral):
        return False
    return any(abs(x - end) < near and end != neutral for end in _ends(p))


def _units(held: Sequence[int], scale: Array) -> Array:
    return np.concatenate([np.ones(len(held)), scale])


def step_size(p: Parameter, x: float) -> float:
    """A step that matters, in the search coordinate: the table's, or all of where the search stands."""
    if p.parameter in BY_VALUE:
        return max(abs(x), 1e-9)
    return float(abs(p.to_search(p.scale)))


def _difference(p: Parameter, x: float) -> float:
    """The step, in the search coordinate, that a sensitivity is a difference over."""
    if p.parameter == "gap":
        share, least = GAP_STEP
        return max(share * abs(x), least)
    if p.parameter == "phase":
        return PHASE_STEP_RAD
    if p.parameter == "delay":
        return LATENCY_STEP_S if p.name.endswith(LATENCY) else DELAY_STEP_S
    return BY_VALUE.get(p.parameter, 0.0) * abs(x) or 0.5 * p.search_step


def _total(c: Calibrated, white: Array, z: Array, spread: float) -> float:
    held = 0.5 * c.problem.discount * z @ z
    return float(spread**2 * np.sum(loss(white[c.train] / spread)) + held)


def _nats(c: Calibrated, spread: float, white: Array, mine: NDArray[np.bool_]) -> float:
    """Of whitened residuals (N,) where the mask (N,) says so and fits look."""
    left = spread**2 * np.sum(loss(white[mine & c.train] / spread))
    return float(left / c.problem.discount)


def _at(
    c: Calibrated,
    vector: Array,
    held: Sequence[int],
    sd: Array,
    dz: Array,
    index: Sequence[int],
    entries: Sequence[Parameter],
    x: Array,
) -> Array:
    out = np.array(vector)
    for k, step in zip(held, sd * dz, strict=True):
        out[c.problem.table.index(c.nuisances[k].name)] += step
    for i, p, s in zip(index, entries, x, strict=True):
        out[i] = min(max(p.from_search(float(s)), p.lower), p.upper)
    return out


def sensitivities(c: Calibrated, vector: Array, answer: Array, names: Sequence[str]) -> Array:
    """(N, P) whitened change per unit of each search coordinate."""
    problem, table = c.problem, c.problem.table
    if not names:
        return np.zeros((problem.size, 0))
    rows, spans = [], []
    for name in names:
        p, i = table[name], table.index(name)
        x = p.to_search(float(vector[i]))
        high = max(p.to_search(p.lower), p.to_search(p.upper))
        step = _difference(p, x)
        if x + step > high:
            step = -step
        row = np.array(vector)
        row[i] = min(max(p.from_search(x + step), p.lower), p.upper)
        rows.append(row)
        spans.append(p.to_search(float(row[i])) - x)
    answers = problem.answers(np.array(rows))
    change = np.where(np.isfinite(answers), answers - answer, 0.0).T
    span = np.array([s if s != 0.0 else 1.0 for s in spans])
    return np.asarray(c.noise.whiten(problem, change) / span)


def _robust_step(
    J: Array,
    white: Array,
    here: Array,
    ridge: Array,
    lower: Array,
    upper: Array,
    spread: float,
) -> tuple[Array, Array]:
    """Bounded robust minimum of the linear problem, and its information matrix there."""
    n = len(here)
    nuisances = ridge >= 1.0
    centre = np.where(nuisances, 0.0, here)
    new, information = np.array(here), np.eye(n)
    for _ in range(3):
        left = np.abs(white - J @ (new - here))
        counts = weight(left / spread)
        weighted = J * counts[:, None]
        information = weighted.T @ J + np.diag(ridge**2)
        gradient = weighted.T @ (white + J @ here) + ridge**2 * centre
        try:
            root = np.linalg.cholesky(information)
        except np.linalg.LinAlgError:
            return here, information + 1e-9 * np.eye(n)
        aim = np.linalg.solve(root, gradient)
        inside = np.clip(here, lower, upper)
        if np.any(upper - lower < 1e-15):
            return inside, information
        new = np.asarray(lsq_linear(root.T, aim, (lower, upper), method="bvls").x)
    return new, information
