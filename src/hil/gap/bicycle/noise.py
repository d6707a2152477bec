"""The floor of a ride: noise of its sensors, carried through the ride's own equations and filters.

Beside it what a healthy bicycle is off its file by: nobody weighs, measures and mounts better than that, so
a verdict counts from there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.signal import lfilter, welch

from hil.bicycle.sensors import IMU_SIGNALS, noise_of
from hil.config.bicycle import SIGNALS
from hil.gap.bicycle.nuisances import SCALE
from hil.gap.bicycle.problem import RideProblem
from hil.gap.bicycle.sideslip import slipped
from hil.gap.bicycle.twin import LEAN_TORQUE, RideTwin
from hil.gap.floor.differences import SPIKE
from hil.gap.floor.noise import NoiseModel, autoregression, projected
from hil.gap.record.problem import Problem
from hil.rigs.bicycle import Packed, low_pass

Array = NDArray[np.float64]
Error = Callable[[RideTwin, str, Array], Array]
"""(N,) of a signal of a ride, given its values (N,)."""

TYRE: Final = "bicycle.tyre_compliance"
DRAWS: Final = 8
WINDOW_S: Final = 1.5
ENVELOPE_S: Final = 0.4
QUIET_HZ: Final = (4.0, 12.0)
SLOW_HZ: Final = 2.5
"""Taken out before: a wheel that turns is a ramp, whose spectrum has no end."""
JUDGED_HZ: Final = 0.8
CORNER_HZ: Final = 10.0
"""Of the filters inside inclinometers and IMUs: between 5 and 20 Hz [R]."""
SLUGGISH: Final = {"lean": 3.0}
"""Hz below which the noise of a signal rises besides: what makes an inclinometer's is slow itself [R]."""
SLOW: Final = 0.25
WANDERS_S: Final = 0.2
"""Of the power of a sensor's noise, what may be slow besides, and how long that lasts [R]: warmth, play and
what filters leave of shaking wander, where no quiet band tells it."""
LOUDER: Final = 0.93
"""Of a floor, what nuisances leave of noise alone."""
REWEIGHTED: Final = 4
LOUDEST: Final = (0.7, 6.0)
"""Bounds of how much louder than its file a sensor is believed to be, by a rough road as well: beyond, it is
a finding."""
SWAY: Final = 1.2
"""N m of lean torque that a healthy rider's breathing and pedalling make, rms [R]: of an upper body of 40 kg
six tenths of a degree."""
SWAY_S: Final = 0.4
SHARE: Final = 0.3
"""Of a gap's size, that a model of it may be off by."""
MASS: Final = 0.006
"""Of a body's mass and of a drag, as one who weighs bodies apart knows them [R]; this and all that follow
are standard deviations."""
INERTIA: Final = 0.015
"""Of a moment of inertia, as one who lets bodies swing knows it [R]."""
PLACE_M: Final = 0.0015
"""Of a tape measure [R]."""
TILT: Final = 0.0015
"""rad of the steer axis: a tenth of a degree [R]."""
LATE_S: Final = 0.001
"""Of lean, wheel and steer against each other: a tenth of a sample [R]."""
FIRM: Final = (2.5e5, 250.0)
"""N/m and N s/m of a hard tyre under its load, one standard deviation softer than none that gives [R: road
tyres have 150 to 300 kN/m]."""
EDGE: Final = 1.4
"""Standard deviations of all that a bicycle may be off by and need no explanation."""


