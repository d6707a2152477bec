"""The twin of a ride: what the IMU must have read, and what lean torque is left, under every effect.

Lean, wheel and steer drive it as setpoints drive a rig's twin. Effects of their sensors are taken out of them
before; wheels, slip, fork and tyres change the ride computed; effects of the IMU are put on its answers.
Angles are smoothed first and nothing after, measured IMU signals by the same low-pass: what is computed of
smooth angles is then the smooth of what would be computed of true ones, and a filter never looks like an
effect. (The documented conditioning filters rates once more, and so treats rates and accelerations unlike.)

The lean torque left over is an equation, not a sensor: nobody pushes a free bicycle from outside, so it
must be zero. It is what a rider's lean against the frame shows in, which no sensor on the frame sees.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from hil.bicycle.recorded import Ride
from hil.bicycle.sensors import IMU_SIGNALS, Sensor, misaligned
from hil.config import BicycleFile
from hil.config.bicycle import SIGNALS
from hil.errors import KinematicsError
from hil.rigs.bicycle import Motion, Packed, Smooth, low_pass, ride
from hil.rigs.bicycle.conditioning import central

Array = NDArray[np.float64]

LEAN_TORQUE: Final = "bicycle.lean_torque"
EVERY: Final = 10
"""Samples of the ride to one that is judged: 10 Hz carry what the low-pass leaves."""
PASSES: Final = 2
"""Of the ride's low-pass over everything: accelerations are second differences and need as much."""
SOFTER: Final = 0.3
"""Of the ride's cutoff: noise of an encoder's second differences shakes a sprung twin as no road shook the
bicycle, and what a rider does lies below."""
EDGE_S: Final = 1.4
"""Of either end, which a zero-phase filter makes up."""
FREE_M_S: Final = 2.5
"""Below, a foot or a hand may hold the bicycle, and the lean torque is not judged."""


@dataclass(frozen=True, slots=True)
class RideTwin:
    """One ride for the twin; arrays of its grid."""

    rig: BicycleFile
    bicycle: Packed
    recorded: Ride
    signals: tuple[str, ...]

    @property
    def judged(self) -> NDArray[np.int64]:
        """Rows of the grid that are judged."""
        edge = round(EDGE_S / self.recorded.dt_s)
        return np.arange(edge, len(self.recorded.angles) - edge, EVERY)

    def measured(self) -> dict[str, Array]:
        """By signal, what was measured at the judged rows, through the ride's low-pass."""
        t = self.recorded.t_s
        out = {}
        for signal in self.signals:
            if signal == LEAN_TORQUE:
                out[signal] = np.zeros(len(self.judged))
            else:
                raw = np.interp(t, *self.recorded.imu[signal])
                out[signal] = self.filtered(np.asarray(raw))[self.judged]
        return out

    def filtered(self, values: Array) -> Array:
        """(N, ...) through the low-pass of angles and IMU: the ride's own, softer, twice."""
        how = self.rig.conditioning
        columns = values[:, None] if values.ndim == 1 else values
        for _ in range(PASSES):
            columns = low_pass(columns, self.recorded.dt_s, SOFTER * how.cutoff, how.order)
        return columns[:, 0] if values.ndim == 1 else columns

    def motion(self, values: Mapping[str, float], angles: Array | None = None) -> Motion:
        """The ride with effects; `angles` instead of the recorded ones."""
        told = self.recorded.angles if angles is None else angles
        t = self.recorded.t_s
        true = np.column_stack(
            [Sensor.of(s, values).truth(t, told[:, k]) for k, s in enumerate(SIGNALS)]
        )
        angle = self.filtered(true)
        rate = central(angle, self.recorded.dt_s)
        bicycle = self.bicycle.scaled(
            values["rear_wheel.wheel_radius.scale"],
            values["front_wheel.wheel_radius.scale"],
            values["rear_wheel.wheel_slip.coefficient"],
        )
        fork, tyre = "bicycle.front_suspension", "bicycle.tyre_compliance"
        stiffness, damping = values[f"{fork}.stiffness"], values[f"{fork}.damping"]
        tyre_stiffness, tyre_damping = values[f"{tyre}.stiffness"], values[f"{tyre}.damping"]
        return ride(
            bicycle,
            Smooth(self.recorded.dt_s, angle, rate, central(rate, self.recorded.dt_s)),
            spring=(stiffness, tyre_stiffness, tyre_stiffness),
            damper=(damping, tyre_damping, tyre_damping),
        )

    def answer(self, values: Mapping[str, float], angles: Array | None = None) -> dict[str, Array]:
        """By signal, what the twin says at the judged rows; NaN where it cannot stand."""
        try:
            motion = self.motion(values, angles)
        except KinematicsError:
            return {s: np.full(len(self.judged), np.nan) for s in self.signals}
        t = self.recorded.t_s
        start = float(t[0])
        seen = misaligned(motion.imu, values)
        # stamps of a clock that runs fast are later than the truth
        at = start + (t - start) / (1.0 + values["imu.clock_drift.rate"])
        if values["imu.clock_drift.rate"] != 0.0:
            at = t / (1.0 + values["imu.clock_drift.rate"])
        out = {}
        for signal in self.signals:
            if signal == LEAN_TORQUE:
                left = motion.lean_torque - rider_torque(self.rig, motion, values)
                out[signal] = np.asarray(left)[self.judged]
                continue
            k = IMU_SIGNALS.index(signal)
            answers = Sensor.of(signal, values).answer(t, seen[:, k], at)
            out[signal] = answers[self.judged]
        return out

    def speed(self) -> Array:
        """(J,) forward speed at the judged rows, m/s, without effects."""
        wheel = self.recorded.angles[:, 1]
        rate = np.gradient(self.filtered(wheel), self.recorded.dt_s)
        return np.asarray(rate[self.judged] * self.rig.geometry.R)


