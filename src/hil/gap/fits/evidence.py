"""How much the data speak for each fit, and which fits these data cannot tell apart.

A fit's evidence is Laplace's approximation: what is left on the training samples, what the nuisances' priors
cost, and what freedom its parameters had and did not need. What is left is no independent noise: the twin is
wrong in small ways everywhere, so the spread and the correlation of the best fit's own whitened residual
set what one sample is worth. Fits whose answers differ by less than the floor stand in one class.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.catalogue.bank import ABSOLUTE
from hil.gap.catalogue.nature import MOMENTS
from hil.gap.fits.fit import step_size
from hil.gap.fits.fitted import Calibrated, Fit, loss
from hil.gap.fits.friction import is_equal, is_peak, nested
from hil.gap.fits.shares import RARE, largest_ratio
from hil.gap.located.result import RATIO

Array = NDArray[np.float64]

TEMPER: Final = 2.0
"""What evidence is divided by at least beside, for what no correlation shows [set on training cases]."""
RELATIVE: Final = 0.01
"""Of all that the best candidate explains: two that differ by less are no further apart than two laws of one
effect, and no number of samples changes that [set on training cases of two worlds]."""
SIMPLER: Final = 0.5
"""Such units that each parameter which these data determine must earn: of two laws that explain alike the one
with fewer is meant more often, whatever small ways of the rig the other's freedom follows [set on training
cases of two worlds]."""
LESS: Final = 2.3
"""Such units that a mass below the rig file's costs: one in ten is [R]. Masses are added to rigs, and what
looks like one that was taken away is more often a drive that pushes harder than it says."""
ADDED: Final = ("payload_mass.mass", "actuator_inertia.mass")
STUCK: Final = 6.0
"""Such units that a parameter at its bound costs: what wants more than any rig has is another effect."""
VECTORS: Final = frozenset({"sensor_misalignment"})
"""Effects whose parameters are the components of one thing, and determined as one: a turned IMU is no law of
three parameters where a wheel that pitches it is one of one."""
PEAKS: Final = 5.0
"""Nats by which friction with a peak at rest must explain more than without it, to have that peak."""
RANGE: Final = 10.0
"""Prior range of a parameter, in its own scales, beyond which sizes become rare slowly."""
UNUSED: Final = 0.05
"""What a parameter costs at least, as a ratio: freedom that changes nothing is no reason to choose it."""
TOLD: Final = 0.5
"""Of its range, within which data must hold a parameter to have determined it."""
MORE: Final = 12.0
"""Nats that each further effect must earn beyond its parameters."""
ALIKE: Final = 0.5
"""Floors by which the answers of two fits may differ on any signal within one class."""
SAME: Final = 0.15
"""Floors by which the answers of one effect under two names differ at most."""
ODDS: Final = 1.2
"""Such units by which the best of those is ahead of the others at most, and again for each parameter that
these data determine of another beyond its own: what is that small is how this rig differs from the twin, not
which of them it is. Laws of friction that hold one another are excepted."""
FAINT: Final = 5.0
"""Nats of the best explanation of a small gap, up to which it is as good as none: no second effect, which
must earn MORE, and no other twin is worth a look."""
OTHER_TWIN: Final = 5.0
"""Nats by which another twin must explain better to be the right one: rig files are right most often."""
LONGEST_LAG: Final = 60
LEAST: Final = 20
"""Samples of a series from which on its residual tells anything."""


@dataclass(frozen=True, slots=True)
class Weighed:
    """A fit with its evidence."""

    fit: Fit
    log_evidence: float
    probability: float


@dataclass(frozen=True, slots=True)
class Temper:
    """What the best fit leaves of one signal: how wide it is, whitened, and how many samples count as one."""

    spread: float
    samples: float

    @property
    def variance(self) -> float:
        """By which an estimate from independent noise of spread 1 is too sure."""
        return self.spread**2 * self.samples

    def counted(self, discount: float) -> float:
        """Samples that count as one: those that hang together, or the discount that fits know."""
        return max(discount, TEMPER * self.samples)


def weigh(c: Calibrated, fits: Sequence[Fit]) -> tuple[list[Weighed], float]:
    """Every fit with its probability among them, best first; and what the variance of parameters is times."""
    best = min(fits, key=lambda f: f.total(c))
    tempers = temper(c, best)
    worth = float(np.mean([t.variance for t in tempers.values()]))
    loose = float(np.mean([t.spread**2 * t.counted(c.problem.discount) for t in tempers.values()]))
    likely = np.array([log_likelihood(c, f, tempers) for f in fits])
    likely += [_as_events(c, f, fits, tempers) for f in fits]
    freedom = np.array([log_freedom(c, f, loose) for f in fits])
    # Which of two that answer alike has the more usual size is no evidence: they share what freedom costs.
    order = np.argsort(-(likely + freedom))
    group = np.empty(len(fits), dtype=int)
    group[order] = classes(c, [fits[k] for k in order], SAME)
    names = np.array([len(f.names) for f in fits])
    several = np.array([len(f.leaves) for f in fits])
    shared = [
        np.mean(freedom[(group == group[k]) & (names == names[k]) & (several == several[k])])
        for k in range(len(fits))
    ]
    costs = np.array(shared)
    asked_for = _asked_for(c, fits)
    for k, held in asked_for:
        costs[k] = max(costs[k], *costs[held])
    logs = likely + costs
    real = np.array([bool(f.leaves) for f in fits])
    unit = max(1.0, RELATIVE * float(logs.max() - logs[~real].max()))
    told = np.array([_told(c, f, loose) for f in fits])
    for k, held in (*_peaks(fits, logs), *asked_for):
        told[k] = min(told[k], *told[held])
    ends = np.array([len(f.at_bound) for f in fits])
    less = np.array(
        [
            sum(v < 0.0 for n, v in zip(f.names, f.values, strict=True) if n.endswith(ADDED))
            for f in fits
        ]
    )
    worth_of = logs / unit - SIMPLER * told - STUCK * ends - LESS * less
    for g in set(group[real].tolist()):
        mine = np.flatnonzero((group == g) & real)
        head = int(mine[np.argmax(worth_of[mine])])
        for k in mine.tolist():
            if not nested(fits[head].leaves, fits[k].leaves) and not ends[k]:
                more = max(int(told[k] - told[head]), 0)
                worth_of[k] = max(worth_of[k], worth_of[head] - ODDS * (1 + more))
    # How much both explain is no reason for a law whose further freedom nothing asks for.
    for j, k in itertools.permutations(np.flatnonzero(real).tolist(), 2):
        if several[k] != several[j] or names[k] <= names[j]:
            continue
        if not nested(fits[j].leaves, fits[k].leaves):
            continue
        if logs[k] < logs[j]:
            worth_of[k] = min(worth_of[k], worth_of[j] - float(logs[j] - logs[k]))
        if is_equal(fits[k]):
            worth_of[k] = min(worth_of[k], worth_of[j] - ODDS)
    # Which effect it is comes first, all alike; each of its places has a share of that.
    worth_of -= [sum(math.log(leaf.places) for leaf in f.leaves) for f in fits]
    worth_of = np.where(real, worth_of, -np.inf if real.any() else 0.0)
    p = np.exp(worth_of - worth_of.max())
    p /= p.sum()
    order = np.argsort(-worth_of)
    return [Weighed(fits[k], float(logs[k]), float(p[k])) for k in order], worth


def gain(weighed: Sequence[Weighed]) -> float:
    """Nats of the first of them over the fit without effects."""
    return weighed[0].log_evidence - next(w.log_evidence for w in weighed if not w.fit.leaves)


def explains_better(c: Calibrated, fits: Sequence[Fit], others: Sequence[Fit]) -> bool:
    """Whether the best of `others`, fits of another twin to the same samples, beats all `fits` of the twin
    that `c` is of by more than OTHER_TWIN nats."""
    seen = [replace(f, white=c.noise.whiten(c.problem, f.residual)) for f in others]
    tempers = temper(c, min((*fits, *seen), key=lambda f: f.total(c)))
    loose = float(np.mean([t.spread**2 * t.counted(c.problem.discount) for t in tempers.values()]))
    first, second = (
        max(log_likelihood(c, f, tempers) + log_freedom(c, f, loose) for f in group)
        for group in (fits, seen)
    )
    return second > first + OTHER_TWIN


def _asked_for(c: Calibrated, fits: Sequence[Fit]) -> list[tuple[int, list[int]]]:
    """Numbers of the laws of friction that leave no gap where every simpler one that they hold leaves one,
    with those: their freedom is asked for, and nothing against them."""
    ratio = [largest_ratio(c, f) for f in fits]
    out = []
    for k in range(len(fits)):
        held = _simpler(fits, k)
        if held and ratio[k] < RARE and min(ratio[j] for j in held) > RATIO:
            out.append((k, held))
    return out


def _peaks(fits: Sequence[Fit], logs: Array) -> list[tuple[int, list[int]]]:
    """Numbers of those whose peak at rest stands out and explains more than every simpler law that they hold,
    by PEAKS nats, with those: that a curve has three parameters is nothing against it then."""
    held = [(k, _simpler(fits, k)) for k, f in enumerate(fits) if is_peak(f)]
    return [(k, some) for k, some in held if some and logs[k] > max(logs[some]) + PEAKS]


def _simpler(fits: Sequence[Fit], k: int) -> list[int]:
    """Numbers of the fits with as many effects as the k-th that are simpler laws which its own holds."""
    f = fits[k]
    return [
        j for j, g in enumerate(fits)
        if g.leaves and len(g.leaves) == len(f.leaves) and len(g.names) < len(f.names)
        and nested(g.leaves, f.leaves)
    ]  # fmt: skip


def temper(c: Calibrated, best: Fit) -> dict[str, Temper]:
    """By signal, what the best fit leaves of it."""
    out: dict[str, Temper] = {}
    for signal in c.problem.signals:
        parts = [
            best.white[x.part][c.train[x.part]] for x in c.problem.series if x.signal == signal
        ]
        long = [w for w in parts if len(w) >= LEAST]
        size = np.array([len(w) for w in long])
        if not long:
            out[signal] = Temper(1.0, 1.0)
            continue
        spread = np.array([1.4826 * float(np.median(np.abs(w))) for w in long])
        time = np.array([_correlation_time(np.clip(w, -2.5, 2.5)) for w in long])
        wide = max(float(np.sqrt(np.average(spread**2, weights=size))), 1.0)
        variance = max(float(np.average(spread**2 * time, weights=size)), 1.0)
        out[signal] = Temper(wide, max(variance / wide**2, 1.0))
    return out


def _correlation_time(w: Array) -> float:
    """Integrated autocorrelation time in samples, up to the first lag at which it has gone [M: Sokal]."""
    w = w - w.mean()
    n = len(w)
    spectrum = np.abs(np.fft.rfft(w, 2 * n)) ** 2
    r = np.fft.irfft(spectrum)[: min(n // 4, LONGEST_LAG)]
    r = r / max(r[0], 1e-300)
    total = 1.0
    for k in range(1, len(r)):
        if k > 5.0 * total:
            break
        total += 2.0 * max(float(r[k]), 0.0)
    return max(total, 1.0)


def log_likelihood(c: Calibrated, f: Fit, tempers: Mapping[str, Temper]) -> float:
    """Nats of data, tempered, and of what the nuisances' priors say.

    Student's distribution is as wide as what the best fit leaves: a narrower one would take all for wild.
    """
    discount = c.problem.discount
    extra = f.extra_cost * min(TEMPER / discount, 1.0)
    return -_data(c, f, tempers, discount) - f.prior_cost - extra


def _data(c: Calibrated, f: Fit, tempers: Mapping[str, Temper], discount: float) -> float:
    data = 0.0
    for x in c.problem.series:
        t = tempers[x.signal]
        rows = c.train[x.part]
        data += float(np.sum(loss(f.white[x.part][rows] / t.spread))) / t.counted(discount)
    return data


def _as_events(c: Calibrated, f: Fit, fits: Sequence[Fit], tempers: Mapping[str, Temper]) -> float:
    """Nats that a fit has beside `log_likelihood` where MOMENTS of it explain what stands in few samples.

    Many samples count as one for the small ways in which a twin is wrong: those are in all of them. What
    an effect that has no such moments explains as well stands in no few samples.
    """
    others = [leaf for leaf in f.leaves if leaf.effect not in MOMENTS]
    base = next((g for g in fits if list(g.leaves) == others), None)
    if len(others) == len(f.leaves) or base is None or largest_ratio(c, base) > RARE:
        return 0.0
    steady = [
        g for g in fits
        if len(g.leaves) <= len(f.leaves) and not any(x.effect in MOMENTS for x in g.leaves)
    ]  # fmt: skip
    if min(_data(c, g, tempers, 0.0) for g in steady) < _data(c, f, tempers, 0.0):
        return 0.0
    part, full = (
        _data(c, base, tempers, by) - _data(c, f, tempers, by) for by in (c.problem.discount, 0.0)
    )
    extra = f.extra_cost - base.extra_cost
    return max((full - extra) - (part - extra * min(TEMPER / c.problem.discount, 1.0)), 0.0)


def log_freedom(c: Calibrated, f: Fit, loose: float) -> float:
    """Nats that the freedom of a fit's parameters and of further effects costs."""
    total = float(np.sum(np.log(np.clip(_felt(c, f, loose), 1e-12, UNUSED))))
    for name, value in zip(f.names, f.values.tolist(), strict=True):
        p = c.problem.table[name]
        at = p.to_search(value)
        away = at - p.to_search(p.neutral)
        if p.parameter not in ABSOLUTE and np.isfinite(away):
            total -= math.log1p(0.5 * float(away / (RANGE * step_size(p, at))) ** 2)
    return total - MORE * max(len(f.leaves) - 1, 0)


