"""How loud a ride's sensors are where rides are judged, and from which on a ride is off without a cause."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import butter, lfilter, welch

from hil.gap.bicycle.noise import CORNER_HZ, JUDGED_HZ, QUIET_HZ, SLUGGISH, _rise
from hil.gap.bicycle.twin import LEAN_TORQUE
from hil.gap.bicycle.verdict import unsaid

RATE_HZ = 100.0
SLOW_HZ = 3.0


def rise(share: float, seed: int, corners_hz: tuple[float, ...]) -> float:
    """As read from 40 s of unit noise, `share` of whose power has passed a low-pass at SLOW_HZ; amplitude."""
    rng = np.random.default_rng(seed)
    slow = lfilter(*butter(1, 2.0 * SLOW_HZ / RATE_HZ), rng.standard_normal(4500))[500:]
    noise = np.sqrt(1.0 - share) * rng.standard_normal(4000) + np.sqrt(share) * slow / np.std(slow)
    hz, power = welch(noise, RATE_HZ, nperseg=200, average="median")
    return float(np.sqrt(_rise(hz, power, corners_hz)))


def true_rise(share: float) -> float:
    def density(hz):
        slow = 2.0 / (np.pi * SLOW_HZ) / (1.0 + (hz / SLOW_HZ) ** 2)
        return (1.0 - share) * 2.0 / RATE_HZ + share * slow

    return float(np.sqrt(density(JUDGED_HZ) / np.median(density(np.linspace(*QUIET_HZ, 50)))))


@pytest.mark.parametrize("share", [0.0, 0.15, 0.35])
def test_slow_noise_of_an_inclinometer_is_led_on_to_where_rides_are_judged(share):
    corners = (CORNER_HZ, SLUGGISH["lean"])
    told = np.mean([rise(share, seed, corners) for seed in range(20)])
    assert told == pytest.approx(true_rise(share), rel=0.15)


def test_a_filter_inside_a_sensor_does_not_tell_that_of_slow_noise():
    assert np.mean([rise(0.35, seed, (CORNER_HZ,)) for seed in range(5)]) < 0.7 * true_rise(0.35)


@dataclass(frozen=True)
class Found:
    """What `unsaid` asks of a diagnosis."""

    located: SimpleNamespace
    verdict: str = "no_gap"
    sentence: str = ""
    unknown: float = 0.0


@pytest.mark.parametrize(
    ("signal", "ratio", "verdict"),
    [
        ("imu.gyro_y", 1.3, "no_gap"),
        ("imu.gyro_y", 1.5, "unknown"),
        (LEAN_TORQUE, 1.5, "no_gap"),
        (LEAN_TORQUE, 1.7, "unknown"),
    ],
)
def test_a_rider_may_sit_less_still_than_a_sensor_may_be_loud(signal, ratio, verdict):
    signals = [SimpleNamespace(signal="imu.accel_z", ratio=0.9)]
    located = SimpleNamespace(signals=[*signals, SimpleNamespace(signal=signal, ratio=ratio)])
    found = unsaid(Found(located))
    assert found.verdict == verdict
    assert (signal in found.sentence) == (verdict == "unknown")
