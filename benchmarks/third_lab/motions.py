"""Cue trajectories of several families, within the rig's limits; all start and end at rest."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from scipy.signal import butter, sosfiltfilt

from benchmarks.third_lab.plant import Plant
from benchmarks.third_lab.pose import setpoints

REST_S: Final = 1.0
"""Standstill before and after the motion, s."""

FADE_S: Final = 1.5

Family = Callable[[np.random.Generator, np.ndarray, int], np.ndarray]


def multisine(rng: np.random.Generator, t: np.ndarray, k: int) -> np.ndarray:
    """Eight tones of their own for every coordinate, 0.1 to 3.5 Hz, smaller the faster."""
    out = np.zeros((len(t), k))
    for j in range(k):
        for f in np.geomspace(0.1, 3.5, 8) * rng.uniform(0.85, 1.15, 8):
            out[:, j] += np.sin(2 * np.pi * (f * t + rng.random())) / (0.15 + f) ** 1.1
    return out * _fade(t)


def chirp(rng: np.random.Generator, t: np.ndarray, k: int) -> np.ndarray:
    """Exponential sweeps, 0.1 to 2..4 Hz, smaller the faster, each coordinate at its own pace."""
    out = np.zeros((len(t), k))
    for j in range(k):
        f0, f1 = rng.uniform(0.08, 0.2), rng.uniform(2.0, 4.0)
        rate = np.log(f1 / f0) / t[-1]
        time = t if rng.random() < 0.7 else t[-1] - t
        f = f0 * np.exp(rate * time)
        out[:, j] = np.sin(2 * np.pi * ((f - f0) / rate + rng.random())) / (0.3 + f) ** 1.1
    return out * _fade(t)


def ramps(rng: np.random.Generator, t: np.ndarray, k: int) -> np.ndarray:
    """Slow ramps with rounded reversals at ever other places."""
    out = np.zeros((len(t), k))
    for j in range(k):
        knots, at = [0.0], [0.0]
        side = rng.choice([-1.0, 1.0])
        while at[-1] < t[-1] - 5.0:
            level = side * rng.uniform(0.15, 1.0)
            at.append(at[-1] + max(abs(level - knots[-1]) / rng.uniform(0.25, 0.8), 0.8))
            knots.append(level)
            side = -side
        at, knots = [*at, max(at[-1] + 2.0, t[-1])], [*knots, 0.0]
        width = int(rng.uniform(0.15, 0.4) / (t[1] - t[0]))
        window = np.hanning(width + 2)
        line = np.interp(t, at, knots)
        out[:, j] = np.convolve(np.pad(line, width, "edge"), window / window.sum(), "same")[
            width:-width
        ]
    return out * _fade(t)


def ride(rng: np.random.Generator, t: np.ndarray, k: int) -> np.ndarray:
    """A ride: band-passed noise, rough and smooth stretches in turn."""
    rate = 1.0 / (t[1] - t[0])
    sos = butter(2, [0.1, rng.uniform(1.0, 2.2)], "bandpass", fs=rate, output="sos")
    out = sosfiltfilt(sos, rng.standard_normal((len(t), k)), axis=0)
    swell = 0.65 + 0.35 * np.sin(2 * np.pi * (t / rng.uniform(7.0, 13.0) + rng.random()))
    return out / out.std(axis=0) * swell[:, None] * _fade(t)


def steps(rng: np.random.Generator, t: np.ndarray, k: int) -> np.ndarray:
    """Smooth moves from place to place with standstills between, one coordinate or all at a time."""
    out, here = np.zeros((len(t), k)), np.zeros(k)
    at = 0.0
    while at < t[-1]:
        move, wait = rng.uniform(0.5, 1.6), rng.uniform(0.2, 1.0)
        there = rng.uniform(-1.0, 1.0, k)
        if k > 1 and rng.random() < 0.5:
            keep = np.arange(k) != rng.integers(k)
            there[keep] = here[keep]
        if at + 2 * move + wait > t[-1]:
            there = np.zeros(k)
        x = np.clip((t - at) / move, 0.0, 1.0)[:, None]
        out += (there - here) * (x**3 * (10 - 15 * x + 6 * x * x))
        here, at = there, at + move + wait
    return out


def circles(rng: np.random.Generator, t: np.ndarray, k: int) -> np.ndarray:
    """Coupled circles: all coordinates at one slowly rising pace, each with its own phase."""
    f0, f1 = rng.uniform(0.1, 0.3), rng.uniform(0.5, 1.2)
    f = f0 + (f1 - f0) * t / t[-1]
    phase = 2 * np.pi * np.cumsum(f) * (t[1] - t[0])
    shifts = np.arange(k) * np.pi / 2 + rng.uniform(-0.4, 0.4, k)
    times = np.where(rng.random(k) < 0.25, 2, 1)
    grow = 0.4 + 0.6 * np.abs(np.sin(2 * np.pi * t / rng.uniform(12.0, 20.0)))
    return np.sin(phase[:, None] * times + shifts) * (grow / (0.3 + f))[:, None] * _fade(t)


FAMILIES: Final[dict[str, Family]] = {
    f.__name__: f for f in (multisine, chirp, ramps, ride, steps, circles)
}


def cue(name: str, rng: np.random.Generator, plant: Plant, duration: float) -> np.ndarray:
    """Poses (k, coordinates) at every cycle of the bus; the first and last second stand still."""
    rig = plant.rig
    fine = rig.bus.cycle / 5.0
    t = np.arange(0.0, duration - 2.0 * REST_S, fine)
    shape = FAMILIES[name](rng, t, len(rig.coordinates))
    shape = _smooth(shape, fine)
    pose = (
        shape
        * _room(shape, fine, rig.limits, rig.cue_limits())
        * rng.uniform(0.6, 0.92, shape.shape[1])
    )
    for _ in range(40):
        if _fits(plant, pose, fine):
            break
        pose = pose * 0.93
    still = np.zeros((round(REST_S / rig.bus.cycle), pose.shape[1]))
    return np.concatenate([still, pose[::5], still])


def _room(
    shape: np.ndarray, dt: float, limits: tuple[float, ...], cues: tuple[tuple[float, ...], ...]
) -> np.ndarray:
    """Largest factor a coordinate for which pose, speed, acceleration and jerk stay within limits."""
    room, x = np.asarray(limits) / np.maximum(np.abs(shape).max(axis=0), 1e-9), shape
    for limit in cues:
        x = np.gradient(x, dt, axis=0)
        room = np.minimum(room, np.asarray(limit) / np.maximum(np.abs(x).max(axis=0), 1e-9))
    return room


def _fits(plant: Plant, pose: np.ndarray, dt: float) -> bool:
    x = setpoints(plant, pose)
    v = np.gradient(x, dt, axis=0)
    a = np.gradient(v, dt, axis=0)
    return all(
        low + 0.006 < x[:, i].min()
        and x[:, i].max() < high - 0.006
        and np.abs(v[:, i]).max() < 0.92 * actuator.velocity_max
        and np.abs(a[:, i]).max() < 0.8 * actuator.acceleration_max
        for i, actuator in enumerate(plant.rig.actuators)
        for low, high in [actuator.stroke]
    )


def _smooth(x: np.ndarray, dt: float) -> np.ndarray:
    """`x` without corners shorter than some 0.1 s, begun and ended at zero."""
    window = np.hanning(round(0.12 / dt) + 2)
    window /= window.sum()
    edge = len(window)
    out = [np.convolve(np.pad(column, edge), window, "same")[edge:-edge] for column in x.T]
    return np.stack(out, axis=1) * _fade(np.arange(len(x)) * dt, 0.3)


def _fade(t: np.ndarray, span: float = FADE_S) -> np.ndarray:
    x = np.clip(np.minimum(t, t[-1] - t) / span, 0.0, 1.0)[:, None]
    return x**3 * (10 - 15 * x + 6 * x * x)
