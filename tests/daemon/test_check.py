"""`hil check` names each thing that is wrong, says what to do, and finds nothing where nothing is wrong."""

import asyncio
import os
import resource
import socket
import threading
from contextlib import contextmanager, suppress
from types import SimpleNamespace

import pytest

from hil.bus.hub import Hub
from hil.bus.port import open_port
from hil.daemon.check import Probe, check_contradictions
from hil.daemon.check.bus import Wanted, check_bus, check_interface
from hil.daemon.check.drives import check_drives
from hil.daemon.check.host import check_daemon, check_disk, check_endpoints
from hil.daemon.check.pc import check_cycle, check_pc
from hil.daemon.lock import RigLock
from hil.sim.rig import SimulatedRig
from hil.sim.serve import SimulatedRigServer
from tests.daemon.simulated_rig import PROFILES, rig_file

RIG = rig_file()
HEX = rig_file("stewart")
ALL_CAPABILITIES = "CapEff:\t000001ffffffffff\n"
NO_CAPABILITIES = "CapEff:\t0000000000000000\n"

GOOD_LINK = {
    "linkinfo": {
        "info_kind": "can",
        "info_data": {
            "state": "ERROR-ACTIVE",
            "restart_ms": 0,
            "ctrlmode": [],
            "bittiming": {"bitrate": 500_000},
        },
    }
}


class Tree:
    """A PC's /proc and /sys as files, all well unless changed."""

    def __init__(self, root):
        self.root = root
        self.write("proc/self/status", f"Name:\thil\n{ALL_CAPABILITIES}")
        self.write("proc/loadavg", "0.10 0.10 0.10 1/100 4242\n")
        self.write("proc/sys/kernel/sched_rt_runtime_us", "950000\n")
        self.write("proc/sys/kernel/sched_rt_period_us", "1000000\n")
        self.write("sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc\n")
        for k in range(2):
            self.write(f"sys/devices/system/cpu/cpu{k}/cpufreq/scaling_governor", "performance\n")
        self.write("sys/class/net/can0/flags", "0x40081\n")
        self.write("sys/class/net/can0/tx_queue_len", "128\n")

    def write(self, path, text):
        target = self.root / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text)


@pytest.fixture
def tree(tmp_path):
    return Tree(tmp_path)


def trouble(found):
    return {f.topic: f.level for f in found if f.level != "ok"}


def remedy(found, topic):
    return next(f.remedy for f in found if f.topic == topic and f.level != "ok")


def interface(tree, link=GOOD_LINK, rig=RIG, name="can0"):
    wanted = Wanted(name, rig.can.bitrate, len(rig.actuators))
    return check_interface(wanted, tree.root, lambda asked: link)


def changed_link(**changes):
    data = {**GOOD_LINK["linkinfo"]["info_data"], **changes}
    return {"linkinfo": {"info_kind": "can", "info_data": data}}


# the PC


def test_a_well_kept_pc_has_nothing_wrong(tree):
    assert trouble(check_pc(tree.root)) == {}


@pytest.mark.parametrize(
    ("path", "text", "topic", "says"),
    [
        ("proc/loadavg", f"{4 * os.cpu_count()}.0 1 1 1/100 1\n", "load", "top"),
        ("proc/sys/kernel/sched_rt_runtime_us", "500000\n", "throttling", "sysctl"),
        (
            "sys/devices/system/clocksource/clocksource0/current_clocksource",
            "hpet\n",
            "clock",
            "dmesg",
        ),
        (
            "sys/devices/system/cpu/cpu1/cpufreq/scaling_governor",
            "powersave\n",
            "processor",
            "perf",
        ),
    ],
)
def test_what_makes_a_pc_late_is_named_with_its_remedy(tree, path, text, topic, says):
    tree.write(path, text)
    found = check_pc(tree.root)
    assert trouble(found) == {topic: "warn"}
    assert says in remedy(found, topic)


@pytest.fixture
def no_rights(tree, monkeypatch):
    tree.write("proc/self/status", NO_CAPABILITIES)
    monkeypatch.setattr(resource, "getrlimit", lambda which: (0, 0))


def test_missing_rights_are_named(tree, no_rights):
    found = check_pc(tree.root)
    assert trouble(found) == {"real time": "warn", "memory": "warn"}
    assert "rtprio 50" in remedy(found, "real time")
    assert "memlock unlimited" in remedy(found, "memory")


def test_a_pc_with_the_service_needs_no_rights_for_its_users(tree, no_rights):
    tree.write("etc/systemd/system/hild.service", "")
    assert trouble(check_pc(tree.root)) == {}


def test_limits_give_rights_without_capabilities(tree, monkeypatch):
    tree.write("proc/self/status", NO_CAPABILITIES)
    given = {resource.RLIMIT_RTPRIO: 50, resource.RLIMIT_MEMLOCK: resource.RLIM_INFINITY}
    monkeypatch.setattr(resource, "getrlimit", lambda which: (given[which], given[which]))
    assert trouble(check_pc(tree.root)) == {}


# the interface


