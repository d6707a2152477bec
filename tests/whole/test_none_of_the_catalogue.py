"""What is none of the catalogue is not named for its nearest neighbour, and what looks like noise is not."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from hil.gap import diagnose
from hil.sim import Twin
from tests.gap.twin_runs import AXIS, effect, record


def test_a_current_sensor_that_warms_up_is_no_scale_of_it():
    frame = record(duration_s=11.0)
    frame["axis.force"] *= 1.0 + frame["t"] / 11.0
    found = diagnose(frame, AXIS)
    assert found.verdict == "unknown"
    assert found.causes[0].probability < 0.5
    assert "goes with time" in found.sentence


def test_a_scale_that_stays_is_named():
    frame = record()
    frame["axis.force"] *= 1.4
    found = diagnose(frame, AXIS)
    assert found.verdict != "unknown"
    assert found.unknown < 0.1


@pytest.mark.parametrize(("times", "verdict"), [(0.5, "no_gap"), (1.5, "unknown")])
def test_a_slow_drag_below_the_noise_is_a_gap_where_it_towers_above_its_band(times, verdict):
    frame = record()
    slow = np.sin(2.0 * np.pi * 0.21 * frame["t"] + 1.0)
    frame["axis.force"] += times * AXIS.noise.force * slow
    found = diagnose(frame, AXIS)
    assert found.verdict == verdict
    assert max(s.ratio for s in found.located.signals) < 1.1
    assert verdict == "unknown" or found.sentence.startswith("No gap")


@pytest.mark.parametrize(("power", "verdict"), [(1, "identified"), (2, "unknown")])
def test_drag_with_the_square_of_speed_is_no_viscous_friction_though_little_is_left(power, verdict):
    frame = record()
    sent = frame[["t", "axis.setpoint"]].dropna()
    speed = np.gradient(sent["axis.setpoint"], sent["t"])
    drag = np.interp(frame["t"], sent["t"], np.sign(speed) * np.abs(speed) ** power)
    frame["axis.force"] += 12.0 * drag / np.sqrt(np.mean(drag**2))
    found = diagnose(frame, AXIS)
    assert found.verdict == verdict
    assert found.causes[0].effect == "viscous_friction"
    if power == 2:
        assert "goes with speed" in found.sentence
        assert "of the explainable gap stands in axis.force" in found.sentence


def test_an_encoder_that_jumps_now_and_then_is_a_gap_and_none_of_the_catalogue():
    frame = record()
    rng = np.random.default_rng(5)
    answered = frame.index[frame["axis.position"].notna()]
    hit = rng.choice(answered, len(answered) // 25, replace=False)
    frame.loc[hit, "axis.position"] += 2e-3 * rng.choice([-1.0, 1.0], len(hit))
    found = diagnose(frame, AXIS)
    assert found.verdict == "unknown"
    assert "axis.position" in found.sentence


@pytest.mark.parametrize(("signal", "blow"), [("axis.position", 0.012), ("axis.force", 60000.0)])
def test_one_blow_harder_than_any_late_frame_is_a_gap(signal: str, blow: float):
    frame = record()
    answered = frame.index[frame[signal].notna()]
    frame.loc[answered[len(answered) // 2], signal] += blow
    found = diagnose(frame, AXIS)
    assert found.verdict == "unknown"
    assert signal in found.sentence


def felt(frame):
    """`frame` with what the axis' accelerometer would have answered."""
    told = frame[["t", "axis.setpoint"]].dropna().to_numpy().T
    stamps = np.arange(3.3e-4, frame["t"].iloc[-1], 1.0 / AXIS.imu.rate)
    values = Twin(AXIS).replay({"axis": told}, {"imu.accel_x": stamps})["imu.accel_x"]
    noise = AXIS.noise.accel * np.random.default_rng(8).standard_normal(len(stamps))
    rows = pd.DataFrame({"t": stamps, "imu.accel_x": values + noise})
    return pd.concat([frame, rows]).sort_values("t", kind="stable", ignore_index=True)


def test_bangs_that_an_accelerometer_feels_are_a_gap_and_none_of_the_catalogue():
    frame = felt(record(duration_s=11.0))
    assert diagnose(frame, AXIS).verdict == "no_gap"
    answered = frame.index[frame["imu.accel_x"].notna()]
    hit = np.random.default_rng(6).choice(answered[400:], 12, replace=False)
    frame.loc[hit, "imu.accel_x"] += 5.0
    found = diagnose(frame, AXIS)
    assert found.verdict == "unknown"
    assert "imu.accel_x" in found.sentence


@pytest.mark.parametrize(
    ("swells", "overtone", "verdict"), [(0.0, 0.3, "identified"), (7.0, 0.0, "unknown")]
)
def test_a_wave_may_have_any_shape_but_one_that_swells_along_the_stroke(swells, overtone, verdict):
    frame = record()
    told = frame[["t", "axis.position"]].dropna()
    place_m = np.interp(frame["t"], told["t"], told["axis.position"])
    turn = 2.0 * np.pi * place_m / 0.012
    wave = np.sin(turn) + overtone * np.sin(2.0 * turn + 1.0)
    frame["axis.force"] += 60.0 * (1.0 + swells * place_m) * wave
    assert diagnose(frame, AXIS).verdict == verdict


def test_a_fast_ripple_is_no_noise():
    found = diagnose(record(effect("force_ripple", amplitude=60.0, period=0.005, phase=1.0)), AXIS)
    assert [x.effect for x in found.effects] == ["force_ripple"]
    assert found.tables()["gap"]["shrink"] > 0.8
