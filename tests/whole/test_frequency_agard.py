"""AGARD measures of motions whose noise, hysteresis, bumps and rise times are known by construction."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hil.configfile import load_rig
from hil.errors import IdentificationError, RunError
from hil.identify.frequency.acceleration import Acceleration
from hil.identify.frequency.agard import AgardAnalysis, agard, excursions
from hil.identify.frequency.agard_sines import measure_sine
from hil.identify.frequency.agard_steps import acceleration_steps, find_steps, measure_steps
from hil.identify.frequency.windows import Window
from hil.ui.agard_report import agard_page
from tests.identify.frequency_data import AXIS, axis_run, sampled

HZ, SIZE = 0.5, 0.05
OMEGA = 2 * np.pi * HZ
RIG = load_rig("stewart_pd")


def sine(extra=lambda t: np.zeros_like(t), noise=0.0, lag_s=0.0, offset=lambda t: np.zeros_like(t)):
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 20.0, 0.01)
    t_imu = np.arange(0.0013, 20.0, 0.005)
    asked = SIZE * np.sin(OMEGA * t)
    pose = SIZE * np.sin(OMEGA * (t - lag_s)) + offset(t)
    felt = -(OMEGA**2) * SIZE * np.sin(OMEGA * (t_imu - lag_s)) + extra(t_imu) + 9.81
    felt = felt + noise * rng.standard_normal(len(t_imu))
    cue = sampled("cue.heave", t, asked)
    return measure_sine(
        "run",
        "heave",
        Window(2.0, 1 / HZ, 8),
        cue,
        cue,
        sampled("heave", t, pose),
        Acceleration(sampled("imu", t_imu, felt, "m/s²"), 0, "m/s²"),
    )


def test_a_clean_sinusoid_has_its_describing_function_and_no_noise():
    m = sine(lag_s=0.05)
    assert abs(m.describing) == pytest.approx(1.0, abs=1e-6)
    assert math.degrees(np.angle(m.describing)) == pytest.approx(-360 * HZ * 0.05, abs=1e-3)
    assert m.commanded == pytest.approx(OMEGA**2 * SIZE, rel=1e-9)
    assert m.noise < 1e-6
    assert m.reversal_bump < 1e-6


def test_noise_is_parted_into_what_repeats_low_and_high_and_what_does_not():
    def harmonics(t):
        return (
            0.02 * np.sin(2 * OMEGA * t)
            + 0.01 * np.cos(3 * OMEGA * t)
            + 0.03 * np.sin(9 * OMEGA * t)
        )

    m = sine(harmonics, noise=0.04)
    assert m.low_frequency == pytest.approx(math.hypot(0.02, 0.01) / math.sqrt(2), rel=0.15)
    assert m.high_frequency == pytest.approx(0.03 / math.sqrt(2), rel=0.25)
    assert m.stochastic == pytest.approx(0.04, rel=0.05)
    total = math.sqrt((0.02**2 + 0.01**2 + 0.03**2) / 2 + 0.04**2)
    assert m.noise == pytest.approx(total, rel=0.05)
    assert m.noise_ratio == pytest.approx(total / (OMEGA**2 * SIZE / math.sqrt(2)), rel=0.05)
    assert m.peak > 3 * 0.04


def test_a_bump_at_the_reversals_is_measured_and_one_elsewhere_is_none():
    def bump(centre):
        return lambda t: 0.2 * np.exp(-((((t + 1 - centre) % 2 - 1) / 0.03) ** 2))

    # The speed SIZE ω cos ωt is zero at a quarter of the two-second period.
    assert sine(bump(0.5)).reversal_bump == pytest.approx(0.2, rel=0.1)
    assert sine(bump(1.0)).reversal_bump < 0.04


def test_hysteresis_is_the_width_of_the_loop():
    m = sine(offset=lambda t: -0.0004 * np.sign(np.cos(OMEGA * t)))
    assert m.hysteresis == pytest.approx(0.0008, rel=0.1)
    lagging = sine(lag_s=0.002)
    assert lagging.hysteresis == pytest.approx(2 * SIZE * OMEGA * 0.002, rel=0.01)


def steps_run(rise, noise=0.0, sizes=(0.2, 0.8)):
    """The shipped test motion, felt through a first-order lag of `rise` s."""
    motion = acceleration_steps(RIG, "heave", sizes)
    rng = np.random.default_rng(5)
    t, p = motion.t_s, motion.poses[:, 0]
    h = 5e-4
    fine = np.arange(0.0, t[-1], h)
    asked = np.interp(fine, t[:-1] + 0.0, np.diff(p, 2, prepend=p[0], append=p[-1])[:-1] / 0.005**2)
    x, level = np.zeros(len(fine)), 0.0
    for k, a in enumerate(asked):
        level += (a - level) * h / rise
        x[k] = level
    t_imu = np.arange(0.002, t[-1], 0.005)
    felt = np.interp(t_imu, fine, x) + 9.81 + noise * rng.standard_normal(len(t_imu))
    return sampled("cue.heave", t, p), sampled("imu", t_imu, felt, "m/s²")


@pytest.mark.parametrize("rise", [0.03, 0.06])
def test_the_dynamic_threshold_of_a_first_order_lag_is_its_time_constant(rise):
    cue, imu = steps_run(rise, noise=0.002)
    steps = find_steps(cue)
    assert len(steps) == 8
    assert sorted({round(abs(size), 3) for _, size in steps}) == [0.2, 0.8]
    found = measure_steps("run", "heave", steps, Acceleration(imu, 0, "m/s²"))
    assert [f.size for f in found] == pytest.approx([0.2, 0.8], rel=1e-6)
    for f in found:
        assert f.steps == 4
        assert f.time_s == pytest.approx(rise, abs=0.006)


def test_a_step_that_is_never_felt_has_no_time():
    cue, imu = steps_run(3.0)
    found = measure_steps("run", "heave", find_steps(cue), Acceleration(imu, 0, "m/s²"))
    assert all(math.isinf(f.time_s) for f in found)


def test_steps_need_an_accelerometer():
    cue, imu = steps_run(0.03)
    with pytest.raises(IdentificationError, match="need an accelerometer"):
        measure_steps("run", "heave", find_steps(cue), Acceleration(imu, 2, "m/s²"))


def test_the_test_motion_ends_where_it_began_and_keeps_the_limits():
    motion = acceleration_steps(RIG, "heave", (0.1, 1.0))
    p = motion.poses[:, 0]
    assert p[-1] == pytest.approx(0.0, abs=1e-9)
    assert np.abs(p).max() < RIG.limits[2]
    assert np.abs(np.gradient(p, 0.005)).max() < 0.2
    with pytest.raises(IdentificationError, match="does not fit heave"):
        acceleration_steps(RIG, "heave", (5.0,))


def test_a_sinusoid_is_not_taken_for_steps():
    t = np.arange(0.0, 20.0, 0.005)
    assert find_steps(sampled("cue.heave", t, SIZE * np.sin(OMEGA * t))) is None


def test_excursions_of_the_mpi_platform_are_those_of_its_data_sheet():
    """Surge 930, sway 860, heave 500 mm, pitch +34/-32, roll ±28, yaw ±44 deg, as published."""
    found = {e.coordinate: e for e in excursions(RIG)}
    for name, span in (("surge", 0.930), ("sway", 0.860), ("heave", 0.500)):
        assert found[name].high - found[name].low == pytest.approx(span, abs=0.004)
    assert np.degrees([found["pitch"].high, found["pitch"].low]) == pytest.approx(
        [34, -32], abs=0.3
    )
    assert np.degrees(found["roll"].high) == pytest.approx(28, abs=0.3)
    assert np.degrees(found["yaw"].high) == pytest.approx(44, abs=0.3)
    # At neutral all legs share a heave alike: its speed is their 0.6 m/s over the cosine of their tilt.
    assert 0.6 < found["heave"].velocity < 0.75


def test_runs_that_are_neither_sinusoid_nor_steps_are_refused():
    rng = np.random.default_rng(1)
    t0 = axis_run("drift", lambda t: 0.01 * np.sin(0.1 * t * t), lambda t: 0.0 * t, rng)
    with pytest.raises(IdentificationError, match="neither a sinusoid of some periods nor steps"):
        agard([t0], AXIS)
    still = axis_run("still", lambda t: 0.0 * t, lambda t: 0.0 * t, rng)
    with pytest.raises(IdentificationError, match="its cues move no coordinate"):
        agard([still], AXIS)


def test_the_page_shows_sinusoids_and_steps(tmp_path):
    cue, imu = steps_run(0.03)
    steps = measure_steps("steps", "heave", find_steps(cue), Acceleration(imu, 0, "m/s²"))
    analysis = AgardAnalysis(
        RIG.name, excursions(RIG), (sine(noise=0.01),), tuple(steps), ("a < b",)
    )
    text = agard_page(analysis, tmp_path / "page.html").read_text(encoding="utf-8")
    body = text.split("</script>", 1)[1]
    for said in ("Dynamic threshold", "reversal bump", "0.493 m/s²", "a &lt; b"):
        assert said in body
    with pytest.raises(RunError, match="cannot be written"):
        agard_page(analysis, tmp_path)


def test_without_an_imu_the_pose_tells_what_it_can():
    rng = np.random.default_rng(2)
    run = axis_run(
        "sine", lambda t: SIZE * np.sin(OMEGA * t), lambda t: SIZE * np.sin(OMEGA * (t - 0.02)), rng
    )
    a = agard([run], AXIS)
    (m,) = a.sines
    assert abs(m.describing) == pytest.approx(1.0, abs=1e-6)
    assert m.source.startswith("measured pose")
    assert math.isnan(m.stochastic)
    assert "no IMU" in a.notes[0]
