"""On which sort of wheels rides were ridden, as the rides themselves tell.

Five things that tyres do and thin wheels do not are estimated together with all nuisances, each with a prior
so wide that it says nothing. An effect moves some of the five, seldom all: each speaks for one sort or the
other by its own likelihood, and one that neither sort explains does not speak.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from hil.bicycle.recorded import Ride
from hil.config import BicycleFile
from hil.gap.bicycle.noise import ride_noise
from hil.gap.bicycle.nuisances import ride_nuisances, wheel_nuisances
from hil.gap.bicycle.problem import RideProblem
from hil.gap.bicycle.wheels import THIN, TYRES, Wheels
from hil.gap.catalogue.nuisances import LIMIT, Nuisance
from hil.gap.located.residual import Fitted, refit

WIDE: Final = 3.0
"""Times what tyres do and its spread: a prior that tells nothing beside either sort."""
BESIDE: Final = {"rear_wheel.wheel_radius.scale": 0.02, "imu.sensor_latency.delay": 0.02}
"""Priors of what may be off as far as this beside: a wheel of another radius or one that slips turns a
bicycle otherwise, a late IMU feels what drives it later, as with tyres."""
DISTURBED: Final = 0.2
"""Chance that something else moves one of the five [R]."""
CLEAR: Final = 3.0
"""Nats by which thin wheels must be more likely than tyres, which nearly all bicycles have [R]."""
BENT: Final = 1.5
"""Root mean square of what is left, in floors, from which on estimates are believed to be off by more than
their own errors, in proportion."""


def rolled(rides: Sequence[Ride], rig: BicycleFile, seed: int = 0) -> Wheels:
    """The sort of wheels that `rides` were ridden on: tyres, unless thin ones are clearly more likely."""
    problem = RideProblem(rig, rides)
    thin, tyres = ({n.name: n for n in wheel_nuisances(w)} for w in (THIN, TYRES))
    wide = {n.name: WIDE * (abs(n.mean) + n.sd) for n in tyres.values()} | BESIDE
    priors = [
        replace(n, mean=0.0, sd=wide[n.name]) if n.name in wide else n
        for n in ride_nuisances(rig, problem)
    ]
    noise = ride_noise(problem, problem.base, np.random.default_rng(seed))
    found = refit(problem, noise, priors)
    white = noise.whiten(problem, found.residual)
    bent = max(float(np.sqrt(np.mean(np.clip(white, -10.0, 10.0) ** 2))) / BENT, 1.0)
    nats = sum(_said(f, thin[f.name], tyres[f.name], bent) for f in found.fitted if f.name in tyres)
    return THIN if nats > CLEAR else TYRES


def _said(f: Fitted, thin: Nuisance, tyres: Nuisance, bent: float) -> float:
    """Nats that one estimate has for thin wheels."""
    error = bent * f.sd
    anything = DISTURBED / (2.0 * LIMIT * f.prior_sd)
    one, other = (
        anything + (1.0 - DISTURBED) * _density(f.change, n, error) for n in (thin, tyres)
    )
    return float(np.log(one / other))


def _density(value: float, n: Nuisance, error: float) -> float:
    """Of an estimate that is off by `error`, where such wheels do what `n` says."""
    sd = np.hypot(n.sd, error)
    return float(np.exp(-0.5 * ((value - n.mean) / sd) ** 2) / (np.sqrt(2.0 * np.pi) * sd))