def rider_torque(rig: BicycleFile, motion: Motion, values: Mapping[str, float]) -> Array:
    """(N,) lean torque on the frame by a rider whose upper body leans against it, N m; first order in lean.

    Upper body as a pendulum on the frame: own a'' + c a' + (k - m h g) a = m h across - k gain theta
    - lever theta'', and on the frame m h g a - lever a''.
    """
    name = "bicycle.rider_motion"
    stiffness, gain = values[f"{name}.stiffness"], values[f"{name}.gain"]
    m, h = rig.rider.mass, rig.rider.height
    if m == 0.0 or (not np.isfinite(stiffness) and gain == 0.0):
        return np.zeros(len(motion.q))
    g = rig.mass.gravity
    lean, bend = motion.q[:, 3], motion.qdd[:, 3]
    own = rig.rider.inertia + m * h * h
    lever = own + m * h * (rig.rider.pivot[2] + rig.geometry.R)
    if not np.isfinite(stiffness):
        return np.asarray(-gain * (m * h * g * lean - lever * bend))
    across = g * np.sin(lean) + motion.speed * motion.qd[:, 2] * np.cos(lean)
    load = m * h * across - stiffness * gain * lean - lever * bend
    damping, held = values[f"{name}.damping"], stiffness - m * h * g
    # trapezoidal rule of the pendulum's equation, second order in the step and stable at any stiffness
    w = 2.0 / motion.dt_s
    b = np.array([1.0, 2.0, 1.0])
    a = np.array(
        [
            own * w * w + damping * w + held,
            2.0 * held - 2.0 * own * w * w,
            own * w * w - damping * w + held,
        ]
    )
    alpha = lfilter(b / a[0], a / a[0], load)
    swing = (load - damping * np.gradient(alpha, motion.dt_s) - held * alpha) / own
    return np.asarray(m * h * g * alpha - lever * swing)
