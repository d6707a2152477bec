"""Periods over the travel at which a residual repeats itself, and a motor's turn: where fits of ripple and of
lead errors start.

Forces tell of them; where forces are set, what a twin that is led by positions lacks of acceleration.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import Actuator
from hil.gap.record.led import lacking
from hil.gap.record.problem import Problem

Array = NDArray[np.float64]

SHORTEST: Final = 1e-3
"""m or rad."""
A_DECADE: Final = 120
"""Periods looked at for each factor of 10, refined about the best."""
MOST: Final = 2
CYCLES: Final = 1.3
"""The travel must hold so many of a period."""
ALIKE: Final = 0.005
"""Of a period, by which a fit that starts at another one finds it."""


def force_periods(problem: Problem, residual: Array, actuator: str) -> list[float]:
    """Periods (m or rad) at which the actuator's force residual repeats along its travel, best first."""
    return _periods(problem, residual, actuator, by_speed=False)


def lead_periods(problem: Problem, residual: Array, actuator: str) -> list[float]:
    """Periods of an error of the lead: what it costs in force grows with the square of the speed."""
    return _periods(problem, residual, actuator, by_speed=True)


def with_turn(periods: Sequence[float], actuator: Actuator, travel: float) -> list[float]:
    """`periods`, and one turn of the motor where they have none like it and the `travel` (m or rad) holds
    some: what wobbles does so in each turn, which a short travel alone tells badly."""
    turn, out = actuator.motor_turn, list(periods)
    if turn is None or turn * CYCLES > travel or any(abs(p / turn - 1.0) < ALIKE for p in out):
        return out
    return [*out, turn]


def _periods(problem: Problem, residual: Array, actuator: str, *, by_speed: bool) -> list[float]:
    xs, ys, ws = [], [], []
    for s in problem.series:
        is_led = problem.pieces[s.stretch].mode == "force"
        told = ("position",) if is_led else ("force", "current")
        if s.actuator != actuator or s.quantity not in told:
            continue
        place = next(
            (p for p in problem.series
             if p.stretch == s.stretch and p.signal == f"{actuator}.position"), None)  # fmt: skip
        kept = problem.kept[s.part]
        if place is None or not kept.any():
            continue
        t, u = problem.t_s[s.part][kept], problem.t_s[place.part]
        measured = problem.measured[place.part]
        y = residual[s.part]
        if is_led:
            y = lacking(problem.t_s[s.part], y)
        y = y[kept]
        xs.append(np.interp(t, u, measured))
        ws.append(np.interp(t, u, np.gradient(measured, u)) ** 2)
        ys.append((y - y.mean()) / max(float(np.std(y)), 1e-12))
    if not xs:
        return []
    x, y, w = np.concatenate(xs), np.concatenate(ys), np.concatenate(ws)
    travel = float(np.ptp(x))
    longest = travel / CYCLES
    if longest <= 2.0 * SHORTEST or len(x) < 50:
        return []
    weight = w / max(float(w.mean()), 1e-300) if by_speed else np.ones_like(x)
    grid = np.geomspace(SHORTEST, longest, int(A_DECADE * np.log10(longest / SHORTEST)) + 2)
    # the travel sets how finely a short period must be known; steps of a quarter cycle over it
    fine = np.arange(1.0 / longest, 1.0 / SHORTEST, 0.25 / travel)
    waves = np.unique(np.concatenate([1.0 / grid, fine]))
    power = np.array([_power(x, y, weight, k) for k in waves])
    peaks = np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])) + 1
    best = peaks[np.argsort(-power[peaks])][:MOST]
    return [float(1.0 / waves[k]) for k in best]


def _power(x: Array, y: Array, weight: Array, wave: float) -> float:
    turn = 2.0 * np.pi * wave * x
    c, s = weight * np.cos(turn), weight * np.sin(turn)
    return float((c @ y) ** 2 / max(float(c @ c), 1e-12) + (s @ y) ** 2 / max(float(s @ s), 1e-12))
