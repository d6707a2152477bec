"""The three modes on the simulated motorcycle platform: slots, staggered samples, delays, noise.

Reference for the figures: "Parameters Identification for Motorcycle Simulator's Platform
Characterization", figures 5 and 6: computed torque tracks better than the drives' own cascades.
"""

from __future__ import annotations

import numpy as np
import pytest

from hil.configfile import load_rig
from hil.control import (
    CueGuard,
    CueShaper,
    Reference,
    build_controller,
)
from hil.control.drive_mode import DriveMode
from hil.errors import ConfigError
from hil.rigs import build_rig
from hil.signals import Cue, TimedPose
from tests.control.loop import ClosedLoop, chirp, still, with_control

RIG = load_rig("motorcycle")
MANIPULATOR = build_rig(RIG)
PITCH_OF_LEGS = [0.0, 0.004, 0.0]
"""4 mm of both legs at 1 m from the pitch axis: what 5 Hz leaves of the legs' 0.375 m/s is more."""


def modes():
    drive = with_control(RIG, mode="drive")
    return {
        "drive": ClosedLoop(drive),
        "drive with pre-control": ClosedLoop(with_control(RIG, mode="drive", precontrol=True)),
        "drive with lead": ClosedLoop(drive, controller=DriveMode(drive, MANIPULATOR, "setpoint")),
        "cascade": ClosedLoop(with_control(RIG, mode="cascade")),
        "computed torque": ClosedLoop(with_control(RIG, mode="computed_torque")),
    }


def rms_mm(error):
    """At the legs: 1 m from the pitch axis."""
    return 1e3 * float(np.sqrt(np.mean(error**2)))


def response_hz(trace, coordinate, f0, f1, duration_s):
    """Highest frequency up to which motion follows within 3 dB and 45 degrees, by demodulation."""
    t = trace.t
    phase = (
        2 * np.pi * f0 * np.expm1(np.log(f1 / f0) / duration_s * t) / (np.log(f1 / f0) / duration_s)
    )
    frequency = f0 * (f1 / f0) ** (t / duration_s)
    good = 0.0
    for low in np.geomspace(0.3, f1 / 1.3, 12):
        part = (frequency >= low) & (frequency < 1.3 * low)
        base = np.exp(-1j * phase[part])
        ratio = np.sum(trace.pose[part, coordinate] * base) / np.sum(
            trace.wanted[part, coordinate] * base
        )
        if abs(ratio) < 0.707 or abs(np.angle(ratio)) > np.pi / 4:
            break
        good = 1.3 * low
    return good


def test_chirp_is_tracked_best_by_the_model(capsys):
    results = {}
    for name, loop in modes().items():
        trace = loop.run(chirp(PITCH_OF_LEGS, 0.1, 5.0, 12.0), 12.0)
        results[name] = rms_mm(trace.error()[:, 1])
        with capsys.disabled():
            hz = response_hz(trace, 1, 0.1, 5.0, 12.0)
            print(
                f"\nchirp 0.1-5 Hz, 4 mm, {name}: {results[name]:.3f} mm RMS, follows to {hz:.1f} Hz"
            )
    assert results["computed torque"] < results["drive"] / 4.0
    assert results["drive with lead"] < results["drive"] / 4.0
    assert results["drive with pre-control"] < results["drive"] / 4.0
    assert results["computed torque"] < results["cascade"] / 4.0


def shaped_step(shaper, size):
    """Reference of a pitch step that shaping has made fair, tabulated cycle by cycle."""
    shaper.follow()
    guard = CueGuard(RIG)
    table = {}
    for k in range(700):
        now = RIG.bus.cycle * k
        pitch = size if k > 400 else 0.0
        cue = Cue("test", k, now, now, (TimedPose(0.0, (0.0, pitch, 0.0)),))
        shaper.accept(guard.check(cue, now).cue)
        reference = shaper.step(now)
        table[round(reference.t_s / RIG.bus.cycle)] = reference
    zero = np.zeros(3)
    rest = Reference(0.0, zero, zero, zero)
    # The step is asked for at 4 s of shaping, after the ramp-in: 1 s of the run.
    return lambda t: table.get(round(t / RIG.bus.cycle) + 300, rest)._replace(t_s=t)


