"""Classical cueing against the figures of the field and exact transfer functions."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.signal import TransferFunction, lsim

from hil.control.washout import G, RateLimiter, Washout, WashoutSettings, translation_filter
from tests.shared_data import shared

DT = 0.002
ALL = ("surge", "sway", "heave", "roll", "pitch", "yaw")
RATE_LIMITED_ONLY = WashoutSettings(tilt_acceleration_max=1.0e3)


def run(washout, acceleration, omega, duration_s):
    steps = round(duration_s / DT)
    t = DT * np.arange(steps)
    poses = [washout.step(np.array(acceleration(x)), np.array(omega(x))) for x in t]
    return t, np.array(poses)


def none(_t):
    return (0.0, 0.0, 0.0)


def test_surge_step_has_the_published_course():
    """The reference's 3 deg/s step: peak surge, final tilt, t90 and the sag of the felt force."""
    case = json.loads(shared("reference.json").read_text())["cueing"]["step_case"]
    t, poses = run(
        Washout(ALL, DT, RATE_LIMITED_ONLY), lambda _t: (case["a"], 0.0, 0.0), none, 12.0
    )
    tilt = -poses[:, 4]
    assert poses[:, 0].max() == pytest.approx(case["peak_surge"], rel=0.01)
    assert np.rad2deg(tilt[-1]) == pytest.approx(case["tilt_deg"], rel=0.002)
    assert t[np.argmax(tilt > 0.9 * tilt[-1])] == pytest.approx(case["t90"], abs=0.01)
    felt = np.gradient(np.gradient(poses[:, 0], DT), DT) + G * np.sin(tilt)
    for at, value in case["f_at"]:
        assert np.interp(at, t, felt) == pytest.approx(value * case["K"] * case["a"], abs=0.01)


def test_tilt_keeps_rate_and_acceleration_limits():
    settings = WashoutSettings()
    _, poses = run(Washout(ALL, DT), lambda x: (4.0 * np.sign(np.sin(x)), 3.0, 0.0), none, 15.0)
    for k in (3, 4):
        rate = np.diff(poses[:, k]) / DT
        assert np.abs(rate).max() <= settings.tilt_rate_max * (1 + 1e-9)
        assert np.abs(np.diff(rate)).max() / DT <= settings.tilt_acceleration_max * (1 + 1e-6)
    assert poses[-1, 3] == pytest.approx(np.arcsin(0.5 * 3.0 / G), rel=0.01)


def test_rate_limiter_arrives_without_overshoot():
    limiter = RateLimiter(0.05, 0.14, DT)
    angles = np.array([limiter.step(0.1) for _ in range(3000)])
    assert angles.max() <= 0.1 + 1e-6
    assert angles[-1] == pytest.approx(0.1, abs=1e-9)
    quickest = 0.1 / 0.05 + 0.05 / 0.14
    assert DT * np.argmax(angles > 0.0999) == pytest.approx(quickest, abs=0.1)


def test_translation_filter_is_its_transfer_function():
    s = WashoutSettings()
    t = 0.01 * np.arange(1500)
    u = np.sin(1.3 * t) + 0.3 * np.sin(9.0 * t)
    ours = translation_filter(s, 0.01)
    out = np.array([ours.step(float(x)) for x in u])
    denominator = np.polymul([1.0, 2 * 2.5, 2.5**2], [1.0, 0.25])
    _, exact, _ = lsim(TransferFunction([1.0, 0.0], denominator), u, t)
    assert np.abs(out - exact).max() < 1e-6


def test_translation_comes_back_to_the_middle_and_does_not_drift():
    t, poses = run(Washout(ALL, DT), lambda _t: (2.0, -1.0, 0.5), none, 40.0)
    assert np.abs(poses[t > 38.0, :3]).max() < 1e-3


def test_a_rig_without_translations_tilts_and_turns():
    three = Washout(("yaw", "pitch", "roll"), DT)
    six = Washout(ALL, DT)
    acceleration = lambda x: (2.0, np.sin(x), 0.0)  # noqa: E731
    omega = lambda x: (0.2, 0.0, 0.3 * np.cos(x))  # noqa: E731
    _, short = run(three, acceleration, omega, 5.0)
    _, full = run(six, acceleration, omega, 5.0)
    assert np.array_equal(short, full[:, [5, 4, 3]])


def test_speeding_up_leans_back_and_turning_left_leans_right():
    """Felt gravity in the tilted platform must point where the vehicle's specific force does."""
    for axis in (0, 1):
        acceleration = np.zeros(3)
        acceleration[axis] = 2.0
        _, poses = run(Washout(ALL, DT), lambda _t, a=acceleration: a, none, 20.0)
        roll, pitch = poses[-1, 3], poses[-1, 4]
        cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
        R = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]]) @ np.array(
            [[1, 0, 0], [0, cr, -sr], [0, sr, cr]]
        )
        felt = R.T @ [0.0, 0.0, G]
        assert felt[axis] == pytest.approx(0.5 * 2.0, rel=0.01)
