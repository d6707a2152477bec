"""Curves for the page of a diagnosis: measured, twin before and after, over the whole record."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hil.gap import Cause, Diagnosis

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Curves:
    """Judged samples of one signal in one stretch."""

    signal: str
    unit: str
    stretch: int
    name: str
    """Of the stretch."""
    t: Array
    measured: Array
    before: Array
    """The twin after calibration."""
    after: Array
    """The twin with the verdict's effects; NaN where there are none."""
    sigma: Array
    """Noise floor of each sample."""
    held_from_s: float | None
    """From when on no fit has seen the samples; None: all were seen."""


def curves(found: Diagnosis) -> list[Curves]:
    """Every judged signal and stretch, in the order of the record: runs of the whole twin, twice."""
    e = found.located.evidence
    p = e.problem
    before = p.measured - (e.residual if found.none is None else p.residual(found.none.vector))
    after = np.full(p.size, np.nan)
    if found.best is not None and found.effects:
        answer = p.answers(found.best.vector)[0]
        after = np.where(np.isfinite(answer), answer, before)
    units = {s.signal: s.unit for s in found.located.signals}
    ends = _seen_until(found)
    out = []
    for x in p.series:
        kept = p.kept[x.part]
        if x.signal in units and kept.sum() > 1:
            held = None if ends is None else ends.get(p.pieces[x.stretch].name, -np.inf)
            parts = (a[x.part][kept] for a in (p.t_s, p.measured, before, after, e.noise.sigma))
            t, measured, twin, better, sigma = parts
            if held is not None and held >= t[-1]:
                held = None
            out.append(
                Curves(x.signal, units[x.signal], x.stretch, p.pieces[x.stretch].name, t, measured, twin,
                       better, sigma, held)
            )  # fmt: skip
    return out


def _seen_until(found: Diagnosis) -> dict[str, float] | None:
    """Last sample that fits saw, by stretch; None where nothing was fitted."""
    if found.calibrated is None:
        return None
    p = found.calibrated.problem
    out: dict[str, float] = {}
    for x in p.series:
        name = p.pieces[x.stretch].name
        out[name] = max(out.get(name, -np.inf), float(p.t_s[x.part][-1]))
    return out


def worst(found: Diagnosis, count: int) -> list[str]:
    """The signals with the largest part of the gap, else the most floors off."""
    ranked = sorted(found.located.signals, key=lambda s: (-s.share, -s.ratio))
    return [s.signal for s in ranked[:count]]


def best_first(found: Diagnosis) -> list[Cause]:
    """The causes by their probability as pages print it, and of equal ones by what speaks for them."""
    return sorted(found.causes, key=lambda c: (-round(c.probability, 3), -c.gain))
