"""Sensors whose noise wanders where riders move: no gap; what follows from the ride is one all the same."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from hil.bicycle.sensors import IMU_SIGNALS, noise_of
from hil.config.bicycle import SIGNALS
from hil.gap.bicycle import diagnose_rides, locate_rides
from hil.gap.bicycle.follows import _said, follows
from tests.whole.test_bicycle_gap import NOMINAL, ROLLS, ridden, short

LASTS_S = 0.3


def slow(rng, stamps):
    """Of spread 1, kept for LASTS_S."""
    keep = np.exp(-np.median(np.diff(stamps)) / LASTS_S)
    drawn = np.sqrt(1.0 - keep**2) * rng.standard_normal(len(stamps) + 1000)
    return lfilter([1.0], [1.0, -keep], drawn)[1000:]


def wandering(run, share, seed):
    """The run, each of its signals with noise besides that wanders: `share` of the power of its own."""
    rng, table = np.random.default_rng(seed), run.table.copy()
    for signal in (*SIGNALS, *IMU_SIGNALS):
        rows = table[signal].notna()
        size, step = noise_of(signal, NOMINAL)
        error = np.sqrt(share * (size**2 + step**2 / 12.0)) * slow(rng, table["t"][rows])
        table.loc[rows, signal] += error
    return replace(run, table=table)


@pytest.fixture(scope="module")
def healthy():
    return ridden(short(), 61)


@pytest.mark.parametrize("seed", [1, 2])
def test_noise_that_wanders_is_no_gap_and_is_told(healthy, seed):
    found = diagnose_rides([wandering(healthy, 0.3, seed)], NOMINAL)
    assert found.verdict == "no_gap", found.sentence
    assert [f.text for f in found.located.findings if f.subject == "noise"]


def test_an_effect_is_named_beside_noise_that_wanders():
    wheel = ("wheel_radius", "rear_wheel", {"scale": 1.05})
    found = diagnose_rides([wandering(ridden(short(), 62, wheel, *ROLLS), 0.3, 3)], NOMINAL)
    assert [(x.effect, x.location) for x in found.effects] == [wheel[:2]], found.sentence


def test_what_follows_from_the_ride_is_told_from_what_lasts_as_long(healthy):
    located = locate_rides([healthy], NOMINAL)
    e = located.evidence
    floors = e.noise.floor(e.problem)
    (part,) = (x.part for x in e.problem.series if x.signal == "imu.gyro_y")
    (felt,) = (x.part for x in e.problem.series if x.signal == "imu.gyro_z")
    rng = np.random.default_rng(4)

    def asked(of):
        left = e.residual.copy()
        left[part] += 2.0 * floors["imu.gyro_y"] * of / np.std(of)
        return follows(e.problem, e.noise, e.vector, left)

    turning = e.problem.measured[felt]
    assert asked(turning) == "imu.gyro_y"
    assert asked(np.abs(turning) - np.mean(np.abs(turning))) == "imu.gyro_y"
    assert asked(slow(rng, e.problem.t_s[part])) is None


def test_a_ride_that_is_too_short_to_learn_from_may_say_all():
    left = np.random.default_rng(6).standard_normal(40)
    assert _said(np.random.default_rng(7).standard_normal((40, 30)), left, 0.1) == np.sqrt(
        np.mean(left**2)
    )


def test_what_no_catalogue_has_stays_unknown_beside_noise_that_wanders(healthy):
    """A gyroscope that feels the square of turning as pitching, 0.1 s of it."""
    run = wandering(healthy, 0.3, 5)
    felt = run.table["imu.gyro_z"] ** 2
    table = run.table.assign(**{"imu.gyro_y": run.table["imu.gyro_y"] + 0.1 * felt})
    assert diagnose_rides([replace(run, table=table)], NOMINAL).verdict == "unknown"
