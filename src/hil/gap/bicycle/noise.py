"""The floor of a ride: noise of its sensors, carried through the ride's own equations and filters."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.bicycle.sensors import noise_of
from hil.config.bicycle import SIGNALS
from hil.gap.bicycle.problem import RideProblem
from hil.gap.bicycle.twin import LEAN_TORQUE
from hil.gap.noise import SPIKE, NoiseModel, autoregression

Array = NDArray[np.float64]

DRAWS: Final = 8
WINDOW_S: Final = 1.5
ENVELOPE_S: Final = 0.4
SHARE: Final = 0.15
"""Of a gap's size, that a model of it may be off by."""


def ride_noise(problem: RideProblem, vector: Array, rng: np.random.Generator) -> NoiseModel:
    """Draws (D, N) of what noise alone leaves at `vector`: of lean, wheel and steer through the twin, and
    the IMU's own."""
    values = problem.values(vector)
    drawn = np.empty((DRAWS, problem.size))
    for d in range(DRAWS):
        parts = []
        for twin in problem.twins:
            ride = twin.recorded
            clean = twin.filtered(ride.angles)
            noisy = clean.copy()
            for k, s in enumerate(SIGNALS):
                noisy[:, k] += _noise(rng, len(noisy), *noise_of(s, twin.rig))
            with_noise = twin.answer(values, noisy)
            without = twin.answer(values, clean)
            for s in twin.signals:
                off = without[s] - with_noise[s]
                if s != LEAN_TORQUE:
                    stamps = ride.imu[s][0]
                    own = _noise(rng, len(stamps), *noise_of(s, twin.rig))
                    on_grid = np.asarray(np.interp(ride.t_s, stamps, own))
                    off = off + twin.filtered(on_grid)[twin.judged]
                parts.append(off)
        drawn[d] = np.concatenate(parts)
    sigma = np.empty(problem.size)
    terms, gains = [], []
    for x in problem.series:
        t = problem.t_s[x.part]
        typical = np.sqrt(np.mean(drawn[:, x.part] ** 2, axis=0))
        width = max(round(WINDOW_S / float(np.median(np.diff(t)))), 1)
        window = np.ones(2 * width + 1)
        level = np.convolve(typical, window, "same") / np.convolve(np.ones(len(t)), window, "same")
        sigma[x.part] = np.maximum(level, 0.2 * float(level.mean()))
        rows = (drawn[:, x.part] / sigma[x.part])[:, problem.kept[x.part]]
        ar, gain = autoregression(np.clip(rows, -4.0, 4.0))
        terms.append(ar)
        gains.append(gain)
    text = (
        "noise model: the rig file's noise and rounding of lean, wheel and steer through the ride's "
        f"equations, and the IMU's own, all through the ride's low-pass; {DRAWS} draws"
    )
    tame = np.clip(drawn, -SPIKE * sigma, SPIKE * sigma)
    return NoiseModel("model", text, tame, sigma, tuple(terms), tuple(gains))


def tempered(model: NoiseModel, problem: RideProblem, residual: Array) -> NoiseModel:
    """The same floor, with less weight where `residual` (N,) stands many floors above it.

    A gap of a ride gathers where it is braked or pulls away, tens of floors high for a second. Counted in
    floors it would be taken for outliers, and a model that explains nine tenths of it would be worth nothing
    for the rest: there a sample counts in shares of the gap.
    """
    sigma = model.sigma.copy()
    for x in problem.series:
        t = problem.t_s[x.part]
        width = max(round(ENVELOPE_S / float(np.median(np.diff(t)))), 1)
        window = np.ones(2 * width + 1)
        power = np.convolve(residual[x.part] ** 2, window, "same") / np.convolve(
            np.ones(len(t)), window, "same"
        )
        sigma[x.part] = np.sqrt(sigma[x.part] ** 2 + SHARE**2 * power)
    return replace(model, sigma=sigma)


def _noise(rng: np.random.Generator, count: int, sigma: float, step: float) -> Array:
    rounding = step * (rng.random(count) - 0.5)
    return np.asarray(sigma * rng.standard_normal(count) + rounding)
