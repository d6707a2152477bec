"""Rides: what a rider is asked to do on the course, as speed and lean over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.signal import butter, sosfiltfilt

Array = NDArray[np.float64]

LEAD_S: Final = 3.0
"""Ridden before the record begins, so that no start shows in it."""
TIGHTEST: Final = 0.3
"""Curvature, 1/m."""
WOBBLE_RAD: Final = 0.003
WOBBLE_HZ: Final = (0.2, 1.0)
STROKE_M_S2: Final = 0.12
"""Ripple of the acceleration by the two pedals."""
KINDS: Final = ("mixed", "slalom", "circles", "lane_changes", "stop_and_go")


@dataclass(frozen=True, slots=True)
class Plan:
    """One ride, sampled every `dt_s` from -LEAD_S on."""

    kind: str
    dt_s: float
    t_s: Array
    speed: Array
    """Of the rear contact on wheels of the rig file's size, m/s."""
    lean: Array
    """rad, right positive."""


def plan(kind: str, rng: np.random.Generator, dt_s: float, gravity: float) -> Plan:
    """A ride of 25 to 45 s."""
    duration = float(rng.uniform(25.0, 45.0))
    t = np.arange(-LEAD_S, duration + 0.5, dt_s)
    cruise = float(rng.uniform(3.0, 5.5))
    speed, turns = np.full_like(t, cruise), np.zeros_like(t)
    at = float(rng.uniform(1.5, 2.5))
    steps = [*_MIX[:2], *rng.permutation(_MIX[2:])] if kind == "mixed" else [kind] * 12
    for what in steps:
        length = float(rng.uniform(*_LENGTH_S[what]))
        end = min(at + length, duration - 1.0)
        if end - at < 2.5:
            break
        here = (t >= at) & (t < end)
        _SEGMENT[what](t[here] - at, here, speed, turns, rng)
        at += length + float(rng.uniform(0.4, 1.5))
    brisk = float(rng.uniform(0.9, 1.4)), float(rng.uniform(2.2, 3.2))
    speed = gaussian_filter1d(_reached(speed, dt_s, *brisk), float(rng.uniform(0.15, 0.3)) / dt_s)
    curve = np.minimum(TIGHTEST, gravity * np.tan(rng.uniform(0.14, 0.22)) / speed**2)
    asked = -np.arctan(speed**2 * gaussian_filter1d(turns, 0.2 / dt_s) * curve / gravity)
    lean = gaussian_filter1d(asked, 0.12 / dt_s) + _wobble(t, rng)
    cadence = 2.0 * np.pi * np.cumsum(speed) * dt_s / float(rng.uniform(2.6, 3.4))
    pedals = gaussian_filter1d((np.gradient(speed, dt_s) > -0.3).astype(float), 0.3 / dt_s)
    ripple = STROKE_M_S2 * pedals * np.sin(cadence + rng.uniform(0.0, 6.28))
    return Plan(kind, dt_s, t, speed + np.cumsum(ripple) * dt_s, lean)


def _reached(asked: Array, dt_s: float, up: float, down: float) -> Array:
    """The speed that follows `asked` with so much acceleration and braking, m/s2."""
    out = asked.copy()
    for k in range(1, len(out)):
        out[k] = min(max(asked[k], out[k - 1] - down * dt_s), out[k - 1] + up * dt_s)
    return out


def _wobble(t: Array, rng: np.random.Generator) -> Array:
    """The small unrest that balancing leaves, rad; it fades in."""
    sections = butter(2, WOBBLE_HZ, btype="band", fs=1.0 / (t[1] - t[0]), output="sos")
    unrest = sosfiltfilt(sections, rng.standard_normal(len(t)))
    return np.asarray(WOBBLE_RAD * unrest / unrest.std() * np.clip((t - t[0]) / 1.5, 0.0, 1.0))


def _slalom(s: Array, here: Array, _speed: Array, turns: Array, rng: np.random.Generator) -> None:
    turns[here] = rng.choice([-1.0, 1.0]) * np.sin(2.0 * np.pi * rng.uniform(0.18, 0.38) * s)


def _circle(s: Array, here: Array, speed: Array, turns: Array, rng: np.random.Generator) -> None:
    turns[here] = rng.choice([-1.0, 1.0]) * rng.uniform(0.6, 1.0)
    speed[here] = rng.uniform(2.6, 5.0) + 0.0 * s


def _lane_change(
    s: Array, here: Array, _speed: Array, turns: Array, rng: np.random.Generator
) -> None:
    period = rng.uniform(1.8, 2.8)
    turns[here] = np.where(s < period, np.sin(2.0 * np.pi * s / period), 0.0)
    turns[here] *= rng.choice([-1.0, 1.0])


def _stop(s: Array, here: Array, speed: Array, turns: Array, rng: np.random.Generator) -> None:
    """Up to a speed, brake hard, roll on slowly; a slight bend with it."""
    fast, slow = rng.uniform(5.5, 6.8), rng.uniform(2.1, 2.8)
    speed[here] = np.where(s < rng.uniform(0.5, 0.65) * s[-1], fast, slow)
    turns[here] = rng.uniform(-0.3, 0.3)


_SEGMENT: Final = {
    "slalom": _slalom, "circles": _circle, "lane_changes": _lane_change, "stop_and_go": _stop
}  # fmt: skip
_LENGTH_S: Final = {
    "slalom": (7.0, 11.0), "circles": (6.0, 10.0), "lane_changes": (3.0, 4.5), "stop_and_go": (6.0, 9.0)
}  # fmt: skip
_MIX: Final = ("stop_and_go", "slalom", "circles", "lane_changes", "stop_and_go", "slalom")
"""The first two come in every mixed ride."""
