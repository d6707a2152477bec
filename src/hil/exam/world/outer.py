"""The loop that somebody closes outside the drives: forces told to them so that the rig follows its cue.

Only where the rig file's control mode is not "drive". The host knows the rig file: force for the wanted
motion with the rig's friction, and, through the mass matrix that the actuators feel, a proportional,
derivative and integral answer to how far each of them is off by the position answers that have arrived. An
observer bridges the time between them. It is nobody's loop but this world's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, interp1d

from hil.compiled import inner
from hil.config import RigFile
from hil.control.trajectory import CueTrajectory
from hil.exam.world import layout as lay
from hil.exam.world.body import Sensor, World
from hil.rigs import Manipulator

Array = NDArray[np.float64]
Places = NDArray[np.int64]

ANSWERED: Final = 0.35
"""Product of the loop's bandwidth in rad/s and its dead time: what the phase allows."""
FASTEST: Final = 25.0
ERROR_SHARE: Final = 0.6
RATE_SHARE: Final = 0.25
"""Of what an answer adds, what the observer takes into error and rate."""
INTEGRAL: Final = 0.2
"""Rate of the integral part over the bandwidth."""
COARSE: Final = 8
"""Rows of a trajectory for one mass matrix."""
SMOOTH: Final = 0.02
"""Of an actuator's largest speed: below it Coulomb friction is told in proportion."""


@dataclass(frozen=True, slots=True)
class Asking:
    """What the host works with: its M frames to n actuators, those of one after those of another, and the N
    samples that the world answers."""

    first: Places
    """(n + 1,) frames of actuator i are those from first[i] to first[i + 1]."""
    t_s: Array
    """(M,) when each is sent."""
    newest: Places
    """(M,) place of the newest position answer among all samples, -1 for none."""
    age_s: Array
    """(M,) how old the host believes that to be."""
    wanted: Array
    """(M,) position wanted when it was sampled."""
    ahead: Array
    """(M,) force for the wanted motion."""
    masses: Array
    """(M, n) row of the mass matrix that the actuators feel."""
    host: Array
    """(6, n) bandwidth rad/s, damping ratio; home, scale, bias and step of the position answers."""
    noise: Array
    """(N,)."""


def nothing_asked(n: int) -> Asking:
    """For drives that close their own loops."""
    first, newest = np.zeros(n + 1, dtype=np.int64), np.empty(0, dtype=np.int64)
    none, table = np.empty(0), np.empty((6, n))
    return Asking(first, none, newest, none, none, none, table[:0], table, none)


def asking(
    world: World,
    nominal: Manipulator,
    trajectory: CueTrajectory,
    sent: Sequence[Array],
    stamps: Mapping[str, Array],
    noise: Mapping[str, Array],
    chance: np.random.Generator,
) -> Asking:
    """The host of a motion: `sent`, for each actuator the instants of its frames; `stamps` and `noise`, by
    signal in the order of the samples, when each answer arrives and what its sensor adds."""
    rig, bus = world.rig, world.rig.bus
    starts = dict(zip(noise, np.cumsum([0, *(len(x) for x in noise.values())]), strict=False))
    late_s = bus.setpoint_delay + 0.5 * bus.cycle
    wanted, ahead = _wanted(rig, nominal, trajectory)
    masses = _masses(nominal, trajectory)
    newest, age, told, force, rows, host = [], [], [], [], [], []
    for i, a in enumerate(rig.actuators):
        signal = f"{a.name}.position"
        at = np.searchsorted(stamps[signal], sent[i], side="right") - 1
        sampled = stamps[signal][np.maximum(at, 0)] - bus.answer_delay
        newest.append(np.where(at >= 0, at + starts[signal], -1))
        age.append(sent[i] - sampled)
        told.append(np.interp(sampled, trajectory.t_s, wanted[:, i]))
        force.append(np.interp(sent[i] + late_s, trajectory.t_s, ahead[:, i]))
        rows.append(masses(sent[i] + late_s)[:, i])
        dead_s = late_s + bus.answer_delay + 0.5 * float(np.median(np.diff(stamps[signal])))
        bandwidth = min(ANSWERED / dead_s, FASTEST) * chance.uniform(0.6, 1.0)
        sensor = world.sensors.get(signal, Sensor())
        step = max(sensor.step, rig.noise.position_step, 1e-12)
        damping = chance.uniform(0.8, 1.2)
        host.append((bandwidth, damping, a.home, sensor.scale, sensor.bias, step))
    return Asking(
        np.cumsum([0, *(len(t) for t in sent)]), np.concatenate(sent), np.concatenate(newest),
        np.concatenate(age), np.concatenate(told), np.concatenate(force), np.concatenate(rows),
        np.array(host).T.copy(), np.concatenate(list(noise.values())),
    )  # fmt: skip


