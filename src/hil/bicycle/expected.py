"""What the sensors' noise alone, by the rig file, leaves between a ride and its model.

Angles that are differenced twice are loud, and louder than some of what they are held against. So the ride is
computed once more with as much noise again on its angles; what that changes, noise had changed before.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.bicycle.effects import RideEffects, soft_motion
from hil.bicycle.sensors import IMU_SIGNALS, noise_of
from hil.config import BicycleFile
from hil.config.bicycle import SIGNALS
from hil.rigs.bicycle import Motion, low_pass, pack, smooth

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SPRUNG: Final = 0.45
"""Of the ride's cutoff, below which fork and tyres are computed: less leaves out what a rider does to them,
more lets the encoders' noise shake tyres [set on simulated rides]."""
SEED: Final = 0


@dataclass(frozen=True, slots=True)
class Expected:
    """Root mean squares that noise alone leaves."""

    raw: dict[str, float]
    """By IMU signal."""
    filtered: dict[str, float]
    lean_torque: float
    """N m, over the samples asked for."""


def motion_of(rig: BicycleFile, effects: RideEffects, dt_s: float, angles: Array) -> Motion:
    """The ride of true `angles` (N, 3), through the rig file's conditioning."""
    how = rig.conditioning
    told = smooth(angles, dt_s, how.cutoff, how.order)
    return effects.added(pack(rig), told, soft_motion(rig, dt_s, angles, SPRUNG))


def expected(
    rig: BicycleFile, effects: RideEffects, t_s: Array, angles: Array, motion: Motion, rolls: Mask
) -> Expected:
    """What noise leaves of the ride `motion`, computed of true `angles` (N, 3) at t_s; `rolls` (N,): samples
    of which the lean torque counts."""
    rng, dt_s, how = np.random.default_rng(SEED), motion.dt_s, rig.conditioning
    noise = np.array([_spread(s, rig) for s in SIGNALS])
    louder = motion_of(rig, effects, dt_s, angles + noise * rng.standard_normal(angles.shape))
    own = np.array([_spread(s, rig) for s in IMU_SIGNALS])
    off = effects.imu(t_s, louder) - effects.imu(t_s, motion)
    off += own * rng.standard_normal(off.shape)
    soft = low_pass(off, dt_s, how.cutoff, how.order)
    torque = effects.lean_torque(rig, louder) - effects.lean_torque(rig, motion)
    return Expected(
        dict(zip(IMU_SIGNALS, off.std(axis=0).tolist(), strict=True)),
        dict(zip(IMU_SIGNALS, soft.std(axis=0).tolist(), strict=True)),
        float(np.sqrt(np.mean(torque[rolls] ** 2))) if rolls.any() else float("nan"),
    )


def _spread(signal: str, rig: BicycleFile) -> float:
    """Standard deviation of a signal's noise and rounding."""
    noise, step = noise_of(signal, rig)
    return float(np.hypot(noise, step / np.sqrt(12.0)))
