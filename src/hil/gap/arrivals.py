"""When setpoints really reach the drives: read from the fine structure of the residual.

A drive takes a setpoint at the first tick of its position loop after the frame's arrival, so an arrival
that is 0.1 ms off may act a whole tick off, and a moving drive answers that with a kick of force many
times the sensor's noise. Neither the mean wait on the bus nor how it varies stands in a rig file. Both show
in the record: at the right delay the twin's ticks fall where the drive's fell, and the kicks cancel. Where
no delay does that (drives whose clocks drift, stamps of another clock) the twin lets setpoints act between
ticks, as they do on average, and the kicks are counted as noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.draws import Wait, draws, sensor_sigma
from hil.gap.problem import Mask, Problem

Array = NDArray[np.float64]

SPAN: Final = (-0.5, 1.5)
"""Delays looked at, in ticks of the position loop, beside the rig file's own setpoint delay."""
STEPS_A_TICK: Final = 8
LEVELS: Final = (0.0, 0.15, 0.3, 0.6, 1.0)
VISIBLE: Final = 1.5
"""Timing shows at samples where it makes the noise so many times the sensor's."""
ENOUGH: Final = 30
LOOK_S: Final = 12.0
"""Of the stretch that moves most, that is looked at: ticks show everywhere alike."""


@dataclass(frozen=True, slots=True)
class Timing:
    """How setpoints reach the drives."""

    smooth: bool
    """Whether the twin comes nearer with setpoints that act between ticks."""
    waits: Mapping[str, Wait]
    """By actuator, by how much arrivals and answers vary."""
    delays_s: Mapping[str, float]
    """By actuator, the transport delay at which its ticks fit best; empty where none does."""

    def start(self, problem: Problem) -> Array:
        """The rig file's parameter vector with these delays."""
        out = np.array(problem.base)
        for actuator, delay in self.delays_s.items():
            out[problem.table.index(f"{actuator}.transport_delay.delay")] += delay
        return out


def find_timing(problem: Problem, rng: np.random.Generator) -> Timing:
    """Delays, whether ticks can be told, and how much arrivals vary, for a smooth `problem`."""
    problem = _sample(problem)
    base = problem.base
    spread = np.sqrt(np.mean(draws(problem, base, rng, 2) ** 2, axis=0))
    parts = [_moving(problem, k, spread[x.part]) for k, x in enumerate(problem.series)]
    weight = np.array([float(p.sum()) if p.sum() > ENOUGH else 0.0 for p in parts])
    if not weight.any():
        return Timing(True, {}, {})
    coarse = problem.with_ticks(smooth=False)
    smooth_size = _sizes(problem, problem.predict(base)[0], parts)
    delays = _best_delays(coarse, parts, weight)
    ticks = Timing(False, {}, delays)
    coarse_size = _sizes(coarse, coarse.predict(ticks.start(coarse))[0], parts)
    seen = weight > 0.0
    ratio = np.average(np.log(smooth_size[seen] / coarse_size[seen]), weights=weight[seen])
    found = Timing(True, {}, {}) if ratio < 0.0 else ticks
    best, size = (problem, smooth_size) if found.smooth else (coarse, coarse_size)
    vector = found.start(best)
    return replace(found, waits=_waits(best, vector, size, parts, rng))


def _sample(problem: Problem) -> Problem:
    """The first LOOK_S of the stretch that moves most, as a problem of its own."""
    spread = [sum(float(np.std(v)) for _, v in p.setpoints.values()) for p in problem.pieces]
    piece = problem.pieces[int(np.argmax(spread))]
    moving = [float(t[np.argmax(v != v[0])]) for t, v in piece.setpoints.values()]
    end = max(min(moving), piece.span_s[0]) + LOOK_S
    return Problem(problem.rig, [piece.until(end)], settle_s=problem.settle_s)


def _waits(
    problem: Problem, vector: Array, size: Array, parts: Sequence[Mask], rng: np.random.Generator
) -> dict[str, Wait]:
    """For each actuator the waits whose draws have the record's fine structure, `size` (S,).

    Setpoints' waits show in forces, answers' in positions: a wait of v × 0.1 ms is many encoder steps.
    """
    flat = problem.predict(vector)[0]
    misfit = []
    for level in LEVELS:
        all_alike = dict.fromkeys(problem.rig.actuator_names, Wait(level, level))
        drawn = draws(problem, vector, rng, 1, all_alike)[0]
        misfit.append(np.abs(np.log(size / _fine(problem, drawn, flat, parts))))
    out = {}
    for a in problem.rig.actuator_names:
        shares = []
        for quantities in (("force", "current"), ("position", "velocity")):
            mine = [
                k
                for k, x in enumerate(problem.series)
                if x.actuator == a and x.quantity in quantities and np.isfinite(size[k])
            ]
            best = np.sum(np.array(misfit)[:, mine], axis=1)
            shares.append(LEVELS[int(np.argmin(best))] if mine else 1.0)
        out[a] = Wait(*shares)
    return out


def _best_delays(problem: Problem, parts: Sequence[Mask], weight: Array) -> dict[str, float]:
    """For each actuator the delay at which its own signals are finest; all are moved at once."""
    bus = problem.rig.bus
    if bus.setpoint_delay <= 0.0 or bus.retimed or bus.position_loop <= bus.speed_loop:
        return {}
    tick = bus.position_loop
    grid = tick * np.arange(SPAN[0], SPAN[1], 1.0 / STEPS_A_TICK)
    names = problem.rig.actuator_names
    rows = [Timing(False, {}, dict.fromkeys(names, float(d))).start(problem) for d in grid]
    sizes = np.log([_sizes(problem, flat, parts) for flat in problem.predict(np.array(rows))])
    out = {}
    for a in names:
        mine = np.array([x.actuator == a for x in problem.series]) & (weight > 0.0)
        if mine.any():
            total = np.average(sizes[:, mine], axis=1, weights=weight[mine])
            out[a] = float(grid[int(np.argmin(total))])
    return out


def _moving(problem: Problem, k: int, spread: Array) -> Mask:
    """Samples of series `k` at which timing makes the noise visibly larger than the sensor's."""
    x = problem.series[k]
    window = np.ones(9) / 9.0
    power = np.convolve(spread**2, window, "same")
    seen = power > (VISIBLE * sensor_sigma(problem.rig, x)) ** 2
    return np.asarray(seen & problem.kept[x.part])


def _sizes(problem: Problem, predicted: Array, parts: Sequence[Mask]) -> Array:
    return _fine(problem, problem.measured - predicted, predicted, parts)


def _fine(problem: Problem, flat: Array, predicted: Array, parts: Sequence[Mask]) -> Array:
    """(S,) size of the fastest part of a residual in each series, whatever its constant delay.

    What a shift in time would take away is taken away; differences leave out what is slow, as most gaps
    are; a quantile leaves out what is rare, as friction at reversals is.
    """
    out = np.full(len(problem.series), np.nan)
    for k, (x, part) in enumerate(zip(problem.series, parts, strict=True)):
        if part.sum() <= ENOUGH:
            continue
        slope = np.diff(np.gradient(predicted[x.part], problem.t_s[x.part]))[part[1:]]
        step = np.diff(flat[x.part])[part[1:]]
        step = step - slope * (slope @ step) / max(float(slope @ slope), 1e-300)
        out[k] = max(float(np.quantile(np.abs(step), 0.75)), 1e-300)
    return out
