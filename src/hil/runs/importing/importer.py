"""Makes a run folder of a foreign log: read, convert, check, write."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from hil import __version__
from hil.config import RigFile
from hil.configfile import find_rig_file, load_any_rig
from hil.errors import ConfigError, RunError
from hil.files import is_taken, whole_folder
from hil.runs.folder import EXTRA, RIG_TOML, RunMeta, write_meta
from hil.runs.importing.checks import check_signal, check_sizes
from hil.runs.importing.clocks import check_clock, check_clocks
from hil.runs.importing.convert import Converter, Signal, check_map, wanted_columns
from hil.runs.importing.findings import Finding, Verdict
from hil.runs.importing.mapfile import ImportMap, load_map
from hil.runs.importing.matfile import MatSource
from hil.runs.importing.messages import CanMessages, McapMessages
from hil.runs.importing.relations import check_axis
from hil.runs.importing.source import Array, Source
from hil.runs.importing.tables import read_csv, read_parquet
from hil.runs.table import check_table, signal_order

MAP_TOML: Final = "map.toml"
_EPOCH_S: Final = (9.0e8, 4.2e9)
"""First stamps between these (1998 and 2103) are seconds since 1970 and tell when the log began."""
_CAN_LOGS: Final = (".log", ".blf", ".asc")


@dataclass(frozen=True, slots=True)
class SignalReport:
    """What came of one column."""

    name: str
    column: str
    unit: str
    clock: str
    samples: int
    rate_hz: float
    lowest: float
    highest: float


@dataclass(frozen=True, slots=True)
class ImportReport:
    """What an import did and what its checks found."""

    folder: str
    file: str
    rig: str
    rows: int
    duration_s: float
    signals: tuple[SignalReport, ...]
    findings: tuple[Finding, ...]


def import_run(
    path: Path, map_path: Path, folder: Path, rig_name: str | None = None
) -> ImportReport:
    """Make the run folder `folder` of the log at `path`, as the map at `map_path` says.

    `rig_name`: the rig file to hold it against; default the shipped one of the map's name, where there is
    one. RunError (file, column, row) where the log is not what the map says or a check fails that the map
    does not allow; nothing is written then. ConfigError for the map or the rig file.
    """
    mapped = load_map(map_path)
    if is_taken(folder):
        raise RunError(f"{folder}: exists already; an import never overwrites")
    if not path.is_file():
        raise RunError(f"{path}: no such file")
    rig, rig_path, findings = _rig_of(mapped, rig_name)
    check_map(mapped, rig, map_path)
    source = open_log(path, mapped, map_path.parent)
    converter = Converter(source, mapped.time)
    signals = {name: converter.signal(name, how) for name, how in mapped.signals.items()}
    extra = {name: converter.signal(name, how) for name, how in mapped.extra.items()}
    findings += [Finding("log", path.name, "note", text) for text in source.notes()]
    for line in converter.lines:
        findings += check_clock(line)
    findings += check_clocks(converter.lines)
    for signal in (*signals.values(), *extra.values()):
        findings += check_signal(signal, str(path))
    findings += check_sizes(signals, rig, str(path))
    for actuator in dict.fromkeys(name.partition(".")[0] for name in signals if "." in name):
        findings += check_axis(actuator, signals, str(path))
    findings = _judged(findings, mapped)
    zero_s = min(line.origin_s for line in converter.lines)
    order = [s for s in (signal_order(rig) if rig else ()) if s in signals]
    table = _table([signals[s] for s in (order or signals)], zero_s)
    table = check_table(table, f"{path} by {map_path.name}", rig)
    meta = _meta(path, map_path, mapped, zero_s, findings)
    _write(folder, table, _table(list(extra.values()), zero_s) if extra else None, meta,
           map_path, rig_path)  # fmt: skip
    reports = tuple(_report(signal) for signal in (*signals.values(), *extra.values()))
    duration = float(table["t"].iloc[-1] - table["t"].iloc[0])
    return ImportReport(
        str(folder), str(path), mapped.rig, len(table), duration, reports, tuple(findings)
    )


def open_log(path: Path, mapped: ImportMap, beside: Path) -> Source:
    """Read what the map needs of a log whose name tells its format; a DBC is looked for `beside` the map."""
    columns, clocks = wanted_columns(mapped)
    kind = path.suffix.lower()
    if mapped.file.dbc is not None or kind in (".blf", ".asc"):
        if mapped.file.dbc is None:
            raise RunError(f"{path}: a CAN log needs a DBC to be read: give the map [file] dbc")
        if kind not in _CAN_LOGS:
            raise RunError(f"{path}: hil reads CAN logs named {', '.join(_CAN_LOGS)}")
        return CanMessages(path, columns, clocks, beside / mapped.file.dbc)
    if kind == ".mcap":
        return McapMessages(path, columns, clocks)
    if kind == ".mat":
        return MatSource(path)
    if kind == ".parquet":
        return read_parquet(path, columns | clocks)
    return read_csv(path, columns | clocks, mapped.file)


def _rig_of(
    mapped: ImportMap, rig_name: str | None
) -> tuple[RigFile | None, Path | None, list[Finding]]:
    try:
        path = find_rig_file(rig_name or mapped.rig)
    except ConfigError:
        if rig_name is not None:
            raise
        text = (
            f"no rig file of the name {mapped.rig!r} comes with hil and none is given: units, stroke and "
            "signal names are not held against one"
        )
        verdict: Verdict = "note" if mapped.mode == "ride" else "warning"
        return None, None, [Finding("rig_file", mapped.rig, verdict, text)]
    rig = load_any_rig(path)
    if rig.name != mapped.rig:
        raise RunError(f"{path}: is the rig {rig.name!r}, the map is for {mapped.rig!r}")
    return (rig if isinstance(rig, RigFile) else None), path, []


def _judged(findings: Sequence[Finding], mapped: ImportMap) -> list[Finding]:
    """`findings` with what the map allows as warnings; RunError with all other faults."""
    allowed = set(mapped.allow)
    judged = [
        replace(f, verdict="warning") if f.verdict == "fault" and f.check in allowed else f
        for f in findings
    ]
    faults = [f"{f.text} [{f.check}]" for f in judged if f.verdict == "fault"]
    if faults:
        raise RunError("\n".join(faults))
    return judged


def _table(signals: Sequence[Signal], zero_s: float) -> pd.DataFrame:
    """Samples of one instant share a row; of equal stamps of one clock the last stays."""
    stamps: dict[int, Array] = {}
    for s in signals:
        stamps.setdefault(id(s.line), s.line.t_s + (s.line.origin_s - zero_s))
    grid = np.unique(np.concatenate(list(stamps.values())))
    places = {key: np.searchsorted(grid, t) for key, t in stamps.items()}
    columns: dict[str, Array] = {"t": grid}
    for s in signals:
        there = ~np.isnan(s.values)
        column = np.full(len(grid), np.nan)
        column[places[id(s.line)][there]] = s.values[there]
        columns[s.name] = column
    table = pd.DataFrame(columns)
    return table.dropna(how="all", subset=[s.name for s in signals]).reset_index(drop=True)


def _meta(
    path: Path, map_path: Path, mapped: ImportMap, zero_s: float, findings: Sequence[Finding]
) -> RunMeta:
    started = mapped.started
    if started is None and _EPOCH_S[0] < zero_s < _EPOCH_S[1]:
        started = datetime.fromtimestamp(zero_s, UTC)
    with path.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    return RunMeta.model_validate(
        {
            "rig": mapped.rig,
            "mode": mapped.mode,
            "started": started,
            "note": mapped.note,
            "role": mapped.role,
            "payload": mapped.payload,
            "imported": {
                "file": path.name,
                "sha256": digest,
                "map": map_path.name,
                "hil": __version__,
                "warnings": [f.text for f in findings if f.verdict == "warning"],
            },
        }
    )


def _write(
    folder: Path,
    table: pd.DataFrame,
    extra: pd.DataFrame | None,
    meta: RunMeta,
    map_path: Path,
    rig_path: Path | None,
) -> None:
    try:
        with whole_folder(folder) as fresh:
            table.to_parquet(fresh / "signals.parquet", index=False, compression="zstd")
            if extra is not None:
                extra.to_parquet(fresh / EXTRA, index=False, compression="zstd")
            shutil.copyfile(map_path, fresh / MAP_TOML)
            if rig_path is not None:
                shutil.copyfile(rig_path, fresh / RIG_TOML)
            write_meta(fresh, meta)
    except OSError as error:
        raise RunError(f"{folder}: cannot be written: {error.strerror or error}") from error


def _report(signal: Signal) -> SignalReport:
    t, values = signal.samples()
    rate = (len(t) - 1) / float(t[-1] - t[0]) if len(t) > 1 and t[-1] > t[0] else 0.0
    return SignalReport(
        signal.name, signal.column, signal.unit, signal.line.label, len(t), rate,
        float(values.min()), float(values.max()),
    )  # fmt: skip
