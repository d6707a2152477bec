"""What comes in: a healthy drive is never suspected, and each kind of trouble is named at its bound."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from hil.configfile import load_drive, load_rig
from hil.control.cascade import cascade_position_rate
from hil.drives.meaning import CanlustMeaning
from hil.drives.profile import LustProfile
from hil.frames import Frame
from hil.safety import Cause, Finding
from hil.safety.monitor import IMU_TIMEOUT_S, Monitor
from hil.signals import Sample

RIG = load_rig("axis")
AXIS = RIG.actuators[0]
CYCLE = RIG.bus.cycle
MEANING = CanlustMeaning(RIG, load_drive("lust_cdd3000", LustProfile), "position")

Motion = Callable[[float], float]


def watch(
    told: Motion, seen: Motion, seconds: float = 2.0, *, velocity: bool = False
) -> dict[Cause, float]:
    """First time at which each cause is found; answers every second cycle, as on the parameter channel."""
    monitor, found = Monitor(RIG, MEANING), {}
    for k in range(round(seconds / CYCLE)):
        t = k * CYCLE
        new = monitor.findings(t)
        monitor.commanded(0, told(t), t)
        if k % 2 == 0:
            at = t + 0.0015
            new += monitor.on_sample(0, Sample("axis", "position", seen(at), at, at + 0.001))
            if velocity:
                v = (seen(at + 1e-6) - seen(at - 1e-6)) / 2e-6
                new += monitor.on_sample(0, Sample("axis", "velocity", v, at, at + 0.001))
        new += monitor.on_sample(1, Sample("imu", "gyro_x", 0.0, t, t))
        for finding in new:
            found.setdefault(finding.cause, t)
    return found


def drive(told: Motion, dead_s: float = 0.0) -> Motion:
    """A drive as it should be: one cycle's delay and a first-order lag of 1/k_p, integrated finely."""
    step = 1e-4
    x, values = told(0.0), []
    for k in range(30_000):
        t = k * step
        held = told(max(0.0, t - CYCLE - dead_s))
        x += step * AXIS.position_gain * (held - x)
        values.append(x)
    return lambda t: values[round(t / step)]


def sine(amplitude: float, hz: float) -> Motion:
    return lambda t: amplitude * math.sin(2 * math.pi * hz * t)


@pytest.mark.parametrize(
    "told",
    [
        sine(0.2, 0.29),  # as far and as fast as the axis goes
        sine(0.01, 5.0),
        sine(0.002, 5.0),
        lambda t: min(0.37 * t, 0.2),
        lambda t: 0.0 if t < 0.5 else min(0.37 * (t - 0.5), 0.2),
        lambda t: 0.1,
    ],
    ids=["far", "chirp", "small", "ramp", "starts late", "stands"],
)
def test_a_healthy_drive_is_never_suspected(told: Motion) -> None:
    assert watch(told, drive(told), velocity=True) == {}


def test_a_drive_with_precontrol_follows_without_lag_and_is_not_suspected() -> None:
    told = sine(0.2, 0.29)
    assert watch(told, lambda t: told(t - CYCLE)) == {}


def test_an_actuator_that_is_held_is_found_before_it_is_far_behind() -> None:
    told = sine(0.2, 0.29)
    found = watch(told, lambda t: drive_until(told, 0.6)(t))
    assert Cause.FOLLOWING_ERROR in found
    assert told(found[Cause.FOLLOWING_ERROR]) - told(0.6) < 0.06


def drive_until(told: Motion, stop_s: float) -> Motion:
    return lambda t: told(min(t, stop_s) - CYCLE)


def watch_cascade(held: bool) -> set[Cause]:
    """The Stewart platform's first leg under the daemon's own slow position loop, or held fast."""
    stewart = load_rig("stewart")
    control = stewart.control.model_copy(update={"mode": "cascade"})
    rig = stewart.model_copy(update={"control": control})
    monitor, rate = Monitor(rig, MEANING), cascade_position_rate(rig)
    assert rate < 0.1 * rig.actuators[0].position_gain
    x, causes = 1.0, set()
    for k in range(600):
        t = k * CYCLE
        told = 1.0 + 0.1 * (1.0 - math.cos(0.9 * t))
        monitor.commanded(0, told, t)
        if not held:
            x += CYCLE * rate * (told - x)
        found = monitor.on_sample(0, Sample("leg1", "position", x, t + 0.0015, t + 0.0025))
        causes |= {finding.cause for finding in found}
    return causes


def test_a_loop_in_the_daemon_is_held_to_its_own_lag_and_not_to_that_of_the_drive() -> None:
    assert watch_cascade(held=False) == set()
    assert Cause.NO_MOTION in watch_cascade(held=True)


@pytest.mark.parametrize(("error", "found"), [(0.0299, False), (0.0301, True)])
def test_following_error_at_rest_at_its_bound(error: float, found: bool) -> None:
    assert (Cause.FOLLOWING_ERROR in watch(lambda t: 0.1, lambda t: 0.1 - error)) is found


@pytest.mark.parametrize(("ahead_s", "found"), [(-0.001, False), (0.001, True)])
def test_following_error_in_motion_allows_the_lag_of_the_drive(ahead_s: float, found: bool) -> None:
    speed = 0.3
    lag_s = 1.0 / AXIS.position_gain + CYCLE + RIG.bus.setpoint_delay
    # The newest setpoint is as old as the sample is after its cycle's start: 1.5 ms.
    behind = RIG.safety.following_error + speed * (lag_s + 0.0015 + ahead_s)
    told: Motion = lambda t: -0.2 + speed * t  # noqa: E731
    seen: Motion = lambda t: told(t) - (behind if t > 0.5 else 0.0)  # noqa: E731
    assert (Cause.FOLLOWING_ERROR in watch(told, seen, 1.0)) is found


