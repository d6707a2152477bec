"""Mode "cascade": P position and PI speed loops in the daemon, one pair an actuator, force setpoints."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.control.observer import Observed
from hil.control.reference import Reference
from hil.control.setpoints import Setpoints, within
from hil.rigs import Manipulator, build_rig

Vector = NDArray[np.float64]

CROSSOVER_SHARE: Final = 1.5
POSITION_SHARE: Final = 1.0 / 3.0
SLOWEST_SHARE: Final = 0.45
INTEGRAL_SHARE: Final = 0.7


def cascade_rates(rig: RigFile, slowest_share: float) -> tuple[float, float, float]:
    """Crossover of the fastest speed loop, k_p, and rate of the integrator, all 1/s.

    By control.bandwidth w: the fastest mode's speed loop crosses over at 1.5 w; k_p is w/3, or 0.45 of
    the slowest mode's crossover where coupled actuators have one much slower: a position loop has to
    stay below the speed loop it rests on. The integrator's rate is 0.7 k_p. At 10 ms, with about
    20 ms from motion to force, w = 30 rad/s leaves 90° - 51° - 6° = 33° of phase.
    """
    w = rig.control.bandwidth
    crossover = CROSSOVER_SHARE * w
    k_p = min(POSITION_SHARE * w, SLOWEST_SHARE * slowest_share * crossover)
    return crossover, k_p, rig.control.integral or INTEGRAL_SHARE * k_p


def cascade_masses(manipulator: Manipulator) -> tuple[Vector, float]:
    """Mass each speed loop reckons with (n,), and the slowest mode's share of the crossover, 0..1.

    The actuators are coupled: Λ = J^-T M J^-1 is the inertia they feel at the neutral pose. Masses in
    proportion to its diagonal, scaled so that the fastest mode of diag(m) Λ^-1 has the crossover
    asked for and no mode a higher one.
    """
    q = manipulator.neutral
    felt = manipulator.actuator_inertia(q)
    mass = np.diag(felt).copy()
    modes = np.sort(np.linalg.eigvals(np.diag(mass) @ np.linalg.inv(felt)).real)
    return mass / modes[-1], float(modes[0] / modes[-1])


def cascade_position_rate(rig: RigFile) -> float:
    """k_p of the position loops on this rig, 1/s: they are behind a moving reference by 1/k_p."""
    _, slowest_share = cascade_masses(build_rig(rig))
    return cascade_rates(rig, slowest_share)[1]


class Cascade:
    """P/PI loops at the bus cycle with force limit and anti-windup, without any pre-control."""

    def __init__(self, rig: RigFile, manipulator: Manipulator) -> None:
        self._manipulator = manipulator
        mass, slowest_share = cascade_masses(manipulator)
        crossover, self._k_p, self._rate = cascade_rates(rig, slowest_share)
        self._k_v = crossover * mass
        self._limit_n = np.array([a.force_max for a in rig.actuators])
        self._v_max = np.array([a.velocity_max for a in rig.actuators])
        self._cycle_s = rig.bus.cycle
        self._integral: Vector | None = None

    def reset(self, observed: Observed) -> None:
        """Start from the present state: the integrators begin with the force that holds it."""
        force = self._manipulator.static_forces(observed.pose)
        self._integral = within(force, self._limit_n)

    def step(self, now_s: float, reference: Reference, observed: Observed) -> Setpoints:
        """Force setpoints for the cycle that starts at `now_s`."""
        if self._integral is None:
            self.reset(observed)
        integral = self._integral
        assert integral is not None
        wanted = self._manipulator.inverse(reference.at(now_s).pose)
        speed = within(self._k_p * (wanted - observed.position), self._v_max)
        error = speed - observed.velocity
        force = self._k_v * error + integral
        limited = within(force, self._limit_n)
        grown = integral + self._k_v * self._rate * self._cycle_s * error
        # Anti-windup: an integrator at its force limit may only come back.
        held = (force != limited) & (np.abs(grown) > np.abs(integral))
        self._integral = np.where(held, integral, within(grown, self._limit_n))
        return Setpoints(limited, "force")
