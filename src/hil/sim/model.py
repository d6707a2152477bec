"""A rig file as the flat model vector of the compiled kernel, and effects put into it.

`pack_model` turns the rig file into constants; `apply_parameters` (compiled, so that a batch of fits runs
without Python) writes a parameter vector's effects over a copy of them. Layouts: `hil.sim.layout`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hil.compiled import compiled
from hil.config import RigFile
from hil.errors import ConfigError
from hil.rigs.pack import (
    kind_code,
    pack_body,
    pack_fed_legs,
    pack_geometry,
    pack_gravity,
    pack_legs,
)
from hil.sim import layout as lay

Array = NDArray[np.float64]

HARDENING_FORCE = 0.1
"""Of an actuator's largest force: at the wind-up that it makes of a linear spring, `hardening` is the share
by which a transmission is stiffer."""


def pack_model(rig: RigFile, substeps: int = 1, *, smooth: bool = False) -> Array:
    """Constants of the rig file's nominal model, without its `effects`; layout in `hil.sim.layout`.

    `substeps` divides the speed loop's period for the integration of the plant; `smooth`: setpoints act
    between ticks (`hil.sim.drive_loops`), which has a meaning only where they come more rarely than ticks, or
    a drive's own ticks are known: else one that waited for the next tick would be replaced there by the next.
    ConfigError where the position loop's period is no multiple of the speed loop's.
    """
    bus = rig.bus
    ticks = bus.position_loop / bus.speed_loop
    if round(ticks) < 1 or abs(ticks - round(ticks)) > 1e-6:
        raise ConfigError(
            f"{rig.name}: bus.position_loop ({bus.position_loop:g} s) must be a whole multiple of "
            f"bus.speed_loop ({bus.speed_loop:g} s)"
        )
    if substeps < 1:
        raise ValueError("substeps must be 1 or more")
    geometry, body, gravity = pack_geometry(rig), pack_body(rig), pack_gravity(rig)
    feeds_static = any(a.law != "cascade" for a in rig.actuators)
    who = lay.NONE_SMOOTH
    if smooth:
        who = lay.ALL_SMOOTH if bus.cycle > 1.5 * bus.position_loop else lay.TICKED_SMOOTH
    delay_s, lines = bus.setpoint_delay, lay.INTERPOLATIONS[bus.interpolation]
    if smooth and lines == lay.LEADS:  # a tick early in all, and it is known how early a tick ago
        delay_s, lines = delay_s - bus.position_loop, lay.INTERPOLATIONS["linear"]
    header = [
        float(kind_code(rig)), len(rig.actuators), bus.speed_loop, round(ticks), bus.cycle,
        delay_s, lines, bus.retimed, substeps, len(geometry),
        rig.imu is not None, feeds_static, rig.imu.delay if rig.imu else 0.0,
        bus.answer_delay, who,
        lay.INTERPOLATIONS[bus.force_interpolation], bus.waits_s(0), bus.waits_s(0) - bus.waits_s(1),
    ]  # fmt: skip
    actuators = _pack_actuators(rig, bus.speed_loop / substeps)
    return np.concatenate(
        [header, actuators.ravel(), geometry, geometry, body, body, gravity, gravity,
         pack_legs(rig).ravel(), pack_fed_legs(rig).ravel(), _pack_imu(rig)]
    ).astype(np.float64)  # fmt: skip


def add_payload(model: Array, mass_kg: float, position_m: tuple[float, float, float]) -> None:
    """Bolt a point mass to the platform of `model`, in place, at a position in the platform frame.

    The drives' own static-force feed-forward does not learn of it.
    """
    body = split(model, int(model[lay.H_N]))[3]
    m, cog = body[0], np.array(body[1:4])
    place = np.array(position_m)
    total = m + mass_kg
    apart = place - cog
    spread = m * mass_kg / total * (apart @ apart * np.eye(3) - np.outer(apart, apart))
    body[0] = total
    body[1:4] = (m * cog + mass_kg * place) / total
    body[4:10] += spread[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def actuator_rows(model: Array) -> Array:
    """View (A_ROWS, n) of the actuators' constants in a model vector."""
    n = int(model[lay.H_N])
    return model[lay.HEADER : lay.HEADER + lay.A_ROWS * n].reshape(lay.A_ROWS, n)


