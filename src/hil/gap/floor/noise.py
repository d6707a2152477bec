"""The noise floor: what a residual would be with no gap at all, and how to weigh residuals by it.

Records drawn from the twin itself with the rig file's sensors and bus (`hil.gap.floor.draws`), brought to the
level of the record's own fine structure (`hil.gap.floor.loudness`), and, where the same motion was played
again (periods of an experiment, or runs that repeat each other), to what repeats differ by
(`hil.gap.floor.differences`). The model says which it used.

Residuals are whitened by the spread that the draws have at each instant (timing noise grows with speed
and acceleration) and by the inverse of the draws' own autoregression: the floor's, never the gap's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz
from scipy.ndimage import median_filter

from hil.gap.floor.differences import SPIKE, USUAL, by_repeats
from hil.gap.floor.draws import FOLLOWED, UNKNOWN, draws, followed, longest_wait_s, sensor_sigma
from hil.gap.floor.loudness import Level, as_loud
from hil.gap.record.problem import Problem
from hil.gap.record.repeats import Repeats
from hil.gap.record.ticks import AtSync

Array = NDArray[np.float64]

DRAWS: Final = 6
SHIFT_S: Final = 1e-4
ORDER: Final = 6
NEIGHBOURS: Final = 5


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """The floor of a problem: draws (D, N) of residuals without a gap, in the signals' units."""

    source: Literal["repeats", "model"]
    text: str
    draws: Array
    sigma: Array
    """(N,) typical spread (by the median) of a residual without a gap at each sample."""
    ar: tuple[Array, ...]
    """Of each series: terms of the autoregression of draws over sigma."""
    gain: tuple[float, ...]
    """Of each series: spread of one step of that autoregression, so that whitened noise is 1."""
    levels: Mapping[str, Level] = field(default_factory=dict)
    """By signal, the level that the record's own residual gave the noise model."""

    def whiten(self, problem: Problem, flat: Array) -> Array:
        """(N, ...) residuals or sensitivities as they count: without a gap independent, spread 1.

        Samples that are not judged come out 0.
        """
        if not flat.size:
            return flat
        shape = (-1, *([1] * (flat.ndim - 1)))
        z = flat / self.sigma.reshape(shape) * problem.kept.reshape(shape)
        out = np.empty_like(z)
        for x, ar, gain in zip(problem.series, self.ar, self.gain, strict=True):
            # as scipy.signal.lfilter, which walks through many columns one by one in Python
            mine, white = z[x.part], z[x.part] / gain
            for back, term in enumerate(ar[: len(mine) - 1], start=1):
                white[back:] -= term / gain * mine[:-back]
            out[x.part] = white
        return np.asarray(out * problem.kept.reshape(shape))

    def tamed(self, problem: Problem, flat: Array) -> Array:
        """(N,) residuals with spikes cut, as those of the draws are."""
        return tame(problem, self.sigma, flat)

    def weighted_rms(self, problem: Problem, flat: Array) -> dict[str, float]:
        """By signal, root mean square of residuals (N,) or (D, N), in the signal's unit.

        Each sample is weighed by its noise; spikes are cut.
        """
        rows = np.array([self.tamed(problem, r) for r in np.atleast_2d(flat)])
        out = {}
        for signal in problem.signals:
            total, weight = 0.0, 0.0
            for x in problem.series:
                if x.signal == signal:
                    kept = problem.kept[x.part]
                    w = 1.0 / self.sigma[x.part][kept] ** 2
                    total += float(np.sum(w * rows[:, x.part][:, kept] ** 2)) / len(rows)
                    weight += float(np.sum(w))
            out[signal] = float(np.sqrt(total / max(weight, 1e-300)))
        return out

    def spikes(self, problem: Problem, flat: Array) -> NDArray[np.bool_]:
        """(N,) samples of a residual that leave their neighbours by more than SPIKE typical spreads."""
        return np.asarray(self.tamed(problem, flat) != flat)

    def usual(self, problem: Problem, flat: Array) -> dict[str, float]:
        """By signal, root mean square of the smaller USUAL of residuals (N,) or (D, N) over their noise."""
        rows = np.atleast_2d(flat) / self.sigma
        out = {}
        for signal in problem.signals:
            parts = [
                rows[:, x.part][:, problem.kept[x.part]].ravel()
                for x in problem.series
                if x.signal == signal
            ]
            size = np.sort(np.concatenate(parts) ** 2)
            few = size[: max(int(USUAL * len(size)), 1)]
            out[signal] = float(np.sqrt(np.mean(few))) if len(size) else 0.0
        return out

    def rms(self, problem: Problem, flat: Array) -> dict[str, float]:
        """By signal, root mean square of residuals (N,) or (D, N) over its judged samples, spikes and all."""
        rows = np.atleast_2d(flat)
        out = {}
        for signal in problem.signals:
            total, count = 0.0, 0
            for x in problem.series:
                if x.signal == signal:
                    kept = rows[:, x.part][:, problem.kept[x.part]]
                    total += float(np.sum(kept**2))
                    count += kept.size
            out[signal] = float(np.sqrt(total / max(count, 1)))
        return out

    def floor(self, problem: Problem) -> dict[str, float]:
        """Root mean square of the draws of each signal over its judged samples."""
        return self.rms(problem, self.draws)


