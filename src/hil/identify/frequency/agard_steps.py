"""Dynamic threshold: how long a step of acceleration takes to be felt to 63 %, by its size.

After AGARD Advisory Report 144, "Dynamic Characteristics of Flight Simulator Motion Systems" (1979) [M];
1 - 1/e is what a first-order lag reaches after its time constant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.control.trajectory import CueTrajectory
from hil.errors import IdentificationError
from hil.identify.frequency.acceleration import Acceleration
from hil.identify.frequency.channels import Channel, Sampled
from hil.identify.frequency.harmonics import sample_step

Array = NDArray[np.float64]

REACHED: Final = 1.0 - math.exp(-1.0)
STILL: Final = 0.03
"""Share of the largest commanded acceleration below which a cue rests or glides."""
SMOOTH_S: Final = 0.015
"""Mean over this time, symmetric, takes noise off without moving a rising flank."""
BEFORE_S: Final = 0.3
FINE_S: Final = 0.0005
ALIKE: Final = 0.1
RATE_HZ: Final = 200.0
REST_S: Final = 1.0
LONGEST_S: Final = 0.4
SHARE: Final = 0.8
"""Of speed and workspace that test motions use."""


@dataclass(frozen=True, slots=True)
class Threshold:
    """Steps of one size."""

    run: str
    coordinate: str
    size: float
    """Commanded acceleration, m/s² or rad/s²."""
    unit: str
    time_s: float
    """From command to 63 % of it, mean over the steps; inf where it was not reached before the next."""
    std_s: float
    """From step to step; NaN with one."""
    steps: int


def acceleration_steps(
    rig: RigFile, coordinate: str, sizes: tuple[float, ...], repeats: int = 4
) -> CueTrajectory:
    """Test motion: from rest +a, twice as long -a, +a, back at rest and in place; `repeats` a size, signs
    in turn. IdentificationError where a size does not fit the cue limits."""
    k = rig.coordinates.index(coordinate)
    speed_max, acceleration_max, _ = (limit[k] for limit in rig.cue_limits())
    parts = [np.zeros(int(2 * REST_S * RATE_HZ))]
    for size in sizes:
        if not 0.0 < size <= SHARE * acceleration_max:
            raise IdentificationError(
                f"a step of {size:g} does not fit {coordinate}: at most {SHARE * acceleration_max:g} does"
            )
        travel_s = math.sqrt(SHARE * rig.limits[k] / size)
        n = int(min(LONGEST_S, SHARE * speed_max / size, travel_s) * RATE_HZ)
        cycle = np.repeat([size, -size, -size, size], n)
        for repeat in range(repeats):
            parts += [cycle * (-1.0) ** repeat, np.zeros(int(REST_S * RATE_HZ))]
    a = np.concatenate(parts)
    h = 1.0 / RATE_HZ
    v = np.concatenate([[0.0], np.cumsum(a[:-1]) * h])
    p = np.concatenate([[0.0], np.cumsum(v[:-1] * h + 0.5 * a[:-1] * h * h)])
    return CueTrajectory((coordinate,), np.arange(len(a)) / RATE_HZ, p[:, None])


def find_steps(cue: Channel) -> list[tuple[float, float]] | None:
    """Instants (s) and signed sizes of acceleration steps from rest; None where the cue is none such.

    A motion of steps has accelerations of few values, each held for a while.
    """
    if not isinstance(cue, Sampled) or len(cue.t_s) < 100:
        return None
    h = sample_step(cue.t_s)
    t = np.arange(cue.t_s[0], cue.t_s[-1], h)
    p = np.interp(t, cue.t_s, cue.value)
    a = np.zeros(len(p))
    a[1:-1] = np.diff(p, 2) / h**2
    top = float(np.quantile(np.abs(a), 0.99))
    if top == 0.0:
        return None
    moving = np.abs(a) > STILL * top
    starts = np.flatnonzero(moving[1:] & ~moving[:-1]) + 1
    found = []
    held = 0
    for start in starts:
        ahead = a[start + 1 : start + 8]
        if start < BEFORE_S / h or np.any(moving[start - int(0.1 * BEFORE_S / h) - 1 : start]):
            continue
        size = float(np.median(ahead))
        if np.ptp(ahead) < ALIKE * abs(size):
            held += 1
            rest = a[start - int(BEFORE_S / h) : start]
            if np.all(np.abs(rest) < STILL * abs(size)):
                # Second differences are centred: the step lies where half of it is reached.
                share = float(np.clip(a[start] / size, 0.0, 1.0))
                found.append((float(t[start] + h * (0.5 - share)), size))
    return found if len(found) >= 2 and held >= 0.8 * len(found) else None


def measure_steps(
    run: str, coordinate: str, steps: list[tuple[float, float]], felt: Acceleration
) -> list[Threshold]:
    """Thresholds by size, steps of sizes within 10 % together; IdentificationError without an IMU."""
    if felt.order or not isinstance(felt.channel, Sampled):
        raise IdentificationError(
            f"{run}: steps of {coordinate} need an accelerometer along it: a rate or a pose, differentiated, "
            "is too rough at a step"
        )
    c = felt.channel
    ends = [*(t for t, _ in steps[1:]), c.span_s[1]]
    found: list[tuple[float, float]] = []
    for (at_s, size), end_s in zip(steps, ends, strict=True):
        found.append((abs(size), _rise(c, at_s, size, min(end_s, at_s + LONGEST_S + BEFORE_S))))
    out = []
    while found:
        size = found[0][0]
        same = np.array([time for s, time in found if abs(s - size) <= ALIKE * size])
        found = [(s, time) for s, time in found if abs(s - size) > ALIKE * size]
        std = (
            float(np.std(same, ddof=1))
            if len(same) > 1 and np.isfinite(same).all()
            else float("nan")
        )
        out.append(
            Threshold(run, coordinate, size, felt.unit, float(np.mean(same)), std, len(same))
        )
    return sorted(out, key=lambda threshold: threshold.size)


def _rise(c: Sampled, at_s: float, size: float, end_s: float) -> float:
    """Time from `at_s` until the smoothed signal has gone 63 % of `size` from its rest; inf if never."""
    rest = c.value[(c.t_s > at_s - BEFORE_S) & (c.t_s <= at_s)]
    t = np.arange(at_s - SMOOTH_S, end_s, FINE_S)
    x = (np.interp(t, c.t_s, c.value) - float(np.mean(rest))) / size
    n = int(SMOOTH_S / FINE_S)
    smooth = np.convolve(x, np.ones(n) / n, mode="same")
    over = np.flatnonzero((smooth >= REACHED) & (t > at_s) & (t < end_s - SMOOTH_S))
    return float(t[over[0]] - at_s) if len(over) else float("inf")
