"""Rigs of exam cases: the shipped rig files, and benches with one axis of many kinds."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from hil.config import RigFile
from hil.configfile import load_rig, parse_settings

RIGS: Final = ("axis", "motorcycle", "stewart")
RIDDEN: Final = "bicycle"
"""Its cases are rides, made by `hil.exam.rides`."""
ALL: Final = (*RIGS, RIDDEN)
CROSSOVER: Final = 282.7
"""rad/s at which the shipped axis' speed loop crosses over: gains follow the mass."""
LAG: Final = 31.4
"""rad/s of its integrator."""


def draw_rig(name: str, rng: np.random.Generator, *, is_told: bool = False) -> RigFile:
    """A rig of the family `name`, with the quantities that its drives are asked for; `is_told`: forces are
    what those are told."""
    if name == "axis":
        tables = _axis(rng)
    elif name == "stewart":
        tables = load_rig("stewart_pd" if rng.random() < 0.25 else "stewart").model_dump()
    else:
        tables = load_rig(name).model_dump()
    chance = rng.random()
    if chance < 0.18:
        tables["bus"]["pattern"] = ("position", "force", "velocity")
    elif chance < 0.26 and tables["actuators"][0]["torque_constant"]:
        tables["bus"]["pattern"] = ("position", "current")
    if is_told:
        tables["control"]["mode"] = "computed_torque"
    return parse_settings(tables, RigFile, name)


def _axis(rng: np.random.Generator) -> dict[str, Any]:
    tables = load_rig("axis").model_dump()
    load = str(rng.choice(["horizontal", "vertical", "pendulum"], p=[0.5, 0.3, 0.2]))
    tables["geometry"]["load"] = load
    actuator, mass = tables["actuators"][0], tables["mass"]
    if load == "pendulum":
        _pendulum(tables, rng)
    else:
        mass["m"] = round(float(rng.uniform(50.0, 160.0)), 1)
        lead = float(rng.choice([0.005, 0.01, 0.02]))
        actuator["transmission"]["lead"] = lead
        actuator["reflected_mass"] = round(float(rng.uniform(0.2, 0.6)) * mass["m"], 1)
        actuator["coulomb"] = round(float(rng.uniform(10.0, 50.0)), 1)
        actuator["viscous"] = round(float(rng.uniform(60.0, 300.0)), 1)
        _gains(actuator, mass["m"] + actuator["reflected_mass"])
    if rng.random() < 0.15:
        tables["bus"]["schedule"] = "fast"
        tables["bus"]["cycle"] = float(rng.choice([0.004, 0.005]))
    return tables


def _pendulum(tables: dict[str, Any], rng: np.random.Generator) -> None:
    """A rotary drive that swings a load: rad and N·m."""
    actuator, mass = tables["actuators"][0], tables["mass"]
    mass["m"] = round(float(rng.uniform(15.0, 40.0)), 1)
    arm = round(float(rng.uniform(0.25, 0.5)), 3)
    mass["cog"] = (0.0, 0.0, -arm)
    mass["inertia"] = ((0.8, 0.0, 0.0), (0.0, 0.8, 0.0), (0.0, 0.0, 0.3))
    turned = mass["m"] * arm**2 + 0.8
    rotor = round(float(rng.uniform(0.15, 0.4)) * turned, 3)
    actuator |= {
        "reflected_mass": rotor,
        "viscous": round(float(rng.uniform(0.5, 2.0)), 2),
        "coulomb": round(float(rng.uniform(0.8, 3.0)), 2),
        "velocity_max": 2.5,
        "force_max": round(3.0 * mass["m"] * 9.81 * arm, 0),
        "acceleration_max": 40.0,
        "stroke": (-1.2, 1.2),
        "transmission": {"type": "direct", "gear": 50.0, "efficiency": 0.9},
        "torque_constant": 0.6,
    }
    _gains(actuator, turned + rotor)
    tables["limits"] = (1.0,)
    tables["cue"] |= {"velocity": (2.0,), "acceleration": (25.0,), "jerk": (800.0,)}
    tables["noise"] |= {
        "position": 5e-5,
        "velocity": 5e-3,
        "force": 0.4,
        "force_step": 0.1,
        "current": 0.02,
    }


def _gains(actuator: dict[str, Any], moved: float) -> None:
    actuator["effective_mass"] = round(moved, 3)
    actuator["speed_gain"] = round(CROSSOVER * moved, 2)
    actuator["integral_gain"] = round(CROSSOVER * LAG * moved, 1)
