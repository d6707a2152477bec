"""A run folder and its `run.toml`: what was run, on which rig file, with which software.

runs/20260131T120000Z_motorcycle/
    run.toml            format "hil-run/1": rig, mode, started, note, role, payload, [recording]
    rig.toml            the rig file as it was
    drives/             the drive files that it names, as they were
    recording.mcap      or else signals.parquet or signals.csv (both: saying the same)
    journal.mcap        all that the control process was told and sent, to the bit, for `hil replay`
    can.log             raw bus log (candump; can.blf where the rig file asks for BLF)
    events.jsonl        one event a line
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import itertools
import platform
import re
import shutil
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import IO, Annotated, Any, Final, Literal

import tomlkit
from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError

from hil import __version__
from hil.config import AnyRig, BicycleFile, RigFile
from hil.config.base import NonNegative
from hil.configfile import parse_any_rig, read_toml
from hil.drivefiles import load_profile, profile_folder
from hil.drives.profiles import DriveProfile
from hil.errors import ConfigError, RunError
from hil.files import write_whole

FORMAT: Final = "hil-run/1"
RUN_TOML: Final = "run.toml"
RIG_TOML: Final = "rig.toml"
DRIVES: Final = "drives"
RECORDING: Final = "recording.mcap"
EVENTS: Final = "events.jsonl"
JOURNAL: Final = "journal.mcap"
EXTRA: Final = "extra.parquet"
"""What was imported beside the signals of runs."""
EXPERIMENT_TOML: Final = "experiment.toml"
EXPERIMENT_CSV: Final = "experiment.csv"
CUSTOM_CSV: Final = "custom.csv"
"""What was played: its description, its motion, and the file that a custom motion came from."""

STOPPED: Final = "recording stopped: "
"""How the reason begins with which a recorder ended before it was told to."""

Mode = Literal["position", "force", "ride"]


def _utc(instant: datetime) -> datetime:
    try:
        return instant.replace(tzinfo=instant.tzinfo or UTC).astimezone(UTC)
    except OverflowError as error:  # the first or last day that there is, in another zone
        raise ValueError(f"{instant} is no instant in UTC") from error


Instant = Annotated[datetime, AfterValidator(_utc)]
"""In UTC; so is one that names no zone, wherever it is read."""

_PACKAGES: Final = (
    "numpy",
    "scipy",
    "numba",
    "pydantic",
    "msgspec",
    "python-can",
    "ruckig",
    "eclipse-zenoh",
    "mcap",
)


class Payload(BaseModel):
    """What the operator says was added to the rig: kg at x, y, z (m) in the platform frame."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    mass: NonNegative
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


class Provenance(BaseModel):
    """How a recording of ours came about; `start_s` is the rig's clock at `t` = 0 of the table."""

    model_config = ConfigDict(extra="allow", frozen=True, allow_inf_nan=False)

    start_s: float = 0.0
    rig_sha256: str = ""
    hil: str = ""
    python: str = ""
    host: str = ""
    system: str = ""
    command_line: tuple[str, ...] = ()
    ended: Instant | None = None
    """Missing where the recorder was killed."""
    end_reason: str = ""
    versions: dict[str, str] = {}


class RunMeta(BaseModel):
    """`run.toml`. Keys that hil does not know are kept: a run may come from anybody."""

    model_config = ConfigDict(extra="allow", frozen=True)

    format: Literal["hil-run/1"] = FORMAT
    rig: str
    mode: Mode = "position"
    started: Instant | None = None
    note: str = ""
    role: Literal["diagnose", "reference"] = "diagnose"
    answer_sha256: str | None = None
    payload: Payload | None = None
    recording: Provenance | None = None


def run_mode(rig: AnyRig) -> Mode:
    """What the drives are given in the rig's control mode; a bicycle is ridden."""
    if isinstance(rig, BicycleFile):
        return "ride"
    return "position" if rig.control.mode == "drive" else "force"


def provenance(rig_toml: str, start_s: float, command_line: Sequence[str]) -> Provenance:
    """Where and with what this process runs."""
    return Provenance(
        start_s=start_s,
        rig_sha256=sha256(rig_toml.encode()),
        hil=__version__,
        python=platform.python_version(),
        host=platform.node(),
        system=platform.platform(),
        command_line=tuple(command_line),
        versions={name: _version(name) for name in _PACKAGES},
    )


def sha256(data: bytes) -> str:
    """Hexadecimal SHA-256."""
    return hashlib.sha256(data).hexdigest()


