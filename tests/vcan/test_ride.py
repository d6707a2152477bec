"""The motorcycle rig on a real bus: log-on, arming, the demo's ride, parking, and what was recorded of it."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import can
import cantools
import numpy as np
import pytest

from hil.runs import Run, load_run

from .independent import DBC
from .wire import CYCLE_S, PATIENCE_S, RigOnWire, engage, require_interface, wait_for

pytestmark = [pytest.mark.vcan, pytest.mark.timeout(400)]

RIDE_S = 8.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The run folder of a ride from log-on to parking, all by the processes that a user starts."""
    require_interface()
    rig = RigOnWire(tmp_path_factory.mktemp("rig"), "motorcycle")
    try:
        rig.simulate()
        rig.daemon()
        with rig.client() as client:
            wait_for(lambda: (state := client.state()) is not None and state.state == "parked")
            seconds = ("--seconds", str(RIDE_S), "-e", rig.endpoint)
            ride = rig.start("cue", "ride", str(rig.file), *seconds)
            engage(client)
            assert ride.wait(PATIENCE_S) == 0
            wait_for(lambda: client.state().state == "parked", 30.0)
        rig.control.terminate()
        assert rig.control.wait(60.0) == 0
        assert rig.simulated.poll() is None
        (made,) = rig.runs.iterdir()
        yield made
    finally:
        rig.end()


@pytest.fixture(scope="module")
def run(folder: Path) -> Run:
    return load_run(folder)


def test_it_went_through_the_states_from_log_on_to_parked(run: Run) -> None:
    states = [event.text.rpartition(" ")[2] for event in run.events if event.name == "rig_state"]
    # A guest that stood still may park once before it engages: an overrun, and armed anew.
    in_order = ["preparing", "parked", "ready", "engaged", "parking"]
    assert [name for name in dict.fromkeys(states) if name != "offline"] == in_order
    assert states[-2:] == ["parking", "parked"]
    assert not [event for event in run.events if event.severity == "fault"]


def test_the_legs_followed_their_setpoints(run: Run) -> None:
    for leg in ("leg1", "leg2"):
        setpoint, position = (
            run.table[["t", f"{leg}.{what}"]].dropna().to_numpy().T
            for what in ("setpoint", "position")
        )
        assert np.ptp(position[1]) > 0.01
        lagging = np.interp(position[0], setpoint[0], setpoint[1]) - position[1]
        assert np.max(np.abs(lagging)) < 0.02


def test_nearly_every_slot_carried_its_pair(run: Run, record_property) -> None:
    share = run.states["slot_use"].dropna().iloc[-1]
    late_us = run.states["lateness_s"].dropna().to_numpy() * 1e6
    record_property("lateness_us_p50_p99_max", np.percentile(late_us, (50, 99, 100)).round())
    assert share > 0.97


def test_the_log_decodes_by_the_dbc_and_each_drive_got_a_setpoint_a_cycle(folder: Path) -> None:
    messages = cantools.database.load_file(DBC)
    enabled_s: list[float] = []
    counts: Counter[str] = Counter()
    for frame in can.CanutilsLogReader(folder / "can.log"):
        try:
            message = messages.get_message_by_frame_id(frame.arbitration_id)
        except KeyError:  # the IMU's
            counts["IMU"] += 1
            continue
        counts[message.name] += 1
        signals = message.decode(bytes(frame.data), decode_choices=False) if message.length else {}
        if message.name == "CONTROL_1" and signals["ControlWord"] == 0x0F:
            enabled_s.append(frame.timestamp)
    for n in (1, 2, 3):
        assert counts[f"LOGON_{n}"] >= 1
        assert counts[f"STATUS_{n}"] > 0.97 * counts[f"CONTROL_{n}"]
        assert counts[f"ANSWER_{n}"] > 0.97 * counts[f"REQUEST_{n}"]
    assert counts["IMU"] > 0
    assert enabled_s[-1] - enabled_s[0] > 0.8 * RIDE_S
    assert np.median(np.diff(enabled_s)) == pytest.approx(CYCLE_S, rel=0.05)


def test_the_recording_replayed_through_the_control_code_gives_the_same_frames(
    folder: Path,
) -> None:
    asked = subprocess.run(
        [sys.executable, "-m", "hil", "replay", str(folder)],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert asked.returncode == 0, asked.stdout + asked.stderr
