"""A motion played on the exam's world and recorded as its drives, bus and sensors would have it.

Where the rig file's control mode is not "drive", a loop outside the drives tells them forces (`outer`).

Two chances: `seen`, what the record tells (send times), and `hidden`, what it does not (waits on the bus,
when an answer was really sampled, sensor noise). Records that differ only in `hidden` differ by the floor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from hil.control.trajectory import CueTrajectory
from hil.errors import HilError
from hil.exam.world import layout as lay
from hil.exam.world.body import Sensor, World
from hil.exam.world.kernel import simulate
from hil.exam.world.outer import Asking, asking, nothing_asked
from hil.exam.world.traffic import Exchanged, exchanged, rising, sampled
from hil.rigs import Manipulator
from hil.rigs.solutions import forward_kinematics
from hil.runs.folder import run_mode
from hil.runs.table import TableBuilder, signal_order
from hil.sim.catalogue import IMU_CHANNELS, QUANTITIES

Array = NDArray[np.float64]


class WorldError(HilError):
    """The world could not play a case: it diverged, or its mechanism does not close."""


@dataclass(frozen=True, slots=True)
class Played:
    """A record: by signal receive stamps (N,), answers (N,), and the same values without noise."""

    stamps: dict[str, Array]
    values: dict[str, Array]
    clean: dict[str, Array]
    setpoints: dict[str, tuple[Array, Array]]
    wanted: dict[str, tuple[Array, Array]]
    """By actuator, instants and the positions that its cue asks for."""
    cues: dict[str, tuple[Array, Array]]

    def table(self, world: World) -> pd.DataFrame:
        """As the table of a run folder."""
        builder = TableBuilder()
        for name, (t, v) in (*self.cues.items(), *self.setpoints.items()):
            for a, b in zip(t.tolist(), v.tolist(), strict=True):
                builder.add(name, round(a, 7), b)
        for name, t in self.stamps.items():
            for a, b in zip(t.tolist(), self.values[name].tolist(), strict=True):
                builder.add(name, round(a, 7), b)
        return builder.table("exam", signal_order(world.rig))


def play(
    world: World,
    trajectory: CueTrajectory,
    *,
    seen: int,
    hidden: int,
    with_imu: bool,
) -> Played:
    """Play `trajectory` (rows from 0 s) and record it; WorldError where the world cannot.

    Setpoints come from the rig file's geometry, forces from its dynamics: the daemon knows no better.
    """
    rig, bus = world.rig, world.rig.bus
    n, nominal = len(rig.actuators), Manipulator(rig)
    chance, dark = np.random.default_rng([seen, 1]), np.random.default_rng([hidden, 2])
    t_k = np.arange(0.0, trajectory.duration_s, bus.cycle)
    poses = np.column_stack(
        [np.interp(t_k, trajectory.t_s, trajectory.poses[:, c]) for c in range(n)]
    )
    rho = np.array([nominal.inverse(q) for q in poses])
    drives = [exchanged(world, i, t_k, chance, dark) for i in range(n)]
    asked = {s: v for drive in drives for s, v in drive.answers.items()}
    if with_imu and rig.imu is not None:
        asked |= sampled(world, trajectory.duration_s, dark)
    noise = {s: _noise(world, s, len(x.taken_s), dark) for s, x in asked.items()}
    host = nothing_asked(n)
    if is_told := run_mode(rig) == "force":
        received = {s: x.received_s for s, x in asked.items()}
        sent = [drive.sent_s for drive in drives]
        host = asking(world, nominal, trajectory, sent, received, noise, chance)
    flat, forces = _simulated(
        world, nominal, (poses[0], rho[0]), drives, rho, host,
        {s: x.taken_s for s, x in asked.items()}, with_imu,
    )  # fmt: skip
    said = np.split(forces, n) if is_told else list(rho.T)
    kind = "force_setpoint" if is_told else "setpoint"
    later = {s: x.stamps_s >= 0.0 for s, x in asked.items()}
    clean = {s: _answered(world, s, exact, None)[later[s]] for s, exact in flat.items()}
    values = {s: _answered(world, s, exact, noise[s])[later[s]] for s, exact in flat.items()}
    return Played(
        {s: rising(x.stamps_s)[later[s]] for s, x in asked.items()},
        values,
        clean,
        {
            f"{a}.{kind}": (d.sent_s, v)
            for a, d, v in zip(rig.actuator_names, drives, said, strict=True)
        },
        {a: (t_k, rho[:, i]) for i, a in enumerate(rig.actuator_names)},
        {f"cue.{c}": (t_k, poses[:, j]) for j, c in enumerate(rig.coordinates)},
    )


def _noise(world: World, signal: str, count: int, dark: np.random.Generator) -> Array:
    """(count,) noise of a signal's sensor."""
    share = float(world.noise_share[1 if signal.startswith("imu.") else 0])
    spread = float(getattr(world.rig.noise, _quantity(signal)))
    return share * spread * dark.standard_normal(count)


