"""The installed service under a real systemd, a simulated rig on vcan0: how it ends and comes back."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from hil.client import RigClient
from hil.errors import RigNotReached
from hil.runs import load_run
from hil.runs.folder import read_meta
from tests.daemon.bench import PATIENCE_S, arm, in_state, ride, wait_for
from tests.vcan.init_systemd import Systemd, in_guest, need, service_python
from tests.vcan.model import hand_over
from tests.vcan.wire import URL, slower

# Only in the guest: a second systemd is nothing to try on a machine that somebody uses.
pytestmark = (
    [pytest.mark.vcan, pytest.mark.timeout(600)]
    if in_guest()
    else pytest.mark.skip(reason="needs the guest: `make test-vcan` on a kernel without vcan")
)

UNIT = "hild.service"
RUNS = Path("/var/lib/hil/runs")
RIG = Path("/etc/hil/rig.toml")
MODEL = Path("/var/cache/hil")
ENDPOINT = "tcp/127.0.0.1:7447"


class Installed:
    """The service as `hil service install` leaves it, and a simulated rig on its bus."""

    def __init__(self, systemd: Systemd, folder: Path) -> None:
        self.systemd = systemd
        self.rig_text = slower("axis").replace('url = "socketcan:can0"', f'url = "{URL}"')
        rig = folder / "axis.toml"
        rig.write_text(self.rig_text)
        self.hil = service_python(systemd, Path("/opt/hil"))
        self.said = systemd.run(str(self.hil), "service", "install", "--rig", str(rig))
        self._patient()
        hand_over(Path("/opt/hil/checkout/src/hil"), MODEL)
        self.systemd.run("chown", "-R", "hil:hil", str(MODEL))
        self.rig_process = subprocess.Popen(
            [sys.executable, "-m", "hil", "simulate", str(rig)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def _patient(self) -> None:
        """A guest on a busy machine has less than real time."""
        drop_in = Path("/etc/systemd/system/hild.service.d/test.conf")
        drop_in.parent.mkdir(parents=True, exist_ok=True)
        drop_in.write_text("[Service]\nWatchdogSec=20\n")
        self.systemd.run("systemctl", "daemon-reload")

    def systemctl(self, verb: str, *, check: bool = True) -> str:
        try:
            return self.systemd.run("systemctl", verb, UNIT, check=check)
        except AssertionError as error:
            status = self.systemd.run("systemctl", "status", "-l", "-n30", UNIT, check=False)
            told = "\n".join(kernel_log()[-20:])
            raise AssertionError(f"{error}{status}{told}") from None

    def shows(self, what: str) -> str:
        return self.systemd.shows(UNIT, what)

    @property
    def pid(self) -> int:
        """Of the control process, as its own namespace numbers it."""
        return int(self.shows("MainPID"))

    def kill(self, pid: int, number: signal.Signals) -> None:
        self.systemd.run("kill", f"-{number.value}", str(pid))

    def gateway(self) -> int:
        children = self.systemd.run("cat", f"/proc/{self.pid}/task/{self.pid}/children")
        return int(children.split()[0])

    def client(self) -> RigClient:
        end_s = time.monotonic() + PATIENCE_S
        while True:
            try:
                return RigClient("axis", ENDPOINT, name="test").open()
            except RigNotReached:
                assert time.monotonic() < end_s, self.systemd.journal(UNIT)[-20:]
                time.sleep(0.2)

    def newest_run(self) -> Path:
        return sorted(RUNS.iterdir())[-1]

    def close(self) -> None:
        self.systemctl("stop", check=False)
        self.rig_process.kill()
        self.rig_process.wait()


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    need("nsenter", "unshare", "systemctl", "journalctl")
    systemd = Systemd()
    made = Installed(systemd, tmp_path_factory.mktemp("rig"))
    yield made
    made.close()
    systemd.close()


@pytest.fixture
def service(installed):
    """The service, stopped and unblemished, with its own rig file."""
    installed.systemctl("stop", check=False)
    installed.systemctl("reset-failed", check=False)
    RIG.write_text(installed.rig_text)
    yield installed
    print("\n".join(installed.systemd.journal(UNIT)[-60:]))  # shown where the test failed
    print("\n".join(kernel_log()[-10:]))


@pytest.fixture
def riding(service):
    """Started, armed and following cues."""
    service.systemctl("start")
    with contextlib.closing(steady(service, ride)) as client:
        service.rig = client
        yield service


def steady(service, use):
    """A client of the running daemon, after `use` of it.

    In a guest that had no processor for long a gateway is given up as one that hangs, the daemon leaves and
    systemd brings another: only then is `use` tried again.
    """
    for attempt in range(1, 4):
        wait_for(lambda: service.shows("ActiveState") == "active", PATIENCE_S)
        pid, client = service.pid, service.client()
        try:
            use(client)
        except (RigNotReached, AssertionError) as error:
            client.close()
            if service.pid == pid or attempt == 3:
                raise
            print(f"once more, with another daemon: {error}")
        else:
            return client
    raise AssertionError


def kernel_log():
    """What systemd itself has said of the service; here it logs to the kernel's log."""
    done = subprocess.run(["dmesg"], capture_output=True, text=True, check=True)
    return [line for line in done.stdout.splitlines() if "hild" in line]


