"""How loud a ride's sensors are where rides are judged, and from which on a ride is off without a cause."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import butter, lfilter, welch

from hil.gap.bicycle.noise import CORNER_HZ, JUDGED_HZ, QUIET_HZ, SLUGGISH, _rise
from hil.gap.bicycle.twin import LEAN_TORQUE
from hil.gap.bicycle.verdict import unsaid, with_road

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
    ("signal", "ratio", "floor", "verdict"),
    [
        ("imu.gyro_y", 1.3, 0.01, "no_gap"),
        ("imu.gyro_y", 1.5, 0.01, "unknown"),
        ("imu.gyro_y", 2.2, 4e-4, "no_gap"),
        ("imu.gyro_y", 5.0, 4e-4, "unknown"),
        (LEAN_TORQUE, 1.5, 1.0, "no_gap"),
        (LEAN_TORQUE, 1.7, 1.0, "unknown"),
    ],
)
def test_riders_and_roads_may_be_less_still_than_sensors_are_loud(signal, ratio, floor, verdict):
    """A road pitches a bicycle by 0.8 mrad/s, which only a quiet gyroscope knows."""
    told = [("imu.accel_z", 0.9, 0.1), (signal, ratio, floor)]
    signals = [SimpleNamespace(signal=s, ratio=k * low / with_road(s, low)) for s, k, low in told]
    found = unsaid(Found(SimpleNamespace(signals=signals, is_gap=False, where=())))
    assert found.verdict == verdict
    assert (signal in found.sentence) == (verdict == "unknown")
