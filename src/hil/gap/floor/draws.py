"""What noise looks like: recordings of the twin itself, with the sensors and the bus of the rig file.

One draw replays the stretches with what the rig file leaves to chance: a setpoint frame waits for the bus,
so it may reach the drive in another tick than its stamp says; an answer's delay varies; the sensor adds
noise and rounds. A draw minus the smooth prediction is what a residual is where there is no gap at all.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from hil.bus.load import RECKONED_BITS
from hil.config import RigFile
from hil.gap.record.led import replay_led
from hil.gap.record.problem import Problem, Series
from hil.gap.record.replays import run_all
from hil.gap.record.ticks import AtSync, Ticks, acting
from hil.identify.replay import Stretch

Array = NDArray[np.float64]

STAMP_SHARE: Final = 0.02
"""Of a tick of the position loop: no stamp is believed to tell better than that when its value held [R].
Otherwise an encoder without noise would count a microsecond of timing as gap."""
WAIT_FRAMES: Final = 1.0
"""A frame waits for the one that is on the bus [R]."""
UNKNOWN: Final = 0.5
"""Of the noise of a force sensor, which in mode "position" hides what friction and masses are off by: where
forces are set nothing hides it, and a soft spring shows a newton [R]."""
UNKNOWN_HZ: Final = 3.0
FOLLOWED: Final = 2e-6
"""m or rad, slower than UNKNOWN_HZ: how near a twin comes to where a drive really is. Encoders tell a tenth
of a micrometre; friction's first micrometres, a screw's pitch and a drive's sums are not known so well [R;
healthy rigs of two worlds of others are up to 2.4 micrometres off]."""
BUSY: Final = 0.4
"""Chance that one is [R]."""


def longest_wait_s(rig: RigFile) -> float:
    """Most that a setpoint waits for the bus: no more than the rig file's setpoint delay, which has it in."""
    return min(WAIT_FRAMES * RECKONED_BITS / rig.can.bitrate, rig.bus.setpoint_delay)


def draws(
    problem: Problem, vector: Array, rng: np.random.Generator, count: int
) -> tuple[Array, Array]:
    """Residuals of records that the twin itself made, against `problem`'s own prediction: what timing makes
    of them, (count, N), and what the sensors add, (count, N).

    Frames wait for the bus, of drives at SYNC as many as are known to; drives whose ticks are not known have
    them anywhere.
    """
    rig = problem.rig
    base = problem.predict(vector)[0]
    longest_s = longest_wait_s(rig)
    tasks = []
    leading: list[tuple[int, slice, Array]] = []
    for d in range(count):
        for k, piece in enumerate(problem.sent):
            told, ticked = {}, []
            for a, (t, v) in piece.setpoints.items():
                ticks = problem.clocks.get((k, a)) or _anywhere(rig, rng)
                if ticks is not None:
                    ticked.append(a)
                if isinstance(ticks, AtSync):
                    told[a] = (acting(rig, t, ticks.drawn(rng)), v)
                else:
                    told[a] = (acting(rig, _waited(t, longest_s, rng), ticks), v)
                if piece.mode == "force":
                    told[a] = (told[a][0], v + _unknown_force(rig, v.shape, rng))
            series = [x for x in problem.series if x.stretch == k]
            stamps = {x.signal: _late(piece, x, rig, rng) for x in series}
            lead: dict[str, tuple[Array, Array]] = {}
            for x in series:
                if piece.mode == "force" and x.quantity == "position":
                    # What leads the twin is noisy too: of that the residual lacks what the twin follows.
                    noise = _sensed(base[x.part], rig, x, rng) - base[x.part]
                    leading.append((d, x.part, noise))
                    lead[x.actuator] = (stamps[x.signal], piece.samples[x.signal][1] - noise)
            drawn = replace(piece, setpoints=told, ticked=ticked)
            tasks.append((replay_led(rig, drawn, stamps, lead), vector))
    flat = run_all(tasks)
    per = len(problem.sent)
    out = np.array([np.concatenate(flat[d * per : (d + 1) * per]) for d in range(count)])
    sensed = np.empty_like(out)
    for x in problem.series:
        sensed[:, x.part] = _sensed(out[:, x.part], rig, x, rng)
    for d, part, noise in leading:
        sensed[d, part] = out[d, part] + noise
    return np.asarray(out - base), np.asarray(sensed - out)


def _unknown_force(rig: RigFile, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """A slow force, one for each setpoint, that no twin knows."""
    return UNKNOWN * rig.noise.force * _slow(shape, rig.bus.cycle, rng)


def followed(problem: Problem, rng: np.random.Generator, count: int) -> Array:
    """(count, N): what of a position no twin follows, where drives are told positions."""
    out = np.zeros((count, problem.size))
    for x in problem.series:
        t = problem.t_s[x.part]
        if x.quantity == "position" and problem.pieces[x.stretch].mode == "position" and len(t) > 1:
            step_s = float(np.median(np.diff(t)))
            out[:, x.part] = FOLLOWED * _slow((count, len(t)), step_s, rng)
    return out


def _slow(shape: tuple[int, ...], step_s: float, rng: np.random.Generator) -> Array:
    """Noise slower than UNKNOWN_HZ, sampled each `step_s` along the last axis, of spread 1."""
    keep = np.exp(-2.0 * np.pi * UNKNOWN_HZ * step_s)
    push = np.sqrt(1.0 - keep**2) * rng.standard_normal(shape)
    return np.asarray(lfilter([1.0], [1.0, -keep], push))


def _anywhere(rig: RigFile, rng: np.random.Generator) -> Ticks | None:
    if rig.bus.retimed or rig.bus.interpolation == "hold":
        return None
    return Ticks(float(rng.random()) * rig.bus.position_loop, 0.0, 0.0)


def sensor_sigma(rig: RigFile, x: Series) -> float:
    """Noise of one sample with its rounding, by the rig file, in the signal's unit; never 0."""
    spread, step = sensor_noise(rig, x.quantity)
    return float(np.hypot(spread, step / np.sqrt(12.0))) or 1e-12


def sensor_noise(rig: RigFile, quantity: str) -> tuple[float, float]:
    """Standard deviation and step of position, velocity, force, current, gyro or accel."""
    noise = rig.noise
    return float(getattr(noise, quantity)), float(getattr(noise, f"{quantity}_step"))


def _waited(t: Array, wait_s: float, rng: np.random.Generator) -> Array:
    """Send stamps with a wait drawn for each, less the mean wait, which the setpoint delay has in."""
    late = wait_s * (rng.random(len(t)) * (rng.random(len(t)) < BUSY) - 0.5 * BUSY)
    return np.maximum.accumulate(t + late)


def _late(piece: Stretch, x: Series, rig: RigFile, rng: np.random.Generator) -> Array:
    """Receive stamps moved to where the sample may really have been taken."""
    t = piece.samples[x.signal][0]
    late = longest_wait_s(rig) * (rng.random(len(t)) - 0.5)
    if x.actuator != "imu":
        spread_s = max(rig.bus.answer_jitter, STAMP_SHARE * rig.bus.position_loop)
        late = spread_s * rng.standard_normal(len(t))
    return np.maximum.accumulate(t - late)


def _sensed(values: Array, rig: RigFile, x: Series, rng: np.random.Generator) -> Array:
    spread, step = sensor_noise(rig, x.quantity)
    noisy = values + spread * rng.standard_normal(values.shape)
    return noisy if step == 0.0 else np.asarray(np.round(noisy / step) * step)
