"""From a stretch's sparse, staggered samples to motion and force on one grid, by the one filter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from hil.config import RigFile
from hil.errors import IdentificationError, KinematicsError
from hil.identify.estimate.body import PARAMETERS, force_rows
from hil.identify.estimate.filtering import ZeroPhaseFilter, default_cutoff_hz
from hil.identify.replay import Stretch
from hil.rigs import build_rig
from hil.rigs.pack import kind_code, pack_geometry, pack_gravity, pack_legs

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOVING: Final = 0.85
"""Share of the filter's window in which an actuator must move for its row to count [R]."""


@dataclass(frozen=True, slots=True)
class Prepared:
    """Motion and force of one stretch on a grid of N instants, n actuators; all through one filter."""

    name: str
    t_s: Array
    """(N,) instants at which the values held: answer delays are taken off."""
    q: Array
    """(N, n) pose, and its rates qd, qdd."""
    qd: Array
    qdd: Array
    rho: Array
    """(N, n) actuator positions, speeds and accelerations."""
    rho_dot: Array
    rho_ddot: Array
    force: Array
    """(N, n) measured actuator force, N."""
    sign: Array
    """(N, n) sign of the speed, sampled where the force was and filtered as the force. It runs straight from
    -1 to 1 where the speed is within its noise: a sign that noise tosses would be noise itself."""
    moving: Mask
    """(N, n) False at standstill, where friction may be anything."""
    body: Array
    """(N, n, 10) actuator force per rigid-body parameter (`body`)."""
    own: Array
    """(N, n) force that the legs' masses need."""
    slowest_m_s: Array
    """(n,) speed below which an actuator counts as standing."""


def cutoff_of(stretch: Stretch, rig: RigFile) -> float:
    """The filter's default cutoff for the sampling of this stretch, Hz."""
    periods = []
    for a in rig.actuator_names:
        for quantity in ("position", "force"):
            t = samples(stretch, f"{a}.{quantity}")[0]
            periods.append((t[-1] - t[0]) / max(len(t) - 1, 1))
    return default_cutoff_hz(max(periods))


def samples(stretch: Stretch, signal: str) -> tuple[Array, Array]:
    """Samples of `signal`, or an IdentificationError that says what records it."""
    found = stretch.samples.get(signal)
    if found is None or len(found[0]) < 2:
        quantity = signal.rpartition(".")[2]
        raise IdentificationError(
            f"{stretch.name}: holds no samples of {signal}: least squares needs position and force of "
            f"every actuator (put {quantity!r} into bus.pattern of the rig file and record again)"
        )
    return found


def prepare(stretch: Stretch, rig: RigFile, cutoff_hz: float) -> Prepared:
    """Filter, differentiate, find the pose. IdentificationError names what the data lack."""
    low_pass = ZeroPhaseFilter(cutoff_hz)
    delay = rig.bus.answer_delay
    n = len(rig.actuators)
    position: list[tuple[float, Array, BSpline]] = []
    force: list[tuple[float, Array, BSpline]] = []
    for a in rig.actuator_names:
        for quantity, to in (("position", position), ("force", force)):
            t, value = samples(stretch, f"{a}.{quantity}")
            what = f"{stretch.name}: {a}.{quantity}"
            to.append((t[0] - delay, t - delay, low_pass.spline(t, value, what)))
    start = max(t[0] for _, t, _ in position + force) + low_pass.edge_s
    end = min(t[-1] for _, t, _ in position + force) - low_pass.edge_s
    grid = np.arange(start, end, low_pass.grid_s)
    if len(grid) < 10:
        raise IdentificationError(
            f"{stretch.name}: only {max(end - start, 0.0):.2f} s are left between the filter's edges: "
            "record longer"
        )
    rho, rho_dot, rho_ddot, force_n, sign, share = (np.empty((len(grid), n)) for _ in range(6))
    slowest = np.empty(n)
    for i in range(n):
        at, _, x = position[i]
        rho[:, i], rho_dot[:, i], rho_ddot[:, i] = (
            x.derivative(k)(grid - at) if k else x(grid - at) for k in range(3)
        )
        at_force, t, f = force[i]
        force_n[:, i] = f(grid - at_force)
        inside = np.clip(t - at, 0.0, position[i][1][-1] - at)
        speed = x.derivative(1)(inside)
        slowest[i] = standstill_m_s(rig, cutoff_hz, position[i][1])
        for target, column in (
            (sign, np.clip(speed / slowest[i], -1.0, 1.0)),
            (share, (np.abs(speed) > slowest[i]).astype(float)),
        ):
            target[:, i] = low_pass.spline(t, column, f"{stretch.name}: force")(grid - at_force)
    q = _poses(stretch.name, rig, rho)
    qd, qdd = np.zeros_like(q), np.zeros_like(q)
    body, own = np.empty((len(grid), n, PARAMETERS)), np.empty((len(grid), n))
    singular = force_rows(
        kind_code(rig), pack_geometry(rig), pack_legs(rig), pack_gravity(rig),
        q, rho_dot, rho_ddot, qd, qdd, body, own,
    )  # fmt: skip
    if singular >= 0:
        raise IdentificationError(
            f"{stretch.name}: the mechanism is singular at {grid[singular]:.3f} s: is this the rig "
            "file of the rig that ran?"
        )
    return Prepared(
        stretch.name, grid, q, qd, qdd, rho, rho_dot, rho_ddot, force_n, sign, share > MOVING,
        body, own, slowest,
    )  # fmt: skip


def standstill_m_s(rig: RigFile, cutoff_hz: float, t_s: Array) -> float:
    """Four standard deviations of the speed that position noise alone makes behind the filter.

    Var v = sigma^2 period omega_c^3 / pi integral u^2 / (1 + u^4)^2 = 0.0884 sigma^2 period omega_c^3 [V].
    """
    sigma = np.hypot(rig.noise.position, rig.noise.position_step / np.sqrt(12.0))
    period_s = float(t_s[-1] - t_s[0]) / max(len(t_s) - 1, 1)
    noise = 0.0884 * sigma**2 * period_s * (2.0 * np.pi * cutoff_hz) ** 3
    return max(4.0 * float(np.sqrt(noise)), 1e-4)


def _poses(name: str, rig: RigFile, rho: Array) -> Array:
    manipulator = build_rig(rig)
    q = np.empty_like(rho)
    guess = manipulator.neutral
    for k, row in enumerate(rho):
        try:
            guess = manipulator.forward(row, guess)
        except KinematicsError as error:
            raise IdentificationError(
                f"{name}: the measured positions fit no pose of the rig {rig.name!r}: {error}. Is it "
                "the rig file of the rig that ran, and are positions in m?"
            ) from error
        q[k] = guess
    return q
