"""Installs the daemon as a service: units, user, folders, rig file. `systemd/` holds what is installed.

Nothing is started: a person does that, beside the rig.
"""

from __future__ import annotations

import contextlib
import math
import shutil
import subprocess
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from hil.config import RigFile, bus_of
from hil.configfile import data_folder, find_rig_file, load_rig
from hil.daemon.leaving import daemon_s
from hil.errors import ConfigError, HilError

RIG: Final = Path("etc/hil/rig.toml")
QUEUE_FRAMES: Final = 128
"""Transmit queue of a CAN interface: some cycles of a six-axis rig; the kernel's own 10 are less than one."""
STOP_S: Final = 45
"""TimeoutStopSec of the unit as it ships; of a rig that may take longer to park and leave, more."""
_UNITS: Final = Path("etc/systemd/system")
_WANTS_CAN: Final = _UNITS / "hild.service.d/can.conf"
_TEMPLATE_BIN: Final = "/opt/hil/bin/hil"
_HIDDEN: Final = ("/home", "/root", "/run/user")
"""Where ProtectHome=yes lets the service see nothing."""


@dataclass(frozen=True, slots=True)
class Placed:
    """A file that the installation puts below the root folder, `path` relative to it."""

    path: Path
    text: str

    def state(self, root: Path) -> Literal["missing", "differs", "installed"]:
        """Whether it is there, and as it should be."""
        target = root / self.path
        if not target.is_file():
            return "missing"
        return "installed" if target.read_text(encoding="utf-8") == self.text else "differs"


def unit_files(rig: RigFile | None, executable: Path) -> list[Placed]:
    """The files of the service; with a rig on a real CAN interface, those that bring that up too."""
    folder = data_folder("systemd")
    unit = (folder / "hild.service").read_text(encoding="utf-8")
    placed = [
        Placed(_UNITS / "hild.service", _unit(unit, rig, executable)),
        _copied(folder / "hil-can@.service", _UNITS / "hil-can@.service"),
        _copied(folder / "hil.sysusers", Path("etc/sysusers.d/hil.conf")),
        _copied(folder / "hil.tmpfiles", Path("etc/tmpfiles.d/hil.conf")),
    ]
    interfaces = {} if rig is None else real_interfaces(rig)
    for interface, bitrate_bps in interfaces.items():
        settings = f"BITRATE={bitrate_bps}\nTXQUEUELEN={QUEUE_FRAMES}\n"
        placed.append(Placed(Path(f"etc/hil/{interface}.env"), settings))
    if interfaces:
        units = " ".join(_can_units(interfaces))
        placed.append(Placed(_WANTS_CAN, f"[Unit]\nWants={units}\nAfter={units}\n"))
    return placed


def real_interfaces(rig: RigFile) -> dict[str, int]:
    """Bit rate, bit/s, of each SocketCAN interface that has to be brought up: no virtual ones, no hubs."""
    buses = zip(map(bus_of, rig.can.urls), rig.can.bitrates, strict=True)
    return {
        interface: bitrate_bps
        for (scheme, interface), bitrate_bps in buses
        if scheme == "socketcan" and not interface.startswith(("vcan", "vxcan"))
    }


def install(
    root: Path, rig: str | None, *, executable: Path | None = None, dry_run: bool = False
) -> list[str]:
    """Install below `root`; says what was done, and what is left to do, a line each.

    A dry run changes nothing and says the same. Without `rig` the rig file that is there stays.
    HilError where there is none, where the service could not reach this Python, or where rights
    are missing; ConfigError where the rig file is wrong, or names a drive file that the service does not see.
    """
    executable = executable or own_executable()
    _require_reachable(executable)
    rig_file = Path(root / RIG) if rig is None else find_rig_file(rig)
    if not rig_file.is_file():
        raise HilError(f"{rig_file}: there is no rig file yet; name one with --rig")
    settings = load_rig(rig_file)
    _require_drive_files(settings, str(rig_file))
    placed = unit_files(settings, executable)
    said = []
    try:
        if rig is not None:
            said += _place_rig(root, rig_file.read_text(encoding="utf-8"), dry_run)
        said += [_place(root, item, dry_run) for item in placed]
        if not real_interfaces(settings) and (root / _WANTS_CAN).is_file():
            if not dry_run:
                (root / _WANTS_CAN).unlink()
            urls = ", ".join(settings.can.urls)
            said.append(f"removed  /{_WANTS_CAN}: {urls} needs no bringing up")
    except OSError as error:
        raise HilError(_no_rights(error)) from error
    for command in install_commands(settings):
        is_now = root == Path("/") and not dry_run
        said.append(_run(command) if is_now else f"to do    {' '.join(command)}")
    said.append(
        "ready    start it beside the rig: systemctl start hild, then systemctl status hild"
    )
    return said


def uninstall(root: Path) -> list[str]:
    """Remove the service; rig file, recordings and user stay. HilError where rights are missing."""
    said = []
    commands: list[list[str]] = [["systemctl", "disable", "--now", "hild.service"]]
    commands += [["systemctl", "disable", "--now", unit] for unit in _can_units(_cans(root))]
    if root == Path("/"):
        said += [_run(command) for command in commands]
    try:
        for item in _installed(root):
            (root / item).unlink()
            said.append(f"removed  /{item}")
        with contextlib.suppress(OSError):  # the owner's own drop-ins stay
            (root / _WANTS_CAN).parent.rmdir()
    except OSError as error:
        raise HilError(_no_rights(error)) from error
    if root == Path("/"):
        said.append(_run(["systemctl", "daemon-reload"]))
    said.append("kept     /etc/hil, /var/lib/hil with all recordings, and the user hil")
    return said


