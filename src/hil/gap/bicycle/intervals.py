"""How far a cause's parameters may lie off the truth beyond what noise does to them.

What no curvature of a fit shows. A real spring stiffens as it goes in and a damper holds the rebound harder:
linear ones that answer alike are others. A damping of fork or tyres hardly shows below 1.5 Hz: whatever
changes no signal by a visible part of its floor is as likely. And what an effect is comes on top of what a
healthy bicycle has anyway, on the whole or as its references showed, which no record tells from it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import takewhile
from typing import Final

import numpy as np

from hil.gap.fits.fitted import Calibrated
from hil.gap.judged.diagnosis import Cause, ParameterValue

SPRUNG: Final = ("front_suspension", "tyre_compliance")
LAW: Final[Mapping[str, float]] = {"stiffness": 1.3, "damping": 1.8}
"""Times or parts of a linear law that answers as a real one does [set on training cases]."""
FACTORS: Final = (0.0, 0.03, 0.1, 0.2, 0.4, 0.6, 0.8, 1.3, 1.7, 2.5, 4.0, 8.0)
"""Times the damping found."""
ALIKE: Final = 0.5
"""Floors by which a signal may change and answer alike, as in `hil.gap.fits.evidence`."""
LEFT: Final[Mapping[str, float]] = {
    "sensor_latency": 0.002, "sensor_scale": 0.004, "wheel_radius": 0.003, "wheel_slip": 0.003,
}  # fmt: skip
"""What stamps, scales and wheels of a healthy bicycle are off by together [R]."""


def beyond_usual(cause: Cause, c: Calibrated) -> Cause:
    """`cause` less what any bicycle has of it, with intervals that hold what calibrations leave and what
    these rides do not show."""
    sd = {n.name: n.sd for n in c.nuisances}
    usual = {n.name: n.mean for n in c.nuisances}
    out: dict[str, ParameterValue] = {}
    for name, found in cause.parameters.items():
        full = f"{cause.location}.{cause.effect}.{name}"
        low, high = found.ci
        is_fitted = c.problem.table[full].scale > 0.0
        more = max(sd.get(full, 0.0), LEFT.get(cause.effect, 0.0)) if is_fitted else 0.0
        if more > 0.0:
            low = found.value - float(np.hypot(found.value - low, more))
            high = found.value + float(np.hypot(high - found.value, more))
        if cause.effect in SPRUNG and np.isfinite(found.value):
            law = LAW[name]
            least, most = found.value / law, found.value * law
            if name == "damping":
                unseen = _unseen(cause, c, full)
                least, most = min(least, unseen[0]), max(most, unseen[1])
            low, high = min(low, least), max(high, most)
        own = usual.get(full, 0.0)
        out[name] = replace(found, value=found.value - own, ci=(low - own, high - own))
    return replace(cause, parameters=out)


def _unseen(cause: Cause, c: Calibrated, name: str) -> tuple[float, float]:
    """Least and largest damping, about the one found, that answers alike."""
    i = c.problem.table.index(name)
    here = float(cause.fit.vector[i])
    rows = np.tile(cause.fit.vector, (len(FACTORS), 1))
    rows[:, i] = here * np.array(FACTORS)
    base = c.problem.measured - cause.fit.residual
    alike = []
    for answer in c.problem.answers(rows):
        off = c.noise.weighted_rms(c.problem, answer - base)
        alike.append(max(off[s] / v for s, v in c.floors.items() if v > 0.0) < ALIKE)
    return here * furthest(FACTORS[::-1], alike[::-1], -1.0), here * furthest(FACTORS, alike, 1.0)


def furthest(factors: Sequence[float], alike: Sequence[bool], way: float) -> float:
    """The last of those above 1 (`way` 1) or below it (-1) up to which all are alike."""
    beyond = [x for x in zip(factors, alike, strict=True) if way * (x[0] - 1.0) > 0.0]
    return max(
        (f for f, _ in takewhile(lambda x: x[1], beyond)), key=lambda f: way * f, default=1.0
    )