def came_back(service, pid):
    """A new control process, disarmed."""
    wait_for(lambda: service.shows("ActiveState") == "active" and service.pid != pid, PATIENCE_S)

    def use(client):
        in_state(client, "parked", "fault", "emergency", "preparing", "engaged")
        if client.state().state == "engaged":
            pytest.fail("it came back engaged")
        arm(client)
        assert client.command("disarm").ok

    steady(service, use).close()


def test_installing_leaves_no_step_undone(installed):
    assert "failed" not in installed.said
    assert installed.shows("UnitFileState") == "enabled"
    assert installed.systemd.run("id", "--name", "--user", "hil").strip() == "hil"


def test_it_starts_rides_and_stops_parked(service):
    begun_s = time.monotonic()
    service.systemctl("start")
    print(f"start: {time.monotonic() - begun_s:.1f} s")
    assert service.shows("SubState") == "running"
    status = Path(f"/proc/{host_pid(service)}/status").read_text()
    assert "CapEff:\t0000000000000000" in status
    assert "NoNewPrivs:\t1" in status
    with contextlib.closing(service.client()) as client:
        ride(client)
        begun_s = time.monotonic()
        service.systemctl("stop")
        print(f"stop: {time.monotonic() - begun_s:.1f} s")
    assert service.shows("Result") == "success"
    run = load_run(service.newest_run())
    states = [e.text for e in run.events if e.name == "rig_state"]
    assert states[-1].endswith("parked")
    assert run.damage is None
    assert read_meta(service.newest_run()).recording.ended is not None
    replayed = subprocess.run(
        [sys.executable, "-m", "hil", "replay", str(service.newest_run()), "--json"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert json.loads(replayed.stdout)["is_same"], replayed.stdout


def host_pid(service):
    """The control process as this namespace numbers it."""
    pid = str(service.pid)
    for status in Path("/proc").glob("[0-9]*/status"):
        with contextlib.suppress(OSError):
            line = next(x for x in status.read_text().splitlines() if x.startswith("NSpid:"))
            if line.split()[2:] == [pid]:
                return int(status.parent.name)
    raise AssertionError(f"no process {pid}")


def test_it_has_its_real_time_rights(riding):
    said = riding.systemd.journal(UNIT)
    assert any("SCHED_FIFO, priority 50" in line for line in said)
    assert any("memory is locked" in line for line in said)
    assert os.sched_getscheduler(host_pid(riding)) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "stopped"])
def test_control_that_is_gone_or_hangs_comes_back_disarmed(riding, number):
    pid, begun_s = riding.pid, time.monotonic()
    ridden = riding.newest_run()
    riding.kill(pid, number)
    wait_for(
        lambda: riding.shows("ActiveState") == "active" and riding.pid not in (0, pid), PATIENCE_S
    )
    print(f"back after {time.monotonic() - begun_s:.1f} s")
    came_back(riding, pid)
    if number is signal.SIGKILL:
        ended = read_meta(ridden).recording.ended
        assert ended is not None, "the gateway closes the recording of the incident"
    else:
        assert any("Watchdog timeout" in line for line in kernel_log())


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "stopped"])
def test_without_its_gateway_control_parks_and_both_come_back(riding, number):
    pid, begun_s = riding.pid, time.monotonic()
    riding.kill(riding.gateway(), number)
    wait_for(
        lambda: riding.shows("ActiveState") == "active" and riding.pid not in (0, pid), PATIENCE_S
    )
    print(f"back after {time.monotonic() - begun_s:.1f} s")
    came_back(riding, pid)


def test_a_daemon_that_cannot_stay_up_is_left_down(service):
    RIG.write_text(service.rig_text.replace(URL, "socketcan:vcan7"))
    assert "failed" in service.systemctl("start", check=False)
    wait_for(lambda: service.shows("ActiveState") == "failed", 5 * PATIENCE_S)
    assert int(service.shows("NRestarts")) <= 5
    assert any("there is no interface vcan7" in line for line in service.systemd.journal(UNIT))


def test_a_wrong_rig_file_is_one_sentence_and_no_second_attempt(service):
    RIG.write_text(service.rig_text.replace("m = 95.0", "m = -95.0"))
    before = len(service.systemd.journal(UNIT))
    service.systemctl("start", check=False)
    wait_for(lambda: service.shows("ActiveState") == "failed", PATIENCE_S)
    assert service.shows("ExecMainStatus") == "78"
    assert service.shows("NRestarts") == "0"
    said = [line for line in service.systemd.journal(UNIT)[before:] if "rig.toml" in line]
    assert len(said) == 1
    assert "mass.m" in said[0]