def status(root: Path, executable: Path | None = None) -> list[str]:
    """What is installed below `root`, whether it is what this hil would install, and how it runs."""
    rig_file = root / RIG
    settings = load_rig(rig_file) if rig_file.is_file() else None
    placed = unit_files(settings, executable or own_executable())
    said = [f"{item.state(root):<9} /{item.path}" for item in placed]
    said.append(f"{'installed' if settings else 'missing':<9} /{RIG}")
    if root == Path("/"):
        for unit in ("hild.service", *_can_units(_cans(root))):
            said.append(f"{_asked('is-active', unit):<9} {unit}, {_asked('is-enabled', unit)}")
    return said


def install_commands(rig: RigFile) -> list[list[str]]:
    """What makes the installed files known to the system, in order."""
    units = ["hild.service", *_can_units(real_interfaces(rig))]
    return [
        ["systemd-sysusers", "/etc/sysusers.d/hil.conf"],
        ["systemd-tmpfiles", "--create", "/etc/tmpfiles.d/hil.conf"],
        ["systemctl", "daemon-reload"],
        ["systemctl", "enable", *units],
    ]


def own_executable() -> Path:
    """The `hil` of the Python that runs this."""
    return Path(sys.executable).parent / "hil"


def _require_reachable(executable: Path) -> None:
    # The interpreter itself counts too: a Python of pyenv or uv lies in somebody's home.
    for path in (executable, executable.parent / "python", Path(__file__)):
        if _is_hidden(path):
            raise HilError(
                f"{path.resolve()}: a service sees nothing below {', '.join(_HIDDEN)}; install hil elsewhere "
                "with the system's Python, as `make install PYTHON=/usr/bin/python3.11` does (into "
                "/opt/hil), and call that one's `hil service install`"
            )


def _require_drive_files(rig: RigFile, source: str) -> None:
    """ConfigError names each drive file of the owner's that the service would not find."""
    faults = [
        f"{source}: actuators[{k}] ({a.name}).drive.profile: {a.drive.profile}: the service looks for it "
        f"from its own folder and sees nothing below {', '.join(_HIDDEN)}; put the folder elsewhere, "
        "as below /etc/hil, and give its whole path"
        for k, a in enumerate(rig.actuators)
        if not _is_seen(a.drive.profile)
    ]
    if faults:
        raise ConfigError("\n".join(faults))


def _is_seen(profile: str) -> bool:
    """Whether the service sees the family `profile`: one that comes with hil, or a whole path."""
    if Path(profile).is_absolute():
        return not _is_hidden(Path(profile))
    return (data_folder("drives") / profile).is_dir()


def _is_hidden(path: Path) -> bool:
    return str(path.resolve()).startswith(tuple(f"{hidden}/" for hidden in _HIDDEN))


def _unit(text: str, rig: RigFile | None, executable: Path) -> str:
    """The daemon's unit: with the place of `hil`, and nobody killed while the rig parks."""
    stop_s = STOP_S if rig is None else max(STOP_S, math.ceil(daemon_s(rig)))
    stop = "TimeoutStopSec={}"
    return text.replace(_TEMPLATE_BIN, str(executable)).replace(
        stop.format(STOP_S), stop.format(stop_s)
    )


def _copied(source: Path, target: Path) -> Placed:
    return Placed(target, source.read_text(encoding="utf-8"))


def _place(root: Path, item: Placed, dry_run: bool) -> str:
    state = item.state(root)
    if state == "installed":
        return f"same     /{item.path}"
    if not dry_run:
        target = root / item.path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(item.text, encoding="utf-8")
    return f"{'wrote' if state == 'missing' else 'replaced':<8} /{item.path}"


def _place_rig(root: Path, text: str, dry_run: bool) -> list[str]:
    """The rig file is the owner's: what was there is kept beside the new one."""
    item = Placed(RIG, text)
    said = []
    if item.state(root) == "differs":
        old = RIG.with_name("rig.toml.old")
        if not dry_run:
            shutil.copy2(root / RIG, root / old)
        said.append(f"kept     /{old}")
    return [*said, _place(root, item, dry_run)]


def _installed(root: Path) -> list[Path]:
    files = [item.path for item in unit_files(None, own_executable())]
    files += [_WANTS_CAN, *(Path(f"etc/hil/{name}.env") for name in _cans(root))]
    return [path for path in files if (root / path).is_file()]


def _can_units(interfaces: Iterable[str]) -> list[str]:
    return [f"hil-can@{interface}.service" for interface in interfaces]


def _cans(root: Path) -> list[str]:
    return sorted(path.stem for path in (root / RIG.parent).glob("*.env"))


def _run(command: Sequence[str]) -> str:
    shown = " ".join(command)
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return f"skipped  {shown}: this system has no {command[0]}"
    if done.returncode:
        why = (done.stderr or done.stdout).strip().splitlines()
        return f"failed   {shown}: {why[-1] if why else done.returncode}"
    return f"done     {shown}"


def _asked(question: str, unit: str) -> str:
    try:
        done = subprocess.run(
            ["systemctl", question, unit], capture_output=True, text=True, check=False
        )
    except FileNotFoundError:
        return "no systemd"
    return (done.stdout or done.stderr).strip().splitlines()[-1] if done.stdout else "unknown"


def _no_rights(error: OSError) -> str:
    again = f"sudo {own_executable()} service ..."
    return f"{error.filename}: {error.strerror}; this needs root: {again}"
