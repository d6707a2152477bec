"""Simulated seconds a second of one core: the plant with its drives' loops beside MuJoCo's bare steps.

Both step the same mechanism at the drives' 0.25 ms and are given setpoints of the same motion every 10 ms.
MuJoCo closes the loops with soft `connect` constraints and runs plain position servos; the plant closes
them exactly and runs cascades, current loops and the IMU's filter as well. Static actuator forces of both
are compared first. Best of several rounds that take turns, so that a busy machine harms both alike.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import mujoco
import numpy as np

from benchmarks.figure import Options, Table
from hil.config import RigFile
from hil.configfile import load_rig
from hil.rigs import build_rig
from hil.sim.plant import Plant

CYCLE_S = 0.01
LEG_KG = 0.01
"""MuJoCo wants moving bodies to have mass; the rig files' legs have none of their own."""


def numbers(values: object) -> str:
    """Numbers for an XML attribute, in full."""
    return " ".join(repr(float(v)) for v in np.ravel(np.asarray(values, dtype=float)))


def mechanism(rig: RigFile) -> str:
    """MJCF of the rig: platform, legs closed by `connect`, rotors, friction, position servos."""
    g, mass = rig.geometry, rig.mass
    inertia = np.array(mass.inertia)
    full = [*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]]
    if g.kind == "stewart_6dof":
        base, cabin, origin = np.array(g.base), np.array(g.cabin), np.array([0.0, 0.0, g.height])
        joints = "<freejoint/>"
    elif g.kind == "motorcycle_3dof":
        base = np.array([[0.0, 0, 0], [0, 0, 0], [-g.L, 0, g.h]])
        cabin = np.array([[0.0, g.l, 0], [0, -g.l, 0], [-g.l3, 0, -g.h3]])
        origin = np.array([g.l3 - g.L, 0.0, g.h + g.h3])
        joints = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><joint type="ball"/>'
    else:
        base, cabin, origin = np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(3)
        a = rig.actuators[0]
        joints = (
            f'<joint name="drive0" type="slide" axis="1 0 0" armature="{a.reflected_mass}" '
            f'damping="{a.viscous}" frictionloss="{a.coulomb}"/>'
        )
    bodies = [
        f'<body name="cabin" pos="{numbers(origin)}">{joints}<inertial pos="{numbers(mass.cog)}" '
        f'mass="{mass.m}" fullinertia="{numbers(full)}"/></body>'
    ]
    closures, servos = [], []
    for i, a in enumerate(rig.actuators):
        drive = f'armature="{a.reflected_mass}" damping="{a.viscous}" frictionloss="{a.coulomb}"'
        servos.append(f'<position joint="drive{i}" kp="{a.speed_gain * 30}" kv="{a.speed_gain}"/>')
        if i >= len(base):
            continue
        planar = g.kind == "motorcycle_3dof"
        span = origin + cabin[i] - base[i]
        grain = f'mass="{LEG_KG}" diaginertia="1e-4 1e-4 1e-4"'
        closures.append(
            f'<connect body1="upper{i}" body2="cabin" anchor="0 0 0" solref="0.002 1" '
            'solimp="0.9999 0.9999 0.001"/>'
        )
        if planar and i == 2:
            bodies.append(
                f'<body name="upper{i}" pos="{numbers(base[i])}"><joint name="drive{i}" type="slide" '
                f'axis="0 1 0" {drive}/><inertial pos="0 0 0" {grain}/></body>'
            )
            continue
        foot = base[i] + (np.array([0.0, cabin[i, 1], 0.0]) if planar else 0.0)
        if planar:
            span[1] = 0.0
            first = '<joint type="slide" axis="0 1 0"/>'
        else:
            first = '<joint type="hinge" axis="1 0 0"/>'
        bodies.append(
            f'<body pos="{numbers(foot)}" '
            f'zaxis="{numbers(span)}">{first}<joint type="hinge" axis="0 1 0"/>'
            f'<inertial pos="0 0 0.1" {grain}/>'
            f'<body name="upper{i}" pos="0 0 {float(np.linalg.norm(span))!r}">'
            f'<joint name="drive{i}" type="slide" axis="0 0 1" {drive}/>'
            f'<inertial pos="0 0 0" {grain}/></body></body>'
        )
    return (
        f'<mujoco><compiler angle="radian"/><option timestep="{rig.bus.speed_loop}" '
        f'gravity="0 0 {-mass.gravity}" integrator="implicitfast"/><worldbody>{"".join(bodies)}'
        f"</worldbody><equality>{''.join(closures)}</equality><actuator>{''.join(servos)}</actuator></mujoco>"
    )