def _pack_actuators(rig: RigFile, step_s: float) -> Array:
    rows = np.zeros((lay.A_ROWS, len(rig.actuators)))
    rows[
        [
            lay.A_STRIBECK_V,
            lay.A_HYST_X,
            lay.A_RIPPLE_P,
            lay.A_LEAD_P,
            lay.A_FORCE_SCALE,
            lay.A_PER_LEAD,
        ]
    ] = 1.0
    rows[lay.A_STIFFNESS] = math.inf
    for i, a in enumerate(rig.actuators):
        lag = 2.0 * math.pi * a.current_hz * step_s
        decay = math.exp(-lag)
        for row, value in (
            (lay.A_REFLECTED, a.reflected_mass),
            (lay.A_VISCOUS, a.viscous),
            (lay.A_COULOMB_POS, (1.0 - a.guide_share) * a.coulomb),
            (lay.A_COULOMB_NEG, (1.0 - a.guide_share) * a.coulomb),
            (lay.A_GUIDE, a.guide_share * a.coulomb),
            (lay.A_PRESLIDING, a.presliding),
            (lay.A_VMAX, a.velocity_max),
            (lay.A_FMAX, a.force_max),
            (lay.A_LOWER, a.stroke[0]),
            (lay.A_UPPER, a.stroke[1]),
            (lay.A_HOME, a.home),
            (lay.A_KP, a.position_gain),
            (lay.A_KV, a.speed_gain),
            (lay.A_KI, a.integral_gain),
            (lay.A_KFV, a.velocity_ff),
            (lay.A_KFA, a.acceleration_ff),
            (lay.A_KFF, a.friction_ff),
            (lay.A_MEFF, a.effective_mass),
            (lay.A_CURRENT_DECAY, decay),
            (lay.A_CURRENT_MEAN, (1.0 - decay) / lag),
            (lay.A_STATIC_FF, a.static_ff if a.law != "cascade" else 0.0),
            (lay.A_PD, a.law == "pd"),
            (lay.A_FORCE_PER_A, a.force_per_ampere or math.nan),
            (lay.A_BRAKE, a.force_max),
            (lay.A_FF_VISCOUS, a.viscous),
            (lay.A_FF_COULOMB, a.coulomb),
        ):
            rows[row, i] = value
    return rows


def _pack_imu(rig: RigFile) -> Array:
    if rig.imu is None:
        return np.zeros(lay.IMU)
    r, p, y = rig.imu.orientation
    cr, sr, cp, sp, cy, sy = (f(x) for x in (r, p, y) for f in (math.cos, math.sin))
    rotation = [
        cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr,
        sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr,
        -sp, cp * sr, cp * cr,
    ]  # fmt: skip
    filters = [rig.imu.bandwidth, *rig.imu.mount.frequency, rig.imu.mount.damping]
    return np.array([*rig.imu.position, *rotation, *filters])


@compiled
def split(model, n):  # type: ignore[no-untyped-def]
    """Views: actuators (A_ROWS, n), geometry, nominal geometry, body, nominal body, gravity, nominal
    gravity, legs (n, 6), legs that are fed forward, IMU."""
    ng = int(model[lay.H_GEOMETRY])
    a = lay.HEADER
    b = a + lay.A_ROWS * n
    c = b + 2 * ng
    d = c + 2 * lay.BODY
    e = d + 2 * lay.GRAVITY
    f = e + lay.LEG * n
    g = f + lay.LEG * n
    return (
        model[a:b].reshape((lay.A_ROWS, n)),
        model[b : b + ng],
        model[b + ng : c],
        model[c : c + lay.BODY],
        model[c + lay.BODY : d],
        model[d : d + lay.GRAVITY],
        model[d + lay.GRAVITY : e],
        model[e:f].reshape((n, lay.LEG)),
        model[f:g].reshape((n, lay.LEG)),
        model[g : g + lay.IMU],
    )