def _simulated(
    world: World,
    nominal: Manipulator,
    start: tuple[Array, Array],
    drives: list[Exchanged],
    rho: Array,
    host: Asking,
    instants: dict[str, Array],
    with_imu: bool,
) -> tuple[dict[str, Array], Array]:
    """By signal, what the world answers, and the forces (M,) that the host told: from the pose and positions
    `start`; `rho` (K, n): setpoints, where those are positions."""
    rig, n = world.rig, len(world.rig.actuators)
    head = world.head.copy()
    head[lay.H_IMU] = with_imu and rig.imu is not None
    columns = {
        f"{a}.{q}": k * n + i
        for k, q in enumerate(QUANTITIES[:3])
        for i, a in enumerate(rig.actuator_names)
    }
    columns |= {f"{a}.current": 2 * n + i for i, a in enumerate(rig.actuator_names)}
    columns |= {f"imu.{c}": 4 * n + k for k, c in enumerate(IMU_CHANNELS)}
    times = [np.maximum.accumulate(t) for t in instants.values()]
    out = np.full(sum(map(len, times)), np.nan)
    forces = np.zeros(len(host.t_s))
    frames = np.arange(rho.size).reshape(n, -1) if len(host.t_s) else rho.T
    told = [frames[i, d.kept].astype(float) for i, d in enumerate(drives)]
    ok = simulate(
        (head, world.act, world.true, world.nominal, world.legs, world.imu),
        (_closed(world, *start), start[1].copy()),
        (
            np.cumsum([0] + [len(x) for x in told]),
            np.concatenate([d.arrived_s for d in drives]),
            np.concatenate(told),
        ),
        (
            host.first,
            host.t_s,
            host.newest,
            host.age_s,
            host.wanted,
            host.ahead,
            host.masses,
            host.host,
            host.noise,
            forces,
        ),
        (
            np.cumsum([0] + [len(t) for t in times]),
            np.concatenate(times),
            np.array([columns[s] for s in instants], dtype=np.int64),
        ),
        out,
    )
    if not ok or not np.all(np.isfinite(out)):
        raise WorldError(f"{rig.name}: the exam's world diverged")
    parts = np.cumsum([0] + [len(t) for t in times])
    parted = zip(instants, parts[:-1], parts[1:], strict=True)
    return {s: out[a:b] for s, a, b in parted}, forces


def _closed(world: World, pose: Array, rho: Array) -> Array:
    """The pose at which the world's own geometry has the drives where they believe to be."""
    q = pose.copy()
    act = world.act
    aim = act[lay.A_HOME] + (rho - act[lay.A_HOME] - act[lay.A_OFFSET]) * act[lay.A_LEAD]
    geometry, body, gravity = world.true
    kind = int(world.head[lay.H_KIND])
    left, _ = forward_kinematics(kind, geometry, body, world.legs, gravity, aim, q, 1e-10, 30)
    if not left <= 1e-9:
        raise WorldError(f"{world.rig.name}: the world's mechanism does not close")
    return q


def _answered(world: World, signal: str, exact: Array, noise: Array | None) -> Array:
    """What the sensor says of `exact`; without noise and the rig file's own rounding where that is None."""
    rig, sensor = world.rig, world.sensors.get(signal, Sensor())
    place, quantity = signal.partition(".")[0], _quantity(signal)
    home = 0.0
    value = exact
    if place != "imu":
        i = rig.actuator_names.index(place)
        home = rig.actuators[i].home if quantity == "position" else 0.0
        if quantity == "current":
            value = exact / world.act[lay.A_PER_AMPERE, i]
    value = home + sensor.scale * (value - home) + sensor.bias
    step = sensor.step
    if noise is not None:
        value = value + noise
        step = max(step, getattr(rig.noise, f"{quantity}_step"))
    return np.asarray(np.round(value / step) * step if step > 0.0 else value)


def _quantity(signal: str) -> str:
    """position, velocity, force, current, gyro or accel."""
    return signal.partition(".")[2].partition("_")[0]
