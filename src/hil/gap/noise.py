"""The noise floor: what a residual would be with no gap at all, and how to weigh residuals by it.

Two sources, and the model says which it used. Repeats: where the same motion was played again (periods of
an experiment, or runs that repeat each other), half the difference of the residuals of two repeats is
noise and nothing else, whatever its cause. Otherwise a noise model: records drawn from the twin itself
with the rig file's sensors and bus (`hil.gap.draws`). How well setpoint stamps tell the drives' ticks is
not in a rig file; it is read from the fine structure of the residual, bounded by what the bus can do.

Residuals are whitened by the spread that the draws have at each instant (timing noise grows with speed
and acceleration) and by the inverse of the draws' own autoregression: the floor's, never the gap's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz
from scipy.ndimage import median_filter
from scipy.signal import lfilter

from hil.gap.draws import draws, longest_wait_s, sensor_sigma
from hil.gap.problem import Problem
from hil.gap.repeats import Repeats

Array = NDArray[np.float64]
Index = NDArray[np.int64]

DRAWS: Final = 6
SHIFT_S: Final = 1e-4
ORDER: Final = 6
SPIKE: Final = 4.0
"""Typical spreads by which a residual may leave its neighbours: a frame that missed a tick kicks harder."""
NEIGHBOURS: Final = 5
USUAL: Final = 0.8
"""Share of the samples, the quieter ones, that tell a gap from many frames that came at the wrong tick."""
UNSTEADY: Final = 3.0
"""Times the model that noise may have by repeats and by the record's level at most: on healthy rigs of two
worlds that is below 2 for forces and 3.1 for accelerometers; what else does not repeat is gap."""
ALIKE: Final = 3.0
"""Spreads of noise by which two repeats may be predicted to differ."""
RARE: Final = 1.8
"""Times what the usual samples say, from which on differences of repeats are rare events and no noise."""
LEVEL_RANGE: Final = (0.3, 3.0)
"""Times the noise model; more than that in the fastest part of a residual is gap."""
LOUDEST: Final = {"position": 1.4, "velocity": 1.4}
"""The same for sensors of motion, whose steps and noise are known: on healthy rigs they are below 1.3."""
LOUDER: Final = 1.1
"""Times all that is left, that its noise may have by the model: weights and chance make that much."""
COMMON: Final = 0.98
"""Share of the samples, the smaller ones, that tell how loud a record is; the rest are its spikes."""
HEALTHY: Final = 1.25
"""Times the level that a healthy reference has by the same model: a run is no noisier than that by itself."""
CALM: Final = 0.4
LIVELY: Final = 0.6
"""Quantiles of how much samples feel time, below which they tell of sensors and above which of timing."""
AS_LIVELY: Final = 0.5
"""Of the run's part of timing in its noise, that a reference must have to tell the level of it."""


@dataclass(frozen=True, slots=True)
class Level:
    """How loud a record is beside the noise model: times the sensors' part, times timing's, and how large
    timing's part is over the sensors'."""

    sensed: float
    late: float
    lively: float

    @property
    def factor(self) -> float:
        """Times the model, both parts together."""
        return math.hypot(self.sensed, self.late * self.lively) / math.hypot(1.0, self.lively)


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
            out[x.part] = lfilter(np.concatenate([[1.0], -ar]) / gain, [1.0], z[x.part], axis=0)
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

    def floor(self, problem: Problem) -> dict[str, float]:
        """Root mean square of the draws of each signal over its judged samples."""
        out = {}
        for signal in problem.signals:
            total, count = 0.0, 0
            for x in problem.series:
                if x.signal == signal:
                    kept = self.draws[:, x.part][:, problem.kept[x.part]]
                    total += float(np.sum(kept**2))
                    count += kept.size
            out[signal] = float(np.sqrt(total / max(count, 1)))
        return out


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
    drawn = late + sensed
    timing = time_sensitivity(problem, vector)
    wait_us = 1e6 * longest_wait_s(problem.rig)
    ticks = (
        "at the drives' ticks as read from the record" if problem.clocks else "anywhere in a tick"
    )
    text = (
        f"noise model: the rig file's sensor noise and rounding, answers' jitter, setpoints that act {ticks} "
        f"after waits of up to {wait_us:.0f} µs; {count} records drawn from the twin itself"
    )
    levels: dict[str, Level] = {}
    if residual is not None:
        drawn, levels = _as_loud(problem, late, sensed, residual, healthy or {})
        factors = [x.factor for x in levels.values()] or [1.0]
        low, high = min(factors), max(factors)
        text += (
            f", each signal's level times {low:.2g} to {high:.2g} by the fastest part of its residual, "
            "and no louder than all of that"
        )
    if not repeats or residual is None:
        return replace(from_draws(problem, drawn, "model", text, timing), levels=levels)
    by_level = {s: level.factor for s, level in levels.items()}
    sigma = from_draws(problem, drawn, "model", text, timing).sigma
    scaled, by_signal = _by_repeats(problem, drawn, repeats, residual, by_level, sigma)
    what = "; ".join(dict.fromkeys(r.text for r in repeats))
    low, high = min(by_signal.values()), max(by_signal.values())
    text = (
        f"{what}: half the difference of their residuals is noise, {low:.2g} to {high:.2g} times the noise "
        "model, whose shape in time is kept"
    )
    return replace(from_draws(problem, scaled, "repeats", text, timing), levels=levels)


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


