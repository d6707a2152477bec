"""The equations of motion against energies, for every kind of rig with all its masses."""

from __future__ import annotations

import numpy as np
import pytest

from hil.config.rig import RigFile
from hil.rigs import build_rig, solutions
from hil.rigs.pack import (
    joint_index,
    kind_code,
    pack_body,
    pack_geometry,
    pack_legs,
    pack_reflected,
)
from tests.rigs.models import Array, Bodies


def state(rig: RigFile, seed: int) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    n = len(rig.limits)
    return rng.uniform(-1, 1, n) * rig.limits, rng.normal(size=n) * 0.8, rng.normal(size=n) * 3.0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_mass_matrix_is_that_of_the_kinetic_energy(heavy_file: RigFile, seed: int) -> None:
    q, _, _ = state(heavy_file, seed)
    M = build_rig(heavy_file).mass_matrix(q)
    np.testing.assert_allclose(M, Bodies(heavy_file).mass_matrix(q), rtol=1e-10, atol=1e-9)
    assert np.all(np.linalg.eigvalsh(M) > 0)


@pytest.mark.parametrize("seed", [1, 2])
def test_forces_are_those_of_lagranges_equations(heavy_file: RigFile, seed: int) -> None:
    q, qd, qdd = state(heavy_file, seed)
    rig = build_rig(heavy_file)
    force = rig.jacobian(q).T @ rig.inverse_dynamics(q, qd, qdd)
    np.testing.assert_allclose(force, Bodies(heavy_file).lagrange(q, qd, qdd), rtol=2e-7, atol=2e-6)


def test_a_tilted_base_with_every_joint_shifted_still_obeys_lagrange(heavy_file: RigFile) -> None:
    """Gravity from any side and any joint out of place: what base tilt and geometry errors need."""
    q, qd, qdd = state(heavy_file, 4)
    gravity = np.array([0.9, -0.6, -9.7])
    geometry = pack_geometry(heavy_file)
    shifts = np.zeros((len(q), 2, 3))
    if heavy_file.kind != "axis_1dof":
        rng = np.random.default_rng(5)
        for i, name in enumerate(heavy_file.actuator_names):
            for k, end in enumerate(("base", "platform")):
                shifts[i, k] = rng.uniform(-0.01, 0.01, 3)
                at = joint_index(heavy_file, f"{name}.{end}")
                geometry[at : at + 3] += shifts[i, k]
    arrays = (
        kind_code(heavy_file), geometry, pack_body(heavy_file), pack_legs(heavy_file), gravity,
        pack_reflected(heavy_file),
    )  # fmt: skip
    bodies = Bodies(heavy_file, gravity, shifts)
    M, h, rho, _, _ = solutions.evaluate(*arrays, q, qd)
    np.testing.assert_allclose(rho, bodies.strokes(q), atol=1e-13)
    np.testing.assert_allclose(M @ qdd + h, bodies.lagrange(q, qd, qdd), rtol=2e-7, atol=2e-6)


@pytest.mark.parametrize("seed", [6, 7])
def test_power_of_the_actuators_is_the_growth_of_energy(heavy_file: RigFile, seed: int) -> None:
    """F · rho_dot = dE/dt along a motion q + qd t + qdd t²/2, at t = 0."""
    q, qd, qdd = state(heavy_file, seed)
    rig, bodies, dt = build_rig(heavy_file), Bodies(heavy_file), 1e-5

    def energy(t: float) -> float:
        kinetic, potential = bodies.energies(q + qd * t + 0.5 * qdd * t * t, qd + qdd * t)
        return kinetic + float(potential)

    growth = (energy(dt) - energy(-dt)) / (2 * dt)
    power = rig.inverse_dynamics(q, qd, qdd) @ rig.rates(q, qd)
    assert power == pytest.approx(growth, rel=1e-6, abs=1e-4)


def test_a_free_motion_keeps_its_energy(heavy_file: RigFile) -> None:
    """No force, fourth-order Runge-Kutta for 0.2 s: energy stays, wherever the platform falls."""
    rig, bodies = build_rig(heavy_file), Bodies(heavy_file)
    q, qd, _ = state(heavy_file, 8)
    q, qd, none, dt = 0.2 * q, 0.5 * qd, np.zeros(rig.n), 0.001
    before = sum(bodies.energies(q, qd))
    for _ in range(200):
        k1 = qd, rig.forward_dynamics(q, qd, none)
        k2 = (
            qd + dt / 2 * k1[1],
            rig.forward_dynamics(q + dt / 2 * k1[0], qd + dt / 2 * k1[1], none),
        )
        k3 = (
            qd + dt / 2 * k2[1],
            rig.forward_dynamics(q + dt / 2 * k2[0], qd + dt / 2 * k2[1], none),
        )
        k4 = qd + dt * k3[1], rig.forward_dynamics(q + dt * k3[0], qd + dt * k3[1], none)
        q = q + dt / 6 * (k1[0] + 2 * k2[0] + 2 * k3[0] + k4[0])
        qd = qd + dt / 6 * (k1[1] + 2 * k2[1] + 2 * k3[1] + k4[1])
    assert sum(bodies.energies(q, qd)) == pytest.approx(before, rel=1e-8, abs=1e-5)


def test_forward_dynamics_undoes_inverse_dynamics(heavy_file: RigFile) -> None:
    q, qd, qdd = state(heavy_file, 9)
    rig = build_rig(heavy_file)
    force = rig.inverse_dynamics(q, qd, qdd)
    np.testing.assert_allclose(rig.forward_dynamics(q, qd, force), qdd, rtol=1e-9, atol=1e-9)
    assert force == pytest.approx(
        np.linalg.solve(rig.jacobian(q).T, rig.mass_matrix(q) @ qdd + rig.bias(q, qd)), rel=1e-9
    )


def test_actuators_feel_their_reflected_mass_one_to_one(stewart_file: RigFile) -> None:
    heavier = [
        a.model_copy(update={"reflected_mass": a.reflected_mass + 5.0})
        for a in stewart_file.actuators
    ]
    more = build_rig(stewart_file.model_copy(update={"actuators": tuple(heavier)}))
    q = np.array([0.1, -0.05, 0.02, 0.1, -0.1, 0.2])
    added = more.actuator_inertia(q) - build_rig(stewart_file).actuator_inertia(q)
    np.testing.assert_allclose(added, 5.0 * np.eye(6), atol=1e-8)
