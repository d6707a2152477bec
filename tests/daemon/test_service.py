"""The service that a rig PC gets: what is put where, and that systemd finds nothing wrong with it."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from hil.cli.app import INTERRUPTED
from hil.configfile import data_folder, find_rig_file, load_rig
from hil.daemon import service
from hil.daemon.leaving import control_s, daemon_s
from hil.daemon.realtime import PRIORITY
from hil.errors import ConfigError, HilError
from hil.safety import state_settings

HIL = Path("/opt/hil/bin/hil")
needs_analyze = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="this system has no systemd-analyze"
)


@pytest.fixture
def rig_on_can(tmp_path):
    path = tmp_path / "rig.toml"
    text = find_rig_file("motorcycle").read_text()
    path.write_text(re.sub(r"(?m)^url = .*$", 'url = "socketcan:can1"', text))
    assert load_rig(path).can.url == "socketcan:can1"
    return path


@pytest.fixture
def root(tmp_path):
    return tmp_path / "root"


def install(root, rig):
    return service.install(root, str(rig), executable=HIL)


def test_an_installation_puts_units_user_folders_and_rig_file(root, rig_on_can):
    install(root, rig_on_can)
    placed = {str(p.relative_to(root)) for p in root.rglob("*") if p.is_file()}
    assert placed == {
        "etc/hil/can1.env",
        "etc/hil/rig.toml",
        "etc/systemd/system/hil-can@.service",
        "etc/systemd/system/hild.service",
        "etc/systemd/system/hild.service.d/can.conf",
        "etc/sysusers.d/hil.conf",
        "etc/tmpfiles.d/hil.conf",
    }
    assert "BITRATE=500000" in (root / "etc/hil/can1.env").read_text()
    assert (root / "etc/hil/rig.toml").read_text() == rig_on_can.read_text()


def test_the_unit_starts_the_hil_that_installed_it(root, rig_on_can):
    service.install(root, str(rig_on_can), executable=Path("/srv/rig/bin/hil"))
    unit = (root / "etc/systemd/system/hild.service").read_text()
    assert "ExecStart=/srv/rig/bin/hil run /etc/hil/rig.toml" in unit
    assert "/opt/hil" not in unit


def test_a_rig_on_a_virtual_bus_brings_no_interface_up(root, rig_on_can):
    install(root, rig_on_can)
    text = rig_on_can.read_text().replace("can1", "vcan0")
    rig_on_can.write_text(text)
    install(root, rig_on_can)
    assert not (root / "etc/systemd/system/hild.service.d/can.conf").exists()
    assert not (root / "etc/hil/vcan0.env").exists()


def test_every_bus_of_a_rig_is_brought_up(root, rig_on_can):
    text = rig_on_can.read_text()
    further = '[[can.further]]\nurl = "socketcan:{}"\nbitrate = {}\n'
    more = further.format("can2", 1_000_000) + further.format("vcan0", 250_000)
    rig_on_can.write_text(f"{text}\n{more}")
    said = install(root, rig_on_can)
    assert "BITRATE=500000" in (root / "etc/hil/can1.env").read_text()
    assert "BITRATE=1000000" in (root / "etc/hil/can2.env").read_text()
    assert not (root / "etc/hil/vcan0.env").exists()
    wants = (root / "etc/systemd/system/hild.service.d/can.conf").read_text()
    both = "hil-can@can1.service hil-can@can2.service"
    assert wants == f"[Unit]\nWants={both}\nAfter={both}\n"
    assert f"to do    systemctl enable hild.service {both}" in said


def test_installing_twice_changes_nothing(root, rig_on_can):
    install(root, rig_on_can)
    again = install(root, rig_on_can)
    assert not [line for line in again if line.startswith(("wrote", "replaced", "kept"))]


def test_the_rig_file_that_was_there_is_kept_beside_the_new_one(root, rig_on_can):
    install(root, "axis")
    install(root, rig_on_can)
    assert (root / "etc/hil/rig.toml.old").read_text() == find_rig_file("axis").read_text()


def test_a_dry_run_says_the_same_and_does_nothing(root, rig_on_can):
    said = service.install(root, str(rig_on_can), executable=HIL, dry_run=True)
    assert not root.exists()
    assert install(root, rig_on_can) == said


def test_without_a_rig_file_it_says_so(root):
    with pytest.raises(HilError, match="--rig"):
        service.install(root, None, executable=HIL)


def test_a_wrong_rig_file_is_not_installed(root, tmp_path):
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(find_rig_file("axis").read_text().replace("m = 95.0", "m = -95.0"))
    with pytest.raises(ConfigError, match=r"mass\.m"):
        install(root, wrong)
    assert not root.exists()


@pytest.mark.parametrize("profile", ["mine", "./drives/mine", "/home/rider/drives/mine"])
def test_a_drive_file_that_the_service_cannot_see_is_refused(
    root, rig_on_can, monkeypatch, profile
):
    (rig_on_can.parent / "mine").mkdir()
    monkeypatch.chdir(rig_on_can.parent)
    text = rig_on_can.read_text()
    rig_on_can.write_text(text.replace('"lust_cdd3000"', f'"{profile}"', 1))
    with pytest.raises(ConfigError, match=r"actuators\[0\] \(.*\)\.drive\.profile: .*whole path"):
        install(root, rig_on_can)
    assert not root.exists()
    rig_on_can.write_text(text.replace('"lust_cdd3000"', '"/etc/hil/drives/mine"', 1))
    install(root, rig_on_can)


def test_a_hil_that_the_service_cannot_see_is_refused(root, rig_on_can):
    with pytest.raises(HilError, match="make install"):
        service.install(root, str(rig_on_can), executable=Path("/home/rider/venv/bin/hil"))


def test_a_python_in_somebodys_home_is_refused(root, rig_on_can, tmp_path):
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin/python").symlink_to("/home/rider/.pyenv/versions/3.11.7/bin/python3.11")
    with pytest.raises(HilError, match=r"/home/rider/\.pyenv"):
        service.install(root, str(rig_on_can), executable=tmp_path / "bin/hil")


def test_status_tells_what_was_changed(root, rig_on_can):
    install(root, rig_on_can)
    unit = root / "etc/systemd/system/hild.service"
    unit.write_text(unit.read_text() + "# mine\n")
    said = service.status(root, HIL)
    assert "differs   /etc/systemd/system/hild.service" in said
    assert "installed /etc/hil/can1.env" in said


def test_uninstalling_leaves_what_is_the_owners(root, rig_on_can):
    install(root, rig_on_can)
    service.uninstall(root)
    assert not (root / "etc/systemd/system/hild.service.d").exists()
    left = {str(p.relative_to(root)) for p in root.rglob("*") if p.is_file()}
    assert left == {"etc/hil/rig.toml"}


def test_uninstalling_leaves_the_owners_overrides(root, rig_on_can):
    install(root, rig_on_can)
    override = root / "etc/systemd/system/hild.service.d/override.conf"
    override.write_text("[Service]\nWatchdogSec=5\n")
    service.uninstall(root)
    assert override.exists()


@pytest.mark.parametrize("speed_share", [None, 0.05])
@pytest.mark.parametrize("name", ["axis", "emps", "simona", "stewart_canopen"])
def test_nobody_is_killed_while_the_rig_parks(root, tmp_path, name, speed_share):
    path = tmp_path / "rig.toml"
    text = find_rig_file(name).read_text()
    if speed_share is not None:
        text, n = re.subn(r"(?m)^speed_share = .*$", f"speed_share = {speed_share}", text)
        text += "" if n else f"\n[parking]\nspeed_share = {speed_share}\n"
    path.write_text(text)
    rig = load_rig(path)
    install(root, path)
    unit = (root / "etc/systemd/system/hild.service").read_text()
    (stop_s,) = re.findall(r"(?m)^TimeoutStopSec=(.*)$", unit)
    assert float(stop_s) >= max(daemon_s(rig), service.STOP_S)
    assert daemon_s(rig) > control_s(rig) > state_settings(rig).park_time_s
    assert speed_share is None or float(stop_s) > service.STOP_S


def test_a_rig_file_that_parks_more_slowly_now_is_told_by_status(root, rig_on_can):
    install(root, rig_on_can)
    unit = "/etc/systemd/system/hild.service"
    assert f"installed {unit}" in service.status(root, HIL)
    there = root / "etc/hil/rig.toml"
    text, n = re.subn(r"(?m)^speed_share = .*$", "speed_share = 0.05", there.read_text())
    there.write_text(text if n else f"{text}\n[parking]\nspeed_share = 0.05\n")
    assert f"differs   {unit}" in service.status(root, HIL)


def unit_values(key):
    text = (data_folder("systemd") / "hild.service").read_text()
    return re.findall(rf"(?m)^{key}=(.*)$", text)


def test_a_daemon_that_is_stopped_while_it_starts_has_not_failed():
    assert unit_values("SuccessExitStatus") == [str(INTERRUPTED)]


def test_its_limits_fit_what_the_daemon_does():
    assert int(unit_values("LimitRTPRIO")[0]) >= PRIORITY
    assert unit_values("LimitMEMLOCK") == ["infinity"]
    assert unit_values("TimeoutStopSec") == [str(service.STOP_S)]
    assert "NUMBA_CACHE_DIR" not in unit_values("Environment")[0]


@needs_analyze
@pytest.mark.parametrize("unit", ["hild.service", "hil-can@can1.service"])
def test_systemd_finds_nothing_wrong_with_the_units(root, rig_on_can, unit, tmp_path):
    program = tmp_path / "hil"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    service.install(root, str(rig_on_can), executable=program)
    folder = root / "etc/systemd/system"
    if "@" in unit:  # systemd-analyze wants an instance by name
        shutil.copy2(folder / "hil-can@.service", folder / unit)
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", str(folder / unit)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert str(folder) not in done.stderr


@needs_analyze
@pytest.mark.parametrize("unit", ["hild.service", "hil-can@.service"])
def test_what_they_may_do_is_little(unit, tmp_path):
    path = tmp_path / unit.replace("@", "@can1")
    path.write_text((data_folder("systemd") / unit).read_text())
    done = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", "--threshold=20", str(path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-400:] + done.stderr
