"""The noise once more, where a fit that is beyond doubt leaves less than was taken for noise.

A gap that is fast makes a record look noisier than it is: friction that is lacking, answers that come late.
What else there may be would drown in that. So the noise is drawn again beside the best fit, brought to the
level of what that leaves, and everything is weighed anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from hil.gap.fits.evidence import gain, weigh
from hil.gap.fits.facts import EFFECT as ROUNDED
from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.fits.frames import EFFECT as LOST
from hil.gap.floor.noise import find_noise, projected
from hil.gap.judged.clear import asked
from hil.gap.located.locate import evidence_of, located
from hil.gap.located.residual import Refit
from hil.gap.located.result import Located

CALMER: Final = 0.93
"""Of a signal's floor, below which what the best fit leaves shows that the floor is too high."""


def calmed(before: Located, c: Calibrated, fits: Sequence[Fit], seed: int) -> Located | None:
    """`before` with the noise that the best of `fits` leaves; None where that is as loud as was thought.

    Noise that repeats of a motion have shown stays; steps of a signal and lost frames stand in no vector.
    """
    e = before.evidence
    ranked, _ = weigh(c, fits)
    best = ranked[0].fit
    if e.noise.source != "model" or not in_vector(best) or gain(ranked) < asked(c).decisive:
        return None
    left = c.noise.usual(c.problem, best.residual)
    if not any(left[s] < CALMER * c.usual_floors[s] for s in left):
        return None
    rng = np.random.default_rng(seed + 3)
    residual = e.problem.residual(best.vector)
    noise = find_noise(e.problem, best.vector, rng, residual=residual)
    spread = np.array([f.prior_sd for f in before.nuisances])
    noise = projected(noise, e.problem, e.jacobian, spread)
    start = Refit(e.vector, e.residual, e.jacobian, before.nuisances)
    text = noise.text + ", beside the best fit"
    quiet = replace(noise, text=text)
    evidence = evidence_of(e.problem, quiet, start, e.motion)
    return located(e.problem.rig, before.runs, evidence, start, before.findings, rng)


def in_vector(f: Fit) -> bool:
    """Whether a fit has effects and all are in the vector: lost frames and steps of signals are in none."""
    return bool(f.leaves) and not any(leaf.effect in (LOST, ROUNDED) for leaf in f.leaves)