def ride_noise(
    problem: RideProblem, vector: Array, rng: np.random.Generator, slow: float = 0.0
) -> NoiseModel:
    """Draws (D, N) of what noise alone leaves at `vector`: of lean, wheel and steer through the twin, and
    the IMU's own; with `slow` of its power besides as noise that lasts for WANDERS_S."""
    louder = {id(twin): _loudness(twin) for twin in problem.twins}

    def error(twin: RideTwin, signal: str, values: Array) -> Array:
        white = _noise(rng, len(values), *noise_of(signal, twin.rig))
        return louder[id(twin)][signal] * (white + _slow(rng, white, twin.recorded.dt_s, slow))

    values = problem.values(vector)
    drawn = np.array([carried(problem, values, error) for _ in range(DRAWS)])
    for row in drawn:
        for x in problem.series:
            if x.signal == LEAN_TORQUE:
                twin = problem.twins[x.stretch]
                count = len(twin.recorded.angles)
                sway = twin.filtered(_sway(rng, count, twin.recorded.dt_s))
                row[x.part] += sway[twin.judged]
    text = (
        "noise model: noise and rounding of lean, wheel and steer through the ride's equations, and the "
        f"IMU's own, all through the ride's low-pass; {DRAWS} draws; as large as the records show it between "
        f"{QUIET_HZ[0]:g} and {QUIET_HZ[1]:g} Hz, where no rider moves: {_said(louder.values())} of the rig "
        "file's"
    )
    if slow > 0.0:
        text += (
            f"; {100.0 * slow:.0f} % of its power besides as noise that lasts for {WANDERS_S:g} s"
        )
    return of_draws(problem, drawn, text)


def carried(problem: RideProblem, values: Mapping[str, float], error: Error) -> Array:
    """(N,) what errors of lean, wheel and steer leave through the twin, and those of the IMU."""
    parts = []
    for twin in problem.twins:
        ride = twin.recorded
        clean = twin.filtered(ride.angles)
        off = [error(twin, s, clean[:, k]) for k, s in enumerate(SIGNALS)]
        right, wrong = twin.answer(values, clean), twin.answer(values, clean + np.column_stack(off))
        for s in twin.signals:
            left = right[s] - wrong[s]
            if s != LEAN_TORQUE:
                stamps, told = ride.imu[s]
                dt_s = float(np.median(np.diff(stamps)))
                smooth = low_pass(told[:, None], dt_s, twin.rig.conditioning.cutoff)[:, 0]
                on_grid = np.asarray(np.interp(ride.t_s, stamps, error(twin, s, smooth)))
                left = left + twin.filtered(on_grid)[twin.judged]
            parts.append(left)
    return np.concatenate(parts)


def of_draws(problem: RideProblem, drawn: Array, text: str) -> NoiseModel:
    """The floor that draws (D, N) make."""
    sigma = _level(drawn, problem)
    terms, gains = [], []
    for x in problem.series:
        rows = (drawn[:, x.part] / sigma[x.part])[:, problem.kept[x.part]]
        ar, gain = autoregression(np.clip(rows, -4.0, 4.0))
        terms.append(ar)
        gains.append(gain)
    tame = np.clip(drawn, -SPIKE * sigma, SPIKE * sigma)
    return NoiseModel("model", text, tame, sigma, tuple(terms), tuple(gains))


def _level(drawn: Array, problem: Problem) -> Array:
    """(N,) typical size of draws (D, N) about each sample."""
    sigma = np.empty(problem.size)
    for x in problem.series:
        t = problem.t_s[x.part]
        typical = np.sqrt(np.mean(drawn[:, x.part] ** 2, axis=0))
        width = max(round(WINDOW_S / float(np.median(np.diff(t)))), 1)
        window = np.ones(2 * width + 1)
        level = np.convolve(typical, window, "same") / np.convolve(np.ones(len(t)), window, "same")
        sigma[x.part] = np.maximum(level, 0.2 * float(level.mean()))
    return sigma


def tempered(
    model: NoiseModel, problem: Problem, residual: Array, share: float = SHARE
) -> NoiseModel:
    """The draws' floor, with less weight where `share` of `residual` (N,) stands above it.

    A gap of a ride gathers where it is braked or pulls away, tens of floors high for a second. Counted in
    floors it would be taken for outliers, and a model that explains nine tenths of it would be worth nothing
    for the rest: there a sample counts in shares of the gap.
    """
    sigma = _level(model.draws, problem)
    for x in problem.series:
        t = problem.t_s[x.part]
        width = max(round(ENVELOPE_S / float(np.median(np.diff(t)))), 1)
        window = np.ones(2 * width + 1)
        power = np.convolve(residual[x.part] ** 2, window, "same") / np.convolve(
            np.ones(len(t)), window, "same"
        )
        sigma[x.part] = np.sqrt(sigma[x.part] ** 2 + share**2 * power)
    return replace(model, sigma=sigma)


