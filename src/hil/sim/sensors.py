"""What stands between a true value and its answer: sensor and bus effects, as pure compiled functions.

Simulated drives, the simulated IMU and the replay of recordings use the same ones.
"""

from __future__ import annotations

import math

import numpy as np

from hil.compiled import inner
from hil.sim import layout as lay


@inner
def reading(value, home, bias, scale, quantum):  # type: ignore[no-untyped-def]
    """The sensor's answer for `value`: scale about `home`, bias, rounding to `quantum` (0: none)."""
    out = home + scale * (value - home) + bias
    if quantum > 0.0:
        out = math.floor(out / quantum + 0.5) * quantum
    return out


@inner
def sampled_at(stamp_s, latency_s, drift, origin_s):  # type: ignore[no-untyped-def]
    """True instant of a value stamped `stamp_s`: a clock that runs fast by `drift` (s/s) since `origin_s`
    stamps too late; `latency_s` more lies between the value and its stamp."""
    return origin_s + (stamp_s - origin_s) / (1.0 + drift) - latency_s


@inner
def is_lost(stream, count, share):  # type: ignore[no-untyped-def]
    """Whether frame number `count` of `stream` (small integers >= 0) gets lost: a share of all, the same
    ones each time, and more of the same as `share` grows."""
    if share <= 0.0:
        return False
    x = np.uint64(stream) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(count)
    for _ in range(2):  # the finaliser of SplitMix64 [M: Steele, Lea, Flood 2014]
        x += np.uint64(0x9E3779B97F4A7C15)
        x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        x = x ^ (x >> np.uint64(31))
    return (x >> np.uint64(11)) * (1.0 / 9007199254740992.0) < share


@inner
def sensor_constants(p, n, signal, out):  # type: ignore[no-untyped-def]
    """Bias, scale, latency, quantum and clock drift of `signal` into out (5,).

    `p` parameter vector; signals 0 .. 4 n - 1: quantity * n + actuator in the order of
    `catalogue.QUANTITIES`; 4 n .. 4 n + 5: the IMU's channels, with the effects of the whole IMU.
    """
    at = n * lay.ACTUATOR_BLOCK
    if signal < 4 * n:
        i, quantity = signal % n, signal // n
        a = i * lay.ACTUATOR_BLOCK + lay.ACTUATOR_SIZE + quantity * lay.SENSOR_SIZE
        for c in range(4):
            out[c] = p[a + c]
        out[4] = p[at + lay.CLOCK_AT + 1]
        return
    a = at + lay.IMU_AT + (signal - 4 * n) * lay.SENSOR_SIZE
    b = at + lay.IMU_WHOLE_AT
    out[0] = p[a + lay.BIAS] + p[b + lay.BIAS]
    out[1] = p[a + lay.SCALE] * p[b + lay.SCALE]
    out[2] = p[a + lay.LATENCY] + p[b + lay.LATENCY]
    out[3] = max(p[a + lay.QUANTUM], p[b + lay.QUANTUM])
    out[4] = p[at + lay.CLOCK_AT]
