"""Events of a few samples: what no frame that comes late and no noise does is a gap."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from hil.gap import diagnose
from hil.gap.located.events import held_off, jumps
from hil.gap.located.locate import locate
from hil.gap.record.problem import Problem
from hil.gap.record.runs import as_runs
from hil.identify.replay import stretches
from hil.sim import Twin
from tests.gap.twin_runs import AXIS, effect, record


@pytest.fixture
def frame():
    return record()


def rows(frame, signal: str, start_s: float, count: int):
    """Labels of `count` answers of a signal from `start_s` on."""
    answered = frame.index[frame[signal].notna() & (frame["t"] >= start_s)]
    return answered[:count]


def test_a_healthy_record_has_no_event(frame):
    assert jumps(locate(frame, AXIS))[1] < 0.6


def test_answers_on_end_off_to_one_side_are_a_gap_and_single_ones_are_late(frame):
    off = 12.0 * AXIS.noise.position
    scattered = rows(frame, "axis.position", 3.0, 90)[::30]
    frame.loc[scattered, "axis.position"] += off
    assert jumps(locate(frame, AXIS))[1] < 1.0
    frame.loc[rows(frame, "axis.position", 7.0, 4), "axis.position"] += off
    found = diagnose(frame, AXIS)
    assert found.verdict == "unknown"
    assert "axis.position" in found.sentence


def test_a_lone_sample_may_be_a_tail_of_the_noise_and_counts_for_half_of_two(frame):
    sent = frame[["t", "axis.setpoint"]].dropna()
    sent = sent[sent["t"] > 3.0]
    moved = sent["axis.setpoint"].diff().abs().rolling(25, center=True).max()
    halves = moved.iloc[: len(moved) // 2], moved.iloc[len(moved) // 2 :]
    there = [rows(frame, "axis.position", sent["t"][x.idxmin()], 1)[0] for x in halves]
    stands = []
    for sizes in ((120.0, 0.0), (120.0, -120.0), (264.0, 0.0)):
        struck = frame.copy()
        for size, row in zip(sizes, there, strict=True):
            struck.loc[row, "axis.position"] += size * AXIS.noise.position
        stands.append(jumps(locate(struck, AXIS)))
    assert {signal for signal, _ in stands} == {"axis.position"}
    alone, two, larger = (times for _, times in stands)
    assert two > 1.25 * alone  # the other place's frames, were they late, would show more
    assert larger == pytest.approx(2.2 * alone, rel=0.3)


def test_a_start_that_sticks_is_a_gap(frame):
    moved = float(frame["t"][frame["axis.setpoint"].abs() > 5e-4].iloc[0])
    frame.loc[rows(frame, "axis.force", moved, 6), "axis.force"] += 60.0 * AXIS.noise.force
    signal, times = jumps(locate(frame, AXIS))
    assert signal == "axis.force"
    assert times > 1.0


def test_a_load_that_sags_onto_its_drive_is_no_event_and_not_judged(frame):
    drive = AXIS.actuators[0]
    fades_s = drive.speed_gain / drive.integral_gain
    whole = locate(frame, AXIS)
    frame["axis.position"] -= 5e-4 * np.exp(-frame["t"] / fades_s)
    sagged = locate(frame, AXIS)
    assert jumps(sagged)[1] < 0.6
    begun = [float(x.evidence.problem.t_s[x.evidence.problem.kept].min()) for x in (whole, sagged)]
    assert begun[1] == pytest.approx(max(begun[0], 5.0 * fades_s), abs=0.1)
    assert [x.ratio for x in sagged.signals] == pytest.approx(
        [x.ratio for x in whole.signals], abs=0.1
    )


def test_position_and_force_struck_at_once_are_a_gap_and_one_after_the_other_none(frame):
    at = {"axis.position": 30.0 * AXIS.noise.position, "axis.force": 300.0 * AXIS.noise.force}
    late = frame.copy()
    for signal, size in at.items():
        frame.loc[rows(frame, signal, 7.0, 1), signal] += size
        late.loc[rows(frame, signal, 7.0 if signal == "axis.force" else 9.0, 1), signal] += size
    assert jumps(locate(frame, AXIS))[1] > 1.0
    assert jumps(locate(late, AXIS))[1] < 1.0


def test_position_and_accelerometer_struck_at_once_are_a_gap_and_one_after_the_other_none(frame):
    sent = frame[["t", "axis.setpoint"]].dropna().to_numpy().T
    t = np.arange(0.3e-3, 14.0, 1.0 / AXIS.imu.rate)
    felt = Twin(AXIS).replay({"axis": (sent[0], sent[1])}, {"imu.accel_x": t})["imu.accel_x"]
    felt = felt + AXIS.noise.accel * np.random.default_rng(5).standard_normal(len(t))
    frame = pd.concat([frame, pd.DataFrame({"t": t, "imu.accel_x": felt})])
    frame = frame.sort_values("t", kind="stable", ignore_index=True)
    at = {"axis.position": 30.0 * AXIS.noise.position, "imu.accel_x": 225.0 * AXIS.noise.accel}
    late = frame.copy()
    for signal, size in at.items():
        frame.loc[rows(frame, signal, 7.0, 1), signal] += size
        late.loc[rows(frame, signal, 7.0 if signal == "imu.accel_x" else 9.0, 1), signal] += size
    assert jumps(locate(frame, AXIS))[1] > 1.0
    assert jumps(locate(late, AXIS))[1] < 1.0


@pytest.mark.parametrize(
    ("share", "jitter_s", "is_event"), [(1.0, 0.0, False), (0.1, 0.0, True), (0.1, 0.0097, True)]
)
def test_what_a_frame_late_by_a_tick_does_to_an_accelerometer_at_speed_is_no_event(
    share, jitter_s, is_event
):
    frame = record(share=share, jitter_s=jitter_s)
    sent, told = frame[["t", "axis.setpoint"]].dropna().to_numpy().T
    t = np.arange(0.3e-3, 14.0, 1.0 / AXIS.imu.rate)
    late = AXIS.bus.position_loop * (np.arange(len(sent)) % 8 == 5)

    def felt(sent, told):
        return Twin(AXIS).replay({"axis": (sent, told)}, {"imu.accel_x": t})["imu.accel_x"]

    acts = np.maximum.accumulate(sent + late)
    kicks = felt(acts, told / share) - felt(sent, told / share)  # as at full speed
    noise = AXIS.noise.accel * np.random.default_rng(5).standard_normal(len(t))
    felt = pd.DataFrame({"t": t, "imu.accel_x": felt(sent, told) + kicks + noise})
    frame = pd.concat([frame, felt]).sort_values("t", kind="stable", ignore_index=True)
    e = (found := locate(frame, AXIS)).evidence
    without = replace(found, evidence=replace(e, problem=e.problem.with_clocks({})))
    for located in (found, without):
        signal, times = jumps(located)
        assert (times > 1.0) == is_event
        assert not is_event or signal == "imu.accel_x"


def test_a_speed_limit_that_is_met_once_is_found():
    sent = record(share=0.8)
    told = sent[["t", "axis.setpoint"]].dropna().to_numpy().T
    fastest = float(np.max(np.abs(np.diff(told[1]) / np.diff(told[0]))))
    found = diagnose(record(effect("velocity_saturation", limit=0.88 * fastest), share=0.8), AXIS)
    assert [x.effect for x in found.effects] == ["velocity_saturation"]


def test_a_push_that_comes_by_the_clock_is_a_gap():
    rig = record(duration_s=30.0)
    pushed = rig["axis.force"].notna()
    rig.loc[pushed, "axis.force"] += 6.0 * np.sin(2.0 * np.pi * 0.83 * rig.loc[pushed, "t"] + 1.0)
    found = diagnose(rig, AXIS)
    assert found.verdict == "unknown"
    assert "axis.force" in found.sentence


@pytest.mark.parametrize(("off_m", "is_event"), [(1.2e-5, False), (4e-5, True)])
def test_what_screws_wobble_by_and_friction_lets_go_of_holds_no_position_off_however_fine_its_encoder(
    off_m, is_event
):
    (run,) = as_runs(record(duration_s=4.0), AXIS)
    problem = Problem(AXIS, stretches(run))
    part = next(x.part for x in problem.series if x.signal == "axis.position")
    left = np.zeros(problem.size)
    left[np.flatnonzero(problem.kept[part])[20:40] + part.start] = off_m
    fine = np.full(problem.size, 1e-7)
    assert (held_off(problem, left, fine)["axis.position"] > 1.0) is is_event
