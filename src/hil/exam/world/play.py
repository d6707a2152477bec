"""A motion played on the exam's world and recorded as its drives, bus and sensors would have it.

Two chances: `seen`, what the record tells (send times), and `hidden`, what it does not (waits on the bus,
when an answer was really sampled, sensor noise). Records that differ only in `hidden` differ by the floor.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from hil.control.trajectory import CueTrajectory
from hil.errors import HilError
from hil.exam.world import layout as lay
from hil.exam.world.body import Sensor, World
from hil.exam.world.kernel import simulate
from hil.rigs import Manipulator
from hil.rigs.solutions import forward_kinematics
from hil.runs.table import TableBuilder, signal_order
from hil.sim.catalogue import IMU_CHANNELS, QUANTITIES

Array = NDArray[np.float64]

FRAME_BITS: Final = 125
"""A frame of eight bytes; a number of this world's own, as all of it is."""
BUSY: Final = 0.3
"""Chance that a frame finds the bus taken."""
TALK_S: Final = 5e-4
"""From a slot's start until the drive has the request."""


class WorldError(HilError):
    """The world could not play a case: it diverged, or its mechanism does not close."""


@dataclass(frozen=True, slots=True)
class Played:
    """A record: by signal receive stamps (N,), answers (N,), and the same values without noise."""

    stamps: dict[str, Array]
    values: dict[str, Array]
    clean: dict[str, Array]
    setpoints: dict[str, tuple[Array, Array]]
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

    Setpoints come from the rig file's geometry: the daemon knows no better.
    """
    rig, bus = world.rig, world.rig.bus
    n, nominal = len(rig.actuators), Manipulator(rig)
    chance, dark = np.random.default_rng([seen, 1]), np.random.default_rng([hidden, 2])
    t_k = np.arange(0.0, trajectory.duration_s, bus.cycle)
    poses = np.column_stack(
        [np.interp(t_k, trajectory.t_s, trajectory.poses[:, c]) for c in range(n)]
    )
    rho = np.array([nominal.inverse(q) for q in poses])
    cues = {f"cue.{c}": (t_k, poses[:, j]) for j, c in enumerate(rig.coordinates)}
    frame_s = FRAME_BITS / rig.can.bitrate
    arrivals, told, setpoints = [], [], {}
    stamps: dict[str, Array] = {}
    instants: dict[str, Array] = {}
    lost = world.lost
    for i, name in enumerate(rig.actuator_names):
        slot = bus.stagger * i if bus.schedule == "parameter" else 0.0
        sent = _rising(t_k + slot + np.abs(chance.normal(0.0, bus.jitter, len(t_k))))
        wait = frame_s * dark.random(len(sent)) * (dark.random(len(sent)) < BUSY)
        there = sent + bus.setpoint_delay + world.setpoint_delay_s[i] + wait - 0.5 * BUSY * frame_s
        kept = dark.random(len(sent)) >= lost.get("setpoints", 0.0)
        kept[0] = True
        arrivals.append(_rising(there)[kept])
        told.append(rho[kept, i])
        setpoints[f"{name}.setpoint"] = (sent, rho[:, i])
        pattern = bus.pattern
        for q in dict.fromkeys(pattern):
            if bus.schedule == "parameter":
                asked = np.isin(
                    np.arange(len(sent)) % len(pattern),
                    [k for k, x in enumerate(pattern) if x == q],
                )
            else:
                asked = np.ones(len(sent), dtype=bool)
            stamp = sent[asked] + TALK_S + bus.answer_delay + frame_s * dark.random(asked.sum())
            stamp = stamp[dark.random(len(stamp)) >= lost.get("answers", 0.0)]
            signal = f"{name}.{q}"
            taken = stamp - bus.answer_delay - world.answer_delay_s[i]
            taken = taken + dark.normal(0.0, bus.answer_jitter, len(stamp))
            stamps[signal] = stamp * (1.0 + world.clocks.get("drives", 0.0))
            instants[signal] = taken - world.sensors.get(signal, Sensor()).latency_s
    if with_imu and rig.imu is not None:
        t = np.arange(0.003 * dark.random(), trajectory.duration_s, 1.0 / rig.imu.rate)
        for channel in IMU_CHANNELS:
            signal = f"imu.{channel}"
            stamps[signal] = (t - rig.imu.group_delay_s + rig.imu.delay) * (
                1.0 + world.clocks.get("imu", 0.0)
            )
            instants[signal] = (
                t + dark.normal(0.0, 2e-5) - world.sensors.get(signal, Sensor()).latency_s
            )
    flat = _simulated(world, nominal, poses[0], rho[0], arrivals, told, instants, with_imu)
    values, clean = {}, {}
    for signal, exact in flat.items():
        clean[signal] = _answered(world, signal, exact, None)
        values[signal] = _answered(world, signal, exact, dark)
    later = {s: t >= 0.0 for s, t in stamps.items()}
    return Played(
        {s: _rising(t)[later[s]] for s, t in stamps.items()},
        {s: v[later[s]] for s, v in values.items()},
        {s: v[later[s]] for s, v in clean.items()},
        setpoints,
        cues,
    )


def _simulated(
    world: World,
    nominal: Manipulator,
    pose: Array,
    rho: Array,
    arrivals: list[Array],
    told: list[Array],
    instants: dict[str, Array],
    with_imu: bool,
) -> dict[str, Array]:
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
    ok = simulate(
        (head, world.act, world.true, world.nominal, world.legs, world.imu),
        (_closed(world, pose, rho), rho.copy()),
        (
            np.cumsum([0] + [len(t) for t in arrivals]),
            np.concatenate(arrivals),
            np.concatenate(told),
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
    return {s: out[a:b] for s, a, b in zip(instants, parts[:-1], parts[1:], strict=True)}


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


def _answered(world: World, signal: str, exact: Array, rng: np.random.Generator | None) -> Array:
    """What the sensor says of `exact`; without noise and the rig file's own rounding where rng is None."""
    rig, sensor = world.rig, world.sensors.get(signal, Sensor())
    place, _, rest = signal.partition(".")
    quantity = rest.partition("_")[0]
    home = 0.0
    value = exact
    if place != "imu":
        i = rig.actuator_names.index(place)
        home = rig.actuators[i].home if quantity == "position" else 0.0
        if quantity == "current":
            value = exact / world.act[lay.A_PER_AMPERE, i]
    value = home + sensor.scale * (value - home) + sensor.bias
    step = sensor.step
    if rng is not None:
        share = float(world.noise_share[0 if place != "imu" else 1])
        value = value + share * getattr(rig.noise, quantity) * rng.standard_normal(len(value))
        step = max(step, getattr(rig.noise, f"{quantity}_step"))
    return np.asarray(np.round(value / step) * step if step > 0.0 else value)


def _rising(t: Array) -> Array:
    return np.maximum.accumulate(t)
