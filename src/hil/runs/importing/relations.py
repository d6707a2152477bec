"""Checks of signals against each other: an answer against its setpoint, force against motion."""

from __future__ import annotations

from typing import Final

import numpy as np
import scipy.ndimage
import scipy.signal

from hil.runs.importing.clocks import is_of_motion, usual_step_s
from hil.runs.importing.convert import Signal
from hil.runs.importing.findings import Finding
from hil.runs.importing.source import Array

LAG_MAX_S: Final = 0.5
SAMPLES_MAX: Final = 400_000
SMOOTHED_S: Final = 0.1
"""Rates are means over so long: noise and steps of the setpoint say less about delay than the motion."""
EARLY: Final = 0.5
"""Steps before its setpoint from which on an answer is too early: less is how well the delay is known."""
LIKE: Final = 0.5
"""Correlations of less say nothing about sign and delay."""


def check_axis(actuator: str, signals: dict[str, Signal], source: str) -> list[Finding]:
    """Setpoint against position, velocity against position's rate, force against velocity."""
    position = signals.get(f"{actuator}.position")
    if position is None or len(position.samples()[0]) < 20:
        return []
    found = []
    setpoint = signals.get(f"{actuator}.setpoint")
    if setpoint is not None:
        found.append(_following(setpoint, position, source))
    velocity = signals.get(f"{actuator}.velocity")
    if velocity is not None:
        found += _velocity(velocity, position, source)
    force = signals.get(f"{actuator}.force")
    if force is not None:
        found += _power(force, position, source)
    return found


def _grid(*signals: Signal) -> tuple[list[Array], float]:
    """The signals on one even grid over the time they share, and its step, s; empty where none."""
    zero_s = signals[0].line.origin_s
    stamped = [(t + (s.line.origin_s - zero_s), v) for s in signals for t, v in [s.samples()]]
    start = max(float(t[0]) for t, _ in stamped)
    end = min(float(t[-1]) for t, _ in stamped)
    step = min(float(np.median(np.diff(t))) for t, _ in stamped)
    if not end > start or step <= 0.0:
        return [], 0.0
    step = max(step, (end - start) / SAMPLES_MAX)
    grid = np.arange(start, end, step)
    return [np.interp(grid, t, v) for t, v in stamped] if len(grid) > 20 else [], step


def _following(setpoint: Signal, position: Signal, source: str) -> Finding:
    name = position.name
    if len(setpoint.samples()[0]) < 20:
        return Finding("delay", name, "note", "too few setpoints to compare with")
    on_grid, step = _grid(setpoint, position)
    if not on_grid:
        return Finding("delay", name, "note", "setpoint and position have no time in common")
    width = max(int(SMOOTHED_S / step), 1)
    rates = [scipy.ndimage.uniform_filter1d(np.diff(x), width) for x in on_grid]
    rates = [rate - np.mean(rate) for rate in rates]
    sizes = [float(np.linalg.norm(r)) for r in rates]
    if min(sizes) == 0.0:
        return Finding("delay", name, "note", "no motion, so no sign and no delay")
    c = scipy.signal.correlate(rates[1], rates[0], method="fft") / (sizes[0] * sizes[1])
    middle = len(rates[0]) - 1
    reach = min(int(LAG_MAX_S / step), middle)
    c = c[middle - reach : middle + reach + 1]
    lags = np.arange(-reach, reach + 1)
    # A periodic motion is like itself a period later: the nearer of two like ones is meant.
    size = np.abs(c)
    best = int(np.argmax(size * (1.0 - 0.2 * np.abs(lags) / max(reach, 1))))
    while 0 < best < len(c) - 1 and max(size[best - 1], size[best + 1]) > size[best]:
        best += 1 if size[best + 1] > size[best - 1] else -1
    delay = (lags[best] + _part_of_step(rates[0], rates[1], int(lags[best]))) * step
    side = "before" if delay < 0.0 else "behind"
    like = f"correlation of the rates {c[best]:.3f}"
    said = f"{abs(delay) * 1e3:.5g} ms {side} its setpoint ({like})"
    where = f"{source}: column {position.column}"
    if c[best] < -LIKE:
        text = f"{where}: runs against its setpoint {setpoint.column}: give one of them sign = -1"
        return Finding("opposite_sign", name, "fault", text)
    if c[best] < LIKE:
        text = (
            f"{where}: is not like its setpoint {setpoint.column} ({like}): is it another axis, or does a "
            "value stand out by far?"
        )
        return Finding("delay", name, "warning", text)
    if abs(delay) > LAG_MAX_S or not all(
        is_of_motion(usual_step_s(s.line)) for s in (setpoint, position)
    ):
        text = (
            f"{where}: {said}: no drive follows so: is the unit of time the one that the map says?"
        )
        return Finding("delay", name, "warning", text)
    if delay < -EARLY * step:
        text = (
            f"{where}: {said}: an answer before its question: is {setpoint.column} really the setpoint, and "
            "are the stamps of one clock, in the unit of time that the map says?"
        )
        return Finding("delay", name, "warning", text)
    return Finding("delay", name, "ok", said)


def _part_of_step(leading: Array, following: Array, lag: int) -> float:
    """What is left of a delay of `lag` steps, in steps: the shift that brings the two nearest."""
    n = len(leading) - abs(lag)
    a = leading[max(-lag, 0) :][:n]
    b = following[max(lag, 0) :][:n]
    slope = np.gradient(a)
    power = float(slope @ slope)
    return float((a - b) @ slope) / power if power > 0.0 else 0.0


def _velocity(velocity: Signal, position: Signal, source: str) -> list[Finding]:
    on_grid, step = _grid(velocity, position)
    if not on_grid:
        return []
    rate = np.gradient(on_grid[1], step)
    power = float(rate @ rate)
    like = float(np.corrcoef(on_grid[0], rate)[0, 1]) if power > 0.0 and np.ptp(on_grid[0]) else 0.0
    if abs(like) < LIKE:
        return []
    slope = float(on_grid[0] @ rate) / power
    if 0.8 < slope < 1.25:
        return []
    text = f"{source}: column {velocity.column}: is {slope:.4g} times the rate of {position.column}"
    return [Finding("velocity_scale", velocity.name, "warning", f"{text}: wrong unit or sign?")]


def _power(force: Signal, position: Signal, source: str) -> list[Finding]:
    """Friction takes power: over a whole record the drive gives more than it gets back."""
    on_grid, step = _grid(force, position)
    if not on_grid:
        return []
    rate = np.gradient(on_grid[1], step)
    size = float(np.linalg.norm(on_grid[0]) * np.linalg.norm(rate))
    share = float(on_grid[0] @ rate) / size if size > 0.0 else 0.0
    if share > -0.1:
        return []
    text = (
        f"{source}: column {force.column}: takes power out of the motion of {position.column} throughout "
        f"({share:.2f} of what it could): give it sign = -1"
    )
    return [Finding("force_sign", force.name, "warning", text)]