def test_a_shaped_step_of_a_centimetre_is_tracked_best_by_the_model(capsys):
    reference = shaped_step(CueShaper(RIG, MANIPULATOR), 0.01)
    results = {}
    for name, loop in modes().items():
        trace = loop.run(reference, 3.0)
        error = trace.error(0.9)[:, 1]
        results[name] = rms_mm(error)
        with capsys.disabled():
            print(
                f"\nstep 10 mm, {name}: {results[name]:.3f} mm RMS, {1e3 * abs(error).max():.2f} worst"
            )
        assert abs(error[-20:]).mean() < (2e-3 if name == "cascade" else 2e-4)
    assert results["computed torque"] < results["drive"] / 3.0
    assert results["computed torque"] < results["cascade"] / 3.0


@pytest.mark.parametrize("mode", ["cascade", "computed_torque"])
@pytest.mark.parametrize("payload", [-40.0, 0.0, 60.0])
def test_force_modes_start_without_a_jump_and_stand_with_a_payload_the_model_lacks(mode, payload):
    rig = with_control(RIG, mode=mode)
    heavy = rig.model_copy(update={"mass": rig.mass.model_copy(update={"m": rig.mass.m + payload})})
    trace = ClosedLoop(rig, heavy).run(still(3), 5.0)
    static = build_rig(heavy).static_forces(np.zeros(3))
    assert np.allclose(trace.setpoints[0], MANIPULATOR.static_forces(np.zeros(3)), atol=5.0)
    sag = np.abs(trace.pose[:, 1]).max()
    assert sag < (2e-4 if payload == 0.0 else 0.03)
    assert np.abs(trace.pose[trace.t > 4.0]).max() < 5e-4
    friction = np.array([a.coulomb for a in RIG.actuators])
    held = trace.setpoints[trace.t > 4.0].mean(axis=0)
    assert np.all(np.abs(held - static) < friction + 2.0)


def test_computed_torque_still_tracks_with_a_wrong_model():
    rig = with_control(RIG, mode="computed_torque")
    heavy = rig.model_copy(update={"mass": rig.mass.model_copy(update={"m": 240.0})})
    trace = ClosedLoop(rig, heavy).run(chirp(PITCH_OF_LEGS, 0.1, 5.0, 8.0), 8.0)
    plain = ClosedLoop(with_control(RIG, mode="drive"), heavy)
    drive = plain.run(chirp(PITCH_OF_LEGS, 0.1, 5.0, 8.0), 8.0)
    assert rms_mm(trace.error()[:, 1]) < rms_mm(drive.error()[:, 1])


def test_force_setpoints_never_exceed_the_drives():
    rig = with_control(RIG, mode="computed_torque")
    far = lambda t: Reference(t, np.array([0.2, 0.25, 0.2]), np.zeros(3), np.zeros(3))  # noqa: E731
    for mode in ("cascade", "computed_torque"):
        controller = build_controller(with_control(rig, mode=mode), MANIPULATOR)
        loop = ClosedLoop(with_control(rig, mode=mode))
        observed = loop.observer.estimate(0.01)
        controller.reset(observed)
        for k in range(50):
            values = controller.step(0.01 * k, far(0.01 * k), observed).values
            assert np.all(np.abs(values) <= [a.force_max for a in rig.actuators])


def test_drive_setpoints_arrive_when_the_reference_does():
    controller = build_controller(with_control(RIG, mode="drive"), MANIPULATOR)
    observed = ClosedLoop(RIG).observer.estimate(0.01)
    motion = chirp([0.02, 0.01, 0.02], 0.5, 1.0, 10.0)
    now = 3.0
    values = controller.step(now, motion(now + RIG.bus.cycle), observed).values
    for i in range(3):
        arrival = now + i * RIG.bus.stagger + RIG.bus.setpoint_delay + RIG.bus.cycle
        wanted = MANIPULATOR.inverse(motion(arrival).pose)[i]
        assert values[i] == pytest.approx(wanted, abs=1e-6)


def test_drives_without_torque_reference_get_leading_setpoints():
    rig = with_control(RIG, mode="computed_torque")
    controller = build_controller(rig, MANIPULATOR, torque_reference=False)
    observed = ClosedLoop(RIG).observer.estimate(0.01)
    controller.reset(observed)
    assert controller.step(0.01, still(3)(0.02), observed).kind == "position"
    with pytest.raises(ConfigError, match="torque reference"):
        build_controller(with_control(RIG, mode="cascade"), MANIPULATOR, torque_reference=False)