def test_a_well_set_interface_has_nothing_wrong(tree):
    assert trouble(interface(tree)) == {}


def test_a_missing_interface_is_a_fault(tree):
    found = interface(tree, name="can7")
    assert trouble(found) == {"bus": "fault"}
    assert "can7" in found[0].text


def test_an_interface_that_is_down_is_a_fault_with_the_command_that_brings_it_up(tree):
    tree.write("sys/class/net/can0/flags", "0x40080\n")
    found = interface(tree)
    assert trouble(found) == {"bus": "fault"}
    assert "ip link set can0 up type can bitrate 500000 restart-ms 0" in remedy(found, "bus")


def test_another_bit_rate_is_a_fault(tree):
    found = interface(tree, changed_link(bittiming={"bitrate": 250_000}))
    assert trouble(found) == {"bit rate": "fault"}
    assert "bitrate 500000" in remedy(found, "bit rate")


def test_a_virtual_interface_has_no_bit_rate_to_be_wrong(tree):
    assert trouble(interface(tree, {"linkinfo": {"info_kind": "vcan"}})) == {}


@pytest.mark.parametrize(
    ("rig", "length", "level"), [(RIG, 10, "warn"), (HEX, 10, "fault"), (HEX, 52, None)]
)
def test_a_queue_shorter_than_a_cycle_is_a_fault_a_tight_one_a_warning(tree, rig, length, level):
    tree.write("sys/class/net/can0/tx_queue_len", f"{length}\n")
    found = trouble(interface(tree, rig=rig))
    assert found == ({"queue": level} if level else {})


def test_a_restart_by_itself_is_warned_of(tree):
    found = interface(tree, changed_link(restart_ms=100))
    assert trouble(found) == {"restart": "warn"}
    assert "restart-ms 0" in remedy(found, "restart")


@pytest.mark.parametrize(
    ("state", "level"), [("BUS-OFF", "fault"), ("ERROR-PASSIVE", "warn"), ("ERROR-WARNING", "warn")]
)
def test_a_controller_that_sees_errors_points_at_the_wiring(tree, state, level):
    found = interface(tree, changed_link(state=state))
    assert trouble(found) == {"controller": level}
    assert "termination" in remedy(found, "controller")


def test_listen_only_mode_is_a_fault(tree):
    found = interface(tree, changed_link(ctrlmode=["LISTEN-ONLY"]))
    assert trouble(found) == {"controller": "fault"}


def test_every_bus_of_a_rig_is_looked_at(tree):
    further = [{"url": "socketcan:can7"}, {"url": f"hub:{tree.root}/none.sock"}]
    found = check_bus(rig_file(can={"url": "socketcan:can0", "further": further}), tree.root)
    faults = [f.text for f in found if f.topic == "bus" and f.level == "fault"]
    assert any("no interface can7" in text for text in faults)
    assert any("none.sock" in text for text in faults)


def test_a_kernel_without_can_is_named(tree, monkeypatch):
    def refused(*_):
        raise OSError(97, "Address family not supported by protocol")

    monkeypatch.setattr(socket, "socket", refused)
    found = check_bus(rig_file(can={"url": "socketcan:can7"}), tree.root)
    assert "modprobe can-raw" in remedy(found, "bus")


# what else is on the host


def test_a_rig_that_its_bus_cannot_carry_is_a_fault():
    found = check_contradictions(rig_file("stewart", can={"bitrate": 125_000}), PROFILES)
    assert trouble(found) == {"bus load": "fault"}
    (load,) = [f for f in found if f.topic == "bus load"]
    assert load.remedy.startswith("what fits on a bus of 125 kbit/s: ")
    assert "What fits" not in load.text


def test_rig_and_drive_file_that_contradict_each_other_are_a_fault():
    found = check_contradictions(rig_file(bus={"schedule": "fast"}), PROFILES)
    assert trouble(found) == {"rig file": "fault"}


def test_a_rig_file_in_millimetres_or_degrees_is_asked_about():
    limits = RIG.model_copy(update={"limits": (0.26, 15.0, 0.26)})
    found = check_contradictions(limits, PROFILES)
    assert trouble(found) == {"rig file": "warn"}
    assert remedy(found, "rig file") == "correct the rig file: it is in m and rad"


def test_a_taken_endpoint_is_a_fault_and_a_free_one_is_not():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        rig = rig_file(zenoh={"listen": [endpoint]})
        assert trouble(check_endpoints(rig, is_running=False)) == {"endpoint": "fault"}
        assert check_endpoints(rig, is_running=True) == []  # it is our own daemon's
    assert trouble(check_endpoints(rig, is_running=False)) == {}


def test_an_endpoint_open_to_the_network_is_warned_of():
    rig = rig_file(zenoh={"listen": ["tcp/0.0.0.0:0"]})
    assert trouble(check_endpoints(rig, is_running=False)) == {"endpoint": "warn"}


