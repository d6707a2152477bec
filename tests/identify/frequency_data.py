"""Multisines, analytic systems and runs made of them, for tests of frequency responses."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd

from hil.configfile import load_rig
from hil.identify.frequency.channels import Sampled
from hil.runs.folder import RunMeta
from hil.runs.reader import Run

AXIS = load_rig("axis")


def analytic(hz, frequency=10.0, damping=1.0, delay=0.035, gain=1.0):
    """Second-order low-pass with delay, written out anew."""
    s = 2j * np.pi * np.asarray(hz)
    w = 2 * np.pi * frequency
    return gain * np.exp(-delay * s) * w**2 / (s**2 + 2 * damping * w * s + w**2)


class Multisine:
    """Σ A_k cos(2π k t/T + φ_k) and what a linear system makes of it, at any instants."""

    def __init__(self, lines, amplitudes, period_s, rng):
        self.lines = np.asarray(lines)
        self.phasors = np.asarray(amplitudes) * np.exp(
            2j * np.pi * rng.uniform(size=len(self.lines))
        )
        self.period_s = period_s

    def at(self, t, system=None):
        factor = 1.0 if system is None else system(self.lines / self.period_s)
        turn = np.exp(2j * np.pi / self.period_s * np.outer(t, self.lines))
        return (turn @ (self.phasors * factor)).real


def irregular(start_s, end_s, step_s, rng, jitter=0.2):
    """Instants as a bus gives them: even, each off by up to `jitter` of a step."""
    t = np.arange(start_s, end_s, step_s)
    return t + step_s * rng.uniform(-jitter, jitter, len(t))


def sampled(name, t, value, unit="m"):
    return Sampled(name, unit, np.asarray(t), np.asarray(value))


def axis_run(name, cue, position, rng, seconds=20.0, noise=0.0, mode="position"):
    """A run of the axis: `cue(t)` asked for and `position(t)` measured, each at its own instants."""
    bus = AXIS.bus
    actuator = AXIS.actuator_names[0]
    t_cue = np.arange(0.0, seconds, 0.01)
    t_sample = irregular(0.003, seconds, 0.02, rng, 0.01)
    columns = {
        "cue.position": (t_cue, cue(t_cue)),
        f"{actuator}.position": (
            t_sample + bus.answer_delay,
            position(t_sample) + noise * rng.standard_normal(len(t_sample)),
        ),
    }
    grid = np.unique(np.concatenate([t for t, _ in columns.values()]))
    table = {"t": grid}
    for key, (t, value) in columns.items():
        column = np.full(len(grid), np.nan)
        column[np.searchsorted(grid, t)] = value
        table[key] = column
    meta = RunMeta(rig=AXIS.name, mode=mode, started=datetime(2026, 1, 1, tzinfo=UTC))
    return Run(Path(name), meta, AXIS, pd.DataFrame(table), pd.DataFrame({"t": []}), ())