def _as_loud(
    problem: Problem,
    late: Array,
    sensed: Array,
    residual: Array,
    healthy: Mapping[str, Level],
) -> tuple[Array, dict[str, Level]]:
    """Draws of timing and sensors brought series by series to the level of a residual.

    To the median size of its second differences, which leave out what is slow and what is rare: kicks at
    reversals, lost frames. And never louder than the whole residual is, for that holds the noise: what the
    bus may do to timing at most is often more than this bus does. Nor much louder than a healthy record.
    """
    out, levels = late + sensed, dict[str, Level]()
    for x in problem.series:
        kept = problem.kept[x.part]
        if kept.sum() < 50:
            continue
        left = residual[x.part][kept]
        a, b = late[:, x.part][:, kept], sensed[:, x.part][:, kept]
        lively = float(np.sqrt(_loud(a) / max(_loud(b), 1e-300)))
        most = (LOUDEST.get(x.quantity, LEVEL_RANGE[1]), LEVEL_RANGE[1])
        usual = healthy.get(x.signal)
        if usual is not None:
            as_lively = usual.lively > AS_LIVELY * lively
            most = (
                min(most[0], HEALTHY * usual.sensed),
                min(most[1], HEALTHY * usual.late) if as_lively else most[1],
            )
        of_sensors, of_timing = _level(left, a, b, most)
        out[:, x.part] = of_timing * late[:, x.part] + of_sensors * sensed[:, x.part]
        known = levels.get(x.signal, Level(0.0, 0.0, 0.0))
        levels[x.signal] = Level(
            max(of_sensors, known.sensed), max(of_timing, known.late), max(lively, known.lively)
        )
    return out, levels


def _level(
    left: Array, late: Array, sensed: Array, most: tuple[float, float]
) -> tuple[float, float]:
    """What draws of sensors and of timing (D, M) are multiplied by, `most` at most, to be as loud as `left`
    (M,): the one by what hardly feels time, the other by what feels it. Timing is no quieter than the model,
    for its kicks are rare, unless all of `left` is."""
    felt = np.sqrt(np.mean(np.diff(late, 2, axis=1) ** 2, axis=0))
    calm, lively = felt <= np.quantile(felt, CALM), felt > np.quantile(felt, LIVELY)
    fine = np.abs(np.diff(left, 2))
    s, t = 1.0, 1.0
    for _ in range(6):
        size = np.abs(np.diff(t * late + s * sensed, 2, axis=1))
        s = float(np.clip(s * _times(fine, size, calm), *LEVEL_RANGE))
        size = np.abs(np.diff(t * late + s * sensed, 2, axis=1))
        t = float(np.clip(t * _times(fine, size, lively), 1.0, LEVEL_RANGE[1]))
        room = LOUDER**2 * _loud(left) - s**2 * _loud(sensed)
        t = min(t, float(np.sqrt(max(room, 0.0) / max(_loud(late), 1e-300))))
    return min(s, most[0]), min(t, max(most[1], 1.0))


