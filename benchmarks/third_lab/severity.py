"""How large an effect is on its record: its own trace over the floor, on the signal that it touches most."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from benchmarks.third_lab.effect import Effect, World
from benchmarks.third_lab.plant import Plant
from benchmarks.third_lab.record import dense
from benchmarks.third_lab.world import Chance, Trace, run

LEVELS = (1.0, 3.0, 10.0)

CLOSE = 0.12
"""A severity so near, as a logarithm, to the level that was asked for will do."""

LOOSE = 0.4
"""And one further above it than this will not, unless smaller sizes are no fault any more."""

TRIES = 8


@dataclass(frozen=True)
class Stage:
    """The diagnosing runs of a case, healthy: cues, chance, and another chance of the same."""

    ideal: Plant
    world: World
    cues: tuple[np.ndarray, ...]
    chances: tuple[Chance, ...]
    others: tuple[Chance, ...]

    @cached_property
    def traces(self) -> tuple[Trace, ...]:
        """Of the healthy rig."""
        return self._run(self.world[0], self.chances)

    @cached_property
    def records(self) -> tuple[dict[str, np.ndarray], ...]:
        """Dense records of the healthy rig."""
        return self._dense(self.world, self.traces, self.chances)

    @cached_property
    def floor(self) -> dict[str, float]:
        """RMS by signal of what two records of one motion differ by, over the root of two."""
        again = self._dense(self.world, self._run(self.world[0], self.others), self.others)
        return {s: r / np.sqrt(2.0) for s, r in _difference(self.records, again).items()}

    def play(self, world: World) -> tuple[Trace, ...] | None:
        """Traces of `world` with the runs' own chance; None where a drive trips on its following error."""
        if world[0] is self.world[0]:
            return self.traces
        traces = self._run(world[0], self.chances)
        return traces if all(_follows(world[0], t) for t in traces) else None

    def severities(self, world: World) -> dict[str, float] | None:
        """Trace of what `world` has more than the healthy one, over the floor, by signal."""
        traces = self.play(world)
        if traces is None:
            return None
        there = self._dense(world, traces, self.chances)
        return {s: r / self.floor[s] for s, r in _difference(self.records, there).items()}

    def signature(self, world: World) -> np.ndarray:
        """Trace of `world` over the floor, all in one row of length one; zero where drives trip."""
        traces = self.play(world)
        if traces is None:
            return np.zeros(1)
        there = self._dense(world, traces, self.chances)
        rows = [
            (b[s] - a[s]) / self.floor[s]
            for a, b in zip(self.records, there, strict=True)
            for s in a
        ]
        row = np.concatenate(rows)
        return row / max(float(np.linalg.norm(row)), 1e-12)

    def _run(self, plant: Plant, chances: tuple[Chance, ...]) -> tuple[Trace, ...]:
        return tuple(
            run(plant, self.ideal, c, ch) for c, ch in zip(self.cues, chances, strict=True)
        )

    def _dense(
        self, world: World, traces: tuple[Trace, ...], chances: tuple[Chance, ...]
    ) -> tuple[dict[str, np.ndarray], ...]:
        return tuple(dense(*world, t, ch) for t, ch in zip(traces, chances, strict=True))


def size_for(
    stage: Stage, effect: Effect, target: float, least: float
) -> tuple[float, float] | None:
    """Size and severity nearest to `target` within the effect's bounds; None where it stays below `least`.

    A secant search on logarithms that turns to halving where the effect sets in steeply. An effect whose
    smallest size already does more is taken at that size; where a drive would trip, smaller ones are tried.
    """
    low, high = float(np.log(effect.low)), float(np.log(effect.high))
    at, best, below, above = 0.5 * (low + high), None, None, None
    for k in range(TRIES):
        found = stage.severities(effect.apply(float(np.exp(at)), stage.world))
        reached = float(np.log(max(max(found.values()), 1e-6) / target)) if found else np.inf
        if found and (best is None or abs(reached) < abs(best[1])):
            best = at, reached
        if abs(reached) < CLOSE or (reached > 0.0 and at == low) or (reached < 0.0 and at == high):
            break
        if reached < 0.0:
            below = at, reached
        else:
            above = at, reached
        at = _next(below, above, low, high, halve=k > 2)
    if best is None or best[1] < np.log(least / target) or (best[1] > LOOSE and best[0] > low):
        return None
    return float(np.exp(best[0])), float(target * np.exp(best[1]))


def _next(
    below: tuple[float, float] | None,
    above: tuple[float, float] | None,
    low: float,
    high: float,
    *,
    halve: bool,
) -> float:
    """Where to look next, between (log size, log severity over target) too small and too large."""
    if below is None or above is None:
        at, reached = below or above
        return float(np.clip(at - (reached if np.isfinite(reached) else 0.5), low, high))
    if halve or not np.isfinite(above[1]):
        return 0.5 * (below[0] + above[0])
    share = below[1] / (below[1] - above[1])
    return below[0] + float(np.clip(share, 0.1, 0.9)) * (above[0] - below[0])


def level_of(severity: float) -> float:
    """The nearest of the levels, on logarithms."""
    return min(LEVELS, key=lambda level: abs(np.log(severity / level)))


def _difference(
    first: tuple[dict[str, np.ndarray], ...], second: tuple[dict[str, np.ndarray], ...]
) -> dict[str, float]:
    return {
        s: float(
            np.sqrt(
                np.mean(
                    np.concatenate([a[s] - b[s] for a, b in zip(first, second, strict=True)]) ** 2
                )
            )
        )
        for s in first[0]
    }


def _follows(plant: Plant, trace: Trace) -> bool:
    limit = plant.rig.safety.following_error
    ticks = np.arange(trace.position.shape[1]) * trace.dt
    for i in range(len(trace.position)):
        aim = np.interp(ticks, trace.sent_s, trace.setpoint[:, i])
        if not np.abs(trace.position[i] - aim).max() < limit:
            return False
    return True
