"""How much of the gap stands and how much a fit takes away, in floors of the signals and as a share."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

import numpy as np
from scipy.ndimage import maximum_filter1d

from hil.gap.fit import Calibrated, Fit, loss
from hil.gap.noise import time_sensitivity
from hil.gap.result import Located

FAINT: Final = 0.3
"""Squared floors of energy above the floor that are too few to speak of."""
RARE: Final = 1.35
"""Floors of the usual residual up to which a gap is one of rare events."""
WILD: Final = {"position": 3.0, "accel": 4.5}
"""Floors of a signal, lone samples and all, that are a gap alone: healthy rigs of three worlds stay below 1.2
and 3.1, for late frames are felt by accelerometers as well."""
STRUCK: Final = {"position": 10.0, "force": 100.0, "current": 100.0}
"""Spreads that a lone sample must have to be a gap alone, what a frame that is LATE does among them: healthy
rigs of two worlds stay below 4 and 84."""
LATE: Final = 0.2
"""Of a cycle."""
NEAR: Final = 9
"""Samples about one, of which the one that feels time most tells how late frames kick."""


def jumps(located: Located) -> tuple[str | None, float]:
    """The signal whose lone samples stand out most, and how far, in what is a gap alone (WILD, STRUCK).

    An encoder's answers do not jump by themselves, and nothing in the noise strikes an accelerometer. Forces
    are asked for single blows only: a frame that reaches its drive a tick late kicks harder than much of what
    is a gap, but no harder than a frame can be late.
    """
    problem = located.evidence.problem
    shocks = _shocks(located)
    worst, most = None, 0.0
    for signal in problem.signals:
        quantity = next(x.quantity for x in problem.series if x.signal == signal)
        times = max(
            _wild(located, signal) / WILD.get(quantity, np.inf),
            shocks.get(signal, 0.0) / STRUCK.get(quantity, np.inf),
        )
        if times > most:
            worst, most = signal, times
    return worst, most


def _wild(located: Located, signal: str) -> float:
    """Root mean square of a signal's residual, lone samples and all, in what noise is."""
    e = located.evidence
    parts = [x.part for x in e.problem.series if x.signal == signal]
    kept = np.concatenate([e.problem.kept[p] for p in parts])
    left = np.concatenate([e.residual[p] / e.noise.sigma[p] for p in parts])[kept]
    drawn = np.hstack([e.noise.draws[:, p] / e.noise.sigma[p] for p in parts])[:, kept]
    usual = max(float(np.sqrt(np.mean(drawn**2))), 1.0) if drawn.size else 1.0
    return float(np.sqrt(np.mean(left**2))) / usual if len(left) else 0.0


def _shocks(located: Located) -> dict[str, float]:
    """By signal of a drive, its largest lone sample over its noise and what late frames do to it."""
    e = located.evidence
    parts = [x for x in e.problem.series if x.quantity in STRUCK]
    if not parts:
        return {}
    late = LATE * e.problem.rig.bus.cycle * np.abs(time_sensitivity(e.problem, e.vector))
    out: dict[str, float] = {}
    for x in parts:
        near = maximum_filter1d(late[x.part], NEAR)
        size = np.abs(e.residual[x.part]) / (e.noise.sigma[x.part] + near)
        largest = float(np.max(size[e.problem.kept[x.part]], initial=0.0))
        out[x.signal] = max(out.get(x.signal, 0.0), largest)
    return out


def weighed_ratio(located: Located) -> float:
    """Largest usual residual of a signal over its floor."""
    e = located.evidence
    left = e.noise.usual(e.problem, e.residual)
    floors = e.noise.usual(e.problem, e.noise.draws)
    return max(left[s] / floors[s] for s in left if floors[s] > 0.0)


def largest_ratio(c: Calibrated, f: Fit) -> float:
    """Largest usual residual of a signal on training samples, in its floor."""
    left = c.noise.usual(c.problem, f.residual)
    floors = c.noise.usual(c.problem, c.noise.draws)
    return max(left[s] / floors[s] for s in left if floors[s] > 0.0)


def most_left(c: Calibrated, f: Fit) -> float:
    """Largest residual of a signal on training samples, in its floor: of the usual samples, or of all."""
    left, floors = (c.noise.weighted_rms(c.problem, r) for r in (f.residual, c.noise.draws))
    return max(largest_ratio(c, f), *(left[s] / floors[s] for s in left if floors[s] > 0.0))


def explained(
    c: Calibrated,
    none: Fit,
    f: Fit,
    is_sure: bool = False,
    signals: Collection[str] | None = None,
) -> float:
    """Share of the gap above the floor that a fit takes away on training samples (of `signals`), 0..1.

    Of its energy, lone spikes cut as everywhere. A gap that stands in rare events is those spikes: there the
    share is that of the robust loss, in which each counts but none for all. `is_sure`: the fit is beyond
    doubt, so what it leaves shows that no more than that is noise: a fast gap makes a record look noisy.
    """
    floors = c.noise.weighted_rms(c.problem, c.noise.draws)
    before = c.noise.weighted_rms(c.problem, none.residual)
    after = c.noise.weighted_rms(c.problem, f.residual)
    if is_sure:
        floors = {s: min(v, after[s]) for s, v in floors.items()}
    asked = floors if signals is None else signals
    ratios = [(before[s] / floors[s], after[s] / floors[s]) for s in asked if floors[s] > 0.0]
    was = sum(max(b**2 - 1.0, 0.0) for b, _ in ratios)
    left = sum(max(a**2 - 1.0, 0.0) for b, a in ratios)
    share = float(np.clip((was - left) / max(was, FAINT), 0.0, 1.0))
    if was < FAINT or largest_ratio(c, none) < RARE:
        return max(share, _robustly(c, none, f))
    return share


def above_noise(c: Calibrated, f: Fit) -> float:
    """Nats of the robust loss that a fit leaves above the floor; 0 where that is no more than chance."""
    drawn = [np.sum(loss(c.noise.whiten(c.problem, row)[c.train])) for row in c.noise.draws]
    left = f.cost(c.train) - float(np.mean(drawn))
    return left if left > float(np.std(drawn)) else 0.0


def _robustly(c: Calibrated, none: Fit, f: Fit) -> float:
    was = above_noise(c, none)
    if was == 0.0:
        return 0.0
    return float(np.clip((none.cost(c.train) - f.cost(c.train)) / was, 0.0, 1.0))
