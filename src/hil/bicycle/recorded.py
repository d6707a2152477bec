"""A recorded ride brought to order: one grid for lean, wheel and steer, calibrated, the IMU at its stamps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from hil.bicycle.sensors import IMU_SIGNALS, Series, calibrated
from hil.config import BicycleFile
from hil.config.bicycle import SIGNALS
from hil.errors import RunError
from hil.runs import Run
from hil.runs.folder import EXTRA
from hil.runs.importing.findings import Finding
from hil.runs.table import parquet_table

Array = NDArray[np.float64]

SHORTEST_S: Final = 2.0
GAP_PERIODS: Final = 5.0
"""Samples missing for so many periods are told: what happened in between is a straight line then."""
FALLS: Final = 0.5
"""Of the wheel's usual way in a period: what falls back by more is no bicycle that rolls."""
ALIKE: Final = 0.1
"""Share of a counter's range by which its falls may seem to differ, for the wheel's own way is guessed."""


@dataclass(frozen=True, slots=True)
class Ride:
    """Lean, rear wheel and steer on one grid, calibrated by the rig file; the IMU where it was sampled."""

    name: str
    rig: BicycleFile
    start_s: float
    """Of the grid, on the run's clock."""
    dt_s: float
    angles: Array
    """(N, 3): lean, rear wheel, steer, rad."""
    imu: dict[str, Series]
    """By signal: instants on the run's clock and values, bias and scale of the rig file taken out."""
    findings: tuple[Finding, ...]

    @property
    def t_s(self) -> Array:
        """(N,) on the run's clock."""
        return np.asarray(self.start_s + self.dt_s * np.arange(len(self.angles)))


def prepare(run: Run, rig: BicycleFile) -> Ride:
    """The ride in `run` as `rig` measures; RunError names the channel that is missing or broken."""
    name = run.path.name
    series = {str(c): _series(run.table, str(c)) for c in run.table.columns if c != "t"}
    findings: list[Finding] = []
    if "rear_wheel" not in series and "lean" in series:
        series["rear_wheel"] = _rolled_by_speed(run, rig, findings)
    missing = [s for s in SIGNALS if s not in series]
    if missing:
        raise RunError(
            f"{run.path}: holds no {' and no '.join(missing)}: lean, rear wheel and steer are what the ride "
            "is computed from; a log with other names comes in with `hil runs import`"
        )
    series["rear_wheel"] = _rolled(series["rear_wheel"], rig, findings, str(run.path))
    start = max(float(series[s][0][0]) for s in SIGNALS)
    end = min(float(series[s][0][-1]) for s in SIGNALS)
    dt = 1.0 / rig.rate
    if end - start < SHORTEST_S:
        raise RunError(f"{run.path}: lean, wheel and steer overlap for {end - start:.2f} s only")
    for s in SIGNALS:
        findings += _rate_and_gaps(s, series[s][0], rig, str(run.path))
    grid = start + dt * np.arange(int((end - start) / dt) + 1)
    zero = (rig.sensors.lean_zero, 0.0, rig.sensors.steer_zero)
    columns = [
        np.interp(grid + (rig.sensors.lean_delay if s == "lean" else 0.0), *series[s]) - z
        for s, z in zip(SIGNALS, zero, strict=True)
    ]
    columns[1] = columns[1] - columns[1][0]
    imu = calibrated({s: series[s] for s in IMU_SIGNALS if s in series}, rig.sensors)
    findings += _saturation(series["lean"], rig)
    return Ride(name, rig, start, dt, np.column_stack(columns), imu, tuple(findings))


def _series(table: pd.DataFrame, column: str) -> Series:
    values = table[column].to_numpy(dtype=float)
    there = ~np.isnan(values)
    return table["t"].to_numpy(dtype=float)[there], values[there]


def _rolled_by_speed(run: Run, rig: BicycleFile, findings: list[Finding]) -> Series:
    """The wheel's angle from a logged speed, where the bicycle counts no turns of its wheel."""
    path = run.path / EXTRA
    extra = parquet_table(path) if path.is_file() else pd.DataFrame()
    if "speed" not in extra:
        raise RunError(
            f"{run.path}: holds no rear_wheel, nor a speed among its extras to count it from"
        )
    t, speed = _series(extra, "speed")
    rolled = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t))])
    text = "the wheel's angle is the integral of the logged speed over its radius: no encoder was logged"
    findings.append(Finding("from_speed", "rear_wheel", "note", text))
    return t, rolled / rig.geometry.R


