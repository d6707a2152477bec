"""Classical motion cueing: a vehicle's accelerations and rates become poses the rig can hold.

Structure of Reid and Nahon (UTIAS 296/307/319, 1985/86) [M]: inputs scaled; specific force high-passed
and integrated twice gives translation; specific force low-passed gives tilt, asin(a/g), under limits
of rate and acceleration that a rider does not notice; angular rate high-passed gives angle.
Frames: x forward, y left, z up; pitch > 0 puts the nose down, roll > 0 leans right.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete

Vector = NDArray[np.float64]

G: Final = 9.81
TRANSLATIONS: Final = ("surge", "sway", "heave")


@dataclass(frozen=True, slots=True)
class WashoutSettings:
    """Scales and corner frequencies; the defaults are the common ones of the field [M]."""

    gain: float = 0.5
    """Scale of specific forces and rates."""
    surge_rad_s: float = 2.5
    """Natural frequency of the translational high pass, damping 1."""
    return_rad_s: float = 0.25
    """Corner of its first-order part, which brings the platform back to the middle."""
    tilt_rad_s: float = 2.5
    """Natural frequency of the low pass to tilt, damping 1."""
    rate_rad_s: float = 1.0
    """Natural frequency of the angular high pass, damping 1."""
    tilt_rate_max: float = float(np.deg2rad(3.0))
    """Tilt rate below what a rider notices, rad/s; 2 to 5 degrees a second are used."""
    tilt_acceleration_max: float = float(np.deg2rad(8.0))
    """rad/s²."""


class Filter:
    """A linear filter b(s)/a(s) of one signal, stepped at a fixed interval.

    Discretised with the input taken as a straight line between its samples (first-order hold): exact
    for such inputs, and without the half step of delay that a held input brings.
    """

    def __init__(self, b: tuple[float, ...], a: tuple[float, ...], dt_s: float) -> None:
        numerator, denominator, _ = cont2discrete((np.array(b), np.array(a)), dt_s, method="foh")[
            :3
        ]
        self._b = np.ravel(numerator)
        self._a = np.ravel(denominator)
        self._memory = np.zeros(len(self._a) - 1)

    def step(self, value: float) -> float:
        """Next output, transposed direct form II."""
        z = self._memory
        out = float(self._b[0] * value + z[0])
        shifted = np.append(z[1:], 0.0)
        self._memory = shifted + self._b[1:] * value - self._a[1:] * out
        return out


def translation_filter(s: WashoutSettings, dt_s: float) -> Filter:
    """Position from acceleration: a·s / ((s² + 2ω s + ω²)(s + ω_b)), two integrations already in it.

    High pass (s²/(s²+2ωs+ω²) · s/(s+ω_b)) and double integration cancel to this; done one after the
    other they drift.
    """
    w = s.surge_rad_s
    return Filter((1.0, 0.0), tuple(np.polymul((1.0, 2.0 * w, w * w), (1.0, s.return_rad_s))), dt_s)


def tilt_filter(s: WashoutSettings, dt_s: float) -> Filter:
    """Low pass ω²/(s² + 2ω s + ω²) from acceleration to the part that tilt stands for."""
    w = s.tilt_rad_s
    return Filter((w * w,), (1.0, 2.0 * w, w * w), dt_s)


def angle_filter(s: WashoutSettings, dt_s: float) -> Filter:
    """Angle from angular rate: s/(s² + 2ω s + ω²), high pass and integration in one."""
    w = s.rate_rad_s
    return Filter((1.0, 0.0), (1.0, 2.0 * w, w * w), dt_s)


class RateLimiter:
    """Follows an angle with limits of rate and acceleration, stopping without overshoot."""

    def __init__(self, rate_max: float, acceleration_max: float, dt_s: float) -> None:
        self._rate_max = rate_max
        self._acceleration_max = acceleration_max
        self._dt_s = dt_s
        self.angle = 0.0
        self.rate = 0.0

    def step(self, wanted: float) -> float:
        """Next angle, rad."""
        a, dt = self._acceleration_max, self._dt_s
        away = wanted - self.angle
        # The fastest rate from which `away` still suffices to stop in whole steps of a·dt.
        reach = abs(away)
        allowed = -0.5 * a * dt + np.sqrt((0.5 * a * dt) ** 2 + 2.0 * a * reach)
        goal = np.sign(away) * min(allowed, self._rate_max, reach / dt)
        self.rate += float(np.clip(goal - self.rate, -a * dt, a * dt))
        self.angle += self.rate * dt
        return self.angle


class Washout:
    """Cueing for a rig with the given coordinates; those it has not are left out.

    A rig without translations (the motorcycle platform) keeps tilt and angular channels: its pitch
    stands for surge acceleration, its roll for sway.
    """

    def __init__(
        self, coordinates: tuple[str, ...], dt_s: float, settings: WashoutSettings | None = None
    ) -> None:
        s = WashoutSettings() if settings is None else settings
        self._coordinates = coordinates
        self._gain = s.gain
        self._translation = {c: translation_filter(s, dt_s) for c in TRANSLATIONS}
        self._low = [tilt_filter(s, dt_s) for _ in range(2)]
        self._limiter = [
            RateLimiter(s.tilt_rate_max, s.tilt_acceleration_max, dt_s) for _ in range(2)
        ]
        self._angle = [angle_filter(s, dt_s) for _ in range(3)]

    def step(self, acceleration: Vector, omega: Vector) -> Vector:
        """Pose (n,) in the rig's coordinates for one step.

        acceleration (3,): the vehicle's own, gravity left out, m/s², vehicle axes. omega (3,):
        angular rate about x, y, z, rad/s.
        """
        scaled = self._gain * np.asarray(acceleration, dtype=np.float64)
        rates = self._gain * np.asarray(omega, dtype=np.float64)
        values = {
            c: f.step(float(x)) for (c, f), x in zip(self._translation.items(), scaled, strict=True)
        }
        tilts = [
            limiter.step(float(np.arcsin(np.clip(low.step(float(x)) / G, -1.0, 1.0))))
            for limiter, low, x in zip(self._limiter, self._low, scaled[:2], strict=True)
        ]
        roll, pitch, yaw = (f.step(float(x)) for f, x in zip(self._angle, rates, strict=True))
        # Nose up (pitch < 0) leans gravity backwards, as speeding up does; leaning right (roll > 0)
        # lets gravity pull right, as turning left (acceleration to the left) does.
        values |= {"pitch": pitch - tilts[0], "roll": roll + tilts[1], "yaw": yaw}
        return np.array([values[c] for c in self._coordinates])
