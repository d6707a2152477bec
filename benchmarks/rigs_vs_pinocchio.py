"""Cost of a Stewart platform's kinematics and dynamics beside Pinocchio, on the same states, one run.

Pinocchio knows the platform as one free body; leg lengths and forces follow from its results with numpy,
as one would write it. Both answers are compared before anything is timed. Best of several rounds that
take turns, so that a busy machine harms both alike.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio

from benchmarks.bare import compiled_dynamics, packed_model
from benchmarks.figure import Options, Table
from hil.config.actuator import LegMass
from hil.configfile import load_rig
from hil.rigs import Manipulator, build_rig

State = tuple[np.ndarray, np.ndarray, np.ndarray]


class ThroughPinocchio:
    """The same questions answered with Pinocchio and numpy."""

    def __init__(self, rig: Any) -> None:
        self.model = pinocchio.Model()
        joint = self.model.addJoint(
            0, pinocchio.JointModelFreeFlyer(), pinocchio.SE3.Identity(), "platform"
        )
        inertia = pinocchio.Inertia(rig.mass.m, np.array(rig.mass.cog), np.array(rig.mass.inertia))
        self.model.appendBodyToJoint(joint, inertia, pinocchio.SE3.Identity())
        self.model.gravity.linear = np.array([0.0, 0.0, -rig.mass.gravity])
        self.data = self.model.createData()
        self.base, self.cabin = np.array(rig.geometry.base), np.array(rig.geometry.cabin)

    def inverse(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Leg lengths (6,)."""
        pinocchio.forwardKinematics(self.model, self.data, q)
        place = self.data.oMi[1]
        legs = self.cabin @ place.rotation.T + place.translation - self.base
        lengths: np.ndarray = np.sqrt(np.einsum("ij,ij->i", legs, legs))
        return lengths

    def wrench(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Force and moment (6,) that the motion needs, platform axes."""
        needed: np.ndarray = pinocchio.rnea(self.model, self.data, q, v, a)
        return needed

    def leg_forces(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Leg forces (6,)."""
        wrench = pinocchio.rnea(self.model, self.data, q, v, a)
        place = self.data.liMi[1]
        legs = self.cabin + (place.translation - self.base) @ place.rotation  # platform axes
        n = legs / np.sqrt(np.einsum("ij,ij->i", legs, legs))[:, None]
        return np.linalg.solve(np.hstack([n, np.cross(self.cabin, n)]).T, wrench)


def pinocchio_state(rig: Manipulator, state: State) -> State:
    """Free-flyer configuration, velocity and spatial acceleration, platform axes."""
    motion = rig.platform_motion(*state)
    R, spin = motion.R, motion.R.T @ motion.omega
    speed = R.T @ motion.velocity
    return (
        np.concatenate([motion.position, pinocchio.Quaternion(R).coeffs()]),
        np.concatenate([speed, spin]),
        np.concatenate([R.T @ motion.acceleration - np.cross(spin, speed), R.T @ motion.omega_dot]),
    )


def best_of(rounds: int, tasks: dict[str, Callable[[], object]], calls: int) -> dict[str, float]:
    """Least cost per call of each task, µs."""
    best = dict.fromkeys(tasks, np.inf)
    for _ in range(rounds):
        for name, task in tasks.items():
            start = time.perf_counter()
            task()
            best[name] = min(best[name], (time.perf_counter() - start) / calls * 1e6)
    return best


def measure(options: Options = Options()) -> list[Table]:  # noqa: B008 - a frozen value
    """Compare answers, then time both. RuntimeError where the two disagree."""
    count, rounds = (200, 3) if options.quick else (500, 7)
    file = load_rig("stewart")

    def variant(leg: LegMass) -> Any:
        legs = [a.model_copy(update={"reflected_mass": 0.0, "leg": leg}) for a in file.actuators]
        return file.model_copy(update={"actuators": tuple(legs)})

    light = variant(LegMass())
    heavy = variant(LegMass(lower_mass=5.0, lower_cog=0.35, upper_mass=5.0, upper_cog=0.3))
    rig, oracle = build_rig(light), ThroughPinocchio(light)
    rng = np.random.default_rng(0)
    shape = (count, 6)
    q, qd, qdd = (
        rng.uniform(-1, 1, shape) * rig.limits,
        rng.normal(size=shape),
        rng.normal(size=shape),
    )
    states = list(zip(q, qd, qdd, strict=True))
    theirs = [pinocchio_state(rig, s) for s in states]
    worst = max(
        float(np.max(np.abs(rig.inverse_dynamics(*s) - oracle.leg_forces(*t))))
        for s, t in zip(states, theirs, strict=True)
    )
    worst_length = max(
        float(np.max(np.abs(rig.inverse(s[0]) - oracle.inverse(*t))))
        for s, t in zip(states, theirs, strict=True)
    )
    note = f"largest difference {worst:.1e} N, {worst_length:.1e} m over {count} states"
    if worst > 1e-6 or worst_length > 1e-12:
        raise RuntimeError(f"the two disagree, nothing timed: {note}")
    lengths = [rig.inverse(s[0]) for s in states]
    packed = {name: packed_model(f) for name, f in (("light", light), ("heavy", heavy))}
    for model in packed.values():
        compiled_dynamics(*model, q, qd, qdd)
    cost = best_of(
        rounds,
        {
            "leg lengths, hil": lambda: [rig.inverse(s[0]) for s in states],
            "leg lengths, pinocchio": lambda: [oracle.inverse(*t) for t in theirs],
            "leg forces, hil": lambda: [rig.inverse_dynamics(*s) for s in states],
            "leg forces, pinocchio": lambda: [oracle.leg_forces(*t) for t in theirs],
            "wrench only, pinocchio rnea": lambda: [oracle.wrench(*t) for t in theirs],
            "pose from lengths, hil": lambda: [rig.forward(length) for length in lengths],
            "leg forces, hil compiled": lambda: compiled_dynamics(*packed["light"], q, qd, qdd),
            "leg forces, leg masses too, hil compiled": lambda: compiled_dynamics(
                *packed["heavy"], q, qd, qdd
            ),
        },
        count,
    )
    ratios = {
        what: (cost[f"{what}, pinocchio"] / cost[f"{what}, hil"],)
        for what in ("leg lengths", "leg forces")
    }
    return [
        Table(
            "Stewart platform, one call, µs",
            ("µs",),
            {name: (us,) for name, us in cost.items()},
            note,
        ),
        Table("so many times Pinocchio's speed", ("ratio",), ratios),
    ]
