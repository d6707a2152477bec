"""Forces against independent rigid-body libraries: MuJoCo and Pinocchio."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pinocchio
import pytest

from hil.config.actuator import LegMass
from hil.config.rig import RigFile
from hil.rigs import PlatformMotion, build_rig
from tests.rigs.closed_chain import ClosedChain, text
from tests.rigs.models import Bodies, bare, with_legs
from tests.rigs.test_dynamics import state

Array = np.ndarray[Any, Any]
LEG = LegMass(lower_mass=5.0, lower_cog=0.35, lower_inertia=0.5,
              upper_mass=5.0, upper_cog=0.3, upper_inertia=0.3)  # fmt: skip


@pytest.fixture(scope="module")
def lopsided(stewart_file: RigFile) -> RigFile:
    """Massless legs, but a platform with its centre of gravity far off and products of inertia."""
    inertia = ((285.0, -12.0, 20.0), (-12.0, 240.0, 9.0), (20.0, 9.0, 150.0))
    mass = stewart_file.mass.model_copy(update={"cog": (0.15, -0.08, 0.3), "inertia": inertia})
    return bare(stewart_file.model_copy(update={"mass": mass}))


def mujoco_wrench(rig: RigFile, motion: PlatformMotion) -> Array:
    inertia = np.array(rig.mass.inertia)
    full = [*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]]
    model: Any = mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 0 {-rig.mass.gravity}"/><worldbody><body><freejoint/>'
        f'<inertial pos="{text(rig.mass.cog)}" mass="{rig.mass.m}" fullinertia="{text(full)}"/>'
        "</body></worldbody></mujoco>"
    )
    data: Any = mujoco.MjData(model)
    data.qpos[:3] = motion.position
    mujoco.mju_mat2Quat(data.qpos[3:], motion.R.ravel())
    data.qvel[:] = [*motion.velocity, *motion.R.T @ motion.omega]
    data.qacc[:] = [*motion.acceleration, *motion.R.T @ motion.omega_dot]
    mujoco.mj_inverse(model, data)
    return np.array([*data.qfrc_inverse[:3], *motion.R @ data.qfrc_inverse[3:]])


def pinocchio_wrench(rig: RigFile, motion: PlatformMotion) -> Array:
    model = pinocchio.Model()
    joint = model.addJoint(0, pinocchio.JointModelFreeFlyer(), pinocchio.SE3.Identity(), "platform")
    inertia = pinocchio.Inertia(rig.mass.m, np.array(rig.mass.cog), np.array(rig.mass.inertia))
    model.appendBodyToJoint(joint, inertia, pinocchio.SE3.Identity())
    model.gravity.linear = np.array([0.0, 0.0, -rig.mass.gravity])
    R, spin = motion.R, motion.R.T @ motion.omega
    q = np.concatenate([motion.position, pinocchio.Quaternion(R).coeffs()])
    speed = R.T @ motion.velocity
    # a spatial acceleration is what the classical one is without omega x v
    acceleration = R.T @ motion.acceleration - np.cross(spin, speed)
    force = pinocchio.rnea(
        model,
        model.createData(),
        q,
        np.concatenate([speed, spin]),
        np.concatenate([acceleration, R.T @ motion.omega_dot]),
    )
    return np.concatenate([R @ force[:3], R @ force[3:]])


@pytest.mark.parametrize("oracle", [mujoco_wrench, pinocchio_wrench])
def test_leg_forces_make_the_wrench_that_the_oracle_asks_for(
    lopsided: RigFile, oracle: Any
) -> None:
    rig, bodies = build_rig(lopsided), Bodies(lopsided)
    for seed in range(50):
        q, qd, qdd = state(lopsided, seed)
        motion = rig.platform_motion(q, qd, qdd)
        made = np.zeros(6)
        joints = bodies.joints(q)
        for force, (base, end) in zip(rig.inverse_dynamics(q, qd, qdd), joints, strict=True):
            along = force * (end - base) / np.linalg.norm(end - base)
            made += [*along, *np.cross(end - motion.position, along)]
        np.testing.assert_allclose(made, oracle(lopsided, motion), rtol=1e-10, atol=1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_a_closed_chain_with_heavy_legs_needs_the_same_leg_forces(
    stewart_file: RigFile, seed: int
) -> None:
    heavy = with_legs(stewart_file, LEG)
    q, qd, qdd = state(heavy, seed)
    rig = build_rig(heavy)
    expected, _ = ClosedChain(heavy).solve(rig.platform_motion(q, qd, qdd))
    np.testing.assert_allclose(rig.inverse_dynamics(q, qd, qdd), expected, rtol=1e-9, atol=1e-6)


def test_ten_kilogram_legs_matter(stewart_file: RigFile) -> None:
    """Legs of 2 x 5 kg are 6.5 % of the forces of a 450 kg platform [V]: never neglected silently."""
    q, qd, qdd = state(stewart_file, 0)
    light = build_rig(bare(stewart_file)).inverse_dynamics(q, qd, qdd)
    heavy = build_rig(with_legs(bare(stewart_file), LEG)).inverse_dynamics(q, qd, qdd)
    assert 0.02 < np.linalg.norm(heavy - light) / np.linalg.norm(light) < 0.15


@pytest.mark.parametrize("seed", range(5))
def test_the_motorcycle_platform_as_a_closed_chain(motorcycle_file: RigFile, seed: int) -> None:
    """Actuator forces and all three constraint forces, with leg, carriage and rotor masses."""
    heavy = with_legs(motorcycle_file, LEG)
    q, qd, qdd = state(heavy, seed)
    rig = build_rig(heavy)
    force, loops = ClosedChain(heavy).solve(rig.platform_motion(q, qd, qdd))
    np.testing.assert_allclose(rig.inverse_dynamics(q, qd, qdd), force, rtol=1e-9, atol=1e-6)
    carriage, held_in_plane = loops[6:9], loops[9]
    np.testing.assert_allclose(
        rig.constraint_forces(q, qd, qdd), [carriage[0], -held_in_plane, carriage[2]], atol=1e-6
    )
