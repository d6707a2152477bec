"""Excitations: poses on the bus cycle's grid, within the limits of coordinates and actuators.

A shape is a curve of unit size for one coordinate, at rest at both ends; `motion` scales it to what
the rig allows.
"""

from __future__ import annotations

import numpy as np

from benchmarks.other_lab.mechanism import actuator_positions

REST_S = 0.4
KINDS = ("multisine", "chirp", "moves", "slow_sine", "ride", "triangle")
FAST = ("multisine", "chirp", "moves", "ride")


def _window(t, length_s, fade_s=1.0):
    """0 while at rest, 1 in the middle, smooth to the third derivative between."""
    u = np.clip((np.minimum(t, length_s - t) - REST_S) / fade_s, 0.0, 1.0)
    return u**4 * (35 - 84 * u + 70 * u**2 - 20 * u**3)


def _multisine(rng, t, length_s):
    hz = np.sort(rng.uniform(0.15, 5.5, int(rng.integers(7, 15))))
    phase = rng.uniform(0.0, 2.0 * np.pi, len(hz))
    size = 1.0 / (0.4 + hz) ** rng.uniform(1.0, 1.6)
    return (size * np.sin(2.0 * np.pi * hz * t[:, None] + phase)).sum(axis=1) * _window(t, length_s)


def _chirp(rng, t, length_s):
    low, high = rng.uniform(0.15, 0.4), rng.uniform(4.0, 7.5)
    u = np.clip((t - REST_S) / (length_s - 2 * REST_S), 0.0, 1.0)
    if rng.random() < 0.3:
        u = 1.0 - u
    hz = low * (high / low) ** u
    return np.sin(2.0 * np.pi * np.cumsum(hz) * (t[1] - t[0])) / hz**1.15 * _window(t, length_s)


def _moves(rng, t, length_s):
    """Point-to-point moves of fifth order with dwells."""
    x, at, here = np.zeros(len(t)), REST_S, 0.0
    while at < length_s - 2.2:
        there = float(rng.uniform(-1.0, 1.0))
        takes = float(rng.uniform(0.35, 0.6)) * max(np.sqrt(abs(there - here)), 0.25) * 1.6
        x += (there - here) * _blend((t - at) / takes)
        here, at = there, at + takes + float(rng.uniform(0.05, 0.9))
    return x - here * _blend((t - at) / 1.2)


def _blend(u):
    u = np.clip(u, 0.0, 1.0)
    return u**3 * (10 - 15 * u + 6 * u**2)


def _slow_sine(rng, t, length_s):
    low, high = sorted(rng.uniform(0.08, 0.7, 2))
    hz = low + (high - low) * t / length_s
    return np.sin(2.0 * np.pi * np.cumsum(hz) * (t[1] - t[0])) * _window(t, length_s, 1.5)


def _ride(rng, t, length_s):
    """Road-like noise of second order with a few jolts."""
    dt = t[1] - t[0]
    x = np.zeros(len(t))
    for low, size in (
        (rng.uniform(0.15, 0.4), 1.0),
        (rng.uniform(0.9, 2.2), 0.22),
        (rng.uniform(3.0, 4.5), 0.03),
    ):
        f = np.fft.rfftfreq(len(t), dt)
        band = np.exp(-0.5 * ((f - low) / (0.45 * low)) ** 2)
        spectrum = band * (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f)))
        part = np.fft.irfft(spectrum, len(t))
        x += size * part / part.std()
    for _ in range(int(rng.integers(2, 6))):
        at = rng.uniform(2.0, length_s - 2.0)
        x += rng.choice((-0.6, 0.6)) * np.exp(-0.5 * ((t - at) / rng.uniform(0.1, 0.25)) ** 2)
    return x * _window(t, length_s)


def _triangle(rng, t, length_s):
    """Constant slow speeds to and fro with rounded corners."""
    period = rng.uniform(2.0, 5.0)
    u = (t - REST_S) / period
    saw = 2.0 * np.abs(2.0 * (u + 0.25 - np.floor(u + 0.75))) - 1.0
    kernel = np.hanning(max(int(0.12 / (t[1] - t[0])), 5))
    rounded = np.convolve(np.pad(saw, len(kernel), "edge"), kernel / kernel.sum(), "same")
    return rounded[len(kernel) : -len(kernel)] * _window(t, length_s)


_SHAPES = dict(zip(KINDS, (_multisine, _chirp, _moves, _slow_sine, _ride, _triangle), strict=True))


def motion(rng, world, kind, length_s):
    """(t, poses): times and cues of one run, on the bus cycle."""
    rig = world.rig
    n = len(rig.coordinates)
    t = np.arange(int(length_s / rig.bus.cycle) + 1) * rig.bus.cycle
    poses = np.zeros((len(t), n))
    active = rng.random(n) < 0.75
    active[rng.integers(n)] = True
    velocity, acceleration, jerk = rig.cue_limits()
    for c in np.flatnonzero(active):
        x = _SHAPES[kind](rng, t, length_s)
        x = x / np.abs(x).max()
        d1, d2 = np.gradient(x, t), np.gradient(np.gradient(x, t), t)
        d3 = np.abs(np.gradient(d2, t)).max()
        share = rng.uniform(0.25, 0.9)
        most = min(
            0.85 * rig.limits[c],
            velocity[c] / np.abs(d1).max(),
            acceleration[c] / np.abs(d2).max(),
            jerk[c] / d3,
        )
        if kind == "triangle":
            top = velocity[c] * rng.uniform(0.03, 0.2)
            most = min(most, top / np.abs(d1).max())
        poses[:, c] = share * most * x
    for _ in range(40):
        if _fits(world, t, poses):
            return t, poses
        poses *= 0.92
    raise ValueError(f"{rig.name}: {kind} does not fit the actuators")


def _fits(world, t, poses):
    rho = np.empty_like(poses)
    actuator_positions(world.kind, world.nominal_joints, world.nominal_neutral, poses, rho)
    for i, a in enumerate(world.rig.actuators):
        v = np.gradient(rho[:, i], t)
        if rho[:, i].min() < a.stroke[0] + 0.012 or rho[:, i].max() > a.stroke[1] - 0.012:
            return False
        if (
            np.abs(v).max() > 0.88 * a.velocity_max
            or np.abs(np.gradient(v, t)).max() > 0.5 * a.acceleration_max
        ):
            return False
    return True
