"""One rig's mechanism: kinematics and dynamics as the rig file gives them, in its coordinates.

q, qd, qdd (n,): m and rad in the order of the rig file's coordinates, translations from the neutral
pose. Actuator positions rho (n,), m or rad: length between its joints of a leg, otherwise from the
rig file's zero. Forces F (n,), N or N·m, along the actuators; F · rho_dot is power. Friction stands
in the actuator models, not here. Equations and sources: `hil.rigs.kernel`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hil.config.rig import RigFile
from hil.errors import ConfigError, KinematicsError
from hil.rigs import solutions
from hil.rigs.kernel import MOTORCYCLE, platform_motion
from hil.rigs.pack import (
    kind_code,
    pack_body,
    pack_geometry,
    pack_gravity,
    pack_legs,
    pack_reflected,
)

Array = NDArray[np.float64]

TOLERANCE_M = 1e-10  # a hundredth of the finest encoder step is far coarser
ITERATIONS = 20  # Newton needs four or fewer within a workspace; more means it is lost


@dataclass(frozen=True, slots=True)
class PlatformMotion:
    """Motion of the platform origin in the base frame: m, m/s, rad/s, m/s², rad/s²."""

    R: Array
    """(3, 3): platform axes in base axes."""
    position: Array
    velocity: Array
    omega: Array
    acceleration: Array
    omega_dot: Array


class Manipulator:
    """The mechanism of one rig. Arrays that its methods return are the caller's own."""

    def __init__(self, rig: RigFile) -> None:
        self.name = rig.name
        self.kind: str = rig.kind
        self.coordinates = rig.coordinates
        self.actuators = rig.actuator_names
        self.n = len(rig.actuators)
        self.neutral: Array = np.zeros(self.n)
        self.limits: Array = np.array(rig.limits)
        self.strokes: Array = np.array([a.stroke for a in rig.actuators])
        self._arrays = (
            kind_code(rig),
            pack_geometry(rig),
            pack_body(rig),
            pack_legs(rig),
            pack_gravity(rig),
        )
        self._model = (*self._arrays, pack_reflected(rig))

    def inverse(self, q: ArrayLike) -> Array:
        """Actuator positions rho (n,) at the pose q."""
        rho: Array = self._evaluate(q)[2]
        return rho

    def forward(self, rho: ArrayLike, guess: ArrayLike | None = None) -> Array:
        """Pose (n,) at the actuator positions rho, by Newton's method from `guess` or neutral.

        KinematicsError names the residual where no pose closes the mechanism.
        """
        target = self._vector(rho)
        q = np.array(self.neutral if guess is None else self._vector(guess))
        residual, steps = solutions.forward_kinematics(
            *self._arrays, target, q, TOLERANCE_M, ITERATIONS
        )
        if not residual <= TOLERANCE_M:
            if np.isnan(residual):
                reason = f"Newton's method met a singular or undefined pose after {steps} steps"
            else:
                reason = f"{residual:.3g} m (or rad) remain after {steps} steps"
            positions = ", ".join(
                f"{name} {value:.4f}" for name, value in zip(self.actuators, target, strict=True)
            )
            raise KinematicsError(f"{self.name}: no pose found with {positions}: {reason}")
        return q

    def jacobian(self, q: ArrayLike) -> Array:
        """J (n, n) with rho_dot = J qd."""
        J: Array = self._evaluate(q)[3]
        return J

    def rates(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """Actuator speeds rho_dot (n,)."""
        return self.jacobian(q) @ self._vector(qd)

    def accelerations(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
        """Actuator accelerations rho_ddot (n,)."""
        _, _, _, J, jdqd = self._evaluate(q, qd)
        result: Array = J @ self._vector(qdd) + jdqd
        return result

    def motion(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> tuple[Array, Array, Array]:
        """Positions, speeds and accelerations (n,) of the actuators in one go."""
        speeds = self._vector(qd)
        _, _, rho, J, jdqd = self._evaluate(q, speeds)
        return rho, J @ speeds, J @ self._vector(qdd) + jdqd

    def mass_matrix(self, q: ArrayLike) -> Array:
        """M (n, n) in the coordinates q, with leg and reflected rotor masses."""
        M: Array = self._evaluate(q)[0]
        return M

    def mass_and_jacobian(self, q: ArrayLike) -> tuple[Array, Array]:
        """M and J (n, n) in one go."""
        M, _, _, J, _ = self._evaluate(q)
        return M, J

    def bias(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """h (n,): Coriolis, centrifugal and gravity terms, M qdd + h = J^T F."""
        h: Array = self._evaluate(q, qd)[1]
        return h

    def inverse_dynamics(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
        """Actuator forces F (n,) of a motion, without friction. KinematicsError where singular."""
        F, found = solutions.inverse_dynamics(
            *self._model, self._vector(q), self._vector(qd), self._vector(qdd)
        )
        if not found:
            raise KinematicsError(f"{self.name}: the actuators cannot hold the platform at {q!r}")
        force: Array = F
        return force

    def static_forces(self, q: ArrayLike) -> Array:
        """Actuator forces (n,) that hold the platform at rest at q."""
        return self.inverse_dynamics(q, self.neutral, self.neutral)

    def forward_dynamics(self, q: ArrayLike, qd: ArrayLike, force: ArrayLike) -> Array:
        """Accelerations qdd (n,) under actuator forces, without friction."""
        qdd, found = solutions.forward_dynamics(
            *self._model, self._vector(q), self._vector(qd), self._vector(force)
        )
        if not found:
            raise KinematicsError(f"{self.name}: the coordinates are singular at {q!r}")
        result: Array = qdd
        return result

    def actuator_inertia(self, q: ArrayLike) -> Array:
        """J^-T M J^-1 (n, n): inertia that the actuators feel, kg; its diagonal sets loop gains."""
        M, _, _, J, _ = self._evaluate(q)
        try:
            half = np.linalg.solve(J.T, M)
            inertia: Array = np.linalg.solve(J.T, half.T)
        except np.linalg.LinAlgError as error:
            raise KinematicsError(f"{self.name}: the Jacobian is singular at {q!r}") from error
        return inertia

    def constraint_forces(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
        """Lambda (3,), N, of the motorcycle platform: x and z of joint P3, y of the origin between.

        In this order (x at P3, y, z at P3); the reactions on the platform are -lambda. From
        Phi_W^T lambda = J^T F - (M_W Wd + h_W), whose first three rows are Phi's unit vectors [V].
        """
        if self._arrays[0] != MOTORCYCLE:
            raise KinematicsError(f"{self.name}: a {self.kind} has no constraint forces to recover")
        F = self.inverse_dynamics(q, qd, qdd)
        wrench: Array = solutions.constraint_wrench(
            *self._model, self._vector(q), self._vector(qd), self._vector(qdd), F
        )
        return wrench[:3]

    def platform_motion(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> PlatformMotion:
        """Motion of the platform origin, as an inertial sensor on it needs it."""
        out = np.empty(24)
        code, geometry = self._arrays[:2]
        platform_motion(code, geometry, self._vector(q), self._vector(qd), self._vector(qdd), out)
        return PlatformMotion(out[:9].reshape(3, 3), *out[9:].reshape(5, 3))

    def _evaluate(
        self, q: ArrayLike, qd: ArrayLike | None = None
    ) -> tuple[Array, Array, Array, Array, Array]:
        rates = self.neutral if qd is None else self._vector(qd)
        values: tuple[Array, Array, Array, Array, Array] = solutions.evaluate(
            *self._model, self._vector(q), rates
        )
        return values

    def _vector(self, values: ArrayLike) -> Array:
        vector = np.ascontiguousarray(values, dtype=np.float64)
        if vector.shape != (self.n,):
            raise ValueError(f"{self.name}: needs {self.n} values, got shape {vector.shape}")
        return vector


def build_rig(rig: RigFile) -> Manipulator:
    """The mechanism that a rig file describes. ConfigError where its neutral pose is out of reach."""
    manipulator = Manipulator(rig)
    at_neutral = manipulator.inverse(manipulator.neutral)
    for name, position, (low, high) in zip(
        manipulator.actuators, at_neutral, manipulator.strokes, strict=True
    ):
        if not low <= position <= high:
            raise ConfigError(
                f"{rig.name}: at the neutral pose {name} would stand at {position:.4g}, outside its stroke "
                f"{low:g}..{high:g}: see whether [geometry] and stroke are in m (rad) and from the same zero"
            )
    return manipulator
