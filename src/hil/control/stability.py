"""Whether the loops that the daemon closes are stable at the rig's cycle, delays and sample pattern.

The loop is taken as it runs, linear: a mass under a force that is held for a cycle and acts after the
setpoint delay, positions that come every few cycles, the observer with its own Kalman gain, the
control law. One turn of the sample pattern is a linear map; its spectral radius, with the mass a
quarter less and a third more than the model's, tells.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.control import kalman
from hil.control.cascade import cascade_masses, cascade_rates
from hil.control.observer import observer_parameters, position_variance, sample_cycles
from hil.control.placement import second_order_gains
from hil.control.setpoints import slot_offsets
from hil.errors import ConfigError
from hil.rigs import Manipulator

WRONG_MASS: Final = (0.75, 1.0, 4.0 / 3.0)
"""True mass over the model's: what a payload or an unidentified rig may be off by."""
GAIN_TURNS: Final = 400


@dataclass(frozen=True, slots=True)
class Loop:
    """A force loop in the daemon, reduced to one mass; times in s, rates in 1/s."""

    mode: str
    cycle_s: float
    delay_s: float
    turn: int
    """Cycles from one position sample to the next."""
    gain: NDArray[np.float64]
    """Kalman gain (3,) of position, velocity, unexplained acceleration."""
    slowest_share: float
    """Crossover of the slowest mode as a share of the nominal one (coupled actuators)."""

    def spectral_radius(self, gains: tuple[float, ...], mass_ratio: float) -> float:
        """Largest growth of the closed loop over one turn; below 1 is stable."""
        basis = np.eye(7)
        columns = [self._turn(basis[k], gains, mass_ratio) for k in range(7)]
        return float(np.max(np.abs(np.linalg.eigvals(np.array(columns).T))))

    def _turn(
        self, z: NDArray[np.float64], gains: tuple[float, ...], mass_ratio: float
    ) -> NDArray[np.float64]:
        """z = position, velocity, held force (per mass); the observer's three states; integrator."""
        x, v, held, ox, ov, oa, integral = z
        T, d = self.cycle_s, self.delay_s
        for cycle in range(self.turn):
            if self.mode == "cascade":
                crossover, k_p, rate = gains
                error = -k_p * ox - ov
                u = crossover * (error + integral)
                integral += rate * T * error
            else:
                k_p, k_d = gains
                px, pv = _move(ox, ov, held + oa, d)
                px += 0.5 * T * pv
                u = -k_p * px - k_d * pv - oa
                integral = 0.0
            x, v = _move(x, v, held / mass_ratio, d)
            ox, ov = _move(ox, ov, held + oa, d)
            if cycle == 0:
                innovation = x - ox
                ox += self.gain[0] * innovation
                ov += self.gain[1] * innovation
                oa += self.gain[2] * innovation
            x, v = _move(x, v, u / mass_ratio, T - d)
            ox, ov = _move(ox, ov, u + oa, T - d)
            held = u
        return np.array([x, v, held, ox, ov, oa, integral])


def _move(x: float, v: float, a: float, dt: float) -> tuple[float, float]:
    return x + dt * (v + 0.5 * dt * a), v + dt * a


def loop_of(rig: RigFile, manipulator: Manipulator) -> Loop:
    """The reduced loop of a rig in mode cascade or computed_torque."""
    turn = sample_cycles(rig)
    share = cascade_masses(manipulator)[1] if rig.control.mode == "cascade" else 1.0
    gain = _steady_gain(rig, turn * rig.bus.cycle)
    delay_s = min(float(np.mean(slot_offsets(rig))), rig.bus.cycle)
    return Loop(rig.control.mode, rig.bus.cycle, delay_s, turn, gain, share)


def is_stable(rig: RigFile, manipulator: Manipulator) -> bool:
    """True where the rig's own bandwidth and damping give a stable loop, model errors included."""
    if rig.control.mode == "drive":
        return True
    loop = loop_of(rig, manipulator)
    if rig.control.mode == "cascade":
        gains: tuple[float, ...] = cascade_rates(rig, loop.slowest_share)
        ratios = {r / s for r in WRONG_MASS for s in (1.0, loop.slowest_share)}
    else:
        gains = second_order_gains(rig.control.bandwidth, rig.control.damping)
        ratios = set(WRONG_MASS)
    return all(loop.spectral_radius(gains, ratio) < 1.0 for ratio in ratios)


def check_bandwidth(rig: RigFile, manipulator: Manipulator) -> None:
    """ConfigError, with the largest bandwidth that would do, where the rig's cannot be stable."""
    if is_stable(rig, manipulator):
        return
    low, high = 0.0, rig.control.bandwidth
    for _ in range(12):
        middle = 0.5 * (low + high)
        control = rig.control.model_copy(update={"bandwidth": middle})
        stable = is_stable(rig.model_copy(update={"control": control}), manipulator)
        low, high = (middle, high) if stable else (low, middle)
    raise ConfigError(
        f"{rig.name}: control.bandwidth = {rig.control.bandwidth:g} rad/s is not stable in mode "
        f"{rig.control.mode} with a cycle of {rig.bus.cycle * 1e3:g} ms and a position every "
        f"{sample_cycles(rig) * rig.bus.cycle * 1e3:g} ms; at most {low:.3g} rad/s is"
    )


def _steady_gain(rig: RigFile, period_s: float) -> NDArray[np.float64]:
    """Kalman gain that the filter of a force-driven actuator settles at."""
    x, P = np.zeros(3), np.diag([1.0e-6, 1.0e-2, 1.0])
    parameters = observer_parameters(rig)[0]
    none = np.zeros(1)
    variance = position_variance(rig)
    gain = np.zeros(3)
    for _ in range(GAIN_TURNS):
        kalman.predict(x, P, 0.0, period_s, kalman.FORCE, parameters, none, none, True)
        gain = P[:, 0] / (P[0, 0] + variance)
        kalman.correct(x, P, 0, x[0], variance, 6.0, 1.0)
    return gain