def no_louder(model: NoiseModel, problem: RideProblem, residual: Array) -> NoiseModel:
    """The floor, of each signal no louder than what is left of it, `residual` (N,) after nuisances.

    What a rough road shakes between QUIET_HZ need not be there where rides are judged.
    """
    left, floors = model.usual(problem, residual), model.usual(problem, model.draws)
    drawn = model.draws.copy()
    for x in problem.series:
        if left[x.signal] < LOUDER * floors[x.signal]:
            drawn[:, x.part] *= left[x.signal] / (LOUDER * floors[x.signal])
    return of_draws(problem, drawn, f"{model.text}; no louder than all that is left")


def with_tolerances(
    model: NoiseModel, problem: RideProblem, vector: Array, jacobian: Array, sd: Array,
    rng: np.random.Generator,
) -> NoiseModel:  # fmt: skip
    """The noise `model` with draws that hold as well what a healthy bicycle is off its file by.

    Draws of the bicycle's numbers and of its sensors' scales and times go through the twin at `vector`; the
    nuisances (`jacobian` (N, K), priors `sd` (K,) wide) take from each what they take from a record.
    """
    values = problem.values(vector)
    off = np.empty_like(model.draws)
    for d in range(len(off)):
        told = _mounted(values, rng)
        seed = int(rng.integers(2**31))
        parts = []
        for twin in problem.twins:
            own = np.random.default_rng(seed)
            built = replace(twin, bicycle=_built(twin.bicycle, own))
            steered = slipped(twin, values, problem.wheels.slips * own.standard_normal())
            right, wrong = twin.answer(values), built.answer(told, steered)
            parts += [EDGE * (wrong[s] - right[s]) for s in twin.signals]
        off[d] = np.concatenate(parts)
    off = np.where(np.isfinite(off), off, 0.0)
    freed = projected(replace(model, draws=off), problem, jacobian, sd)
    return replace(
        model,
        draws=model.draws + freed.draws,
        text=f"{model.text}; for the verdict with what a healthy bicycle is off its file by",
    )


def _built(nominal: Packed, rng: np.random.Generator) -> Packed:
    """A bicycle that was built and measured as well as bicycles are."""
    p, body, extra = nominal.p.copy(), nominal.body.copy(), nominal.extra.copy()
    turn = np.arctan2(p[3], p[4]) + TILT * rng.standard_normal()
    p[3], p[4] = np.sin(turn), np.cos(turn)
    p[7:11] += PLACE_M * rng.standard_normal(4)
    body[:, 0] *= 1.0 + MASS * rng.standard_normal(4)
    body[:, 1:] *= 1.0 + INERTIA * rng.standard_normal((4, 1))
    extra[1] *= 1.0 + 10.0 * MASS * rng.standard_normal()
    extra[2:] += PLACE_M * rng.standard_normal(3)
    return Packed(p, body, extra, nominal.sensor, nominal.encoder_on_frame)


def _mounted(values: Mapping[str, float], rng: np.random.Generator) -> dict[str, float]:
    """`values` with tyres that give as hard ones do, and sensors that are as true as calibrated ones are."""
    out = dict(values)
    if not np.isfinite(out[f"{TYRE}.stiffness"]):
        out[f"{TYRE}.stiffness"] = FIRM[0] / max(abs(rng.standard_normal()), 1e-3)
        out[f"{TYRE}.damping"] = FIRM[1]
    for s in (*SIGNALS, *IMU_SIGNALS):
        out[f"{s}.sensor_scale.scale"] *= 1.0 + SCALE * rng.standard_normal()
        if s in SIGNALS:
            out[f"{s}.sensor_latency.delay"] += LATE_S * rng.standard_normal()
    return out


