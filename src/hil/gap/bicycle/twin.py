"""The twin of a ride: what the IMU must have read, and what lean torque is left, under every effect.

Lean, wheel and steer drive it as setpoints drive a rig's twin. Effects of their sensors are taken out of them
before; wheels, slip, fork and tyres change the ride computed; effects of the IMU are put on its answers.
Angles pass the ride's low-pass, and what is computed of them a softer one; measured IMU signals pass both.
A filter then never looks like an effect: what turns lean into pitch, and what loads a fork, is a product, and
the product of what a soft filter leaves is not what it leaves of the product. (The documented conditioning
filters rates once more, and so treats rates and accelerations unlike.)

The lean torque left over is an equation, not a sensor: nobody pushes a free bicycle from outside, so it
must be zero. It is what a rider's lean against the frame shows in, which no sensor on the frame sees.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.bicycle.effects import RideEffects, differenced, softened
from hil.bicycle.recorded import Ride
from hil.bicycle.sensors import IMU_SIGNALS
from hil.config import BicycleFile
from hil.errors import KinematicsError
from hil.rigs.bicycle import Motion, Packed, Smooth

Array = NDArray[np.float64]

LEAN_TORQUE: Final = "bicycle.lean_torque"
EVERY: Final = 10
"""Samples of the ride to one that is judged: 10 Hz carry what the low-pass leaves."""
EDGE_S: Final = 1.4
"""Of either end, which a zero-phase filter makes up."""
FREE_M_S: Final = 2.5
"""Below, a foot or a hand may hold the bicycle, and the lean torque is not judged."""
ANSWERS: Final = 512
"""Answers that are kept of a ride: a quarter or more is asked again, of one that many look at in turn."""
MOTIONS: Final = 8
"""Motions that are: a third of the answers differ from others by what is read of a motion alone."""


@dataclass(frozen=True, slots=True)
class RideTwin:
    """One ride for the twin; arrays of its grid."""

    rig: BicycleFile
    bicycle: Packed
    recorded: Ride
    signals: tuple[str, ...]
    slope: Array | None = None
    """(N,) of the road on the grid, rad, uphill positive; None where it is level."""
    _answered: Callable[..., dict[str, Array]] = field(init=False, repr=False, compare=False)
    _moved: Callable[..., Motion] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_answered", lru_cache(ANSWERS)(self._answer))
        object.__setattr__(self, "_moved", lru_cache(MOTIONS)(self._motion))

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
        """(N, ...) through both low-passes: the ride's own, and a softer one."""
        columns = values[:, None] if values.ndim == 1 else values
        columns = self._softer(softened(self.rig, self.recorded.dt_s, columns, 1.0))
        return columns[:, 0] if values.ndim == 1 else columns

    def motion(self, values: Mapping[str, float], angles: Array | None = None) -> Motion:
        """The ride with effects, of angles through both low-passes; `angles` instead of the recorded ones."""
        effects = RideEffects(values)
        return effects.motion(self.bicycle, self._true(effects, angles, is_soft=True))

    def answer(self, values: Mapping[str, float], angles: Array | None = None) -> dict[str, Array]:
        """By signal, what the twin says at the judged rows; NaN where it cannot stand."""
        if angles is None:
            return self._answered(tuple(values), tuple(values.values()))
        return self._told_by(RideEffects(values), angles)

    def _answer(self, names: tuple[str, ...], values: tuple[float, ...]) -> dict[str, Array]:
        return self._told_by(RideEffects(dict(zip(names, values, strict=True))))

    def _motion(self, names: tuple[str, ...], values: tuple[float, ...]) -> Motion:
        effects = RideEffects(dict(zip(names, values, strict=True)))
        return effects.motion(self.bicycle, self._true(effects, None))

    def _told_by(self, effects: RideEffects, angles: Array | None = None) -> dict[str, Array]:
        try:
            if angles is None:
                own = effects.moving.values
                motion = self._moved(tuple(own), tuple(own.values()))
            else:
                motion = effects.motion(self.bicycle, self._true(effects, angles))
        except KinematicsError:
            return {s: np.full(len(self.judged), np.nan) for s in self.signals}
        told = self._softer(self._columns(effects, motion))
        return {s: told[self.judged, k] for k, s in enumerate(self.signals)}

    def _softer(self, columns: Array) -> Array:
        return softened(self.rig, self.recorded.dt_s, columns)

    def _true(self, effects: RideEffects, angles: Array | None, is_soft: bool = False) -> Smooth:
        """True angles through the ride's low-pass, and the softer one as well where `is_soft`."""
        told = self.recorded.angles if angles is None else angles
        true = effects.true_angles(self.recorded.t_s, told)
        true = softened(self.rig, self.recorded.dt_s, true, 1.0)
        return differenced(self.recorded.dt_s, self._softer(true) if is_soft else true)

    def _columns(self, effects: RideEffects, motion: Motion) -> Array:
        """(N, signals) of a motion."""
        if self.slope is not None:
            motion = replace(motion, imu=pitched(motion.imu, self.slope, motion.dt_s))
        imu = effects.imu(self.recorded.t_s, motion)
        return np.column_stack(
            [
                effects.lean_torque(self.rig, motion)
                if s == LEAN_TORQUE
                else imu[:, IMU_SIGNALS.index(s)]
                for s in self.signals
            ]
        )

    def speed(self) -> Array:
        """(J,) forward speed at the judged rows, m/s, without effects."""
        wheel = self.recorded.angles[:, 1]
        rate = np.gradient(self.filtered(wheel), self.recorded.dt_s)
        return np.asarray(rate[self.judged] * self.rig.geometry.R)


def pitched(imu: Array, slope: Array, dt_s: float) -> Array:
    """(N, 6) what an IMU that reads `imu` on a level road reads on one of that slope (N,)."""
    out = imu.copy()
    for along, up in ((0, 2), (3, 5)):
        out[:, along] += slope * imu[:, up]
        out[:, up] -= slope * imu[:, along]
    out[:, 1] -= np.gradient(slope, dt_s)
    return out
