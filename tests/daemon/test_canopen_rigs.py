"""Rigs with CiA 402 drives in simulated time: every mode, several buses, mixed families, and trouble."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hil.bus.schedule import require_schedule_fits
from hil.config import RigFile
from hil.configfile import load_rig, parse_settings
from hil.control.streaming import cues
from hil.daemon.records import FrameRecord, InputRecord, SetpointRecord, StateRecord
from hil.daemon.replay import Replay
from hil.daemon.simulated import cue_at
from hil.drivefiles import load_profile, load_profiles
from hil.drives import DrivePhase
from hil.errors import BusOff, CommandRefused, ConfigError
from hil.frames import Frame
from hil.safety import Rule
from tests.daemon.simulated_rig import Session, rig_file
from tests.drives.cia402.exchange import with_drive

PROFILES = {"cia402": load_profile("cia402"), "lust_cdd3000": load_profile("lust_cdd3000")}


def session(name: str = "axis_canopen", cyclic: str = "position", **tables) -> Session:
    return Session(with_drive(rig_file(name, **tables), cyclic=cyclic), PROFILES)


def mixed(bus: int = 0, **tables) -> RigFile:
    """The motorcycle platform: two LUST legs and a CiA 402 slide, on one bus or on one of its own."""
    values = load_rig("motorcycle").model_dump()
    for table, changes in tables.items():
        values[table].update(changes)
    drive = values["actuators"][2]["drive"]
    drive.update({"profile": "cia402", "bus": bus, "counts_per_unit": 1e7})
    if bus:
        values["can"]["further"] = ({"url": "socketcan:can1", "bitrate": 500_000},)
    return parse_settings(values, RigFile, "mixed")


def rms(ride: Session, after_s: float) -> float:
    errors = [
        s.tracking_error
        for s in ride.of(StateRecord)
        if s.state == "engaged" and s.t_s > after_s and not math.isnan(s.tracking_error)
    ]
    return float(np.sqrt(np.mean(np.square(errors))))


@pytest.mark.parametrize(
    ("mode", "cyclic", "kind", "most_mm"),
    [
        ("drive", "position", "position", 3.0),
        ("drive", "velocity", "velocity", 3.0),
        ("cascade", "position", "force", 5.0),
        ("computed_torque", "position", "force", 0.05),
    ],
)
def test_the_axis_rides_in_every_mode_and_ends_parked_and_off(mode, cyclic, kind, most_mm):
    ride = session(cyclic=cyclic, control={"mode": mode}).engaged(1.5)
    assert rms(ride, ride.now_s - 0.7) < 1e-3 * most_mm
    ride.leave()
    assert ride.core.state == "parked"
    assert not ride.powered()
    assert {r.kind for r in ride.of(SetpointRecord)} == {kind}
    assert ride.state().slots == ride.state().pairs > 1500
    assert not ride.core._link.gate.refused


@pytest.mark.parametrize("mode", ["drive", "computed_torque"])
@pytest.mark.parametrize("cycle_s", [0.001, 0.002])
def test_six_axes_on_two_buses_at_1_khz_and_as_shipped(mode, cycle_s):
    timing = {"cycle": cycle_s, "setpoint_delay": cycle_s + 0.00015}
    ride = session("stewart_canopen", control={"mode": mode}, bus=timing).engaged(0.5)
    assert {f.frame.bus for f in ride.of(FrameRecord)} == {0, 1}
    assert ride.state().pairs > 0.99 * ride.state().slots
    assert ride.state().bus_load < 0.9
    assert [bus.totals.refused for bus in ride.buses] == [0, 0]


@pytest.mark.parametrize("bus", [0, 1])
@pytest.mark.parametrize("mode", ["drive", "computed_torque"])
def test_two_lust_legs_and_a_cia_402_slide_ride_together(bus, mode):
    ride = Session(mixed(bus, control={"mode": mode}), PROFILES).engaged(2.0)
    assert [d.status.phase for d in ride.core._link.drives] == [DrivePhase.ENABLED] * 3
    assert rms(ride, ride.now_s - 1.0) < 0.01
    ride.leave()
    assert ride.core.state == "parked"
    assert not ride.powered()
    nodes = {f.frame.bus for f in ride.sent() if f.frame.can_id == 0x200 + 3}
    assert nodes == {bus}


def test_identifiers_of_two_families_that_collide_are_refused():
    rig = mixed()
    drive = rig.actuators[0].drive.model_copy(update={"address": 74})  # its log-on: 0x607 + 74
    legs = rig.actuators[0].model_copy(update={"drive": drive})
    slide = rig.actuators[2].drive.model_copy(update={"address": 0x51})
    moved = rig.actuators[2].model_copy(update={"drive": slide})
    clash = rig.model_copy(update={"actuators": (legs, rig.actuators[1], moved)})
    with pytest.raises(ConfigError, match="identifier 0x651"):
        Session(clash, PROFILES)


def test_a_bus_that_is_too_full_is_refused_with_what_fits():
    rig = rig_file("stewart_canopen", bus={"cycle": 0.001, "setpoint_delay": 0.00115})
    assert 0.8 < require_schedule_fits(rig, PROFILES) < 0.9
    crowded = with_drive(rig, bus=0)
    with pytest.raises(ConfigError) as refused:
        require_schedule_fits(crowded, PROFILES)
    text = str(refused.value)
    assert "3 of these 6 drives with bus.cycle = 0.001" in text
    assert "all of them with bus.cycle = 0.002" in text
    slower = crowded.model_copy(update={"bus": rig.bus.model_copy(update={"cycle": 0.002})})
    assert require_schedule_fits(slower, PROFILES) < 0.9


def test_a_replay_sends_the_same_frames_again():
    ride = session().engaged(0.3)
    journal = [r for r in ride.records if isinstance(r, InputRecord | FrameRecord)]
    cues = [r for r in ride.records if type(r).__name__ in ("CueRecord", "CommandRecord")]
    ordered = [r for r in ride.records if r in journal or r in cues]
    found = Replay(ride.rig, PROFILES).run(ordered)
    assert found.is_same
    assert found.frames > 1000


# trouble


def test_a_node_that_vanishes_while_armed_is_an_emergency_and_can_be_had_back():
    ride = session().engaged(0.5)
    (drive,) = ride.simulated.drives
    drive.silence()
    ride.ride(0.4)
    assert ride.core.state == "emergency"
    assert ride.state().fault.startswith("answers_lost: axis")
    drive.silence(silent=False)
    ride.run_until(ride.now_s + 0.5)
    assert ride.command("reset").ok
    ride.run_until(ride.now_s + 3.0)
    ride.arm()
    assert ride.core.state in ("ready", "engaged")


def test_a_drive_error_while_armed_parks_or_stops_the_rig_and_names_itself():
    ride = session().engaged(0.5)
    (drive,) = ride.simulated.drives
    ride.simulated._queue(drive.set_fault(0x4310), 0)
    ride.ride(0.3)
    assert ride.core.state in ("fault", "emergency")
    assert "motor too hot" in ride.state().fault
    assert not ride.powered()


@pytest.mark.parametrize("name", ["axis", "axis_canopen"])
def test_a_rig_whose_drive_does_not_go_off_is_not_called_parked(name):
    ride = session(name)
    ride.wait_for("parked")
    ride.arm()
    ride.run_until(ride.now_s + 0.5)
    (drive,) = ride.simulated.drives
    stage = drive.stage if name == "axis" else drive._power
    stage.obey = lambda *a, **k: None  # it answers and heeds no control word
    assert ride.command("disarm").ok
    ride.run_until(ride.now_s + 1.5)
    assert ride.core.state == "fault"
    assert "still makes force" in ride.state().fault
    assert "drive_stays_on" in ride.events()
    assert "still makes force" in ride.command("arm").text


@pytest.mark.parametrize("name", ["axis_canopen", "stewart_canopen"])
def test_a_boot_up_message_of_a_drive_that_makes_force_takes_its_power_too(name):
    """Another node of its number has booted, or it has begun its communication anew without a break."""
    ride = session(name).engaged(0.5)
    ride.core.on_frame(ride.now_s, Frame(0x701, b"\x00"))
    ride.run_until(ride.now_s + 0.1)
    assert ride.core.state == "emergency"
    assert ride.state().fault.startswith("drive_rebooted: ")
    assert not ride.powered()
    assert ride.command("reset").ok
    ride.wait_for("parked")


def test_a_drive_that_told_its_boot_up_and_stays_on_is_named():
    ride = session().engaged(0.5)
    ride.simulated.drives[0]._power.obey = lambda *a: None
    ride.core.on_frame(ride.now_s, Frame(0x701, b"\x00"))
    ride.run_until(ride.now_s + 1.5)
    assert "axis (node 1) still makes force" in ride.text_of("drive_stays_on")


def test_a_late_node_keeps_the_rig_from_being_armed_until_it_boots():
    ride = session()
    (drive,) = ride.simulated.drives
    drive.silence()
    ride.run_until(1.0)
    assert ride.core.state == "offline"
    assert not ride.command("arm").ok
    drive.silence(silent=False)
    drive.reboot(ride.now_s)
    ride.wait_for("parked")


def refuse_mapping(drive) -> None:
    drive.objects.refused[0x1A00, 3] = "not_mappable"


def another_drive(drive) -> None:
    drive.objects.put((0x1018, 2), 0x999)


@pytest.mark.parametrize(
    ("breaks", "name", "says"),
    [
        (lambda drive, now_s: drive.storm(now_s), "drive_error", "encoder"),
        (lambda drive, now_s: drive.wrong_pdos(50), "wrong_pdo", "3 bytes"),
        (lambda drive, now_s: drive.set_voltage(now_s, present=False), "enpo_lost", "voltage"),
        (lambda drive, now_s: drive.reboot(now_s), "drive_silent", "answered nothing"),
    ],
    ids=["EMCY storm", "wrong PDO length", "supply gone", "restart"],
)
def test_trouble_while_riding_is_named_ends_unpowered_and_a_reset_brings_the_rig_back(
    breaks, name, says
):
    ride = session().engaged(0.5)
    (drive,) = ride.simulated.drives
    breaks(drive, ride.now_s)
    ride.run_until(ride.now_s + 2.0)
    assert ride.core.state in ("fault", "emergency")
    assert not ride.powered()
    assert name in ride.events()
    assert says in ride.text_of(name)
    assert not ride.command("arm").ok
    drive.storm(0.0, on=False)  # the cause is removed, as docs/cia402.md says, then:
    drive.wrong_pdos(0)
    drive.set_voltage(ride.now_s, present=True)
    assert ride.command("reset").ok
    ride.wait_for("parked")
    ride.engaged(0.3)


@pytest.mark.parametrize(
    ("breaks", "name"),
    [(refuse_mapping, "mapping_refused"), (another_drive, "drive_identity")],
    ids=["refused mapping", "another identity"],
)
def test_a_drive_that_is_not_as_wanted_keeps_the_rig_unarmed_until_it_is_put_right(breaks, name):
    ride = session()
    (drive,) = ride.simulated.drives
    breaks(drive)
    ride.run_until(3.0)
    assert name in ride.events()
    assert ride.core.state in ("preparing", "fault")
    assert not ride.command("arm").ok
    assert not ride.powered()
    drive.objects.refused.clear()
    drive.objects.put((0x1018, 2), 0x402)
    assert ride.command("reset").ok
    ride.engaged(0.3)


def test_a_daemon_that_dies_lets_the_drives_stop_by_themselves():
    ride = session().engaged(0.5)
    at_s = ride.now_s
    ride.world.masters["control"] = _Dead()
    ride.world.run_until(at_s + 0.4)
    assert not ride.powered()


class _Dead:
    """A master that has crashed."""

    next_due_s = float("inf")

    def on_due(self, now_s: float) -> list[Frame]:
        return []

    def on_frame(self, now_s: float, frame: Frame) -> list[Frame]:
        return []

    def on_refused(self, now_s: float, frame: Frame, error: Exception) -> None:
        return None


def test_a_bus_without_its_controller_is_not_on_again_because_another_is_heard():
    ride = session("stewart_canopen")
    ride.wait_for("parked")
    now_s = ride.now_s
    ride.core.on_refused(now_s, Frame(0x201, bytes(6), bus=1), BusOff("can1 is off the bus"))
    of_one, send = ride.core.on_frame, ride.core.on_due
    ride.core.on_frame = lambda t_s, frame: of_one(t_s, frame) if frame.bus == 0 else ()
    ride.core.on_due = lambda t_s: [frame for frame in send(t_s) if frame.bus == 0]
    ride.run_until(now_s + 0.1)
    assert "bus_on" not in ride.events()
    with pytest.raises(CommandRefused, match="bus_off"):
        ride.arm()
    ride.core.on_frame = of_one
    ride.core.on_due = send
    ride.run_until(now_s + 2.0)
    assert ride.events().count("bus_on") == 1


def test_shipped_rig_files_name_drive_files_that_there_are():
    for name in ("axis_canopen", "stewart_canopen", "axis", "motorcycle"):
        rig = load_rig(name)
        assert require_schedule_fits(rig, load_profiles(rig)) < 0.9


def test_late_wakes_and_missed_cycles_at_1_khz_are_not_taken_for_setpoints_that_are_too_fast():
    ride = session(bus={"cycle": 0.001, "setpoint_delay": 0.00115}, safety={"overrun_cycles": 60})
    ride.arm()
    ride.world._jitter_s = 0.0008  # half of all wakes more than half a cycle late
    start_s, amplitude_m = ride.now_s, 0.02

    def motion(t_s):
        grown = np.clip(t_s - 0.3, 0.0, 1.0)
        return (amplitude_m * grown * np.sin(4.0 * np.pi * t_s))[:, None]

    for cue in cues(motion, 0.0, 2.0, "test"):
        ride.cue(cue_at(cue, start_s))
    assert ride.core._schedule.overruns > 100
    assert set(ride.core._link.gate.refused) <= {Rule.DUPLICATE}
    assert ride.core.state == "engaged"