def test_motion_that_is_commanded_but_does_not_show_is_found() -> None:
    told = sine(0.008, 1.0)  # never far enough for a following error
    found = watch(told, lambda t: 0.0)
    assert set(found) == {Cause.NO_MOTION}
    assert found[Cause.NO_MOTION] < 0.5


@pytest.mark.parametrize(("share", "found"), [(0.08, True), (0.15, False)])
def test_a_tenth_of_the_motion_must_show(share: float, found: bool) -> None:
    told = sine(0.008, 2.0)
    assert (Cause.NO_MOTION in watch(told, lambda t: share * told(t))) is found


@pytest.mark.parametrize(("amplitude", "found"), [(0.0024, False), (0.0027, True)])
def test_motion_too_small_to_tell_is_not_judged(amplitude: float, found: bool) -> None:
    assert (Cause.NO_MOTION in watch(sine(amplitude, 2.0), lambda t: 0.0)) is found


@pytest.mark.parametrize(("value", "found"), [(0.25, False), (0.2501, True), (-0.2501, True)])
def test_a_position_outside_the_stroke(value: float, found: bool) -> None:
    monitor = Monitor(RIG, MEANING)
    findings = monitor.on_sample(0, Sample("axis", "position", value, 0.0, 0.0))
    assert [f.cause for f in findings] == ([Cause.OUTSIDE_STROKE] if found else [])


@pytest.mark.parametrize(("speed", "found"), [(0.4499, False), (0.4501, True), (-0.4501, True)])
def test_speed_from_two_positions_twice_in_a_row(speed: float, found: bool) -> None:
    monitor, causes = Monitor(RIG, MEANING), []
    for k in range(3):
        sample = Sample("axis", "position", speed * 0.02 * k, 0.02 * k, 0.02 * k + 0.001)
        causes.append([f.cause for f in monitor.on_sample(0, sample)])
    assert causes == [[], [], [Cause.OVERSPEED] if found else []]


def test_one_wrong_sample_is_no_runaway() -> None:
    monitor = Monitor(RIG, MEANING)
    values = [0.0, 0.0, 0.02, 0.021, 0.021]
    found: list[Finding] = []
    for k, value in enumerate(values):
        found += monitor.on_sample(0, Sample("axis", "position", value, 0.02 * k, 0.02 * k))
    assert found == []


def test_answers_too_near_to_each_other_tell_no_speed() -> None:
    monitor, found = Monitor(RIG, MEANING), []
    for k in range(20):
        for later, noise in ((0.0, 0.0), (0.001, 0.001)):
            at = 0.02 * k + later
            found += monitor.on_sample(0, Sample("axis", "position", noise, at, at))
    assert found == []


@pytest.mark.parametrize(("silent_s", "found"), [(0.09, False), (0.11, True)])
def test_a_drive_that_is_told_setpoints_and_answers_no_position(
    silent_s: float, found: bool
) -> None:
    monitor = Monitor(RIG, MEANING)
    monitor.on_sample(0, Sample("axis", "position", 0.0, 0.999, 1.0))
    causes = set()
    for k in range(round(silent_s / CYCLE) + 1):
        monitor.commanded(0, 0.0, 1.0 + k * CYCLE)
        causes |= {f.cause for f in monitor.findings(1.0 + k * CYCLE)}
    assert causes == ({Cause.ANSWERS_LOST} if found else set())


def test_after_the_drives_were_off_a_moved_rig_is_no_following_error() -> None:
    monitor = Monitor(RIG, MEANING)
    for k in range(100):
        monitor.commanded(0, 0.2, k * CYCLE)
    found = []
    for k in range(100):  # off, and moved by hand
        at = 1.5 + 0.02 * k
        found += monitor.on_sample(0, Sample("axis", "position", 0.2 - 0.001 * k, at, at))
    for k in range(50):
        t = 3.5 + k * CYCLE
        monitor.commanded(0, 0.101, t)
        found += monitor.on_sample(0, Sample("axis", "position", 0.101, t + 0.001, t + 0.002))
        found += monitor.findings(t)
    assert [f for f in found if f.cause is not Cause.IMU_LOST] == []


@pytest.mark.parametrize(
    ("frame", "found"),
    [
        (Frame(0x296, bytes(8)), True),
        (Frame(0x44E, bytes(8)), True),
        (Frame(0x0DD, b"\x01"), True),
        (Frame(0x296, b""), True),
        (Frame(0x372, bytes(8)), False),
        (Frame(0x296, bytes(8), is_extended=True), False),
        (Frame(0x296, bytes(8), is_error=True), False),
    ],
)
def test_a_second_master_is_known_by_our_identifiers(frame: Frame, found: bool) -> None:
    findings = Monitor(RIG, MEANING).on_frame(frame)
    assert [f.cause for f in findings] == ([Cause.SECOND_MASTER] if found else [])


@pytest.mark.parametrize(("off_by_s", "found"), [(-0.01, False), (0.01, True)])
def test_an_imu_that_falls_silent(off_by_s: float, found: bool) -> None:
    monitor = Monitor(RIG, MEANING)
    monitor.on_sample(1, Sample("imu", "gyro_x", 0.0, 1.0, 1.0))
    causes = [f.cause for f in monitor.findings(1.0 + IMU_TIMEOUT_S + off_by_s)]
    assert causes == ([Cause.IMU_LOST] if found else [])