def _wanted(rig: RigFile, nominal: Manipulator, trajectory: CueTrajectory) -> tuple[Array, Array]:
    """(T, n) positions of the actuators along a trajectory, and forces that the rig file knows for it."""
    t = trajectory.t_s
    path = CubicSpline(t, trajectory.poses)
    viscous = np.array([a.viscous for a in rig.actuators])
    coulomb = np.array([a.coulomb for a in rig.actuators])
    slow = SMOOTH * np.array([a.velocity_max for a in rig.actuators])
    positions, forces = [], []
    for q, qd, qdd in zip(path(t), path(t, 1), path(t, 2), strict=True):
        rate = nominal.rates(q, qd)
        friction = viscous * rate + coulomb * np.tanh(rate / slow)
        positions.append(nominal.inverse(q))
        forces.append(nominal.inverse_dynamics(q, qd, qdd) + friction)
    return np.array(positions), np.array(forces)


def _masses(nominal: Manipulator, trajectory: CueTrajectory) -> Callable[[Array], Array]:
    """Gives at instants (K,) the mass matrix (K, n, n) that the actuators feel along a trajectory."""
    t = trajectory.t_s[::COARSE]
    still = np.zeros(len(trajectory.coordinates))
    felt = []
    for q in trajectory.poses[::COARSE]:
        rest = nominal.inverse_dynamics(q, still, still)
        ways = np.linalg.inv(nominal.jacobian(q)).T
        felt.append([nominal.inverse_dynamics(q, still, way) - rest for way in ways])
    ends = (felt[0], felt[-1])
    between: Callable[[Array], Array] = interp1d(
        t, np.array(felt), axis=0, bounds_error=False, fill_value=ends
    )
    return between


@inner
def ask(st, i, k, t, out, newest, age, wanted, ahead, masses, host, noise):  # type: ignore[no-untyped-def]
    """Force that the host sends actuator i in frame k at instant t."""
    dt, pushed = t - st[lay.S_HOST_T, i], st[lay.S_HOST_PUSH, i]
    st[lay.S_HOST_T, i] = t
    st[lay.S_HOST_E, i] += dt * (st[lay.S_HOST_ED, i] - 0.5 * dt * pushed)
    st[lay.S_HOST_ED, i] -= dt * pushed
    j = newest[k]
    if j >= 0 and j != st[lay.S_HOST_J, i]:
        every = max(t - st[lay.S_HOST_HEARD, i], 1e-3)
        st[lay.S_HOST_J, i] = j
        st[lay.S_HOST_HEARD, i] = t
        home, step = host[2, i], host[5, i]
        read = home + host[3, i] * (out[j] - home) + host[4, i] + noise[j]
        read = math.floor(read / step + 0.5) * step
        more = wanted[k] - read - (st[lay.S_HOST_E, i] - age[k] * st[lay.S_HOST_ED, i])
        st[lay.S_HOST_E, i] += ERROR_SHARE * more
        st[lay.S_HOST_ED, i] += RATE_SHARE * more / every
    w, error = host[0, i], st[lay.S_HOST_E, i]
    st[lay.S_HOST_SUM, i] += dt * error
    st[lay.S_HOST_PUSH, i] = w * w * error + 2.0 * host[1, i] * w * st[lay.S_HOST_ED, i]
    force = ahead[k]
    for a in range(masses.shape[1]):
        slow = INTEGRAL * host[0, a] ** 3 * st[lay.S_HOST_SUM, a]
        force += masses[k, a] * (st[lay.S_HOST_PUSH, a] + slow)
    return force
