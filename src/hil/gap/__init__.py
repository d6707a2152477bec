"""The sim-to-real gap: where a rig's twin differs from the rig, above the floor of noise.

`locate` answers that; `Problem`, `NoiseModel` and `refit` are what it and everything after it stand on.
"""

from hil.gap.diagnose import diagnose
from hil.gap.diagnosis import Cause, Diagnosis
from hil.gap.locate import locate
from hil.gap.noise import NoiseModel, find_noise
from hil.gap.nuisances import Nuisance, default_nuisances
from hil.gap.problem import Problem
from hil.gap.residual import Refit, refit
from hil.gap.result import Located, Place, SignalGap
from hil.gap.sanity import Finding

__all__ = [
    "Cause",
    "Diagnosis",
    "Finding",
    "Located",
    "NoiseModel",
    "Nuisance",
    "Place",
    "Problem",
    "Refit",
    "SignalGap",
    "default_nuisances",
    "diagnose",
    "find_noise",
    "locate",
    "refit",
]
