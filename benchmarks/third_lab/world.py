"""One run of a plant: setpoint frames over the bus, the engine, what drives and IMU hold at every instant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.signal import butter, sosfilt

from benchmarks.third_lab import columns as c
from benchmarks.third_lab.engine import rotation, simulate
from benchmarks.third_lab.plant import Plant
from benchmarks.third_lab.pose import rest, setpoints

SETTLE_S: Final = 1.5
"""Simulated before the record, so that it starts at rest."""

SETPOINT_STEP: Final = 1e-6
"""m: the drives' increments (`counts_per_unit`)."""


@dataclass(frozen=True)
class Chance:
    """What no two records of one motion share: instants on the bus, lost frames, phases, noise."""

    sent: np.ndarray  # (k,) jitter of setpoint frames, s
    lost: np.ndarray  # (k, n) uniform: a frame is lost where it is below the share
    phases: np.ndarray  # (n,) speed tick on which a drive's position loop runs
    weaken: np.ndarray  # (ms,) torque factor of a drive with dropouts
    seed: int  # of everything that sensors add

    @classmethod
    def draw(cls, rng: np.random.Generator, plant: Plant, cycles: int) -> Chance:
        """Chance of one run of `cycles` bus cycles."""
        bus = plant.rig.bus
        n = len(plant.rig.actuators)
        every = round(bus.position_loop / bus.speed_loop)
        span = round(cycles * bus.cycle * 1000.0)
        weaken = np.ones(span)
        at = 0
        while (at := at + int(rng.exponential(1300.0)) + 150) < span:
            weaken[at : at + int(rng.uniform(25.0, 90.0))] = rng.uniform(0.0, 0.3)
        return cls(
            sent=np.clip(rng.normal(0.0, bus.jitter, cycles), -3.5 * bus.jitter, 3.5 * bus.jitter),
            lost=rng.random((cycles, n)),
            phases=rng.integers(0, every, n),
            weaken=weaken,
            seed=int(rng.integers(2**63)),
        )


@dataclass(frozen=True)
class Trace:
    """A run without sensors: everything at the drives' speed ticks from t = 0."""

    dt: float
    position: np.ndarray  # (n, ticks) m, as drives count
    force: np.ndarray  # (n, ticks) N
    imu: np.ndarray  # (6, ticks) rad/s and m/s² in the platform frame, behind the sensor's filter
    sent_s: np.ndarray  # (k,)
    cue: np.ndarray  # (k, coordinates)
    setpoint: np.ndarray  # (k, n)


def run(plant: Plant, reference: Plant, cue: np.ndarray, chance: Chance) -> Trace:
    """Drive `plant` along `cue`, with setpoints computed for the `reference` (nominal) rig."""
    rig, bus = plant.rig, plant.rig.bus
    cycles, n = len(cue), len(rig.actuators)
    aim = np.round(setpoints(reference, cue) / SETPOINT_STEP) * SETPOINT_STEP
    sent = np.arange(cycles) * bus.cycle + 4.0 * bus.jitter + chance.sent
    arrivals, values = _arrivals(plant, sent, aim, chance.lost)
    origin, q, members = rest(plant, aim[0])
    actuated = plant.actuated >= 0
    hold = np.zeros(n)
    hold[plant.actuated[actuated]] = members[actuated]
    hold = hold * plant.act[:, c.LEAD] / plant.act[:, c.TORQUE]
    attitude = _matrix(q)
    settle = round(SETTLE_S / bus.speed_loop)
    ticks = settle + round((cycles * bus.cycle + 0.1) / bus.speed_loop)
    slosh = plant.slosh.copy()
    slosh[1:4] -= plant.cog
    position, force, imu = simulate(
        plant.act,
        plant.kind,
        plant.actuated,
        plant.cabin - plant.cog,
        plant.base,
        plant.line,
        plant.passive,
        plant.mass - plant.slosh[0],
        plant.inertia,
        plant.gravity,
        plant.floor,
        slosh,
        plant.imu_at - plant.cog,
        np.concatenate([origin + attitude @ plant.cog, q]),
        hold,
        np.ascontiguousarray(aim[0]),
        arrivals,
        values,
        chance.phases,
        chance.weaken,
        -SETTLE_S,
        ticks,
        bus.cycle,
        bus.speed_loop,
        round(bus.position_loop / bus.speed_loop),
    )
    force = _shown(force, round(bus.position_loop / bus.speed_loop))
    if rig.imu:
        sos = butter(2, rig.imu.bandwidth, fs=1.0 / bus.speed_loop, output="sos")
        imu = sosfilt(sos, imu, axis=1)
    return Trace(
        bus.speed_loop, position[:, settle:], force[:, settle:], imu[:, settle:], sent, cue, aim
    )


def _shown(force: np.ndarray, ticks: int) -> np.ndarray:
    """What drives answer as torque: current over the last period of the position loop, no sawtooth."""
    total = np.cumsum(np.pad(force, ((0, 0), (ticks, 0)), "edge"), axis=1)
    return (total[:, ticks:] - total[:, :-ticks]) / ticks


def _arrivals(
    plant: Plant, sent: np.ndarray, aim: np.ndarray, lost: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """When setpoints act at each drive (n, k + 1), inf after the last, and which."""
    n = aim.shape[1]
    times, values = np.full((n, len(sent) + 1), np.inf), np.zeros((n, len(sent) + 1))
    for i in range(n):
        kept = np.flatnonzero(lost[:, i] >= plant.lost_setpoints)
        times[i, : len(kept)] = sent[kept] + plant.act[i, c.SETPOINT_DELAY]
        values[i, : len(kept)] = aim[kept, i]
    return times, values


def _matrix(q: np.ndarray) -> np.ndarray:
    out = np.empty((3, 3))
    rotation(q, out)
    return out
