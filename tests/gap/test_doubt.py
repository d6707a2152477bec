"""What is none of the catalogue is not named for its nearest neighbour, and what looks like noise is not."""

from __future__ import annotations

import numpy as np

from hil.gap import diagnose
from tests.gap.twin_runs import AXIS, effect, record


def test_a_current_sensor_that_warms_up_is_no_scale_of_it():
    frame = record()
    frame["axis.force"] *= 1.0 + frame["t"] / 14.0
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


def test_an_encoder_that_jumps_now_and_then_is_a_gap_and_none_of_the_catalogue():
    frame = record()
    rng = np.random.default_rng(5)
    answered = frame.index[frame["axis.position"].notna()]
    hit = rng.choice(answered, len(answered) // 25, replace=False)
    frame.loc[hit, "axis.position"] += 2e-3 * rng.choice([-1.0, 1.0], len(hit))
    found = diagnose(frame, AXIS)
    assert found.verdict == "unknown"
    assert "axis.position" in found.sentence


def test_a_fast_ripple_is_no_noise():
    found = diagnose(record(effect("force_ripple", amplitude=60.0, period=0.005, phase=1.0)), AXIS)
    assert [x.effect for x in found.effects] == ["force_ripple"]
    assert found.tables()["gap"]["shrink"] > 0.8
