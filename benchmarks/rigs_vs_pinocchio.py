"""Cost of a Stewart platform's kinematics and dynamics beside Pinocchio, on the same states, one run.

Pinocchio knows the platform as one free body; leg lengths and forces follow from its results with numpy,
as one would write it. Both answers are compared before anything is timed. Best of several rounds that
take turns, so that a busy machine harms both alike.

    python benchmarks/rigs_vs_pinocchio.py [--states 500] [--rounds 7]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio
from numba import njit

from hil.config.actuator import LegMass
from hil.configfile import load_rig
from hil.rigs import Manipulator, build_rig, solutions
from hil.rigs.pack import (
    kind_code,
    pack_body,
    pack_geometry,
    pack_gravity,
    pack_legs,
    pack_reflected,
)

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
        return np.sqrt(np.einsum("ij,ij->i", legs, legs))

    def wrench(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Force and moment (6,) that the motion needs, platform axes."""
        return pinocchio.rnea(self.model, self.data, q, v, a)

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


@njit
def compiled_loop(kind, geometry, body, legs, gravity, reflected, q, qd, qdd):  # type: ignore[no-untyped-def]
    """Inverse dynamics of all states without leaving compiled code, as plant and twin run it."""
    total = 0.0
    for i in range(q.shape[0]):
        force, _ = solutions.inverse_dynamics(
            kind, geometry, body, legs, gravity, reflected, q[i], qd[i], qdd[i]
        )
        total += force[0]
    return total


def best_of(rounds: int, tasks: dict[str, Callable[[], object]], calls: int) -> dict[str, float]:
    """Least cost per call of each task, µs."""
    best = dict.fromkeys(tasks, np.inf)
    for _ in range(rounds):
        for name, task in tasks.items():
            start = time.perf_counter()
            task()
            best[name] = min(best[name], (time.perf_counter() - start) / calls * 1e6)
    return best


def main() -> None:
    """Compare, time, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--states", type=int, default=500)
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()

    file = load_rig("stewart")

    def variant(leg: LegMass) -> Any:
        legs = [a.model_copy(update={"reflected_mass": 0.0, "leg": leg}) for a in file.actuators]
        return file.model_copy(update={"actuators": tuple(legs)})

    def arrays(rig: Any) -> tuple[Any, ...]:
        return (kind_code(rig), pack_geometry(rig), pack_body(rig), pack_legs(rig),
                pack_gravity(rig), pack_reflected(rig))  # fmt: skip

    light = variant(LegMass())
    heavy = variant(LegMass(lower_mass=5.0, lower_cog=0.35, upper_mass=5.0, upper_cog=0.3))
    rig, oracle = build_rig(light), ThroughPinocchio(light)
    rng = np.random.default_rng(0)
    shape = (options.states, 6)
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
    print(f"largest difference: {worst:.1e} N, {worst_length:.1e} m over {len(states)} states")
    if worst > 1e-6 or worst_length > 1e-12:
        raise SystemExit("the two disagree: nothing timed")
    lengths = [rig.inverse(s[0]) for s in states]
    packed = {name: arrays(f) for name, f in (("light", light), ("heavy", heavy))}
    for model in packed.values():
        compiled_loop(*model, q, qd, qdd)
    cost = best_of(
        options.rounds,
        {
            "leg lengths, hil": lambda: [rig.inverse(s[0]) for s in states],
            "leg lengths, pinocchio": lambda: [oracle.inverse(*t) for t in theirs],
            "leg forces, hil": lambda: [rig.inverse_dynamics(*s) for s in states],
            "leg forces, pinocchio": lambda: [oracle.leg_forces(*t) for t in theirs],
            "wrench only, pinocchio rnea": lambda: [oracle.wrench(*t) for t in theirs],
            "pose from lengths, hil": lambda: [rig.forward(length) for length in lengths],
            "leg forces, hil compiled": lambda: compiled_loop(*packed["light"], q, qd, qdd),
            "leg forces, leg masses too, hil compiled": lambda: compiled_loop(
                *packed["heavy"], q, qd, qdd
            ),
        },
        len(states),
    )
    for name, value in cost.items():
        print(f"{name:42s} {value:8.2f} µs")
    for what in ("leg lengths", "leg forces"):
        print(f"{what}: hil / pinocchio = {cost[what + ', hil'] / cost[what + ', pinocchio']:.2f}")


if __name__ == "__main__":
    main()
