"""Motions of one coordinate that begin and end at rest, made in the domain of acceleration.

A motion is known by samples of its acceleration a with speed v and position p. It is faded in and out
by a window on its acceleration; a little acceleration of the same smoothness, added within the fade,
makes it join the unfaded motion exactly, so that nothing drifts and nothing is filtered.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_simpson

Array = NDArray[np.float64]
Law = Literal["linear", "log"]

SWEEP_C1: Final = 4.0
SWEEP_C2: Final = 1.0 / (np.exp(SWEEP_C1) - 1.0)
"""Constants of the exponential sweep: "Towards Simulating a Mid-size Stewart Platform on a Large
Hexapod Simulator", (10), mended [V]: C2 = 1/(e^C1 - 1) = 0.018657 ends at the frequency asked for; the
printed 0.0187 is this rounded."""


@dataclass(frozen=True, slots=True)
class Motion:
    """Samples (m,) every `step_s`: acceleration, speed, position; SI."""

    step_s: float
    a: Array
    v: Array
    p: Array

    def __getitem__(self, part: slice) -> Motion:
        return Motion(self.step_s, self.a[part], self.v[part], self.p[part])

    def reversed(self) -> Motion:
        """The same motion run backwards."""
        return Motion(self.step_s, self.a[::-1], -self.v[::-1], self.p[::-1])


def smooth_step(u: Array) -> Array:
    """0 to 1 over u = 0..1, three derivatives vanish at both ends."""
    u = np.clip(u, 0.0, 1.0)
    return u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3)


def faded(motion: Motion, fade_in: int, fade_out: int) -> Motion:
    """`motion` with its acceleration faded in over so many steps and out over so many: rest to rest.

    Between the fades it is `motion` itself.
    """
    rising = _faded_in(motion[: fade_in + 1])
    falling = _faded_in(motion[len(motion.a) - fade_out - 1 :].reversed()).reversed()
    middle = motion[fade_in + 1 : len(motion.a) - fade_out - 1]
    parts = (rising, middle, falling)
    a, v, p = (np.concatenate([getattr(x, name) for x in parts]) for name in "avp")
    return Motion(motion.step_s, a, v, p)


def bridged(
    a: Array, step_s: float, start: tuple[float, float], end: tuple[float, float]
) -> Motion:
    """Motion with acceleration `a` (m,) from `start` to `end` (speed, position).

    Two smooth bumps, zero with three derivatives at both ends, are added to `a` so that it gets there.
    """
    u = np.linspace(0.0, 1.0, len(a))
    bump = (u * (1.0 - u)) ** 4
    bumps = (bump, bump * (1.0 - 2.0 * u))
    v, p = _integrated(a, step_s, *start)
    ends = [_integrated(b, step_s, 0.0, 0.0) for b in bumps]
    matrix = np.array([[x[0][-1] for x in ends], [x[1][-1] for x in ends]])
    c = np.linalg.solve(matrix, np.array([end[0] - v[-1], end[1] - p[-1]]))
    whole = a + c[0] * bumps[0] + c[1] * bumps[1]
    v, p = _integrated(whole, step_s, *start)
    return Motion(step_s, whole, v, p)


def chirp(law: Law, low_hz: float, high_hz: float, duration_s: float, step_s: float) -> Motion:
    """Sine of amplitude 1 in position whose frequency rises linearly or exponentially."""
    t = np.arange(round(duration_s / step_s) + 1) * step_s
    w0, w1 = 2.0 * np.pi * low_hz, 2.0 * np.pi * high_hz
    if law == "linear" or low_hz == high_hz:
        rate = np.full_like(t, (w1 - w0) / duration_s)
        w = w0 + rate * t
        theta = (w0 + 0.5 * rate * t) * t
    else:
        growth = np.log(w1 / w0) / duration_s
        w = w0 * np.exp(growth * t)
        theta, rate = (w - w0) / growth, growth * w
    sine, cosine = np.sin(theta), np.cos(theta)
    return Motion(step_s, rate * cosine - w**2 * sine, w * cosine, sine)


def sweep_frequency(t_s: Array, low_hz: float, high_hz: float, duration_s: float) -> Array:
    """ω (rad/s) of the exponential sweep at `t_s` after its start, (10) of the source of SWEEP_C1.

    Before 0 the lowest frequency is held, as the source does for one period.
    """
    w0, w1 = 2.0 * np.pi * low_hz, 2.0 * np.pi * high_hz
    share = np.clip(t_s / duration_s, 0.0, 1.0)
    return np.asarray(w0 + SWEEP_C2 * np.expm1(SWEEP_C1 * share) * (w1 - w0))


def sweep_phase(t_s: Array, low_hz: float, high_hz: float, duration_s: float) -> Array:
    """θ (rad), the integral of ω from one period before 0, (9) of the source of SWEEP_C1."""
    w0, w1 = 2.0 * np.pi * low_hz, 2.0 * np.pi * high_hz
    t = np.clip(t_s, 0.0, None)
    grown = duration_s / SWEEP_C1 * np.expm1(SWEEP_C1 * t / duration_s) - t
    return np.asarray(w0 * (t_s + 1.0 / low_hz) + SWEEP_C2 * (w1 - w0) * grown)


def sweep(low_hz: float, high_hz: float, duration_s: float, step_s: float) -> Motion:
    """Sine of amplitude 1 in acceleration, exponentially rising after one period at `low_hz`.

    Integrated twice from one steady oscillation to another, so that it does not drift.
    """
    held_s = 1.0 / low_hz
    t = np.asarray(np.arange(round((held_s + duration_s) / step_s) + 1) * step_s - held_s)
    theta = sweep_phase(t, low_hz, high_hz, duration_s)
    w = sweep_frequency(t, low_hz, high_hz, duration_s)
    steady = [(-np.cos(theta[k]) / w[k], -np.sin(theta[k]) / w[k] ** 2) for k in (0, -1)]
    return bridged(np.sin(theta), step_s, *steady)


def multisine(
    harmonics: NDArray[np.int64], amplitudes: Array, phases: Array, period: int, step_s: float
) -> Motion:
    """One period of `period` steps of Σ amplitude · cos(2π harmonic t / period + phase), in position."""
    spectrum = np.zeros(period // 2 + 1, dtype=np.complex128)
    spectrum[harmonics] = 0.5 * period * amplitudes * np.exp(1j * phases)
    s = 2.0j * np.pi * np.arange(len(spectrum)) / (period * step_s)
    a, v, p = (np.fft.irfft(s**k * spectrum, period) for k in (2, 1, 0))
    return Motion(step_s, a, v, p)


def carried_on(motion: Motion, start: int, count: int) -> Motion:
    """`count` samples of a periodic motion of which `motion` is one period, from index `start` on."""
    index = np.arange(start, start + count) % len(motion.a)
    return Motion(motion.step_s, motion.a[index], motion.v[index], motion.p[index])


def _faded_in(motion: Motion) -> Motion:
    window = smooth_step(np.linspace(0.0, 1.0, len(motion.a)))
    end = (float(motion.v[-1]), float(motion.p[-1]))
    return bridged(window * motion.a, motion.step_s, (0.0, 0.0), end)


def _integrated(a: Array, step_s: float, v0: float, p0: float) -> tuple[Array, Array]:
    v = v0 + cumulative_simpson(a, dx=step_s, initial=0.0)
    return v, p0 + cumulative_simpson(v, dx=step_s, initial=0.0)
