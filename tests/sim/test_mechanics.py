"""The plant's mechanics against integration by other means and against conservation of energy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hil.config import RigFile
from hil.configfile import load_rig
from hil.rigs import build_rig
from hil.sim.plant import Plant
from tests.sim.rigs import changed, effect, frictionless, pendulum, with_effects

FREE = {"coulomb": 0.0, "viscous": 0.0}
MEASURE = np.array([1.0, -1.0, 0.5, 0.8, -0.6, 0.4])


def let_go(plant: Plant) -> None:
    for i in range(plant.n):
        plant.set_setpoint(i, 0.0, plant.now_s)


def wide(name: str) -> RigFile:
    """A rig without friction, delays and current lag whose end stops are out of the way."""
    return changed(
        frictionless(name, current_hz=1e5, stroke=(-3.0, 3.0)), bus={"setpoint_delay": 0.0}
    )


@pytest.mark.parametrize("name", ["motorcycle", "stewart"])
def test_a_free_fall_follows_the_equations_of_motion(name: str) -> None:
    rig = wide(name)
    model = build_rig(rig)
    start = np.array([0.05, -0.04, 0.06, 0.03, -0.05, 0.07])[: model.n]
    plant = Plant(rig)
    plant.reset(tuple(start), mode="force")
    let_go(plant)
    plant.advance(0.25)

    def slope(_: float, y: np.ndarray) -> np.ndarray:
        q, qd = y[: model.n], y[model.n :]
        return np.concatenate([qd, model.forward_dynamics(q, qd, np.zeros(model.n))])

    exact = solve_ivp(
        slope, (0.0, 0.25), np.concatenate([start, 0 * start]), rtol=1e-11, atol=1e-12
    )
    fallen = np.max(np.abs(exact.y[: model.n, -1] - start))
    assert fallen > 0.1
    np.testing.assert_allclose(plant.pose(), exact.y[: model.n, -1], atol=2e-4 * fallen)


def test_the_scheme_is_of_second_order_in_the_step() -> None:
    errors = []
    fine = Plant(pendulum(**FREE), substeps=64)
    for plant in (Plant(pendulum(**FREE)), Plant(pendulum(**FREE), substeps=4), fine):
        plant.reset((1.0,), mode="force")
        let_go(plant)
        plant.advance(1.0)
        errors.append(plant.pose()[0])
    coarse, finer = abs(errors[0] - errors[2]), abs(errors[1] - errors[2])
    assert coarse / finer == pytest.approx(16.0, rel=0.2)


def energy(plant: Plant) -> float:
    """Kinetic and potential energy of the pendulum bench, J, from its position and speed."""
    rig = plant.rig
    inertia = rig.mass.inertia[1][1] + rig.mass.m * 0.3**2 + rig.actuators[0].reflected_mass
    height = -0.3 * np.cos(plant.pose()[0])
    return 0.5 * inertia * plant.velocity(0) ** 2 + rig.mass.m * rig.mass.gravity * height


def test_a_pendulum_without_friction_keeps_its_energy_for_minutes() -> None:
    plant = Plant(pendulum(**FREE))
    plant.reset((1.0,), mode="force")
    let_go(plant)
    plant.advance(0.01)
    first, swing = energy(plant), 20.0 * 9.81 * 0.3 * (1.0 - np.cos(1.0))
    drift = []
    for k in range(1, 300):
        plant.advance(0.4 * k)
        drift.append(energy(plant) - first)
    assert np.max(np.abs(drift)) < 2e-6 * swing


@pytest.mark.parametrize(
    "line",
    [
        effect("coulomb_friction", "axis", force=2.0),
        effect("viscous_friction", "axis", coefficient=0.5),
        effect("stribeck_friction", "axis", coulomb=1.0, static=3.0, velocity=0.1),
        effect("asymmetric_friction", "axis", positive=1.0, negative=2.0),
        effect("load_friction", "axis", coefficient=0.05),
        effect("hysteresis", "axis", force=2.0, displacement=0.01),
    ],
    ids=lambda line: line["effect"],
)
def test_every_friction_takes_energy_out_and_never_puts_any_in(line: dict) -> None:
    plant = Plant(with_effects(pendulum(**FREE), line))
    plant.reset((1.0,), mode="force")
    let_go(plant)
    plant.advance(0.01)
    levels = []
    for k in range(1, 60):
        plant.advance(0.01 + 0.25 * k)
        levels.append(energy(plant))
    stored = 0.02 if line["effect"] == "hysteresis" else 0.0  # J: its spring gives some back
    assert levels[-1] < levels[0] - 0.3
    assert np.max(np.diff(levels)) <= stored


def test_below_coulomb_friction_nothing_moves_at_all_and_above_it_does() -> None:
    rig = load_rig("axis")
    plant = Plant(rig)
    plant.reset(mode="force")
    plant.set_setpoint(0, 0.999 * rig.actuators[0].coulomb, 0.0)
    plant.advance(20.0)
    assert plant.position(0) == 0.0
    assert plant.velocity(0) == 0.0
    plant.set_setpoint(0, 1.01 * rig.actuators[0].coulomb, 20.0)
    plant.advance(21.0)
    moved = 0.01 * 20.0 / 120.0  # excess force over viscous friction: terminal speed
    assert plant.velocity(0) == pytest.approx(moved * (1.0 - np.exp(-120.0 / 135.0)), rel=0.02)


@pytest.mark.parametrize("name", ["motorcycle", "stewart"])
def test_all_actuators_stick_together_inside_their_bands(name: str) -> None:
    plant = Plant(load_rig(name))
    plant.reset(mode="force")
    held = [plant.force(i) for i in range(plant.n)]
    start = plant.pose()
    for i in range(plant.n):
        band = plant.rig.actuators[i].coulomb
        plant.set_setpoint(i, held[i] + 0.95 * band * MEASURE[i], 0.0)
    plant.advance(5.0)
    assert np.max(np.abs(plant.pose() - start)) < 1e-12
    plant.set_setpoint(0, held[0] + 1.5 * plant.rig.actuators[0].coulomb, 5.0)
    plant.advance(5.5)
    assert np.max(np.abs(plant.pose() - start)) > 1e-4


def test_end_stops_hold_the_load_where_the_stroke_ends() -> None:
    rig = load_rig("axis")
    plant = Plant(rig)
    plant.reset(mode="force")
    plant.set_setpoint(0, 3000.0, 0.0)
    plant.advance(2.0)
    assert 0.25 <= plant.pose()[0] < 0.253
    assert abs(plant.velocity(0)) < 1e-6


def test_a_disabled_drive_is_held_by_its_brake() -> None:
    plant = Plant(load_rig("motorcycle"))
    start = plant.pose()
    plant.advance(10.0)
    np.testing.assert_allclose(plant.pose(), start, atol=1e-13)
    assert plant.force(0) == 0.0
