"""Signals of rides in steps coarser than the rig file says: seen in the values as sensors told them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.bicycle.sensors import IMU_SIGNALS, noise_of
from hil.config import BicycleFile
from hil.config.bicycle import SIGNALS
from hil.gap.bicycle.noise import carried, of_draws
from hil.gap.bicycle.problem import RideProblem
from hil.gap.bicycle.twin import RideTwin
from hil.gap.floor.noise import NoiseModel
from hil.gap.floor.rounding import is_coarse, step_of
from hil.runs import Run

Array = NDArray[np.float64]

SAME: Final = 0.01
"""Of a step, by which those of several rides may differ."""


def coarse_steps_of_rides(runs: Sequence[Run], rig: BicycleFile) -> dict[str, float]:
    """By signal, the step that its values keep to in every ride, where rig file and noise allow none such."""
    out = {}
    for signal in (*SIGNALS, *IMU_SIGNALS):
        told = [run.table[signal].dropna().to_numpy() for run in runs if signal in run.table]
        sigma, own = noise_of(signal, rig)
        steps = [step_of(values, own) for values in told]
        known = [step for step in steps if step is not None]
        if not known or len(known) < len(steps):
            continue
        if np.ptp(known) < SAME * min(known) and is_coarse(known[0], sigma, own):
            out[signal] = float(np.mean(known))
    return out


def with_steps(
    noise: NoiseModel,
    problem: RideProblem,
    vector: Array,
    steps: Mapping[str, float],
    rng: np.random.Generator,
) -> NoiseModel:
    """`noise` with what the `steps` of its signals make of rides at `vector`: a slow signal is off to one
    side for as long as it stays between two of them."""

    def error(twin: RideTwin, signal: str, values: Array) -> Array:
        step = steps.get(signal)
        if step is None:
            return np.zeros(len(values))
        spread, _ = noise_of(signal, twin.rig)
        place = (values + spread * rng.standard_normal(len(values))) / step + rng.random()
        return np.asarray(step * (np.round(place) - place))

    values = problem.values(vector)
    off = np.array([carried(problem, values, error) for _ in range(len(noise.draws))])
    said = ", ".join(f"{signal} in steps of {step:.3g}" for signal, step in steps.items())
    return of_draws(problem, noise.draws + off, f"{noise.text}; {said}")