def _times(fine: Array, size: Array, some: NDArray[np.bool_]) -> float:
    """How many times larger the median of `fine` (M,) is than that of `size` (D, M) where `some` (M,)."""
    if not some.any():
        return 1.0
    return float(np.median(fine[some])) / max(float(np.median(size[:, some])), 1e-300)


def _loud(values: Array) -> float:
    """Mean square of the smaller COMMON of `values`."""
    size = np.sort(values.ravel() ** 2)
    return float(np.mean(size[: max(int(COMMON * len(size)), 1)]))


def _factor(measured: Array, modelled: Array, spread: Array) -> float:
    """Times that differences of repeats (M,) are larger than `modelled` ones (D, M).

    Where some are RARE beside the usual ones, for frames that one of two lost are no noise, both are cut at
    SPIKE times their `spread` (M,), as spikes are everywhere.
    """
    usual, all_of_them = (
        float(np.sqrt(_mean_square(measured, share) / max(_mean_square(modelled, share), 1e-300)))
        for share in (USUAL, 1.0)
    )
    least = float(np.mean(np.clip(modelled, -SPIKE * spread, SPIKE * spread) ** 2))
    factor = usual
    for _ in range(2):
        most = SPIKE * factor * spread
        factor = float(np.sqrt(np.mean(np.clip(measured, -most, most) ** 2) / max(least, 1e-300)))
    factor = min(factor, RARE * usual)
    return factor if all_of_them > RARE * usual else max(factor, all_of_them)


def _mean_square(values: Array, share: float) -> float:
    """Of the smaller `share` of values."""
    size = np.sort(values.ravel() ** 2)
    return float(np.mean(size[: max(int(share * len(size)), 1)]))


def _by_repeats(
    problem: Problem,
    drawn: Array,
    repeats: Sequence[Repeats],
    residual: Array,
    by_level: Mapping[str, float],
    sigma: Array,
) -> tuple[Array, Mapping[str, float]]:
    """Draws scaled signal by signal to what repeats differ by, where the twin says the same of them: what is
    shaken into one of them is no noise. Up to UNSTEADY times the model, with what `by_level` did before."""
    out = np.array(drawn)
    factors = {}
    predicted = problem.measured - residual
    spread = np.sqrt(np.mean(drawn**2, axis=0))
    for signal in problem.signals:
        pairs = [_alike(*r.pairs[signal], predicted, spread) for r in repeats if signal in r.pairs]
        if sum(len(first) for first, _ in pairs) < 50:
            continue
        measured = np.concatenate([residual[first] - residual[second] for first, second in pairs])
        modelled = np.hstack([drawn[:, first] - drawn[:, second] for first, second in pairs])
        both = np.concatenate([np.hypot(sigma[first], sigma[second]) for first, second in pairs])
        most = UNSTEADY / max(by_level.get(signal, 1.0), 1.0)
        factors[signal] = min(_factor(measured, modelled, both), most)
        for x in problem.series:
            if x.signal == signal:
                out[:, x.part] *= factors[signal]
    return out, factors


def _alike(first: Index, second: Index, predicted: Array, spread: Array) -> tuple[Index, Index]:
    """Those of paired samples that are predicted alike, as far as frames that never come at the very same
    instants of a period allow; at least half of them."""
    apart = np.abs(predicted[first] - predicted[second]) / spread[first]
    same = apart <= max(ALIKE, float(np.median(apart)))
    return first[same], second[same]


def projected(model: NoiseModel, problem: Problem, jacobian: Array, prior_sd: Array) -> NoiseModel:
    """The same floor after each draw had its own nuisances refitted, as the residual has had.

    `jacobian` (N, P) of the nuisances, `prior_sd` (P,).
    """
    if not len(prior_sd):
        return model
    J = model.whiten(problem, jacobian) * prior_sd
    white = model.whiten(problem, model.draws.T)
    step = np.linalg.solve(J.T @ J + np.eye(J.shape[1]), J.T @ white)
    step = np.clip(step, -3.0, 3.0)
    return replace(model, draws=model.draws - (jacobian * prior_sd @ step).T)
