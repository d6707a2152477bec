"""Wheels that are out of round: what pitches a bicycle once a turn of a wheel.

A gap is judged on what the rider does, which is slow, and behind a filter. A wheel turns faster: what it does
is looked for in the pitch rate as sensors told it, at one beat a turn, beside beats near it that nothing on
a bicycle has.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.bicycle.recorded import Ride
from hil.rigs.bicycle.parameters import rotation

Array = NDArray[np.float64]

GYROS: Final = ("imu.gyro_x", "imu.gyro_y", "imu.gyro_z")
RUNS_OUT_M: Final = 1e-3
"""Up to which wheels are round: rims and tyres are made to some tenths of a millimetre [R; of 106 cases of
four worlds, 103 have 0.7 mm at most, three whose wheels are out of round 2.1 and more]."""
BESIDE: Final = 4.0
"""Times what beats near it have, root mean square."""
NEAR: Final = 0.02
"""Of a turn, that the front wheel may turn otherwise than its radius says: slip, load, its way in curves."""
OTHERS: Final = (0.80, 0.84, 0.88, 0.92, 1.08, 1.12, 1.16, 1.20)
"""Beats a turn that are near."""
FEWEST: Final = 10.0
"""Turns from which on a ride tells."""
SLOWEST: Final = 2.0
"""rad/s: a wheel that hardly turns shakes nothing."""
SMOOTH_S: Final = 0.1
"""Over which the wheel's speed is taken."""


def runs_out_m(rides: Sequence[Ride]) -> float | None:
    """By how much a wheel is out of round, m (amplitude), as all of the `rides` that can tell say; None where
    one says that they are round, or none tells."""
    told = [found for found in map(_runs_out, rides) if found is not None]
    if not told or any(size < max(RUNS_OUT_M, BESIDE * beside) for size, beside in told):
        return None
    return float(np.median([size for size, _ in told]))


def out_of_round(size_m: float) -> str:
    """What such a wheel does, in words."""
    return f"an end of the bicycle goes up and down by {1e3 * size_m:.1f} mm once a turn of a wheel"


def _runs_out(ride: Ride) -> tuple[float, float] | None:
    """How far a wheel's contact goes up and down once a turn, m, and what beats near it would say; None where
    a ride tells nothing of it."""
    turned, t_s = ride.angles[:, 1], ride.t_s
    rate = np.gradient(turned, ride.dt_s)
    width = max(round(SMOOTH_S / ride.dt_s), 1)
    rate = np.convolve(rate, np.ones(width) / width, "same")
    t, pitch = _pitch_rate(ride)
    speed = np.interp(t, t_s, rate)
    rolls = (t > t_s[0]) & (t < t_s[-1]) & (np.abs(speed) > SLOWEST)
    angle = np.interp(t, t_s, turned)[rolls]
    if not rolls.any() or float(np.ptp(angle)) < 2.0 * np.pi * FEWEST:
        return None
    beats = _beats(
        pitch[rolls], angle, speed[rolls], ride.rig.geometry.wheelbase, _orders(ride, angle)
    )
    own = len(beats) - len(OTHERS)
    return float(np.max(beats[:own])), float(np.sqrt(np.mean(beats[own:] ** 2)))


def _pitch_rate(ride: Ride) -> tuple[Array, Array]:
    """Instants (N,) s and the rate (N,) rad/s about the axis across the frame; (0,) where it is not told."""
    imu = ride.rig.imu
    if imu is None or any(signal not in ride.imu for signal in GYROS):
        return np.empty(0), np.empty(0)
    t, _ = ride.imu[GYROS[1]]
    axes = [np.interp(t, *ride.imu[signal]) for signal in GYROS]
    return t, np.asarray(rotation(*imu.orientation)[1] @ np.array(axes))


def _orders(ride: Ride, angle: Array) -> Array:
    """Beats a turn of the rear wheel that are looked at: its own, those that the front wheel may have, and
    OTHERS."""
    front = ride.rig.geometry.R / ride.rig.geometry.front_radius
    apart = 0.5 * np.pi / float(np.ptp(angle))
    return np.concatenate([[1.0], front * np.arange(1.0 - NEAR, 1.0 + NEAR, apart), OTHERS])


def _beats(told: Array, angle: Array, speed: Array, wheelbase_m: float, orders: Array) -> Array:
    """(len(orders),) m by which a wheel would be out of round that turns the bicycle as `told` (N,) rad/s, at
    angles (N,) rad and rates `speed` (N,) rad/s: one end of the wheelbase goes up and down by it."""
    left = told - np.mean(told)
    out = np.empty(len(orders))
    for k, order in enumerate(orders):
        lift = speed * order / wheelbase_m
        shape = np.column_stack([lift * np.cos(order * angle), lift * np.sin(order * angle)])
        out[k] = float(np.hypot(*np.linalg.lstsq(shape, left, rcond=None)[0]))
    return out