def from_draws(
    problem: Problem,
    drawn: Array,
    source: Literal["repeats", "model"],
    text: str,
    timing: Array | None = None,
) -> NoiseModel:
    """Typical spread and autoregression of `drawn` (D, N).

    `timing` (N,): what a second of delay would change of each sample. Where setpoints and answers are a
    little off in time a sample errs in proportion to it, far more right after a setpoint than before one.
    """
    sigma = np.empty(problem.size)
    terms, gains = [], []
    for x in problem.series:
        kept = problem.kept[x.part]
        late = np.zeros(len(kept)) if timing is None else timing[x.part]
        sigma[x.part] = _typical(
            np.abs(drawn[:, x.part]), late, 0.8 * sensor_sigma(problem.rig, x), kept
        )
        rows = np.clip(drawn[:, x.part] / sigma[x.part], -4.0, 4.0)[:, kept]
        ar, gain = autoregression(rows)
        terms.append(ar)
        gains.append(gain)
    tamed = np.array([tame(problem, sigma, d) for d in drawn])
    return NoiseModel(source, text, tamed, sigma, tuple(terms), tuple(gains))


def _typical(size: Array, late: Array, least: float, kept: NDArray[np.bool_]) -> Array:
    """(N,) spread: that of samples which hardly feel time, and a part in proportion to `late`."""
    share = np.abs(late)
    calm = kept & (share <= np.quantile(share[kept], 0.4)) if kept.any() else kept
    base = max(1.4826 * float(np.median(size[:, calm])) if calm.any() else least, least)
    felt = kept & (share > np.quantile(share[kept], 0.6)) if kept.any() else kept
    if not felt.any() or float(share[felt].max()) == 0.0:
        return np.full(size.shape[1], base)
    # the part in proportion: whatever makes the median of what is felt come out right
    low, high = 0.0, 1e-2
    for _ in range(30):
        middle = 0.5 * (low + high)
        ratio = size[:, felt] / np.hypot(base, middle * share[felt])
        low, high = (middle, high) if float(np.median(ratio)) > 0.6745 else (low, middle)
    return np.asarray(np.hypot(base, high * share))


def tame(problem: Problem, sigma: Array, flat: Array) -> Array:
    """(N,) residuals that leave the median of their neighbours by no more than SPIKE typical spreads."""
    out = np.empty_like(flat)
    for x in problem.series:
        r = flat[x.part]
        middle = median_filter(r, NEIGHBOURS, mode="nearest")
        most = SPIKE * sigma[x.part]
        out[x.part] = middle + np.clip(r - middle, -most, most)
    return out