def _felt(c: Calibrated, f: Fit, loose: float) -> Array:
    """Of each parameter, the width that data leave it over the range that it had.

    Its variance is `loose` times that of independent noise.
    """
    spread = np.sqrt(2.0 * np.pi) * f.search_sd * np.sqrt(loose)
    entries = [c.problem.table[name] for name in f.names]
    free = [
        RANGE * step_size(p, p.to_search(v))
        for p, v in zip(entries, f.values.tolist(), strict=True)
    ]
    return np.asarray(spread / np.array(free))


def _told(c: Calibrated, f: Fit, loose: float) -> int:
    """How many parameters of a fit these data determine; a vector is one thing, whatever it points to."""
    one = {n: leaf.name for leaf in f.leaves if leaf.effect in VECTORS for n in leaf.parameters}
    felt = _felt(c, f, loose).tolist()
    return len({one.get(n, n) for n, x in zip(f.names, felt, strict=True) if x < TOLD})


def distance(c: Calibrated, a: Fit, b: Fit) -> float:
    """Largest root mean square difference of two fits' answers on any signal, in its floor."""
    between = c.noise.weighted_rms(c.problem, a.residual - b.residual)
    return max(between[s] / v for s, v in c.floors.items() if v > 0.0)


def classes(c: Calibrated, fits: Sequence[Fit], alike: float = ALIKE) -> list[int]:
    """For each of `fits` (best first) the number of its class: that of the first it is like."""
    heads: list[Fit] = []
    out = []
    for f in fits:
        near = next((k for k, h in enumerate(heads) if distance(c, f, h) < alike), None)
        if near is None:
            heads.append(f)
            near = len(heads) - 1
        out.append(near)
    return out