def _rolled(series: Series, rig: BicycleFile, findings: list[Finding], source: str) -> Series:
    """The wheel's angle without the jumps of a counter that ran over; RunError where it runs backward."""
    t, angle = series
    steps = np.diff(angle)
    typical = float(np.median(np.abs(steps))) + 2.0 * np.pi / rig.sensors.steps_per_turn
    gap = np.diff(t) > GAP_PERIODS / rig.rate  # what happened there is told apart
    jumps = np.flatnonzero((np.abs(steps) > max(50.0 * typical, 1.0)) & ~gap)
    back = _fallen_back(steps, gap, rig)
    if len(back) > len(jumps):
        jumps = back
    if jumps.size:
        sizes = steps[jumps]
        lost = _lost(steps, jumps)
        if np.ptp(lost) > 20.0 * typical + 0.2:
            row = int(jumps[0])
            raise RunError(
                f"{source}: column rear_wheel: jumps by {sizes[0]:.4g} rad at {t[row + 1]:.3f} s and by "
                "other amounts elsewhere: no counter runs over like that; lost counts or a loose encoder?"
            )
        size = _counter_range(float(np.median(lost)), rig)
        corrected = steps.copy()
        corrected[jumps] -= np.sign(sizes) * size
        angle = np.concatenate([[angle[0]], angle[0] + np.cumsum(corrected)])
        text = (
            f"the counter ran over {jumps.size} times (by {size:.5g} rad, first at "
            f"{t[jumps[0] + 1]:.2f} s); its turns were put together again"
        )
        findings.append(Finding("rollover", "rear_wheel", "warning", text))
    if angle[-1] - angle[0] < -1.0:
        raise RunError(
            f"{source}: column rear_wheel: ends {angle[0] - angle[-1]:.4g} rad below its start: the bicycle "
            "rolled backward, or the encoder counts forward as negative (forward is positive)"
        )
    return t, angle


def _fallen_back(steps: Array, gap: NDArray[np.bool_], rig: BicycleFile) -> NDArray[np.intp]:
    """Where a counter of short range ran over: the wheel rolls on and its angle falls back, each time by as
    much. Empty where that is no counter's doing."""
    step = 2.0 * np.pi / rig.sensors.steps_per_turn
    rolling = float(np.median(steps[~gap])) if not gap.all() else 0.0
    if abs(rolling) < step:
        return np.empty(0, dtype=np.intp)
    fell = np.flatnonzero((np.sign(rolling) * steps < -(FALLS * abs(rolling) + 2.0 * step)) & ~gap)
    if fell.size < 2:
        return np.empty(0, dtype=np.intp)
    size = float(np.median(np.abs(steps[fell]))) + abs(rolling)
    # at rest on the edge of its range a counter jumps up as well
    at = np.flatnonzero((np.abs(np.abs(steps) - size) < 0.5 * size) & ~gap)
    if not 2 <= at.size <= 0.5 * len(steps):
        return np.empty(0, dtype=np.intp)
    lost = _lost(steps, at)
    alike = np.abs(lost - np.median(lost)) < ALIKE * np.median(lost) + 2.0 * step
    return at if alike.all() else np.empty(0, dtype=np.intp)


def _lost(steps: Array, at: NDArray[np.intp]) -> Array:
    """(len(at),) by how much each of the steps `at` falls short of those beside it, rad."""
    rest = np.setdiff1d(np.arange(len(steps)), at)
    return np.asarray(np.sign(steps[at]) * (steps[at] - np.interp(at, rest, steps[rest])))


def _counter_range(seen: float, rig: BicycleFile) -> float:
    """Radians at which a counter runs over that was seen to lose `seen`: turns or powers of two steps where
    one is that near, else whole steps."""
    step = 2.0 * np.pi / rig.sensors.steps_per_turn
    usual = (
        2.0 * np.pi * max(round(seen / (2.0 * np.pi)), 1),
        step * 2.0 ** round(np.log2(seen / step)),
    )
    near = min(usual, key=lambda x: abs(x - seen))
    return near if abs(near - seen) < 8.0 * step else step * round(seen / step)


def _rate_and_gaps(signal: str, t: Array, rig: BicycleFile, source: str) -> list[Finding]:
    steps = np.diff(t)
    out = []
    rate = 1.0 / float(np.median(steps))
    for per_s, unit in ((1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")):
        if abs(rate * per_s / rig.rate - 1.0) < 0.2:
            raise RunError(
                f"{source}: column t: {signal} comes every {1.0 / rate:.4g} s where the rig file says "
                f"{rig.rate:g} Hz: are these {unit}?"
            )
    if abs(rate / rig.rate - 1.0) > 0.2:
        text = f"is sampled at {rate:.1f} Hz, the rig file says {rig.rate:g}: it was interpolated"
        out.append(Finding("rate", signal, "warning", text))
    holes = np.flatnonzero(steps > GAP_PERIODS / min(rate, rig.rate))
    if holes.size:
        k = int(holes[np.argmax(steps[holes])])
        text = (
            f"{holes.size} gaps, the longest {1e3 * steps[k]:.0f} ms at {t[k]:.2f} s: straight lines stand "
            "there, and everything after has a path of its own"
        )
        out.append(Finding("gaps", signal, "warning", text))
    return out


def _saturation(series: Series, rig: BicycleFile) -> list[Finding]:
    t, lean = series
    limit = rig.sensors.lean_range
    at_end = np.abs(lean) >= limit - max(rig.noise.lean_step, 1e-4)
    if at_end.sum() < 3:
        return []
    text = (
        f"{at_end.sum()} samples stand at the inclinometer's range of ±{np.rad2deg(limit):.1f} degrees, "
        f"first at {t[np.argmax(at_end)]:.2f} s: the bicycle leant further than it could read"
    )
    return [Finding("saturation", "lean", "warning", text)]
