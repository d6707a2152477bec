"""What beats once a turn of a wheel: wheels that are out of round, encoders off centre.

A gap is judged on what the rider does, which is slow, and behind a filter. A wheel turns faster: what it does
is looked for in the pitch rate and in the wheel's own rate as sensors told them, at one beat a turn, beside
beats near it that nothing on a bicycle has.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from hil.bicycle.recorded import Ride
from hil.bicycle.sensors import IMU_SIGNALS
from hil.rigs.bicycle.parameters import rotation

Array = NDArray[np.float64]
Beat = tuple[float, float]
"""How large what beats once a turn is, and what beats near it."""

GYROS: Final = IMU_SIGNALS[:3]
RUNS_OUT_M: Final = 1e-3
"""Up to which wheels are round: rims and tyres are made to some tenths of a millimetre [R; of 166 cases of
five worlds, those whose wheels are round have 0.7 mm at most, four that are not 2.1 and more]."""
OFF_CENTRE_RAD: Final = 4e-3
"""Up to which an encoder sits on its axis: a tenth of a millimetre on a ring of 25 [R; of those cases all but
four wheels out of round and one encoder off centre have 1.0 mrad at most, the encoder 6]."""
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
"""Over which the wheel's speed is taken, to say what a lift makes of it."""
USUAL_S: Final = 1.0
"""Over which its usual speed is taken, to say what beats in it."""


def once_a_turn(rides: Sequence[Ride]) -> str | None:
    """In words, what beats once a turn of a wheel in all of the `rides` that can tell; None where nothing
    does as no healthy wheel has it, or none tells."""
    lift_m = _common(rides, _lift, RUNS_OUT_M)
    if lift_m is not None:
        size = f"{1e3 * lift_m:.1f} mm"
        return (
            f"a wheel is out of round, an end of the bicycle goes up and down by {size} once a turn"
        )
    ahead_rad = _common(rides, _ahead, OFF_CENTRE_RAD)
    if ahead_rad is None:
        return None
    return f"the rear wheel's encoder is off centre, it runs ahead by {1e3 * ahead_rad:.1f} mrad once a turn"


def _common(
    rides: Sequence[Ride], beat: Callable[[Ride], Beat | None], least: float
) -> float | None:
    told = [found for found in map(beat, rides) if found is not None]
    if not told or any(size < max(least, BESIDE * beside) for size, beside in told):
        return None
    return float(np.median([size for size, _ in told]))


def _lift(ride: Ride) -> Beat | None:
    """How far an end of the bicycle goes up and down once a turn, m (amplitude), by the pitch rate."""
    t, pitch = _pitch_rate(ride)
    if not len(t):
        return None
    speed = np.interp(t, ride.t_s, _rate(ride, SMOOTH_S))
    rolls = (t > ride.t_s[0]) & (t < ride.t_s[-1]) & (np.abs(speed) > SLOWEST)
    angle = np.interp(t, ride.t_s, ride.angles[:, 1])
    left = pitch[rolls] * ride.rig.geometry.wheelbase
    front = ride.rig.geometry.R / ride.rig.geometry.front_radius
    return _beat(left, angle[rolls], speed[rolls], front)


def _ahead(ride: Ride) -> Beat | None:
    """By how much the rear wheel's encoder runs ahead once a turn, rad (amplitude), by its own rate."""
    usual = _rate(ride, USUAL_S)
    rolls = np.abs(usual) > SLOWEST
    left = (_rate(ride, 0.0) - usual)[rolls]
    return _beat(left, ride.angles[rolls, 1], usual[rolls], None)


def _rate(ride: Ride, smooth_s: float) -> Array:
    """(N,) rad/s of the rear wheel, over so long."""
    width = max(round(smooth_s / ride.dt_s), 1)
    rate = np.gradient(ride.angles[:, 1], ride.dt_s)
    return np.asarray(uniform_filter1d(rate, width, mode="nearest"))


def _pitch_rate(ride: Ride) -> tuple[Array, Array]:
    """Instants (N,) s and the rate (N,) rad/s about the axis across the frame; (0,) where it is not told."""
    imu = ride.rig.imu
    if imu is None or any(signal not in ride.imu for signal in GYROS):
        return np.empty(0), np.empty(0)
    t, _ = ride.imu[GYROS[1]]
    axes = [np.interp(t, *ride.imu[signal]) for signal in GYROS]
    return t, np.asarray(rotation(*imu.orientation)[1] @ np.array(axes))


def _beat(left: Array, angle: Array, speed: Array, front: float | None) -> Beat | None:
    """Of what goes to and fro as `left` (N,) 1/s at a wheel's angles (N,) rad and rates `speed` (N,) rad/s,
    what beats once a turn of it, or `front` times and about; None of too few turns."""
    if not len(left) or float(np.ptp(angle)) < 2.0 * np.pi * FEWEST:
        return None
    own = [1.0]
    if front is not None:
        apart = 0.5 * np.pi / float(np.ptp(angle))
        own += (front * np.arange(1.0 - NEAR, 1.0 + NEAR, apart)).tolist()

    def size(order: float) -> float:
        ahead = order * speed
        shape = np.column_stack([ahead * np.cos(order * angle), ahead * np.sin(order * angle)])
        return float(np.hypot(*np.linalg.lstsq(shape, left - np.mean(left), rcond=None)[0]))

    return max(map(size, own)), float(np.sqrt(np.mean([size(k) ** 2 for k in OTHERS])))
