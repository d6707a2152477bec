"""A rig as a tree of rigid bodies in MuJoCo, its loops closed by exact constraints, as an oracle.

Platform on a free joint; each leg of its own: a Stewart leg on a universal joint with a slider, a front
leg of the motorcycle platform on a cylindrical joint with a slider, its rear slide on a rail. MuJoCo's
inverse dynamics gives the tree's generalised forces; actuator forces and loop multipliers follow from
tau = S F + Jc^T mu, which is square and exact (soft loop constraints would not be).
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from hil.config.rig import RigFile
from hil.rigs import PlatformMotion

Array = np.ndarray[Any, Any]
AXIAL = 1e-12  # MuJoCo wants some inertia about a leg's own axis


class ClosedChain:
    """`solve(motion)` gives actuator forces and loop multipliers for a motion of the platform."""

    def __init__(self, rig: RigFile) -> None:
        self.rig, g = rig, rig.geometry
        if g.kind == "stewart_6dof":
            self.base, self.cabin = np.array(g.base), np.array(g.cabin)
            home = np.add(self.cabin, [0.0, 0.0, g.height])
        else:
            self.base = np.array([[0.0, 0, 0], [0, 0, 0], [-g.L, 0, g.h]])
            self.cabin = np.array([[0.0, g.l, 0], [0, -g.l, 0], [-g.l3, 0, -g.h3]])
            home = np.add(self.cabin, [g.l3 - g.L, 0.0, g.h + g.h3])
        self.planar = g.kind == "motorcycle_3dof"
        self.span = home - self.base
        if self.planar:
            self.span[:, 1] = 0.0
        self.model: Any = mujoco.MjModel.from_xml_string(self._xml())
        self.data: Any = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)
        self.frames = [np.array(self.data.body(f"lower{i}").xmat).reshape(3, 3) if
                       not self._rail(i) else np.eye(3) for i in range(len(self.base))]  # fmt: skip

    def _rail(self, i: int) -> bool:
        return self.planar and i == 2

    def _xml(self) -> str:
        mass = self.rig.mass
        inertia = np.array(mass.inertia)
        full = [*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]]
        bodies = [
            f'<body name="cabin"><freejoint/><inertial pos="{text(mass.cog)}" mass="{mass.m}" '
            f'fullinertia="{text(full)}"/></body>'
        ]
        for i, actuator in enumerate(self.rig.actuators):
            leg, rotor = actuator.leg, f'armature="{actuator.reflected_mass}"'
            if self._rail(i):
                bodies.append(
                    f'<body name="upper{i}" pos="{text(self.base[i])}">'
                    f'<joint name="drive{i}" type="slide" axis="0 1 0" {rotor}/>'
                    f'<inertial pos="0 0 0" mass="{leg.upper_mass}" diaginertia="1 1 1"/></body>'
                )
                continue
            length = float(np.linalg.norm(self.span[i]))
            first = "slide" if self.planar else "hinge"
            axis = "0 1 0" if self.planar else "1 0 0"
            bodies.append(
                f'<body name="lower{i}" pos="{text(self.base[i])}" zaxis="{text(self.span[i])}">'
                f'<joint name="first{i}" type="{first}" axis="{axis}"/><joint type="hinge" axis="0 1 0"/>'
                f'<inertial pos="0 0 {leg.lower_cog}" mass="{leg.lower_mass}" '
                f'diaginertia="{leg.lower_inertia} {leg.lower_inertia} {AXIAL}"/>'
                f'<body name="upper{i}" pos="0 0 {length!r}">'
                f'<joint name="drive{i}" type="slide" axis="0 0 1" {rotor}/>'
                f'<inertial pos="0 0 {-leg.upper_cog}" mass="{leg.upper_mass}" '
                f'diaginertia="{leg.upper_inertia} {leg.upper_inertia} {AXIAL}"/></body></body>'
            )
        return (
            f'<mujoco><compiler angle="radian"/><option gravity="0 0 {-mass.gravity}"/>'
            f"<worldbody>{''.join(bodies)}</worldbody></mujoco>"
        )

    def solve(self, motion: PlatformMotion) -> tuple[Array, Array]:
        """Actuator forces (n,) and multipliers: 3 a joint, then for the planar rig that of y = 0."""
        model, data, n = self.model, self.data, len(self.base)
        data.qpos[:3] = motion.position
        mujoco.mju_mat2Quat(data.qpos[3:7], motion.R.ravel())
        data.qvel[:3], data.qvel[3:6] = motion.velocity, motion.R.T @ motion.omega
        data.qacc[:3], data.qacc[3:6] = motion.acceleration, motion.R.T @ motion.omega_dot
        arms = self.cabin @ motion.R.T
        ends = motion.position + arms
        for i in range(n):
            data.qpos[self._dofs(i) + 1] = self._leg_position(i, ends[i])
        mujoco.mj_fwdPosition(model, data)
        jacobians = [self._jacobian(f"upper{i}", ends[i]) for i in range(n)]
        for i in range(n):
            speed = motion.velocity + np.cross(motion.omega, arms[i])
            self._assign(data.qvel, jacobians[i], i, speed)
        mujoco.mj_fwdVelocity(model, data)
        for i in range(n):
            spin = motion.omega
            wanted = (
                motion.acceleration
                + np.cross(motion.omega_dot, arms[i])
                + np.cross(spin, np.cross(spin, arms[i]))
            )
            drift = np.zeros((3, model.nv))
            body = model.body(f"upper{i}").id
            mujoco.mj_jacDot(model, data, drift, None, ends[i], body)
            self._assign(data.qacc, jacobians[i], i, wanted - drift @ data.qvel)
        mujoco.mj_inverse(model, data)
        loops = [jacobians[i] - self._jacobian("cabin", ends[i]) for i in range(n)]
        if self.planar:
            loops.append(self._jacobian("cabin", motion.position)[1:2])
        drives = np.zeros((model.nv, n))
        for i in range(n):
            drives[model.joint(f"drive{i}").dofadr[0], i] = 1.0
        system = np.hstack([drives, np.vstack(loops).T])
        unknowns = np.linalg.solve(system, data.qfrc_inverse)
        return unknowns[:n], unknowns[n:]

    def _dofs(self, i: int) -> Array:
        name = f"drive{i}" if self._rail(i) else f"first{i}"
        start = self.model.joint(name).dofadr[0]
        return np.arange(start, start + (1 if self._rail(i) else 3))

    def _leg_position(self, i: int, end: Array) -> Array:
        span = end - self.base[i]
        if self._rail(i):
            return span[1:2]
        along = span[1]
        if self.planar:
            span = span * [1.0, 0.0, 1.0]
        length = float(np.linalg.norm(span))
        d = self.frames[i].T @ span / length
        stroke = length - float(np.linalg.norm(self.span[i]))
        if self.planar:
            return np.array([along, np.arctan2(d[0], d[2]), stroke])
        return np.array([np.arctan2(-d[1], d[2]), np.arcsin(d[0]), stroke])

    def _jacobian(self, body: str, point: Array) -> Array:
        jacobian = np.zeros((3, self.model.nv))
        mujoco.mj_jac(self.model, self.data, jacobian, None, point, self.model.body(body).id)
        return jacobian

    def _assign(self, target: Array, jacobian: Array, i: int, value: Array) -> None:
        """Leg rates (or accelerations) that move its end so; fails where it cannot follow."""
        dofs = self._dofs(i)
        found = np.linalg.lstsq(jacobian[:, dofs], value, rcond=None)[0]
        np.testing.assert_allclose(jacobian[:, dofs] @ found, value, atol=1e-9)
        target[dofs] = found


def text(values: Any) -> str:
    """Numbers for an XML attribute, in full."""
    return " ".join(repr(float(v)) for v in values)