def autoregression(z: Array) -> tuple[Array, float]:
    """Terms and step of the autoregression of the rows of `z`, by Yule and Walker [M]; of none, none."""
    n = z.shape[1]
    if n == 0:  # a signal of which no sample is judged
        return np.empty(0), 1.0
    order = min(ORDER, n // 20)
    r = np.array([np.mean(np.sum(z[:, k:] * z[:, : n - k], axis=1)) / n for k in range(order + 1)])
    if order == 0 or not np.any(np.abs(r[1:]) > 4.0 * r[0] / np.sqrt(n * len(z))):
        return np.empty(0), float(np.sqrt(max(r[0], 1e-12)))
    damped = r[:-1] + 1e-6 * r[0] * (np.arange(order) == 0)
    ar = np.asarray(solve_toeplitz(damped, r[1:]))
    return ar, float(np.sqrt(max(r[0] - ar @ r[1:], 1e-6 * r[0])))


def find_noise(
    problem: Problem,
    vector: Array,
    rng: np.random.Generator,
    *,
    repeats: Sequence[Repeats] = (),
    residual: Array | None = None,
    healthy: Mapping[str, Level] | None = None,
    count: int = DRAWS,
) -> NoiseModel:
    """The floor at `vector`: the model's draws, set right by repeats of the same motion where there are any.

    With the `residual` at `vector` the draws are brought to the level of its fastest part, in which noise
    is and a gap hardly; it is needed where `repeats` are given. `healthy`: levels of a reference, which this
    record's own exceed by little, for impacts and the like are fast as well.
    """
    late, sensed = draws(problem, vector, rng, count)
    drawn, near = late + sensed, followed(problem, rng.spawn(1)[0], count)
    timing = time_sensitivity(problem, vector)
    text = (
        "noise model: the rig file's sensor noise and rounding, answers' jitter, setpoints that act "
        f"{_acting(problem)}; {count} records drawn from the twin itself"
    )
    if problem.are_forces:
        text += (
            f", that is led by the measured positions, as the twin is, and feels a slow force of "
            f"{UNKNOWN * problem.rig.noise.force:g} N (or N·m) that no twin knows"
        )
    if near.any():
        text += (
            f", with a slow {1e6 * FOLLOWED:g} µm (or µrad) of each position that no twin follows"
        )
    levels: dict[str, Level] = {}
    if residual is not None:
        drawn, levels = as_loud(problem, late, sensed, residual, healthy or {})
        factors = [x.factor for x in levels.values()] or [1.0]
        low, high = min(factors), max(factors)
        text += (
            f", each signal's level times {low:.2g} to {high:.2g} by the fastest part of its residual, "
            "and no louder than all of that"
        )
    model = replace(from_draws(problem, drawn + near, "model", text, timing), levels=levels)
    if not repeats or residual is None:
        return model
    by_level = {s: level.factor for s, level in levels.items()}
    scaled, by_signal = by_repeats(problem, drawn, repeats, residual, by_level, model.sigma)
    if not by_signal:  # too few samples repeat
        return model
    what = "; ".join(dict.fromkeys(r.text for r in repeats))
    low, high = min(by_signal.values()), max(by_signal.values())
    text = (
        f"{what}: half the difference of their residuals is noise, {low:.2g} to {high:.2g} times the noise "
        "model, whose shape in time is kept"
    )
    return replace(from_draws(problem, scaled + near, "repeats", text, timing), levels=levels)


def _acting(problem: Problem) -> str:
    """When setpoints act in the draws, in words."""
    ticks = problem.clocks.values()
    if ticks and all(isinstance(x, AtSync) for x in ticks):
        return "at SYNC, or a tick later where the record says so"
    waits = f"after waits of up to {1e6 * longest_wait_s(problem.rig):.0f} µs"
    place = "at the drives' ticks as read from the record" if ticks else "anywhere in a tick"
    return f"{place} {waits}"


def time_sensitivity(problem: Problem, vector: Array) -> Array:
    """(N,) change of each sample per second by which setpoints, and in quadrature answers, are late."""
    base, changes = problem.predict(vector)[0], []
    for ends in ((".transport_delay.delay",), (".position.sensor_latency.delay",
                 ".velocity.sensor_latency.delay", ".force.sensor_latency.delay",
                 ".current.sensor_latency.delay", "imu.sensor_latency.delay")):  # fmt: skip
        row = np.array(vector)
        for i, p in enumerate(problem.table.entries):
            if p.name.endswith(ends):
                row[i] += SHIFT_S
        answer = problem.answers(row)[0]
        changes.append(np.where(np.isfinite(answer), answer - base, 0.0) / SHIFT_S)
    return np.asarray(np.hypot(*changes))


def projected(model: NoiseModel, problem: Problem, jacobian: Array, prior_sd: Array) -> NoiseModel:
    """The same floor after each draw had its own nuisances refitted, as the residual has had.

    `jacobian` (N, P) of the nuisances, `prior_sd` (P,).
    """
    if not len(prior_sd):
        return model
    J = model.whiten(problem, jacobian) * prior_sd
    white = model.whiten(problem, model.draws.T)
    held = problem.discount * np.eye(J.shape[1])
    step = np.linalg.solve(J.T @ J + held, J.T @ white)
    step = np.clip(step, -3.0, 3.0)
    return replace(model, draws=model.draws - (jacobian * prior_sd @ step).T)


def rougher(model: NoiseModel, problem: Problem, times: Mapping[str, float]) -> NoiseModel:
    """The same floor, of each signal as many times as high as `times` says: what a healthy rig stands above
    it is no gap of another record."""
    by_sample = np.ones(problem.size)
    for x in problem.series:
        by_sample[x.part] = times.get(x.signal, 1.0)
    return replace(model, draws=model.draws * by_sample, sigma=model.sigma * by_sample)
