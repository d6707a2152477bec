"""A rig in motion on a real bus, and what disturbs it: one named reaction each, safe, and back again.

One daemon and one simulated axis serve all the cases, in order: each must leave the rig so that it can be
armed again. The last one pulls the adapter.
"""

from __future__ import annotations

import random
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from hil.frames import Frame, pack
from hil.messages import StateMessage

from .wire import (
    CYCLE_S,
    STARVED,
    URL,
    VCAN,
    Rider,
    RigOnWire,
    engage,
    ip,
    raw_socket,
    require_interface,
    stop_the_queue,
    sway,
    wait_for,
)

pytestmark = [pytest.mark.vcan, pytest.mark.timeout(300)]

STATUS, ANSWER, CONTROL, REQUEST = 0x372, 0x52A, 0x296, 0x44E
"""Of the axis' drive, whose address is 1."""
BUS_OFF_FRAME = Frame(0x040, bytes(8), is_error=True)
RESTARTED_FRAME = Frame(0x100, bytes(8), is_error=True)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RigOnWire]:
    require_interface()
    made = RigOnWire(tmp_path_factory.mktemp("rig"), "axis")
    try:
        made.simulate()
        made.daemon()
        with made.client() as client:
            made.rig = client
            yield made
    finally:
        made.end()


@pytest.fixture
def riding(rig: RigOnWire) -> Iterator[RigOnWire]:
    """The rig, armed and following cues, whatever the case before has left."""
    rig.heard = []
    with Rider(rig.rig, sway):
        engage(rig.rig)
        rig.events = rig.rig.events()
        yield rig
    for event in [*rig.heard, *rig.events.waiting()]:
        print(f"{event.t:.3f} {event.severity} {event.name}: {event.text}")


