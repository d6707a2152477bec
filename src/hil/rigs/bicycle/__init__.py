"""The bicycle: Whipple's nonlinear model in nine coordinates, any parameter set, compiled.

`Whipple` is the model, `canonical` and `linearise` its motion near straight running, `ride` a ride
computed from its measured lean, wheel and steer, `smooth` what the measured angles need before.
"""

from hil.rigs.bicycle.conditioning import Smooth, low_pass, smooth
from hil.rigs.bicycle.linear import Canonical, canonical, linearise
from hil.rigs.bicycle.model import COORDINATES, Whipple
from hil.rigs.bicycle.motion import Motion, ride
from hil.rigs.bicycle.parameters import Packed, impossible_bodies, pack, reduced_inertia
from hil.rigs.bicycle.rider import with_usual_rider

__all__ = [
    "COORDINATES",
    "Canonical",
    "Motion",
    "Packed",
    "Smooth",
    "Whipple",
    "canonical",
    "impossible_bodies",
    "linearise",
    "low_pass",
    "pack",
    "reduced_inertia",
    "ride",
    "smooth",
    "with_usual_rider",
]