@compiled
def apply_parameters(base, p, out):  # type: ignore[no-untyped-def]
    """Write the model `base` with the effects of parameter vector `p` into `out` (same length)."""
    for c in range(base.shape[0]):
        out[c] = base[c]
    n = int(base[lay.H_N])
    act, geometry, _, body, _, gravity, _, _, _, imu = split(out, n)
    for i in range(n):
        x = p[i * lay.ACTUATOR_BLOCK : i * lay.ACTUATOR_BLOCK + lay.ACTUATOR_SIZE]
        act[lay.A_COULOMB_POS, i] += x[lay.P_COULOMB] + x[lay.P_ASYM_POS]
        act[lay.A_COULOMB_NEG, i] += x[lay.P_COULOMB] + x[lay.P_ASYM_NEG]
        act[lay.A_PRESLIDING, i] += x[lay.P_PRESLIDING]
        viscous = act[lay.A_VISCOUS, i] + x[lay.P_VISCOUS]
        ahead = max(viscous + x[lay.P_ASYM_VISCOUS_POS], 0.0)
        back = max(viscous + x[lay.P_ASYM_VISCOUS_NEG], 0.0)
        act[lay.A_VISCOUS, i] = 0.5 * (ahead + back)
        act[lay.A_VISCOUS_SKEW, i] = 0.5 * (ahead - back)
        act[lay.A_STRIBECK_C, i] = x[lay.P_STRIBECK_C]
        act[lay.A_STRIBECK_D, i] = x[lay.P_STRIBECK_S] - x[lay.P_STRIBECK_C]
        act[lay.A_STRIBECK_V, i] = x[lay.P_STRIBECK_V]
        act[lay.A_LOAD, i] = x[lay.P_LOAD]
        act[lay.A_LOAD_ASYM, i] = x[lay.P_LOAD_ASYM]
        act[lay.A_GAP, i] = x[lay.P_GAP]
        act[lay.A_HYST_F, i] = x[lay.P_HYST_F]
        act[lay.A_HYST_X, i] = x[lay.P_HYST_X]
        act[lay.A_STIFFNESS, i] = x[lay.P_STIFFNESS]
        act[lay.A_DAMPING, i] = x[lay.P_DAMPING]
        windup = HARDENING_FORCE * act[lay.A_FMAX, i] / x[lay.P_STIFFNESS]
        act[lay.A_HARDENING, i] = x[lay.P_HARDENING] / windup**2 if windup > 0.0 else 0.0
        if act[lay.A_STIFFNESS, i] == math.inf and act[lay.A_GAP, i] == 0.0:  # one with the motor
            act[lay.A_COULOMB_POS, i] += act[lay.A_GUIDE, i]
            act[lay.A_COULOMB_NEG, i] += act[lay.A_GUIDE, i]
            act[lay.A_GUIDE, i] = 0.0
        act[lay.A_REFLECTED, i] += x[lay.P_INERTIA]
        act[lay.A_FMAX, i] = x[lay.P_FMAX]
        act[lay.A_FKNEE, i] = x[lay.P_FKNEE]
        act[lay.A_VMAX, i] = x[lay.P_VMAX]
        act[lay.A_VKNEE, i] = x[lay.P_VKNEE]
        act[lay.A_RIPPLE_A, i] = x[lay.P_RIPPLE_A]
        act[lay.A_RIPPLE_P, i] = x[lay.P_RIPPLE_P]
        act[lay.A_RIPPLE_PHASE, i] = x[lay.P_RIPPLE_PHASE]
        act[lay.A_FORCE_SCALE, i] = x[lay.P_FORCE_SCALE]
        act[lay.A_KP, i] *= x[lay.P_KP]
        act[lay.A_KV, i] *= x[lay.P_KV]
        act[lay.A_KI, i] *= x[lay.P_KI]
        act[lay.A_DELAY, i] = x[lay.P_DELAY]
        act[lay.A_OFFSET, i] = x[lay.P_OFFSET]
        act[lay.A_PER_LEAD, i] = 1.0 / x[lay.P_LEAD]
        act[lay.A_LEAD_A, i] = x[lay.P_LEAD_A]
        act[lay.A_LEAD_P, i] = x[lay.P_LEAD_P]
        act[lay.A_LEAD_PHASE, i] = x[lay.P_LEAD_PHASE]
    at = n * lay.ACTUATOR_BLOCK
    static = p[at + lay.PL_STATIC]
    for i in range(n):
        act[lay.A_STATIC_FF, i] *= static
    body[0] += p[at + lay.PL_MASS]
    for c in range(3):
        body[1 + c] += p[at + lay.PL_COG + c]
        body[4 + c] += p[at + lay.PL_INERTIA + c]
    roll, pitch = p[at + lay.PL_TILT], p[at + lay.PL_TILT + 1]
    if roll != 0.0 or pitch != 0.0:  # level gravity seen from a base turned by Ry(pitch) Rx(roll)
        g = gravity[2]
        gravity[0] = -math.sin(pitch) * g
        gravity[1] = math.cos(pitch) * math.sin(roll) * g
        gravity[2] = math.cos(pitch) * math.cos(roll) * g
    at_joints = at + lay.JOINTS_AT
    for j in range(p.shape[0] - at_joints):
        geometry[j] += p[at_joints + j]
    _misalign(p[at + lay.MISALIGNMENT_AT : at + lay.MISALIGNMENT_AT + 3], imu[3:12])


@compiled
def _misalign(turn, rotation):  # type: ignore[no-untyped-def]
    """rotation (9,) times the rotation vector `turn` (3,) in the sensor's own axes, exactly."""
    angle = math.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
    if angle == 0.0:
        return
    s, c = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle**2
    x, y, z = turn[0], turn[1], turn[2]
    for r in range(3):
        a, b, d = rotation[3 * r], rotation[3 * r + 1], rotation[3 * r + 2]
        # row times (1 + s [t]x + c [t]x [t]x), [t]x the skew matrix of `turn`
        u, v, w = b * z - d * y, d * x - a * z, a * y - b * x
        rotation[3 * r] = a + s * u + c * (v * z - w * y)
        rotation[3 * r + 1] = b + s * v + c * (w * x - u * z)
        rotation[3 * r + 2] = d + s * w + c * (u * y - v * x)
