"""What moves: the rigs' kinematics and dynamics.

`build_rig(rig_file)` gives a `Manipulator`; compiled code takes `hil.rigs.kernel` and
`hil.rigs.pack`. Pure functions of pose, rates and forces: no file, clock or bus.
"""

from hil.rigs.manipulator import Manipulator, PlatformMotion, build_rig
from hil.rigs.workspace import (
    ConditionMap,
    StrokeViolation,
    condition_map,
    single_axis_ranges,
    stroke_violations,
)

__all__ = [
    "ConditionMap",
    "Manipulator",
    "PlatformMotion",
    "StrokeViolation",
    "build_rig",
    "condition_map",
    "single_axis_ranges",
    "stroke_violations",
]