def motion(rig: RigFile, seconds: float) -> np.ndarray:
    """Actuator positions (cycles, n) of a smooth motion well inside the workspace."""
    model = build_rig(rig)
    t = np.arange(0.0, seconds, CYCLE_S)[:, None]
    phase = np.arange(model.n)
    amplitude = 0.2 * np.array(rig.limits)
    poses = amplitude * (np.sin(2 * np.pi * 0.5 * t + phase) - np.sin(phase)) * np.minimum(t, 1.0)
    return np.array([model.inverse(q) for q in poses])


def through_plant(rig: RigFile, rho: np.ndarray) -> Callable[[], float]:
    """Runs the motion in the plant; returns seconds of processor time."""
    plant = Plant(rig)
    plant.reset(mode="position")
    plant.advance(CYCLE_S)

    def run() -> float:
        plant.reset(mode="position")
        start = time.thread_time()
        for k, row in enumerate(rho.tolist()):
            for i, value in enumerate(row):
                plant.set_setpoint(i, value, k * CYCLE_S)
            plant.advance((k + 1) * CYCLE_S)
        return time.thread_time() - start

    return run


def through_mujoco(rig: RigFile, rho: np.ndarray) -> tuple[Callable[[], float], np.ndarray]:
    """Runs the motion in MuJoCo; returns seconds of processor time. Also its static actuator forces."""
    model = mujoco.MjModel.from_xml_string(mechanism(rig))
    data = mujoco.MjData(model)
    steps = round(CYCLE_S / rig.bus.speed_loop)
    frictionless = mujoco.MjModel.from_xml_string(mechanism(rig))
    frictionless.dof_frictionloss[:] = 0.0
    mujoco.mj_step(frictionless, data, 400 * steps)
    held = np.array(data.actuator_force)

    def run() -> float:
        mujoco.mj_resetData(model, data)
        start = time.thread_time()
        for row in rho:
            data.ctrl[:] = row - rho[0]
            mujoco.mj_step(model, data, steps)
        return time.thread_time() - start

    return run, held


def measure(options: Options = Options()) -> list[Table]:  # noqa: B008 - a frozen value
    """Speed of both for three rigs. RuntimeError where static forces differ: other mechanisms then."""
    seconds, rounds = (1.0, 3) if options.quick else (5.0, 5)
    rows = {}
    for name in ("axis", "motorcycle", "stewart"):
        rig = load_rig(name)
        rho = motion(rig, seconds)
        ours = through_plant(rig, rho)
        theirs, held = through_mujoco(rig, rho)
        zero = np.zeros(len(rig.actuators))
        static = build_rig(rig).inverse_dynamics(zero, zero, zero)
        if not np.allclose(held, static, atol=2.0):
            raise RuntimeError(f"{name}: static forces differ: MuJoCo {held}, hil {static}")
        best = [np.inf, np.inf]
        for _ in range(rounds):
            best = [min(best[0], ours()), min(best[1], theirs())]
        speed = [seconds / b for b in best]
        rows[name] = (speed[0], speed[1], speed[0] / speed[1])
    columns = ("plant and drives", "MuJoCo", "ratio")
    return [Table("simulated seconds a second of one core", columns, rows)]