def new_folder(parent: Path, rig: str, started: datetime) -> Path:
    """Make `parent/<UTC stamp>_<rig>`; a second run within the second gets `_2` and so on.

    Simulated runs all start in the same second. RunError where the folder cannot be made.
    """
    stem = f"{started.astimezone(UTC):%Y%m%dT%H%M%SZ}_{rig}"
    path = parent / stem
    try:
        parent.mkdir(parents=True, exist_ok=True)
        for n in itertools.count(2):
            with contextlib.suppress(FileExistsError):
                path.mkdir()
                break
            path = parent / f"{stem}_{n}"
    except (FileExistsError, NotADirectoryError) as error:
        raise RunError(
            f"{path}: cannot be made: {parent} is no folder, but a file or in one"
        ) from error
    except OSError as error:
        raise RunError(f"{path}: cannot be made: {error.strerror}") from error
    return path


def counted(path: Path) -> tuple[tuple[int, str], ...]:
    """What to sort folders of one second by: their name, its numbers by size: `_2` stands before `_10`."""
    parts = re.findall(r"\d+|\D+", path.name)
    return tuple((int(part), "") if part.isdecimal() else (-1, part) for part in parts)


def nearest(folder: Path) -> Path:
    """`folder`, or of those above it the nearest that there is."""
    folder = folder.absolute()
    return next(path for path in (folder, *folder.parents) if path.exists())


def write_meta(folder: Path, meta: RunMeta) -> None:
    """Write `run.toml` at once: readers see the old file or the new one, never half of it."""
    write_whole(folder / RUN_TOML, meta_toml(meta))


def meta_toml(meta: RunMeta) -> str:
    """`meta` as TOML text."""
    return tomlkit.dumps(meta.model_dump(exclude_none=True))


def read_meta(folder: Path) -> RunMeta:
    """Read `folder/run.toml`; RunError names file, key and what is wrong."""
    path = folder / RUN_TOML
    if not path.is_file():
        raise RunError(f"{folder}: is no run folder, it has no {RUN_TOML}")
    try:
        return parse_meta(read_toml(path), str(path))
    except ConfigError as error:
        raise RunError(str(error)) from error


def parse_meta(tables: dict[str, Any], source: str) -> RunMeta:
    """`tables` as RunMeta; RunError names `source`, key and what is wrong."""
    if tables.get("format") != FORMAT:
        raise RunError(f"{source}: format is {tables.get('format')!r}, hil reads {FORMAT!r}")
    try:
        return RunMeta.model_validate(tables)
    except ValidationError as error:
        lines = [
            f"{source}: {'.'.join(map(str, fault['loc']))}: {fault['msg'].lower()}"
            for fault in error.errors()
        ]
        raise RunError("\n".join(lines)) from error


def require_rig(rig: AnyRig, meta: RunMeta, source: Path) -> None:
    """RunError where the run `source` is one of another rig than `rig`."""
    if rig.name != meta.rig:
        raise RunError(f"{source}: is a run of the rig {meta.rig!r}, not of {rig.name!r}")


def read_rig(folder: Path, meta: RunMeta) -> RigFile | None:
    """The file of the rig that was driven, kept with the run; None where there is none. As `read_any_rig`."""
    rig = read_any_rig(folder, meta)
    return rig if isinstance(rig, RigFile) else None


def read_any_rig(folder: Path, meta: RunMeta) -> AnyRig | None:
    """The rig file kept with the run, or None where there is none.

    RunError where it is not the one that ran: another name than `run.toml` says, or changed since.
    """
    path = folder / RIG_TOML
    if not path.is_file():
        return None
    text = path.read_bytes()
    kept = meta.recording.rig_sha256 if meta.recording else ""
    if kept and kept != sha256(text):
        raise RunError(f"{path}: was changed after the run ({RUN_TOML} keeps its SHA-256)")
    try:
        rig = parse_any_rig(read_toml(path), str(path))
    except ConfigError as error:
        raise RunError(str(error)) from error
    if rig.name != meta.rig:
        raise RunError(f"{path}: is the rig {rig.name!r}, but {RUN_TOML} says {meta.rig!r}")
    return rig


def keep_drives(folder: Path, rig: RigFile) -> None:
    """Copy the drive files that `rig` names into the run folder: drive.toml, and what stands beside it."""
    for name in {a.drive.profile for a in rig.actuators}:
        shutil.copytree(profile_folder(name), folder / DRIVES / Path(name).name, dirs_exist_ok=True)


def read_profiles(folder: Path, rig: RigFile) -> dict[str, DriveProfile]:
    """The drive files that `rig` names, as the run kept them; those of today where it kept none."""
    kept = {a.drive.profile: folder / DRIVES / Path(a.drive.profile).name for a in rig.actuators}
    return {n: load_profile(str(path) if path.is_dir() else n) for n, path in kept.items()}


def lock(stream: IO[bytes]) -> None:
    """Mark the recording in `stream` as being written, until it is closed."""
    fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)


def is_being_recorded(path: Path) -> bool:
    """Whether a living process writes the recording at `path`."""
    with path.open("rb") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
