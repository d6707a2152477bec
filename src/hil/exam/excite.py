"""Motions of exam cases: families drawn at random, as large as a share of the rig's limits allows."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from hil.config import RigFile
from hil.control.trajectory import CueTrajectory
from hil.identify.experiments.limits import uses
from hil.rigs import Manipulator

Array = NDArray[np.float64]

RATE_HZ: Final = 200.0
REST_S: Final = 0.8
FADE_S: Final = 1.5
FAMILIES: Final = ("multisine", "chirp", "slow", "ride", "steps", "circle")


def draw_motion(
    rig: RigFile, family: str, duration_s: float, share: float, rng: np.random.Generator
) -> CueTrajectory:
    """A motion of `family` that uses `share` of the limit reached first; rests at both ends."""
    n = len(rig.coordinates)
    t = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    inner = np.maximum(t - REST_S, 0.0)
    shape = _SHAPES[family](inner, n, rng)
    weight = rng.uniform(0.35, 1.0, n)
    weight[rng.integers(n)] = 1.0
    rise = np.clip(inner / FADE_S, 0.0, 1.0)
    fall = np.clip((t[-1] - REST_S - t) / FADE_S, 0.0, 1.0)
    fade = _smooth(rise) * _smooth(fall)
    units = shape * fade[:, None] * weight * np.asarray(rig.limits)
    return _sized(rig, t, units, share)


def _sized(rig: RigFile, t: Array, units: Array, share: float) -> CueTrajectory:
    manipulator = Manipulator(rig)
    own = [np.asarray(x) for x in rig.cue_limits()]
    v, a = (np.gradient(units, 1.0 / RATE_HZ, axis=0) for _ in range(2))
    a = np.gradient(v, 1.0 / RATE_HZ, axis=0)
    peaks = [np.max(np.abs(x), axis=0) for x in (units, v, a)]
    bounds = (np.asarray(rig.limits), own[0], own[1])
    scale = share * min(
        float(np.min(b / np.maximum(p, 1e-9))) for b, p in zip(bounds, peaks, strict=True)
    )
    for _ in range(3):
        trajectory = CueTrajectory(rig.coordinates, t, scale * units)
        thin = CueTrajectory(rig.coordinates, t[::4], scale * units[::4])
        worst = max(u.share for u in uses(thin, rig, manipulator))
        if worst <= share * 1.02:
            break
        scale *= share / worst
    return trajectory


def _smooth(x: Array) -> Array:
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


def _multisine(t: Array, n: int, rng: np.random.Generator) -> Array:
    top = rng.uniform(1.5, 4.0)
    lines = np.unique(np.round(np.geomspace(1.0, 10.0 * top, 14)))
    out = np.zeros((len(t), n))
    for c in range(n):
        mine = rng.permutation(lines)[: max(6, len(lines) // 2 + 2)] / 10.0
        for f in mine:
            out[:, c] += np.sin(2.0 * math.pi * (f * t + rng.random())) / max(f, 0.2)
    return _unit(out)


def _chirp(t: Array, n: int, rng: np.random.Generator) -> Array:
    out = np.zeros((len(t), n))
    chosen = rng.permutation(n)[: rng.integers(1, n + 1)]
    for c in chosen:
        low, high = rng.uniform(0.08, 0.2), rng.uniform(2.0, 4.5)
        if rng.random() < 0.5:
            low, high = high, low
        rate = math.log(high / low) / t[-1]
        phase = low * np.expm1(rate * t) / rate
        f = low * np.exp(rate * t)
        out[:, c] = np.sin(2.0 * math.pi * (phase + rng.random())) / np.maximum(f, 0.5)
    return _unit(out)


def _slow(t: Array, n: int, rng: np.random.Generator) -> Array:
    """Ramps with rounded reversals, now and then a rest."""
    out = np.zeros((len(t), n))
    for c in range(n):
        marks, ends = [0.0], [0.0]
        while marks[-1] < t[-1]:
            marks.append(marks[-1] + rng.uniform(1.5, 5.0))
            ends.append(rng.uniform(0.4, 1.0) * (-1.0) ** len(ends))
            if rng.random() < 0.25:
                marks.append(marks[-1] + rng.uniform(0.4, 1.2))
                ends.append(ends[-1])
        out[:, c] = np.interp(t, marks, ends)
    return _unit(_low_passed(out, 1.5))


def _ride(t: Array, n: int, rng: np.random.Generator) -> Array:
    """What a rider feels: slow sways, quicker corrections, a bump now and then."""
    noise = rng.standard_normal((len(t), n))
    out = _unit(_low_passed(noise, rng.uniform(0.25, 0.5)))
    out += rng.uniform(0.2, 0.5) * _unit(_low_passed(rng.standard_normal((len(t), n)), 1.2))
    for _ in range(rng.integers(3, 9)):
        at, f = rng.uniform(2.0, t[-1] - 1.0), rng.uniform(2.0, 4.0)
        bump = np.exp(-(((t - at) * f) ** 2)) * np.sin(2.0 * math.pi * f * (t - at))
        out[:, rng.integers(n)] += rng.uniform(0.02, 0.08) * bump
    return _unit(out)


def _steps(t: Array, n: int, rng: np.random.Generator) -> Array:
    out = np.zeros((len(t), n))
    for c in range(n):
        at, here = 0.0, 0.0
        while at < t[-1]:
            at += rng.uniform(0.8, 2.5)
            there = rng.uniform(-1.0, 1.0)
            out[:, c] += (there - here) * _smooth(
                np.clip((t - at) / rng.uniform(0.35, 0.8), 0.0, 1.0)
            )
            here = there
    return _unit(out)


def _circle(t: Array, n: int, rng: np.random.Generator) -> Array:
    out = np.zeros((len(t), n))
    w = 2.0 * math.pi / rng.uniform(4.0, 10.0)
    for c in range(n):
        phase = 0.5 * math.pi * c
        out[:, c] = np.sin(w * t + phase) + rng.uniform(0.0, 0.15) * np.sin(3.3 * w * t)
    return _unit(out)


def _low_passed(x: Array, hz: float) -> Array:
    return np.asarray(sosfiltfilt(butter(2, hz, fs=RATE_HZ, output="sos"), x, axis=0))


def _unit(x: Array) -> Array:
    return np.asarray(x / np.maximum(np.max(np.abs(x), axis=0), 1e-12))


_SHAPES: Final = {
    "multisine": _multisine,
    "chirp": _chirp,
    "slow": _slow,
    "ride": _ride,
    "steps": _steps,
    "circle": _circle,
}
