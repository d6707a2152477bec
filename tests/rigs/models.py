"""Energies of the rigs' bodies, written down from their positions alone, as an oracle.

Positions are functions of the coordinates; speeds are their exact derivatives by complex steps. Nothing
here shares code or formulae of motion with hil: only where the bodies are, and that T = m v^2 / 2.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from hil.config.actuator import LegMass
from hil.config.rig import RigFile

Array = np.ndarray[Any, Any]
STEP = 1e-30


def bare(rig: RigFile, reflected: float = 0.0) -> RigFile:
    """The rig with massless legs and this reflected mass on every actuator."""
    actuators = [
        a.model_copy(update={"reflected_mass": reflected, "leg": LegMass()}) for a in rig.actuators
    ]
    return rig.model_copy(update={"actuators": tuple(actuators)})


def with_legs(rig: RigFile, leg: LegMass) -> RigFile:
    """The rig with this leg on every actuator."""
    actuators = [a.model_copy(update={"leg": leg}) for a in rig.actuators]
    return rig.model_copy(update={"actuators": tuple(actuators)})


def rotation(roll: Any, pitch: Any, yaw: Any) -> Array:
    """R = Rz Ry Rx."""
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(a), np.sin(a)) for a in (roll, pitch, yaw))
    rx = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    ry = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    rz = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return rz @ ry @ rx


class Bodies:
    """Where every body of a rig is, as a function of q, with complex numbers allowed."""

    def __init__(self, rig: RigFile, gravity: Array | None = None, shifts: Array | None = None):
        self.rig = rig
        self.g = np.array([0.0, 0.0, -rig.mass.gravity]) if gravity is None else gravity
        self.shifts = np.zeros((len(rig.actuators), 2, 3)) if shifts is None else shifts

    def platform(self, q: Array) -> tuple[Array, Array]:
        """R and the origin's position."""
        g: Any = self.rig.geometry
        if self.rig.kind == "stewart_6dof":
            return rotation(*q[3:]), q[:3] + np.array([0.0, 0.0, g.height])
        if self.rig.kind == "motorcycle_3dof":
            R = rotation(q[2], q[1], q[0])
            # P3 must lie on the slide's line; the mirrored cylinders keep the origin in the plane y = 0
            p3 = R @ (np.array([-g.l3, 0.0, -g.h3]) + self.shifts[2, 1])
            line = np.array([-g.L, 0.0, g.h]) + self.shifts[2, 0]
            return R, np.array([line[0] - p3[0], 0.0 * q[0], line[2] - p3[2]])
        if g.load == "pendulum":
            return rotation(0.0, q[0], 0.0), np.zeros(3) * q[0]
        along = {"horizontal": np.array([1.0, 0, 0]), "vertical": np.array([0, 0, 1.0])}[g.load]
        return np.eye(3), along * q[0]

    def joints(self, q: Array) -> Iterator[tuple[Array, Array]]:
        """Base joint and platform joint of each actuator, base frame."""
        g: Any = self.rig.geometry
        R, origin = self.platform(q)
        if self.rig.kind == "stewart_6dof":
            ends = list(zip(g.base, g.cabin, strict=True))
        else:
            ends = [((0, 0, 0), (0, g.l, 0)), ((0, 0, 0), (0, -g.l, 0)),
                    ((-g.L, 0, g.h), (-g.l3, 0, -g.h3))]  # fmt: skip
        for (base, cabin), shift in zip(ends, self.shifts, strict=True):
            yield np.array(base) + shift[0], origin + R @ (np.array(cabin) + shift[1])

    def strokes(self, q: Array) -> Array:
        """Actuator positions."""
        if self.rig.kind == "axis_1dof":
            return q
        spans = [p - b for b, p in self.joints(q)]
        if self.rig.kind == "motorcycle_3dof":
            return np.array([*(np.sqrt(s[0] ** 2 + s[2] ** 2) for s in spans[:2]), spans[2][1]])
        return np.array([np.sqrt(np.sum(s * s)) for s in spans])

    def energies(self, q: Array, qd: Array) -> tuple[float, Any]:
        """Kinetic energy at (q, qd) and potential energy at q (complex where q is)."""
        kinetic, potential = 0.0, 0.0 * q[0]
        moved = q + 1j * STEP * qd
        m, c = self.rig.mass.m, np.array(self.rig.mass.cog)
        (R, _), (Rm, _) = self.platform(q), self.platform(moved)
        spin = (Rm.imag / STEP @ np.real(R).T)[[2, 0, 1], [1, 2, 0]]
        inertia = np.real(R) @ np.array(self.rig.mass.inertia) @ np.real(R).T
        kinetic += 0.5 * spin @ inertia @ spin
        points = [(m, lambda x: self.platform(x)[1] + self.platform(x)[0] @ c)]
        for i, actuator in enumerate(self.rig.actuators):
            points += self._leg_points(i, actuator.leg)
            tilt = self._leg_direction(i, moved)
            turning = actuator.leg.lower_inertia + actuator.leg.upper_inertia
            kinetic += 0.5 * turning * np.sum((tilt.imag / STEP) ** 2)
            speed = self.strokes(moved)[i].imag / STEP
            kinetic += 0.5 * actuator.reflected_mass * speed**2
        for mass, point in points:
            kinetic += 0.5 * mass * np.sum((point(moved).imag / STEP) ** 2)
            potential = potential - mass * (self.g @ point(q))
        return float(np.real(kinetic)), potential

    def _leg_direction(self, i: int, q: Array) -> Array:
        if self.rig.kind == "axis_1dof" or (self.rig.kind == "motorcycle_3dof" and i == 2):
            return np.zeros(3, dtype=complex)
        base, end = list(self.joints(q))[i]
        span = end - base
        if self.rig.kind == "motorcycle_3dof":
            span = span * np.array([1.0, 0.0, 1.0])
        return span / np.sqrt(np.sum(span * span))

    def _leg_points(self, i: int, leg: LegMass) -> list[Any]:
        if self.rig.kind == "axis_1dof":
            return [(leg.upper_mass, lambda x: self.platform(x)[1])]
        along_y = np.array([0.0, 1.0, 0.0])
        if self.rig.kind == "motorcycle_3dof" and i == 2:
            return [(leg.upper_mass, lambda x: list(self.joints(x))[2][1] * along_y)]

        def lower(x: Array) -> Array:
            base, end = list(self.joints(x))[i]
            slide = (end - base) * along_y if self.rig.kind == "motorcycle_3dof" else 0.0
            return base + slide + leg.lower_cog * self._leg_direction(i, x)

        def upper(x: Array) -> Array:
            return list(self.joints(x))[i][1] - leg.upper_cog * self._leg_direction(i, x)

        return [(leg.lower_mass, lower), (leg.upper_mass, upper)]

    def mass_matrix(self, q: Array) -> Array:
        """M from T, which is quadratic in the rates: polarisation, no rounding beyond T's own."""
        unit = np.eye(len(q))
        single = [self.energies(q, u)[0] for u in unit]
        return np.array(
            [
                [self.energies(q, u + v)[0] - single[i] - single[j] for j, v in enumerate(unit)]
                for i, u in enumerate(unit)
            ]
        )

    def lagrange(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Generalised forces from Lagrange's equations; d M / d q by central differences."""
        n, step = len(q), 1e-5
        dM = np.array(
            [
                (self.mass_matrix(q + step * u) - self.mass_matrix(q - step * u)) / (2 * step)
                for u in np.eye(n)
            ]
        )
        coriolis = np.einsum("kij,j,k->i", dM, qd, qd) - 0.5 * np.einsum("ijk,j,k->i", dM, qd, qd)
        gravity = [self.energies(q + 1j * STEP * u, qd * 0)[1].imag / STEP for u in np.eye(n)]
        return self.mass_matrix(q) @ qdd + coriolis + np.array(gravity)
