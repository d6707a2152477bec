"""Experiments whose truth is known: a rig with other numbers, played and sampled as the daemon does it."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd

from hil.config import RigFile
from hil.identify.estimate.names import with_numbers
from hil.identify.estimate.traffic import frame_s, played_again
from hil.identify.replay import Stretch
from hil.rigs import build_rig
from hil.runs import Run, RunMeta
from hil.sim.twin import Payload, Twin

Array = np.ndarray


def without_noise(rig: RigFile) -> RigFile:
    """`rig` with perfect sensors."""
    none = dict.fromkeys(type(rig.noise).model_fields, 0.0)
    return rig.model_copy(update={"noise": rig.noise.model_copy(update=none)})


def multisine(
    rig: RigFile, duration_s: float, seed: int, top_hz: float, share: float = 0.7
) -> Array:
    """(N, n) poses each bus cycle: random phases, all coordinates at once, within the rig's limits.

    Fades in and out; amplitude so that position, speed and acceleration keep to `share` of their limits.
    """
    rng = np.random.default_rng(seed)
    cycle = rig.bus.cycle
    t = np.arange(0.0, duration_s, cycle)
    fade = np.clip(np.minimum(t, duration_s - t) / (0.15 * duration_s), 0.0, 1.0)
    fade = fade**3 * (10.0 - 15.0 * fade + 6.0 * fade**2)
    lines = np.arange(0.2, top_hz, 1.0 / (0.5 * duration_s))
    speed, acceleration, _ = rig.cue_limits()
    poses = np.empty((len(t), len(rig.coordinates)))
    for k, limit in enumerate(rig.limits):
        phase = rng.uniform(0.0, 2.0 * np.pi, len(lines))
        x = fade * (np.cos(2.0 * np.pi * np.outer(t, lines) + phase) / lines).sum(axis=1)
        v, a = np.gradient(x, cycle), np.gradient(np.gradient(x, cycle), cycle)
        size = max(abs(x).max() / limit, abs(v).max() / speed[k], abs(a).max() / acceleration[k])
        poses[:, k] = share * x / size
    return poses


def play(
    rig: RigFile,
    poses: Array,
    *,
    truth: Mapping[str, float] | None = None,
    effects: Mapping[str, float] | None = None,
    seed: int = 0,
    position_noise_m: float | None = None,
    payload: Payload | None = None,
    name: str = "run",
) -> Stretch:
    """What `rig` answers to `poses`, where its numbers are `truth` and it has `effects`.

    Setpoints go out and answers come back on the parameter channel: slots staggered, position and force in
    turn, all with the rig file's jitter, noise and quantisation.
    """
    rng = np.random.default_rng(seed)
    bus, noise, n = rig.bus, rig.noise, len(rig.actuators)
    manipulator = build_rig(rig)
    strokes = np.array([manipulator.inverse(q) for q in poses])
    start = 1.0 + bus.cycle * np.arange(len(poses))
    setpoints, stamps = {}, {}
    for i, actuator in enumerate(rig.actuator_names):
        sent = start + i * bus.stagger + np.abs(rng.normal(0.0, bus.jitter, len(start)))
        setpoints[actuator] = (sent, strokes[:, i])
        answered = sent + 2e-3 + bus.answer_jitter * rng.standard_normal(len(sent))
        for turn, quantity in enumerate(bus.pattern):
            stamps[f"{actuator}.{quantity}"] = answered[turn :: len(bus.pattern)]
    true_rig = with_numbers(rig, truth or {})
    twin = Twin(true_rig, payload=payload)
    answers = twin.replay(setpoints, stamps, twin.table.vector(effects or {}, twin.parameters))
    samples = {}
    for i in range(n):
        actuator = rig.actuator_names[i]
        for quantity in bus.pattern:
            signal = f"{actuator}.{quantity}"
            spread, step = getattr(noise, quantity), getattr(noise, f"{quantity}_step")
            if quantity == "position" and position_noise_m is not None:
                spread = position_noise_m
            value = answers[signal] + spread * rng.standard_normal(len(answers[signal]))
            samples[signal] = (stamps[signal], np.round(value / step) * step if step else value)
    return Stretch(name, setpoints, samples, "position", payload)


def play_on_bus(rig: RigFile, poses: Array, *, late_s: float, seed: int = 0) -> Stretch:
    """As `play`, on the bus of the simulated rig while nobody else speaks: a drive samples when its slot's
    request comes, behind the control frame; the answer waits for the drive's status, and the stamps hold the
    jitter of both. Setpoints come `late_s` later than their stamps and the rig file's delay say."""
    rng = np.random.default_rng(seed)
    bus, frame = rig.bus, frame_s(rig.can.bitrate)
    told = play(rig, poses, seed=seed).setpoints
    replies = [
        bus.answer_delay + bus.answer_jitter * rng.standard_normal((2, len(t)))
        for t, _ in told.values()
    ]
    sent = [t for t, _ in told.values()]
    traffic = played_again(sent, np.empty(0), rig.can.bitrate, replies, one_queue=True)
    sampled, stamps = {}, {}
    for i, actuator in enumerate(rig.actuator_names):
        for turn, quantity in enumerate(bus.pattern):
            k = slice(turn, None, len(bus.pattern))
            sampled[f"{actuator}.{quantity}"] = sent[i][k] + 2.0 * frame + bus.answer_delay
            stamps[f"{actuator}.{quantity}"] = traffic.answers[i][k]
    acting = {a: (t + late_s, x) for a, (t, x) in told.items()}
    samples = {}
    for signal, value in Twin(rig).replay(acting, sampled).items():
        quantity = signal.rpartition(".")[2]
        noise = getattr(rig.noise, quantity) * rng.standard_normal(len(value))
        step = getattr(rig.noise, f"{quantity}_step")
        samples[signal] = (stamps[signal], np.round((value + noise) / step) * step)
    return Stretch("run", told, samples)


def as_run(piece: Stretch, rig: RigFile, **changed: Array) -> Run:
    """`piece` as the reader would hand it over; `changed`: signals (dots as `__`) with other values."""
    columns = {f"{a}.setpoint": s for a, s in piece.setpoints.items()} | dict(piece.samples)
    for name, values in changed.items():
        signal = name.replace("__", ".")
        columns[signal] = (columns[signal][0], values)
    grid = np.unique(np.concatenate([t for t, _ in columns.values()]))
    table = {"t": grid}
    for signal, (t, values) in columns.items():
        table[signal] = np.full(len(grid), np.nan)
        table[signal][np.searchsorted(grid, t)] = values
    meta = RunMeta(rig=rig.name, started=datetime(2026, 1, 1, tzinfo=UTC))
    return Run(Path(piece.name), meta, rig, pd.DataFrame(table), pd.DataFrame({"t": []}), ())
