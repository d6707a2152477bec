"""The catalogue's effects put into the exam's world: the same names and parameters, laws of its own."""

from __future__ import annotations

import math

import numpy as np

from hil.config import Effect
from hil.errors import ConfigError
from hil.exam.world import layout as lay
from hil.exam.world.body import World
from hil.rigs.pack import joint_index

HARDENING = 2.0
"""A soft transmission is twice as stiff at so many times the wind-up of a tenth of the largest force."""
SECOND = 0.2
"""Second harmonic of a force ripple."""
BOUC_WEN_N = 1.6
BOUC_WEN_B = 0.6


def apply_effect(world: World, effect: Effect) -> None:
    """Change `world` by one effect; ConfigError for one that it does not have."""
    p, name = effect.parameters, effect.effect
    if effect.location in world.rig.actuator_names:
        if _of_actuator(world, name, world.rig.actuator_names.index(effect.location), p):
            return
    elif effect.location == "platform":
        if _of_platform(world, name, p):
            return
    elif name == "geometry_error":
        at = joint_index(world.rig, effect.location)
        world.true[0][at : at + 3] += [p.get(c, 0.0) for c in "xyz"]
        return
    elif name == "clock_drift":
        world.clocks[effect.location] = p["rate"]
        return
    elif name == "lost_frames":
        world.lost.update(p)
        return
    elif _of_sensor(world, name, effect.location, p):
        return
    raise ConfigError(f"the exam's world has no {name} at {effect.location}")


def _of_actuator(world: World, name: str, i: int, p: dict[str, float]) -> bool:
    act = world.act

    def add(row: int, value: float) -> None:
        act[row, i] += value

    def put(row: int, value: float) -> None:
        act[row, i] = value

    match name:
        case "coulomb_friction":
            add(lay.A_POSITIVE, p["force"])
            add(lay.A_NEGATIVE, p["force"])
        case "viscous_friction":
            add(lay.A_VISCOUS, p["coefficient"])
        case "stribeck_friction":
            add(lay.A_POSITIVE, p["coulomb"])
            add(lay.A_NEGATIVE, p["coulomb"])
            put(lay.A_STRIBECK, p["static"] - p["coulomb"])
            put(lay.A_STRIBECK_V, p["velocity"])
        case "asymmetric_friction":
            add(lay.A_POSITIVE, p["positive"])
            add(lay.A_NEGATIVE, p["negative"])
        case "load_friction":
            put(lay.A_LOAD, p["coefficient"])
            put(lay.A_LOAD_ASYM, p.get("asymmetry", 0.0))
        case "backlash":
            put(lay.A_GAP, p["gap"])
        case "hysteresis":
            put(lay.A_HYST_F, p["force"])
            put(lay.A_HYST_X, p["displacement"])
            put(lay.A_HYST_N, BOUC_WEN_N)
            put(lay.A_HYST_B, BOUC_WEN_B)
        case "compliance":
            own = act[lay.A_STIFFNESS, i]
            k = p["stiffness"]
            put(lay.A_STIFFNESS, k * own / (k + own))
            put(lay.A_DAMPING, p.get("damping", 0.0) + 0.01 * math.sqrt(k * act[lay.A_MEFF, i]))
            put(lay.A_HARDENING, HARDENING * 0.1 * act[lay.A_FORCE_MAX, i] / k)
        case "actuator_inertia":
            add(lay.A_MASS, p["mass"])
        case "force_saturation":
            put(lay.A_FORCE_LIMIT, p["limit"])
        case "velocity_saturation":
            put(lay.A_SPEED_LIMIT, p["limit"])
        case "force_ripple":
            put(lay.A_RIPPLE_A, p["amplitude"])
            put(lay.A_RIPPLE_P, p["period"])
            put(lay.A_RIPPLE_PHASE, p.get("phase", 0.0))
            put(lay.A_RIPPLE_2, SECOND)
        case "force_constant":
            put(lay.A_FORCE_SCALE, p["scale"])
        case "loop_gain":
            for row, key in ((lay.A_KP, "position"), (lay.A_KV, "speed"), (lay.A_KI, "integral")):
                act[row, i] *= p.get(key, 1.0)
        case "transport_delay":
            world.setpoint_delay_s[i] += p["delay"]
        case "position_offset":
            add(lay.A_OFFSET, p["offset"])
        case "lead_error":
            put(lay.A_LEAD, p.get("scale", 1.0))
            put(lay.A_LEAD_A, p.get("amplitude", 0.0))
            put(lay.A_LEAD_P, p.get("period", 1.0))
        case _:
            return False
    return True


def _of_platform(world: World, name: str, p: dict[str, float]) -> bool:
    _, body, gravity = world.true
    match name:
        case "payload_mass":
            body[0] += p["mass"]
        case "payload_cog":
            body[1:4] += [p.get(c, 0.0) for c in "xyz"]
        case "payload_inertia":
            body[4:7] += [p.get(c, 0.0) for c in ("xx", "yy", "zz")]
        case "static_force_feedback":
            world.act[lay.A_STATIC] *= p["scale"]
        case "base_tilt":
            roll, pitch = p.get("roll", 0.0), p.get("pitch", 0.0)
            back_roll = np.array(
                [
                    [1, 0, 0],
                    [0, math.cos(roll), math.sin(roll)],
                    [0, -math.sin(roll), math.cos(roll)],
                ]
            )
            back_pitch = np.array(
                [
                    [math.cos(pitch), 0, -math.sin(pitch)],
                    [0, 1, 0],
                    [math.sin(pitch), 0, math.cos(pitch)],
                ]
            )
            gravity[:] = back_roll @ back_pitch @ gravity
        case _:
            return False
    return True


def _of_sensor(world: World, name: str, signal: str, p: dict[str, float]) -> bool:
    if name == "sensor_misalignment":
        small = np.array([p.get(c, 0.0) for c in "xyz"])
        angle = float(np.linalg.norm(small))
        if angle > 0.0:
            x, y, z = small / angle
            K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            turn = np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * K @ K
            world.imu[3:] = (world.imu[3:].reshape(3, 3) @ turn).ravel()
        return True
    channels = [signal]
    if signal == "imu":
        channels = [f"imu.{q}_{c}" for q in ("gyro", "accel") for c in "xyz"]
    for channel in channels:
        sensor = world.sensor(channel)
        match name:
            case "sensor_bias":
                sensor.bias += p["offset"]
            case "sensor_scale":
                sensor.scale *= p["scale"]
            case "sensor_latency":
                sensor.latency_s += p["delay"]
            case "sensor_quantisation":
                sensor.step = p["step"]
            case _:
                return False
    return True
