"""A short motion of the motorcycle rig, told to a recorder as the gateway tells it."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from pathlib import Path

import pytest

from hil.config import RigFile
from hil.configfile import find_rig_file, load_rig
from hil.frames import Frame, StampedFrame
from hil.messages import ActuatorState, StateMessage
from hil.runs import Recorder
from hil.signals import IMU_QUANTITIES, Cue, Event, Sample, TimedPose

STARTED = datetime(2026, 1, 31, 12, 0, 0, tzinfo=UTC)
START_S = 5000.0
"""The rig's clock when recording starts: not zero, as CLOCK_MONOTONIC is not."""


@pytest.fixture(scope="session")
def rig_toml() -> str:
    return find_rig_file("motorcycle").read_text(encoding="utf-8")


@pytest.fixture(scope="session")
def rig() -> RigFile:
    return load_rig("motorcycle")


@pytest.fixture
def recorder(tmp_path: Path, rig: RigFile, rig_toml: str) -> Recorder:
    return Recorder(tmp_path / "runs", rig_toml, rig, START_S, started=STARTED, reserve_bytes=0)


def position(actuator: int, t: float) -> float:
    """True position of an actuator, m."""
    home = (0.6, 0.6, 0.0)[actuator]
    return home + 0.02 * math.sin(2.0 * math.pi * 0.5 * t + actuator)


def tell(recorder: Recorder, rig: RigFile, first: int, last: int) -> None:
    """Cycles `first` to `last` of 10 ms."""
    for k in range(first, last):
        t = START_S + 0.01 * k
        if k % 2 == 0:
            poses = (TimedPose(0.0, (0.001 * k, 0.0, 0.0)), TimedPose(0.05, (0.9, 0.0, 0.0)))
            recorder.cue(Cue("simulator", k, 0.01 * k, t, poses))
        for i, name in enumerate(rig.actuator_names):
            sent = t + 0.0011 * i
            recorder.setpoint(sent, "position", {name: position(i, sent - START_S)})
            recorder.frame(StampedFrame(sent, Frame(0x2D0 + i, bytes([k % 256] * 8))), is_sent=True)
            got = sent + 0.0008
            quantity = "position" if (k + i) % 2 == 0 else "force"
            value = position(i, got - START_S) if quantity == "position" else 800.0 + k % 7
            recorder.sample(Sample(name, quantity, value, got - 0.001, got))
        for j in range(2):
            got = t + 0.004 + 0.005 * j
            for n, quantity in enumerate(IMU_QUANTITIES):
                at = got + (0.0002 if n >= 3 else 0.0)
                recorder.sample(Sample("imu", quantity, 0.1 * n, at - 0.001, at))
        actuators = {
            n: ActuatorState(position(i, t - START_S), 0.0, 800.0, 0.004)
            for i, n in enumerate(rig.actuator_names)
        }
        recorder.state(
            StateMessage(
                t,
                "engaged",
                {"yaw": 0.0, "pitch": 0.0, "roll": 0.01},
                {"yaw": 0.0, "pitch": 0.0, "roll": 0.012},
                actuators,
                0.001,
                "",
                lateness_s=1e-5 * (k % 9),
                period_s=0.01,
                slot_use=1.0,
                bus_load=0.3,
            )
        )


@pytest.fixture
def finished(recorder: Recorder, rig: RigFile) -> Path:
    """The folder of a run of two seconds."""
    recorder.event(Event(START_S, "info", "engaged", "the rig follows cues"))
    tell(recorder, rig, 0, 200)
    recorder.event(Event(START_S + 2.0, "warning", "cue_stale", "no cue for 0.2 s"))
    recorder.close("asked for")
    assert recorder.stopped is not None
    return recorder.path
