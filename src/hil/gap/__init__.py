"""The sim-to-real gap: where a rig's twin differs from the rig, above the floor of noise.

`locate` answers that; `Problem`, `NoiseModel` and `refit` are what it and everything after it stand on.
"""

from hil.gap.bicycle.either import diagnose_any as diagnose
from hil.gap.bicycle.either import locate_any as locate
from hil.gap.catalogue.nuisances import Nuisance, default_nuisances
from hil.gap.floor.noise import NoiseModel, find_noise
from hil.gap.judged.diagnosis import Cause, Diagnosis
from hil.gap.located.residual import Refit, refit
from hil.gap.located.result import Located, Place, SignalGap
from hil.gap.located.sanity import Finding
from hil.gap.record.problem import Problem

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