def test_another_daemon_on_the_bus_is_named(tmp_path):
    rig = rig_file(can={"url": f"hub:{tmp_path / 'bus.sock'}"})
    assert trouble(check_daemon(rig)) == {}
    with RigLock(rig.name, rig.can.url):
        found = check_daemon(rig)
    assert f"process {os.getpid()}" in found[0].text


def test_the_disk_is_measured_where_the_recordings_will_be(tmp_path, monkeypatch):
    rig = rig_file(recording={"folder": str(tmp_path / "not" / "yet")})
    assert trouble(check_disk(rig)) == {}
    for free_bytes, level in ((100 << 20, "warn"), (1 << 20, "fault")):
        usage = SimpleNamespace(free=free_bytes)
        monkeypatch.setattr("shutil.disk_usage", lambda path, usage=usage: usage)
        assert trouble(check_disk(rig)) == {"disk": level}


# drives


@contextmanager
def simulated(folder, rig):
    """`rig` on a hub at its own bus URL, in a thread of its own."""
    stop: list = []
    up = threading.Event()

    async def serve():
        async with Hub(folder / "bus.sock", rig.can.bitrate):
            port = open_port(f"{rig.can.url}?node=rig", bitrate_bps=rig.can.bitrate)
            task = asyncio.ensure_future(
                SimulatedRigServer(SimulatedRig(rig, PROFILES), port).run()
            )
            stop.append((asyncio.get_running_loop(), task))
            up.set()
            with suppress(asyncio.CancelledError):
                await task
            port.close()

    thread = threading.Thread(target=asyncio.run, args=(serve(),))
    thread.start()
    assert up.wait(30.0)
    try:
        yield
    finally:
        loop, task = stop[0]
        loop.call_soon_threadsafe(task.cancel)
        thread.join()


@pytest.fixture
def rig(tmp_path):
    return rig_file("axis", can={"url": f"hub:{tmp_path / 'bus.sock'}"})


def test_drives_that_log_on_are_heard(tmp_path, rig):
    with simulated(tmp_path, rig):
        found = check_drives(rig, PROFILES, Probe(listen_s=0.5))
    assert trouble(found) == {}
    assert "axis logs on" in found[0].text


def test_silent_drives_are_warned_of(tmp_path, rig):
    async def main():
        async with Hub(tmp_path / "bus.sock", rig.can.bitrate):
            return await asyncio.to_thread(check_drives, rig, PROFILES, Probe(listen_s=0.2))

    assert trouble(asyncio.run(main()))["drives"] == "warn"


def test_the_other_stride_is_told_by_the_log_ons(tmp_path, rig):
    profile = PROFILES["lust_cdd3000"]
    ids = profile.ids.model_copy(update={"stride": 3 - profile.ids.stride})
    other = {"lust_cdd3000": profile.model_copy(update={"ids": ids})}
    with simulated(tmp_path, rig):
        found = check_drives(rig, other, Probe(listen_s=0.5))
    assert found[0].level == "fault"
    assert f"ids.stride = {profile.ids.stride}" in remedy(found, "drives")


def test_drives_answer_when_asked(tmp_path, rig):
    with simulated(tmp_path, rig):
        assert trouble(check_drives(rig, PROFILES, Probe(asks=True))) == {}


def test_drives_are_prepared_up_to_ready_without_power(tmp_path, rig):
    with simulated(tmp_path, rig):
        found = check_drives(rig, PROFILES, Probe(prepares=True))
        assert trouble(found) == {}
        again = check_drives(rig, PROFILES, Probe(listen_s=0.5))
    assert "watchdog is written and read back" in found[0].text
    assert "logs on" in again[0].text  # and none of them ran into its watchdog


def test_a_watchdog_parameter_that_the_drive_refuses_is_named(tmp_path, rig):
    profile = PROFILES["lust_cdd3000"]
    dog = profile.parameters.watchdog.model_copy(update={"number": 575})
    parameters = profile.parameters.model_copy(update={"watchdog": dog})
    wrong = {"lust_cdd3000": profile.model_copy(update={"parameters": parameters})}
    with simulated(tmp_path, rig):
        found = check_drives(rig, wrong, Probe(prepares=True))
    assert trouble(found) == {"drives": "fault"}
    assert "parameter 575 (watchdog) was refused" in found[0].text


def test_nothing_is_asked_while_a_daemon_has_the_bus(tmp_path, rig):
    with simulated(tmp_path, rig), RigLock(rig.name, rig.can.url):
        found = check_drives(rig, PROFILES, Probe(asks=True))
    assert trouble(found) == {"drives": "fault"}
    assert "already run" in found[0].text


def test_the_processor_time_of_fast_cycles_is_told():
    assert check_cycle(RIG) == []
    (fits,) = check_cycle(rig_file("stewart_canopen"))
    assert fits.level == "ok"
    fast = rig_file("stewart_canopen", bus={"cycle": 0.001, "setpoint_delay": 0.00115})
    (tight,) = check_cycle(fast)
    assert tight.level == "warn"
    assert "six axes at 1 kHz took 69 %" in tight.text
    assert "bus.cycle = 0.002 with bus.setpoint_delay = 0.00215" in tight.remedy
