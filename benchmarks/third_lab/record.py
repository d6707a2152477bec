"""The record of a run: setpoint rows, one answer a slot and drive, the IMU's rows; dense for severity."""

from __future__ import annotations

import numpy as np
import pandas as pd

from benchmarks.third_lab.plant import Plant
from benchmarks.third_lab.sensing import IMU, Sensing, instants, reading, signals
from benchmarks.third_lab.world import Chance, Trace

REQUEST_S = 7e-4
"""First drive's sample instant after the start of its cycle, s."""

DENSE_S = 0.004
"""Grid on which two records are held against each other, s."""


def table(plant: Plant, sensing: Sensing, trace: Trace, chance: Chance) -> pd.DataFrame:
    """All samples of the run, one row an instant, in the order of the contract's columns."""
    rng = np.random.default_rng([chance.seed, 1])
    rig, bus = plant.rig, plant.rig.bus
    cycles = len(trace.sent_s)
    columns: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for j, name in enumerate(rig.coordinates):
        columns[f"cue.{name}"] = trace.sent_s, trace.cue[:, j]
    for i, name in enumerate(rig.actuator_names):
        columns[f"{name}.setpoint"] = trace.sent_s, trace.setpoint[:, i]
        turn = rng.integers(len(bus.pattern))
        slots = np.arange(cycles) * bus.cycle + REQUEST_S + 4.0 * bus.jitter + i * bus.stagger
        sampled = slots + 0.3 * chance.sent + rng.normal(0.0, 4e-5, cycles)
        delay = sensing.answer_delay[i] + np.abs(rng.normal(0.0, bus.answer_jitter, cycles))
        stamps = (sampled + delay) * (1.0 + sensing.clock.get("drives", 0.0))
        kept = rng.random(cycles) >= sensing.lost_answers
        for k, quantity in enumerate(bus.pattern):
            mine = (np.arange(cycles) + turn) % len(bus.pattern) == k
            values = reading(
                plant, sensing, trace, f"{name}.{quantity}", sampled[mine], chance.seed
            )
            columns[f"{name}.{quantity}"] = stamps[mine][kept[mine]], values[kept[mine]]
    if rig.imu:
        stamps = np.arange(0.003 + rng.uniform(0, 0.004), cycles * bus.cycle, 1.0 / rig.imu.rate)
        stamps = stamps + rng.normal(0.0, 5e-5, len(stamps))
        for name in IMU:
            sampled = instants(plant, sensing, name, stamps)
            columns[name] = stamps, reading(plant, sensing, trace, name, sampled, chance.seed)
    grid = np.unique(np.concatenate([t for t, _ in columns.values()]))
    out: dict[str, np.ndarray] = {"t": grid}
    for name, (t, values) in columns.items():
        out[name] = np.full(len(grid), np.nan)
        out[name][np.searchsorted(grid, t)] = values
    return pd.DataFrame(out)


def dense(plant: Plant, sensing: Sensing, trace: Trace, chance: Chance) -> dict[str, np.ndarray]:
    """Every signal on one regular grid of stamps, with the run's own chance."""
    end = (len(trace.sent_s) - 5) * (trace.sent_s[-1] / len(trace.sent_s))
    stamps = np.arange(0.1, end, DENSE_S)
    return {
        name: reading(
            plant, sensing, trace, name, instants(plant, sensing, name, stamps), chance.seed
        )
        for name in signals(plant)
    }
