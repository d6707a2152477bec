"""The bicycle as it is: what a healthy one has of everything, and what a fault makes of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.other_rides.balance import Hold
from benchmarks.other_rides.road import ROUGHNESS_M3
from benchmarks.other_rides.travel import Springs


@dataclass(frozen=True, slots=True)
class Body:
    """Everything that moves. Healthy values are small, not neutral."""

    springs: Springs
    hold: Hold
    restless_rad: float
    """Sway of the rider that nothing asks for, rms."""
    rear_scale: float
    front_scale: float
    crown_m: float
    """Radius of the tyre's section: a leaning wheel rolls on a smaller circle."""
    flex: float
    """Front wheel turned out of the curve by fork and frame, rad by m/s2 across."""
    side_slip: tuple[float, float]
    """Slip angles of rear and front tyre, rad by m/s2 across."""
    roughness_m3: float
    slip: float = 0.0
    """Share of the rolling speed that the rear wheel loses where nothing drives or brakes."""
    headset_play: float = 0.0
    """rad."""
    axle_play: float = 0.0
    """rad."""
    runout_m: tuple[float, float] = (0.0, 0.0)
    """Rear and front wheel out of round."""
    slope: tuple[float, float] = (0.0, 40.0)
    """Steepest slope (rad) of a hill and its length (m)."""
    gusts_n: float = 0.0
    """Side wind, rms."""


def healthy(rng: np.random.Generator) -> Body:
    """A bicycle in order: radii within 0.3 %, hard tyres, a rider who sits still but for a little."""
    springs = Springs(
        tyre=float(rng.uniform(2.2e5, 3.2e5)),
        tyre_damping=float(rng.uniform(500.0, 900.0)),
        tyre_progress=float(rng.uniform(5.0, 15.0)),
    )
    return Body(
        springs=springs,
        hold=Hold(float(rng.uniform(6e3, 1.2e4)), float(rng.uniform(150.0, 300.0))),
        restless_rad=float(rng.uniform(0.002, 0.005)),
        rear_scale=1.0 + _clipped(rng, 0.0015, 0.003),
        front_scale=1.0 + _clipped(rng, 0.0015, 0.003),
        crown_m=float(rng.uniform(0.014, 0.022)),
        flex=float(rng.uniform(1e-4, 3e-4)),
        side_slip=(float(rng.uniform(1e-4, 4e-4)), float(rng.uniform(1e-4, 4e-4))),
        roughness_m3=float(np.exp(rng.uniform(*np.log(ROUGHNESS_M3)))),
    )


def _clipped(rng: np.random.Generator, spread: float, limit: float) -> float:
    return float(np.clip(spread * rng.standard_normal(), -limit, limit))
