"""The platform's filter against its transfer function, and against the limits it must not break."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lsim, lti

from hil.config import PlatformFilterSettings
from hil.control.platform_filter import PlatformFilter
from hil.control.reference import Reference

CYCLE_S = 0.01
MPI = PlatformFilterSettings(frequency=10.0, delay=0.035)


def response(settings: PlatformFilterSettings, hz: float) -> complex:
    s = 2j * np.pi * hz
    return complex(np.exp(-settings.delay * s) / (1 + s / (2 * np.pi * settings.frequency)) ** 2)


def run(settings: PlatformFilterSettings, motion, seconds: float) -> list[Reference]:
    """Filter what `motion(t)` asks for: pose, velocity, acceleration, one value each."""
    platform = PlatformFilter(settings, 1, CYCLE_S)
    platform.reset(np.array([motion(0.0)[0]]))
    times = CYCLE_S * np.arange(1, round(seconds / CYCLE_S) + 1)
    return [platform.step(Reference(t, *(np.array([x]) for x in motion(t)))) for t in times]


@pytest.mark.parametrize("hz", [0.3, 2.0, 7.0])
@pytest.mark.parametrize("delay", [0.0, 0.01, 0.035, 0.0437])
def test_a_sine_comes_out_with_the_transfer_functions_gain_and_phase(hz, delay):
    settings = PlatformFilterSettings(frequency=10.0, delay=delay)
    w = 2 * np.pi * hz
    out = run(
        settings, lambda t: (np.sin(w * t), w * np.cos(w * t), -w * w * np.sin(w * t)), 20 / hz
    )[-round(10 / hz / CYCLE_S) :]
    h = response(settings, hz)
    t = np.array([r.t_s for r in out])
    wave = np.exp(1j * w * t) * h
    # The cubic between knots is what limits this: (wT)⁴/384 of the amplitude, 1e-4 at 7 Hz.
    tolerance = 1e-9 + (w * CYCLE_S) ** 4 / 300
    assert np.array([r.pose[0] for r in out]) == pytest.approx(wave.imag, abs=tolerance)
    assert np.array([r.velocity[0] for r in out]) == pytest.approx(
        (1j * w * wave).imag, abs=w * tolerance * 3
    )
    assert np.array([r.acceleration[0] for r in out]) == pytest.approx(
        (-w * w * wave).imag, abs=w * w * (w * CYCLE_S) ** 2 / 50
    )


def test_a_ramp_comes_out_as_a_fine_integration_of_the_filter_says():
    out = run(MPI, lambda t: (0.1 * t, 0.1, 0.0), 1.0)
    omega = 2 * np.pi * MPI.frequency
    fine = np.linspace(0.0, 1.0, 20001)
    # The ramp begins with a step of velocity, which the cubic of the first cycle spreads over it.
    first = np.minimum(fine / CYCLE_S, 1.0)
    rise = CYCLE_S * 0.1 * (2 * first**2 - first**3)
    asked = np.where(fine < CYCLE_S, rise, 0.1 * fine)
    _, y, _ = lsim(lti([omega**2], [1.0, 2 * omega, omega**2]), asked, fine)
    t = np.array([r.t_s for r in out])
    expected = np.interp(t - MPI.delay, fine, y, left=0.0)
    assert np.array([r.pose[0] for r in out]) == pytest.approx(expected, abs=1e-7)


def test_velocity_and_acceleration_are_the_derivatives_of_the_pose():
    out = run(MPI, lambda t: (t**3 / 6, t**2 / 2, t), 2.0)[50:]
    pose = np.array([r.pose[0] for r in out])
    velocity = np.array([r.velocity[0] for r in out])
    acceleration = np.array([r.acceleration[0] for r in out])
    assert np.diff(pose) == pytest.approx(
        CYCLE_S * (velocity[1:] + velocity[:-1]) / 2 - CYCLE_S**2 * np.diff(acceleration) / 12,
        abs=1e-12,
    )
    assert np.diff(velocity) == pytest.approx(
        CYCLE_S * (acceleration[1:] + acceleration[:-1]) / 2, abs=1e-10
    )


def test_no_motion_comes_out_larger_faster_or_harder_than_it_went_in():
    """Bang-bang acceleration is the worst that shaping lets through."""
    rng = np.random.default_rng(5)
    platform = PlatformFilter(MPI, 1, CYCLE_S)
    p = v = 0.0
    asked, out = [], []
    for k in range(3000):
        a = float(rng.choice([-3.0, 3.0])) if k % 7 == 0 else (asked[-1][2] if asked else 3.0)
        a = -3.0 if v > 0.2 or p > 0.1 else 3.0 if v < -0.2 or p < -0.1 else a
        p, v = p + CYCLE_S * v + CYCLE_S**2 * a / 2, v + CYCLE_S * a
        asked.append((p, v, a))
        r = platform.step(Reference(k * CYCLE_S, *(np.array([x]) for x in (p, v, a))))
        out.append((r.pose[0], r.velocity[0], r.acceleration[0]))
    assert np.all(np.max(np.abs(out), axis=0) <= np.max(np.abs(asked), axis=0) * (1 + 1e-9))


def test_it_rests_only_when_its_tail_has_come_out():
    platform = PlatformFilter(MPI, 2, CYCLE_S)
    platform.reset(np.zeros(2))
    assert platform.at_rest
    target, still = np.array([0.05, -0.02]), np.zeros(2)
    rests = []
    for k in range(100):
        out = platform.step(Reference(k * CYCLE_S, target, still, still))
        rests.append(platform.at_rest)
        assert not platform.at_rest or out.pose == pytest.approx(target, abs=1e-5)
    first = rests.index(True)
    assert 12 < first < 40  # 35 ms, and the step of 50 mm decays to 10 µm with 63 rad/s
    assert all(rests[first:])


def test_a_motion_still_in_the_delay_line_is_no_rest():
    platform = PlatformFilter(PlatformFilterSettings(frequency=50.0, delay=0.2), 1, CYCLE_S)
    platform.step(Reference(0.0, np.array([0.01]), np.zeros(1), np.zeros(1)))
    assert not platform.at_rest


def test_after_a_reset_nothing_of_the_motion_before_is_left():
    platform = PlatformFilter(MPI, 1, CYCLE_S)
    for k in range(5):
        platform.step(Reference(k * CYCLE_S, np.array([0.1 * k]), np.ones(1), np.ones(1)))
    platform.reset(np.array([0.3]))
    assert platform.at_rest
    out = platform.step(Reference(0.05, np.array([0.3]), np.zeros(1), np.zeros(1)))
    assert out.pose == pytest.approx([0.3], abs=1e-14)
    assert out.acceleration == pytest.approx([0.0], abs=1e-9)
