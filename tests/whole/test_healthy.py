"""What healthy rigs have that no rig file tells is no gap, and what bends once with place is no wave."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hil.gap import diagnose
from tests.gap.twin_runs import AXIS, effect, record
from tests.whole.session import ridden


@pytest.mark.parametrize(("off", "is_finding"), [(0.5, False), (5.0, False), (15.0, True)])
def test_a_zero_that_is_as_far_off_as_homing_repeats_is_no_gap(
    off: float, is_finding: bool
) -> None:
    """In spreads of one answer's noise, 20 µm."""
    frame = record()
    frame["axis.position"] += off * AXIS.noise.position
    found = diagnose(frame, AXIS)
    named = [(x.effect, x.location) for x in found.effects]
    assert named == ([("sensor_bias", "axis.position")] if is_finding else []), found.sentence
    assert found.verdict == ("identified" if is_finding else "no_gap"), found.sentence


@pytest.mark.parametrize("late_s", [-0.5e-3, 0.5e-3])
def test_a_force_read_half_a_tick_from_where_the_twin_reads_it_is_no_gap(late_s: float) -> None:
    frame = record(effect("sensor_latency", "axis.force", delay=late_s))
    assert diagnose(frame, AXIS).verdict == "no_gap"


def test_setpoints_that_are_rounded_to_a_millimetre_are_no_error_of_the_lead() -> None:
    assert diagnose(record(step_m=1e-3), AXIS).verdict == "unknown"


def test_a_spring_beside_the_drive_is_no_ripple() -> None:
    frame = record(duration_s=10.0)
    told = frame[["t", "axis.setpoint"]].dropna()
    place = np.interp(frame["t"], told["t"], told["axis.setpoint"])
    frame["axis.force"] += 1500.0 * place
    found = diagnose(frame, AXIS)
    assert found.verdict == "unknown"


@pytest.mark.parametrize("name", ["stewart", "stewart_pd"])
def test_a_hexapod_that_sags_when_armed_and_whose_bus_is_busy_is_no_gap(
    tmp_path: Path, name: str
) -> None:
    run, rig = ridden(tmp_path, name, "drive")
    found = diagnose(run, rig)
    assert found.verdict == "no_gap", found.sentence


def test_a_fast_drive_whose_targets_wait_for_the_imus_frames_is_no_gap(tmp_path: Path) -> None:
    run, rig = ridden(tmp_path, "axis_canopen", "drive")
    found = diagnose(run, rig)
    assert found.verdict == "no_gap", found.sentence


def test_friction_behind_such_a_drive_is_found(tmp_path: Path) -> None:
    hidden = effect("coulomb_friction", force=45.0)
    run, rig = ridden(tmp_path, "axis_canopen", "drive", hidden)
    best = diagnose(run, rig).causes[0]
    assert (best.effect, best.location) == ("coulomb_friction", "axis")
    assert best.parameters["force"].value == pytest.approx(45.0, rel=0.1)


def test_targets_that_such_a_drive_never_got_are_lost_frames(tmp_path: Path) -> None:
    hidden = effect("lost_frames", "bus", setpoints=0.003)
    run, rig = ridden(tmp_path, "axis_canopen", "drive", hidden)
    found = diagnose(run, rig)
    assert found.verdict == "identified", found.sentence
    assert [(x.effect, x.location) for x in found.effects] == [("lost_frames", "bus")]
    share = found.effects[0].parameters["setpoints"]
    assert share.ci[0] < 0.003 < share.ci[1] < 0.01