def stays_engaged(rig: RigOnWire, seconds: float) -> bool:
    """Whether nothing but a guest that stood still ends the ride; after that it is engaged anew."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        if rig.rig.state().state != "engaged":
            time.sleep(0.2)  # the event that says why may come after the state
            new = rig.events.waiting()
            rig.heard += new
            if not any(event.name in STARVED for event in new):
                return False
            engage(rig.rig)
        time.sleep(CYCLE_S)
    return True


def comes_to(rig: RigOnWire, *names: str) -> StateMessage:
    wait_for(lambda: rig.rig.state().state in names, 30.0)
    return rig.rig.state()


def send(*frames: Frame) -> None:
    with raw_socket() as wire:
        for frame in frames:
            wire.send(pack(frame))


def test_it_follows_its_cues(riding: RigOnWire) -> None:
    seen = []
    for _ in range(40):
        time.sleep(0.1)
        seen.append(riding.rig.state().pose["position"])
    assert max(seen) - min(seen) > 0.012
    assert riding.rig.state().slot_use > 0.9


def test_an_interface_set_down_is_bus_off_and_an_emergency_and_all_is_well_when_it_is_up(
    riding: RigOnWire,
) -> None:
    ip("link", "set", VCAN, "down")
    state = comes_to(riding, "emergency", "fault")
    assert state.state == "emergency"
    assert state.fault.startswith("bus_off")
    time.sleep(0.5)
    assert riding.control.poll() is None
    assert riding.simulated.poll() is None
    assert not riding.rig.command("arm").ok
    ip("link", "set", VCAN, "up")


def test_bus_off_is_an_emergency_until_it_is_restarted_and_reset(riding: RigOnWire) -> None:
    send(BUS_OFF_FRAME)
    state = comes_to(riding, "emergency", "fault")
    assert state.state == "emergency"
    assert state.fault.startswith("bus_off")
    send(RESTARTED_FRAME)


def test_a_full_transmit_queue_ends_safe(riding: RigOnWire) -> None:
    stop_the_queue()
    state = comes_to(riding, "parked", "fault", "emergency")
    assert state.state != "parked" or comes_to(riding, "fault", "emergency")
    assert not riding.rig.command("arm").ok
    assert riding.control.poll() is None


def test_a_lasting_flood_of_the_highest_priority_is_lived_through(riding: RigOnWire) -> None:
    with subprocess.Popen(["cangen", VCAN, "-I", "000", "-L", "8", "-g", "2"]) as flood:
        engaged = stays_engaged(riding, 2.0)
        flood.terminate()
    assert engaged or comes_to(riding, "parked", "ready", "engaged")


def test_frames_of_strangers_do_not_matter(riding: RigOnWire) -> None:
    rng = random.Random(5)
    ours = {0x0DD, 0x1B9, 0x1BA, CONTROL, STATUS, REQUEST, ANSWER, *range(0x607, 0x648)}
    with raw_socket() as wire:
        for _ in range(30):
            for _ in range(5):
                can_id = rng.choice([i for i in range(0x800) if i not in ours])
                wire.send(pack(Frame(can_id, rng.randbytes(rng.randrange(9)))))
                wire.send(pack(Frame(CONTROL, rng.randbytes(8), is_extended=True)))
            assert stays_engaged(riding, 0.05)


def test_remote_frames_and_short_frames_of_the_drives_are_counted_not_followed(
    riding: RigOnWire,
) -> None:
    for _ in range(20):
        send(Frame(STATUS, is_remote=True), Frame(ANSWER, bytes(8), is_remote=True))
        send(*(Frame(STATUS, bytes(n)) for n in range(8)))
        send(*(Frame(ANSWER, bytes(n)) for n in range(8)))
        assert stays_engaged(riding, 0.05)


def test_a_warning_of_the_controller_does_not_stop_the_ride(riding: RigOnWire) -> None:
    send(Frame(0x004, bytes([0, 0x08, 0, 0, 0, 0, 0, 0]), is_error=True))
    assert stays_engaged(riding, 0.5)


def test_a_second_master_is_a_fault(riding: RigOnWire) -> None:
    with can.Bus(interface="socketcan", channel=VCAN) as other:
        reads = bytes([0x90, 0x01, 5, 0, 0, 0, 0, 0])  # parameter 400
        other.send(can.Message(arbitration_id=REQUEST, is_extended_id=False, data=reads))
        state = comes_to(riding, "fault", "emergency")
    assert state.fault.startswith("second_master")


def test_a_log_replayed_onto_a_live_bus_is_a_second_master(
    riding: RigOnWire, tmp_path: Path
) -> None:
    log = tmp_path / "can.log"
    log.write_text(f"(1.000000) can0 {REQUEST:03X}#9001050000000000\n")
    subprocess.run(["canplayer", "-I", str(log), f"{VCAN}=can0"], check=True, timeout=30)
    assert comes_to(riding, "fault", "emergency").fault.startswith("second_master")


def test_an_error_frame_of_a_drive_is_a_fault(riding: RigOnWire) -> None:
    subprocess.run(["cansend", VCAN, "1BA#0300000000000000"], check=True, timeout=30)
    state = comes_to(riding, "fault", "emergency")
    assert state.fault.startswith("drive_error")
    assert "E-OC" in state.fault


def test_a_second_daemon_is_refused_and_the_first_rides_on(riding: RigOnWire) -> None:
    second = riding.start("run", str(riding.file), "--can", URL, "--listen", "tcp/127.0.0.1:0")
    wait_for(lambda: second.poll() is not None)
    assert second.returncode == 2
    riding.processes.remove(second)
    assert f"process {riding.control.pid}" in second.communicate()[0]
    engage(riding.rig)


def test_killed_drives_are_lost_answers(riding: RigOnWire) -> None:
    riding.simulated.kill()
    state = comes_to(riding, "fault", "emergency")
    assert state.state == "emergency"
    assert state.fault.startswith("answers_lost")
    riding.simulate()


def test_a_pulled_adapter_ends_the_daemon_with_a_sentence(riding: RigOnWire) -> None:
    ip("link", "del", VCAN)
    wait_for(lambda: riding.control.poll() is not None)
    assert riding.control.returncode == 2
    riding.processes.remove(riding.control)
    said = riding.control.communicate()[0]
    assert f"socketcan:{VCAN}" in said
    assert "Traceback" not in said