def _loudness(twin: RideTwin) -> dict[str, float]:
    """By signal, the noise that a record has below QUIET_HZ over what the rig file's would be there.

    Read between QUIET_HZ, by the median over time, for jerks are no noise, and over frequencies, for wheels
    that are not round make lines; and led on to where rides are judged, for many sensors' noise is not white.
    """
    ride = twin.recorded
    series = {s: (ride.t_s, ride.angles[:, k]) for k, s in enumerate(SIGNALS)} | ride.imu
    out = {}
    for s, (t, values) in series.items():
        rate = 1.0 / float(np.median(np.diff(t)))
        sigma, step = noise_of(s, twin.rig)
        expected = 2.0 * (sigma**2 + step**2 / 12.0) / rate
        values = values - low_pass(values[:, None], 1.0 / rate, SLOW_HZ, 4)[:, 0]
        width = min(len(values), round(2.0 * rate))
        hz, power = welch(values, rate, nperseg=width, average="median")
        quiet = (hz > QUIET_HZ[0]) & (hz < QUIET_HZ[1])
        corners = (CORNER_HZ, *((SLUGGISH[s],) if s in SLUGGISH else ()))
        seen = expected
        if quiet.any():
            seen = float(np.median(power[quiet])) * _rise(hz, power, corners)
        out[s] = float(np.clip(np.sqrt(seen / max(expected, 1e-30)), *LOUDEST))
    return out


def _rise(hz: Array, power: Array, corners_hz: Sequence[float]) -> float:
    """How much more power noise has at JUDGED_HZ than, by the median, between QUIET_HZ: 1 where it is white.

    By white noise and parts through low-passes at `corners_hz`, fitted in relative errors to what is faster
    than a rider.
    """
    fast = (hz > QUIET_HZ[0]) & (hz < 0.9 * hz[-1])
    quiet = (hz > QUIET_HZ[0]) & (hz < QUIET_HZ[1])

    def parts(at_hz: Array) -> Array:
        """(N, C + 1) what each part has at these frequencies."""
        slow = [1.0 / (1.0 + (at_hz / corner) ** 2) for corner in corners_hz]
        return np.stack([np.ones_like(at_hz), *slow], axis=1)

    shape = parts(hz)
    level = np.maximum(power, 1e-300)
    for _ in range(REWEIGHTED):  # what a line or a lucky bin adds must not lead
        share, _ = nnls(shape[fast] / level[fast, None], power[fast] / level[fast])
        level = np.maximum(shape @ share, 1e-300)
    at = float(parts(np.array([JUDGED_HZ]))[0] @ share)
    return max(at / float(np.median(level[quiet])), 1.0)


def _sway(rng: np.random.Generator, count: int, dt_s: float) -> Array:
    """(N,) lean torque of a rider who sits as still as riders do, N m."""
    width = max(round(SWAY_S / dt_s), 1)
    window = np.hanning(2 * width + 1)
    noise = np.convolve(rng.standard_normal(count + 2 * width), window, "valid")
    return np.asarray(SWAY * noise / np.sqrt(np.sum(window**2)))


def _said(louder: Iterable[Mapping[str, float]]) -> str:
    """The range of loudness, in words."""
    shares = [x for one in louder for x in one.values()]
    return f"{min(shares):.2f} to {max(shares):.2f} times"


def _slow(rng: np.random.Generator, white: Array, dt_s: float, share: float) -> Array:
    """(N,) errors beside `white` ones (N,) that last for WANDERS_S, `share` of their power."""
    if share == 0.0:
        return np.zeros(len(white))
    keep = float(np.exp(-dt_s / WANDERS_S))
    size = np.sqrt(share * np.mean(white**2) * (1.0 - keep**2))
    start = size / np.sqrt(1.0 - keep**2) * rng.standard_normal()
    return np.asarray(
        lfilter([1.0], [1.0, -keep], size * rng.standard_normal(len(white)), zi=[keep * start])[0]
    )


def _noise(rng: np.random.Generator, count: int, sigma: float, step: float) -> Array:
    rounding = step * (rng.random(count) - 0.5)
    return np.asarray(sigma * rng.standard_normal(count) + rounding)
