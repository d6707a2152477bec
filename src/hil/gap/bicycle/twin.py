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

from hil.bicycle.effects import RideEffects, soft_motion, softened
from hil.bicycle.recorded import Ride
from hil.bicycle.sensors import IMU_SIGNALS
from hil.config import BicycleFile
from hil.errors import KinematicsError
from hil.rigs.bicycle import Motion, Packed

Array = NDArray[np.float64]

LEAN_TORQUE: Final = "bicycle.lean_torque"
EVERY: Final = 10
"""Samples of the ride to one that is judged: 10 Hz carry what the low-pass leaves."""
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
        columns = values[:, None] if values.ndim == 1 else values
        columns = softened(self.rig, self.recorded.dt_s, columns)
        return columns[:, 0] if values.ndim == 1 else columns

    def motion(self, values: Mapping[str, float], angles: Array | None = None) -> Motion:
        """The ride with effects; `angles` instead of the recorded ones."""
        told = self.recorded.angles if angles is None else angles
        effects = RideEffects(values)
        true = effects.true_angles(self.recorded.t_s, told)
        return effects.motion(self.bicycle, soft_motion(self.rig, self.recorded.dt_s, true))

    def answer(self, values: Mapping[str, float], angles: Array | None = None) -> dict[str, Array]:
        """By signal, what the twin says at the judged rows; NaN where it cannot stand."""
        try:
            motion = self.motion(values, angles)
        except KinematicsError:
            return {s: np.full(len(self.judged), np.nan) for s in self.signals}
        effects = RideEffects(values)
        imu = effects.imu(self.recorded.t_s, motion)
        out = {}
        for signal in self.signals:
            if signal == LEAN_TORQUE:
                whole = effects.lean_torque(self.rig, motion)
            else:
                whole = imu[:, IMU_SIGNALS.index(signal)]
            out[signal] = whole[self.judged]
        return out

    def speed(self) -> Array:
        """(J,) forward speed at the judged rows, m/s, without effects."""
        wheel = self.recorded.angles[:, 1]
        rate = np.gradient(self.filtered(wheel), self.recorded.dt_s)
        return np.asarray(rate[self.judged] * self.rig.geometry.R)
