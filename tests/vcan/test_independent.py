"""Our master against a foreign drive, our drive against a foreign master, and foreign tools in between."""

from __future__ import annotations

import statistics
import subprocess
import time
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import can
import cantools
import pytest

from hil.configfile import load_rig

from .independent import (
    DBC,
    DISABLE,
    ENABLE,
    ENABLED,
    POSITION,
    PREPARE,
    READY,
    RESET,
    SWITCHED_OFF,
    WATCHDOG,
    Drive,
    Master,
)
from .wire import CYCLE_S, DRIVE_WATCHDOG_MS, VCAN, Rider, RigOnWire, engage, sway, wait_for

pytestmark = [pytest.mark.vcan, pytest.mark.timeout(400)]

BITS_OF_A_FAULT, FAULT = 0x4F, 0x08
E_OC, E_SIO = 3, 18


@pytest.fixture
def axis(tmp_path: Path) -> Iterator[RigOnWire]:
    made = RigOnWire(tmp_path, "axis")
    yield made
    made.end()


@pytest.fixture
def log(tmp_path: Path) -> Iterator[Path]:
    """What candump hears."""
    path = tmp_path / "candump.log"
    with path.open("wb") as file, subprocess.Popen(["candump", "-L", VCAN], stdout=file) as candump:
        yield path
        candump.terminate()


def test_a_foreign_master_drives_our_drive(axis: RigOnWire, log: Path) -> None:
    axis.simulate()
    master = Master(VCAN)
    try:
        assert master.wait("LOGON_1", timeout_s=180.0) == {}
        assert master.control(DISABLE)["StatusWord"] == SWITCHED_OFF
        master.parameter(WATCHDOG, 2000)
        assert master.parameter(WATCHDOG) == 2000
        start = master.parameter(POSITION)
        master.send("SYSTEM", Start=1)
        assert master.control(PREPARE)["StatusWord"] == READY
        master.control(ENABLE, start)
        assert master.control(ENABLE, start)["StatusWord"] == ENABLED
        for step in range(50):
            master.control(ENABLE, start + 100 * (step + 1))
            time.sleep(CYCLE_S)
        for _ in range(10):
            master.control(ENABLE, start + 5000)
            time.sleep(CYCLE_S)
        assert master.parameter(POSITION) == pytest.approx(start + 5000, abs=300)
        # It is let down: its own watchdog must stop it and tell.
        assert master.wait("ERROR_1")["Code"] == E_SIO
        time.sleep(0.5)
        assert master.control(DISABLE)["StatusWord"] & BITS_OF_A_FAULT == FAULT
        master.control(RESET)
        assert master.control(DISABLE)["StatusWord"] == SWITCHED_OFF
    finally:
        master.close()
    assert decoded(log)["STATUS_1"] >= 60
    assert decoded(log)["ERROR_1"] == 1


def test_our_master_rides_a_foreign_drive(axis: RigOnWire, log: Path) -> None:
    (actuator,) = load_rig("axis").actuators
    gains = (actuator.position_gain, actuator.speed_gain, actuator.integral_gain)
    with Drive(VCAN, gains) as drive:
        axis.daemon()
        with axis.client() as client, Rider(client, sway):
            engage(client)
            assert drive.status == ENABLED
            assert drive.parameters[WATCHDOG] == DRIVE_WATCHDOG_MS
            time.sleep(4.0)
            assert client.state().state == "engaged"
            drive.report(E_OC)
            wait_for(lambda: client.state().state in ("fault", "emergency"), 30.0)
            assert client.state().fault.startswith("drive_error")
            assert "E-OC" in client.state().fault
            wait_for(lambda: drive.status != ENABLED, 30.0)
        axis.end()
    enabled = [(t_s, reference) for t_s, word, reference in drive.controls if word == ENABLE]
    references = [reference for _, reference in enabled]
    assert max(references) - min(references) > 12_000
    assert max(abs(b - a) for a, b in pairwise(references)) < 3_000
    periods = [b[0] - a[0] for a, b in pairwise(enabled)]
    assert statistics.median(periods) == pytest.approx(CYCLE_S, rel=0.1)
    counts = decoded(log)
    assert counts["CONTROL_1"] == len(drive.controls)
    assert counts["REQUEST_1"] - counts["ANSWER_1"] <= 1


def decoded(log: Path) -> Counter[str]:
    """Messages in a candump log by name, each decoded by the DBC; what it does not know must be the IMU's."""
    messages = cantools.database.load_file(DBC)
    imu = load_rig("axis").can.imu_base_id
    counts: Counter[str] = Counter()
    for frame in can.CanutilsLogReader(log):
        if imu <= frame.arbitration_id < imu + 8:
            continue
        message = messages.get_message_by_frame_id(frame.arbitration_id)
        assert frame.dlc == message.length
        if message.length:
            message.decode(bytes(frame.data))
        counts[message.name] += 1
    return counts
