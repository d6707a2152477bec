"""A sensor whose zero goes one way along a ride is none of the catalogue; what goes to and fro is no such."""

from dataclasses import replace

import numpy as np
import pytest

from hil.gap.bicycle import diagnose_rides
from hil.gap.bicycle.warming import CLEAR, drift
from tests.whole.test_bicycle_gap import NOMINAL, ridden, short

TAU_S = 8.0
SLOWLY_S = 40.0


@pytest.fixture(scope="module")
def healthy():
    return ridden(short(), 63)


@pytest.mark.parametrize(
    ("signal", "size"), [("imu.gyro_y", 0.006), ("imu.gyro_y", 0.012), ("imu.gyro_x", -0.012)]
)
def test_a_sensor_that_warms_up_is_told_with_how_far_its_zero_goes(healthy, signal, size):
    table = healthy.table.copy()
    table[signal] += size * (1.0 - np.exp(-table["t"] / TAU_S))
    found = diagnose_rides([replace(healthy, table=table)], NOMINAL)
    assert found.verdict == "unknown", found.sentence
    assert not found.effects
    assert f"the zero of {signal} goes one way along a ride" in found.sentence


def test_without_warmth_there_is_no_gap(healthy):
    assert diagnose_rides([healthy], NOMINAL).verdict == "no_gap"


def test_references_that_warm_up_as_well_are_the_same_bicycle(healthy):
    def warm(run):
        return replace(run, table=run.table.assign(**{
            "imu.gyro_y": run.table["imu.gyro_y"] + 0.012 * (1.0 - np.exp(-run.table["t"] / TAU_S))
        }))  # fmt: skip

    found = diagnose_rides([warm(healthy)], NOMINAL, references=[warm(ridden(short(), 64))])
    assert found.verdict == "no_gap", found.sentence


def test_how_far_a_zero_goes_is_told_from_noise_and_from_what_goes_to_and_fro():
    rng, t = np.random.default_rng(5), np.arange(0.0, SLOWLY_S, 0.01)
    noise = 0.1 * rng.standard_normal(len(t))
    gone = drift(t, noise + 0.05 * t / SLOWLY_S)
    assert gone.span == pytest.approx(0.05, rel=0.2)
    assert gone.clear > CLEAR
    for other in (noise, noise + 0.05 * np.sin(2.0 * np.pi * t / 7.0)):
        assert drift(t, other).clear < CLEAR
    assert drift(t[:1000], noise[:1000]) is None
    assert drift(t[:0], noise[:0]) is None
