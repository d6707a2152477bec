"""Checks of single signals: never moved, NaN blocks, clipped, of a size that its unit cannot mean."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from hil.config import RigFile
from hil.errors import RunError
from hil.runs.importing.convert import Signal
from hil.runs.importing.findings import Finding, Verdict
from hil.runs.importing.source import Array

NAN_BLOCK: Final = 10
"""So many times its usual spacing without a value is a block, not the pattern of its sampling."""
CLIPPED_RUN: Final = 4
"""So many samples in a row at the very same extreme count as clipped."""
GYRO_MAX: Final = 60.0
"""rad/s; more no rate sensor of this class shows (they end at 2000 deg/s = 35 rad/s)."""
ACCEL_NORM: Final = (5.0, 15.0)
"""m/s²; the median length of the specific force of a rig that moves people lies within."""


def check_signal(signal: Signal, source: str) -> list[Finding]:
    """All checks that need no other signal and no rig; RunError where there is nothing to check."""
    there = ~np.isnan(signal.values)
    if not there.any():
        raise RunError(f"{source}: column {signal.column}: holds no value at all")
    found = [*_nan_blocks(signal, there, source), *_clipping(signal, source)]
    values = signal.values[there]
    if values.min() == values.max():
        text = (
            f"{source}: column {signal.column}: never moved, it is {values[0]:.6g} {signal.unit} "
            "throughout; nothing that depends on its motion can be judged"
        )
        found.append(Finding("constant", signal.name, "warning", text))
    return found


def _nan_blocks(signal: Signal, there: npt.NDArray[np.bool_], source: str) -> list[Finding]:
    line = signal.line
    at = np.flatnonzero(there)
    usual = int(np.median(np.diff(at))) if len(at) > 1 else 1
    edges = np.concatenate([[-1], at, [len(there)]])
    missing = np.diff(edges) - 1
    worst = int(np.argmax(missing))
    blocks = int((missing >= NAN_BLOCK * usual).sum())
    if blocks:
        first, last = int(edges[worst]) + 1, int(edges[worst + 1]) - 1
        lasted = line.t_s[last] - line.t_s[first]
        text = (
            f"{source}: column {signal.column}, {line.row_word}s {int(line.rows[first]) + 1} to "
            f"{int(line.rows[last]) + 1}: no value for {lasted:.4g} s ({blocks} such blocks); cut the log, "
            "or allow it in the map to keep the rest"
        )
        return [Finding("nan_block", signal.name, "fault", text)]
    if usual == 1 and missing.any():
        text = f"{source}: column {signal.column}: {int(missing.sum())} empty cells, taken as not sampled"
        return [Finding("empty_cells", signal.name, "note", text)]
    return []


def _clipping(signal: Signal, source: str) -> list[Finding]:
    """Plateaus at an extreme that the signal reaches and leaves at speed."""
    if signal.name.startswith("cue.") or signal.name.endswith("setpoint"):
        return []
    values = signal.values[~np.isnan(signal.values)]
    steps = np.abs(np.diff(values))
    moving = steps[steps > 0.0]
    if len(moving) < 20:
        return []
    fast = max(3.0 * float(moving.min()), 0.25 * float(np.sqrt(np.mean(moving**2))))
    for level in {float(values.max()), float(values.min())} - {0.0}:  # 0 is rest
        starts, ends = _runs(values == level)
        # The step onto a plateau is cut short by it: the one before tells the speed.
        sides = [max(steps[max(a - 2, 0) : a], default=0.0) for a in starts]
        others = [max(steps[b - 1 : b + 1], default=0.0) for b in ends]
        clipped = [
            b - a
            for a, b, before, after in zip(starts, ends, sides, others, strict=True)
            if b - a >= CLIPPED_RUN and max(before, after) >= fast
        ]
        if clipped:
            text = (
                f"{source}: column {signal.column}: stays at its extreme {level:.6g} {signal.unit} for up to "
                f"{max(clipped)} samples, {sum(clipped) / len(values):.2%} of all: sensor or drive at its end"
            )
            return [Finding("clipping", signal.name, "warning", text)]
    return []


def _runs(mask: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    edges = np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)


def check_sizes(signals: dict[str, Signal], rig: RigFile | None, source: str) -> list[Finding]:
    """Numbers that cannot mean what their units say: against the rig file, and against gravity."""
    found: list[Finding] = []

    def say(name: str, text: str, verdict: Verdict = "warning") -> None:
        column = signals[name].column
        found.append(Finding("unit", name, verdict, f"{source}: column {column}: {text}"))

    for name, signal in signals.items():
        group, _, quantity = name.partition(".")
        size = _largest(signal)
        if quantity.startswith("gyro") and size > GYRO_MAX:
            say(name, f"up to {size:.4g} rad/s: are these deg/s, or counts?")
        if name in ("lean", "steer") and size > np.pi:
            say(name, f"up to {size:.4g} rad: are these degrees?")
        if rig is None or group not in rig.actuator_names:
            continue
        actuator = rig.actuators[rig.actuator_names.index(group)]
        stroke = actuator.stroke[1] - actuator.stroke[0]
        span = float(np.ptp(signal.samples()[1]))
        unit, asked = signal.unit, f"is the map's unit, {signal.given}, right?"
        if quantity in ("position", "setpoint") and 0.0 < span < stroke / 500.0:
            say(
                name,
                f"moves over {span:.3g} {unit} of a stroke of {stroke:g} {unit}: {asked}",
            )
        if quantity in ("force", "force_setpoint"):
            limit = actuator.force_max
            if size > 1.2 * limit:
                say(
                    name,
                    f"up to {size:.4g} {unit}, the drive's largest is {limit:g} {unit}: {asked}",
                )
            elif 0.0 < size < limit / 500.0:
                text = f"at most {size:.3g} {unit} of {limit:g} {unit}: {asked}"
                say(name, f"{text} are these kN, volts or amperes?")
        if quantity == "velocity" and size > 3.0 * actuator.velocity_max:
            fastest = actuator.velocity_max
            say(
                name, f"up to {size:.4g} {unit}, the drive's fastest is {fastest:g} {unit}: {asked}"
            )
    axes = [signals.get(f"imu.accel_{a}") for a in "xyz"]
    if all(axes) and len({id(a.line) for a in axes if a}) == 1:
        norm = np.sqrt(sum(a.values**2 for a in axes if a))
        middle = float(np.nanmedian(norm))
        if not ACCEL_NORM[0] < middle < ACCEL_NORM[1]:
            unit = "g" if 0.5 < middle < 1.5 else "another unit, or is gravity taken off"
            say(
                "imu.accel_x",
                f"specific force of {middle:.4g} m/s² in the middle: is it in {unit}?",
            )
    return found


def _largest(signal: Signal) -> float:
    values: Array = np.abs(signal.samples()[1])
    return float(np.percentile(values, 99.9))
