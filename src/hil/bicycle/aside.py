"""How a bicycle on tyres goes aside: both wheels slip outwards, by an angle for each m/s² across.

The frame then points further into a bend than it goes, and all of it follows the bend late, by slip times
speed: what an accelerometer across feels, and what leans the bicycle. How fast it turns stays the same.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hil.rigs.bicycle import Motion, Packed
from hil.rigs.bicycle.parameters import G3_UP, G4_UP, RADIUS_FRONT, RADIUS_REAR


def goes_aside(motion: Motion, bicycle: Packed, per_accel: float) -> Motion:
    """`motion` of a bicycle whose wheels slip by `per_accel`, rad for each m/s² across.

    First order in the slip, and in steer: masses stand where they do with the fork straight ahead.
    """
    if per_accel == 0.0:
        return motion
    p, mass = bicycle.p, bicycle.body[:, 0]
    speed, lean = motion.speed, motion.q[:, 3]
    slips = -speed * per_accel * (speed * motion.qd[:, 2])
    across = np.gradient(slips, motion.dt_s)
    level, down = across * np.cos(lean), -across * np.sin(lean)
    imu = motion.imu.copy()
    imu[:, 3:] += np.outer(level, bicycle.sensor[:, 1]) + np.outer(down, bicycle.sensor[:, 2])
    up_m = p[RADIUS_REAR] + np.array([0.0, p[G3_UP], p[G4_UP], p[RADIUS_FRONT] - p[RADIUS_REAR]])
    multipliers = motion.multipliers.copy()
    multipliers[:, 6] += float(mass @ up_m) * level
    return replace(motion, imu=imu, multipliers=multipliers)
