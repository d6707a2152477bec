"""One run: what is sent, what happens, what is answered and stamped.

`Plan` holds all that chance decides apart from the rig (send instants, jitter, tick phase, noise), so that
the same run can be played with and without an effect. Stamps belong to the plan: an effect changes values.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.signal import butter, lfilter

from benchmarks.other_lab import layout as lay
from benchmarks.other_lab.mechanism import AXIS, actuator_positions
from benchmarks.other_lab.plant import THROTTLE_TAU_S, simulate

CHANNELS = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
SETTLE_S = 2.5
"""The drives hold the first setpoint for so long before the record begins."""
FRAME_S = 2.6e-4


@dataclass
class Plan:
    """Chance and motion of one run."""

    kind: str
    t: np.ndarray
    poses: np.ndarray
    with_imu: bool
    seed: int
    sends: np.ndarray
    stamps: dict[str, np.ndarray]

    @property
    def end_s(self):
        """Last instant that is simulated."""
        return self.t[-1] + 0.06

    def rng(self, *what):
        """A generator of its own for each thing that chance decides."""
        return np.random.default_rng([self.seed, *(zlib.crc32(str(w).encode()) for w in what)])


def plan_run(world, kind, t, poses, with_imu, seed):
    """Send instants and stamps of a run on the parameter channel."""
    rig, n = world.rig, len(world.rig.actuators)
    rng = np.random.default_rng([seed, 1])
    late = np.abs(rng.normal(0.0, rig.bus.jitter, len(t))) + (
        rng.random(len(t)) < 0.01
    ) * rng.uniform(0, 1e-3, len(t))
    begin = t + 0.02 + late
    sends = (
        begin[:, None] + np.arange(n) * rig.bus.stagger + np.abs(rng.normal(0.0, 3e-5, (len(t), n)))
    )
    stamps = {}
    answers = (
        sends
        + FRAME_S
        + 3e-4
        + rig.bus.answer_delay
        + rng.normal(0.0, rig.bus.answer_jitter, sends.shape)
    )
    pattern = rig.bus.pattern
    for i, a in enumerate(rig.actuators):
        turn = int(rng.integers(len(pattern)))
        for p, quantity in enumerate(pattern):
            stamps[f"{a.name}.{quantity}"] = answers[(p - turn) % len(pattern) :: len(pattern), i]
    if with_imu:
        period = 1.0 / rig.imu.rate * (1.0 + rng.normal(0.0, 1.5e-5))
        ticks = np.arange(int((t[-1] - 0.02) / period)) * period + rng.uniform(0.02, 0.025)
        ticks += rng.normal(0.0, 2e-5, len(ticks))
        stamps |= {f"imu.{c}": ticks for c in CHANNELS}
    return Plan(kind, t, poses, with_imu, seed, sends, stamps)


def setpoints(world, plan):
    """Nominal actuator positions of the cues (k, n)."""
    rho = np.empty_like(plan.poses)
    actuator_positions(world.kind, world.nominal_joints, world.nominal_neutral, plan.poses, rho)
    if world.kind == AXIS:
        rho += world.rig.actuators[0].home
    return rho


def _arrivals(setup, plan, values, chance):
    """Setpoints as they reach the drives (N, 3), in order of arrival."""
    k, n = values.shape
    at = plan.sends + setup.setpoint_delay + plan.rng("frames", chance).normal(0.0, 1e-5, (k, n))
    if setup.stall_s > 0.0:
        rng, stall_at = plan.rng("stalls"), 1.0
        while stall_at < plan.t[-1]:
            stuck = (at > stall_at) & (at < stall_at + setup.stall_s)
            at[stuck] = stall_at + setup.stall_s + 1e-4 * np.argsort(np.argsort(at[stuck]))
            stall_at += rng.uniform(1.2, 3.0) + setup.stall_s
    kept = plan.rng("lost setpoints").random((k, n)) >= setup.lost_setpoints
    who = np.broadcast_to(np.arange(n), (k, n))
    rows = np.stack([at[kept], who[kept], values[kept]], axis=1)
    return rows[np.argsort(rows[:, 0], kind="stable")]


def _bangs(setup, plan):
    if setup.bang_m == 0.0:
        return np.empty((0, 3))
    rng = plan.rng("bangs")
    at = np.cumsum(rng.exponential(1.6, 40)) + 0.5
    size = setup.bang_m * rng.uniform(0.5, 1.5, 40) * np.where(np.arange(40) % 2 == 0, 1.0, -1.0)
    return np.stack([at, np.full(40, setup.bang_at), size], axis=1)[at < plan.t[-1]]


def play(world, setup, plan, chance=0):
    """(t, columns by signal): what holds in truth behind each signal. `chance` draws what a repeat of the run
    would change though its frames were sent at the same instants: frame delays, clocks, friction."""
    phase, rng = plan.rng("phase"), plan.rng("chance", chance)
    setup = setup.copy()
    n = setup.act.shape[1]
    setup.glob[lay.START] = -SETTLE_S - phase.uniform(0.0, setup.glob[lay.TICK])
    setup.act[lay.TICK_AT] = phase.integers(lay.POSITION_TICKS, size=n)
    setup.glob[lay.TICK] *= 1.0 + rng.normal(0.0, 5e-7)
    setup.act[[lay.COUL_P, lay.COUL_N]] *= rng.normal(1.0, 0.01, n)
    setup.act[lay.VIS] *= rng.normal(1.0, 0.01, n)
    values = setpoints(world, plan)
    q0 = plan.poses[0].copy()
    dense = simulate(
        world.kind, setup.joints, setup.neutral, setup.body, setup.legs, setup.grav, setup.act, setup.glob,
        world.imu_r, _arrivals(setup, plan, values, chance), _bangs(setup, plan), q0, values[0].copy(),
        plan.end_s,
    )  # fmt: skip
    if not np.isfinite(dense).all() or np.abs(dense[:, n : 2 * n]).max() > 1e5:
        raise FloatingPointError("the rig became unstable")
    t = setup.glob[lay.START] + (1 + np.arange(len(dense))) * setup.glob[lay.TICK]
    columns = {}
    for i, a in enumerate(world.rig.actuators):
        columns[f"{a.name}.position"] = dense[:, i]
        columns[f"{a.name}.force"] = dense[:, n + i]
    if plan.with_imu:
        turn = _rotation_vector(setup.misalignment)
        b, c = butter(2, world.rig.imu.bandwidth, fs=1.0 / setup.glob[lay.TICK])
        felt = np.concatenate(
            [dense[:, 3 * n : 3 * n + 3] @ turn, dense[:, 3 * n + 3 :] @ turn], axis=1
        )
        rest = felt[0].copy()
        felt = lfilter(b, c, felt - rest, axis=0) + rest
        for k, name in enumerate(CHANNELS):
            columns[f"imu.{name}"] = felt[:, k]
    return t, columns


def _rotation_vector(v):
    """Rotation by the vector v: columns are the turned axes."""
    angle = float(np.linalg.norm(v))
    if angle == 0.0:
        return np.eye(3)
    k = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]]) / angle
    return np.eye(3) + math.sin(angle) * k + (1.0 - math.cos(angle)) * (k @ k)


def read(world, setup, plan, truth):
    """Values of every signal at its stamps, without noise and rounding but that of effects."""
    t, columns = truth
    rig = world.rig
    homes = {f"{a.name}.position": a.home for a in rig.actuators}
    group_s = math.sqrt(2.0) / (2.0 * math.pi * rig.imu.bandwidth) - rig.imu.delay
    out = {}
    for name, stamps in plan.stamps.items():
        imu = name.startswith("imu.")
        sensors = [setup.sensors[k] for k in (name, "imu" if imu else "") if k in setup.sensors]
        true_s = stamps / (1.0 + (setup.clock_imu if imu else setup.clock_drives))
        true_s = (
            true_s + (group_s if imu else -setup.answer_delay_s) - sum(s.latency_s for s in sensors)
        )
        value = np.interp(true_s, t, columns[name])
        home = homes.get(name, 0.0)
        for s in sensors:
            value = home + s.scale * (value - home) + s.bias
        if setup.stale_share > 0.0 and not imu:
            value = _stale(value, plan.rng("stale", name).random(len(value)) < setup.stale_share)
        for s in sensors:
            if s.step > 0.0:
                value = np.round(value / s.step) * s.step
        out[name] = value
    return out


def _stale(value, old):
    """Where `old`, what was answered before is answered again."""
    at = np.where(old, 0, np.arange(len(value)))
    return value[np.maximum.accumulate(at)]


def noise(world, plan):
    """Noise of every signal: white, a slow coloured part, for forces an offset that creeps in bits."""
    out = {}
    for name, stamps in plan.stamps.items():
        quantity = name.split(".")[-1].split("_")[0]
        sigma = getattr(world.rig.noise, quantity) * world.noise_scale[quantity]
        rng = plan.rng("noise", name)
        period = float(np.median(np.diff(stamps)))
        keep = math.exp(-period / 0.4)
        slow = lfilter(
            [math.sqrt(1.0 - keep * keep)], [1.0, -keep], rng.standard_normal(len(stamps))
        )
        x = sigma * rng.standard_normal(len(stamps)) + 0.15 * sigma * slow
        if quantity == "force":
            creep = np.cumsum(rng.standard_normal(len(stamps))) * math.sqrt(period / 20.0)
            bit = 0.12 * sigma
            x += np.round((0.2 * sigma * creep + rng.uniform(-0.3, 0.3) * sigma) / bit) * bit
        if quantity in ("gyro", "accel"):
            x += rng.uniform(-0.5, 0.5) * sigma
        out[name] = x
    return out


def table(world, setup, plan, clean):
    """The run's rows: signals.parquet's columns, each value at its own stamp."""
    rig, disturbance = world.rig, noise(world, plan)
    columns = []
    for name, value in clean.items():
        quantity = name.split(".")[-1].split("_")[0]
        coarse = max(
            (setup.sensors[k].step for k in (name, name.split(".")[0]) if k in setup.sensors),
            default=0.0,
        )
        step = max(getattr(rig.noise, f"{quantity}_step"), coarse)
        kept = np.full(len(value), True)
        if not name.startswith("imu."):
            kept = plan.rng("lost answers", name).random(len(value)) >= setup.lost_answers
        rounded = np.round((value + disturbance[name]) / step) * step
        columns.append((name, plan.stamps[name][kept], rounded[kept]))
    values = setpoints(world, plan)
    for c, name in enumerate(rig.coordinates):
        columns.insert(c, (f"cue.{name}", plan.sends[:, 0], plan.poses[:, c]))
    for i, a in enumerate(rig.actuators):
        columns.append((f"{a.name}.setpoint", plan.sends[:, i], values[:, i]))
    return _merge(columns)


def mean_square(force, period_s):
    """Mean square force that a drive's heat follows, from samples `period_s` apart."""
    share = period_s / THROTTLE_TAU_S
    square = np.square(force)
    return square[0] + lfilter([share], [1.0, share - 1.0], square - square[0])


def _merge(columns):
    """One table: rows in order of time, equal stamps in one row."""
    parts = [pd.Series(v, index=pd.Index(t, name="t"), name=name) for name, t, v in columns]
    frame = pd.concat(parts, axis=1).sort_index().reset_index()
    return frame.astype("float64")
