"""Reads a run: a recording of ours, a bare MCAP file of ours, or anybody's run folder.

Whatever the source, the result is one `Run` that was checked: increasing time, known signals,
finite numbers, a rig file that fits. What is wrong becomes a RunError that names file, column, row.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, cast, get_args

import msgspec
import pandas as pd

from hil.config import AnyRig, BicycleFile, RigFile
from hil.configfile import parse_any_rig, parse_toml
from hil.errors import ConfigError, RunError
from hil.messages import EventMessage
from hil.runs.content import Content
from hil.runs.csvfile import csv_table
from hil.runs.folder import (
    EVENTS,
    RECORDING,
    RIG_TOML,
    RUN_TOML,
    RunMeta,
    parse_meta,
    read_any_rig,
    read_meta,
    require_rig,
)
from hil.runs.mcapfile import McapSource
from hil.runs.table import check_table, parquet_table, signal_order
from hil.signals import Event, Severity

_READERS: Final[dict[str, Callable[[Path], pd.DataFrame]]] = {
    "signals.parquet": parquet_table,
    "signals.csv": csv_table,
}


@dataclass(frozen=True, slots=True)
class Run:
    """One run, checked."""

    path: Path
    meta: RunMeta
    rig: RigFile | None
    """The rig file kept with the run."""
    table: pd.DataFrame
    """Column `t` (s from the start of recording), one column a signal, NaN where not sampled."""
    states: pd.DataFrame
    """One row a state message: t, state, pose.*, setpoint.*, tracking_error, loop statistics."""
    events: tuple[Event, ...]
    damage: str | None = None
    """What the file lacks, where it was cut or hurt."""
    bicycle: BicycleFile | None = None
    """The bicycle's file kept with the run of one; `rig` is None then."""

    @property
    def duration_s(self) -> float:
        """Time from first to last row."""
        t = self.table["t"]
        return float(t.iloc[-1] - t.iloc[0])


def load_run(path: str | Path, rig: AnyRig | None = None) -> Run:
    """Read the run at `path`: a run folder, or a recording.mcap.

    Of several records in one folder recording.mcap is the run; signals.parquet and signals.csv must say the
    same.
    `rig`: the rig file to hold the run against, instead of the one kept with it. RunError where
    nothing can be read, or it is no run of this rig.
    """
    path = Path(path)
    if path.is_dir():
        return _load_folder(path, rig)
    if not path.exists():
        raise RunError(f"{path}: no such run")
    if path.suffix == ".mcap":
        if (path.parent / RUN_TOML).is_file() and path.name == RECORDING:
            return _load_folder(path.parent, rig)
        return _load_mcap(path, None, rig)
    raise RunError(f"{path}: is neither a run folder nor an .mcap file")


def _load_folder(folder: Path, rig: AnyRig | None) -> Run:
    meta = read_meta(folder)
    fitting = _fitting(rig, meta, folder) or read_any_rig(folder, meta)
    if (folder / RECORDING).is_file():
        return _load_mcap(folder / RECORDING, meta, fitting)
    name, frame = _record(folder)
    table = check_table(frame, str(folder / name), fitting)
    events = _read_events(folder / EVENTS, _start_s(meta))
    return _run(folder, meta, fitting, table, pd.DataFrame({"t": []}), events)


def _record(folder: Path) -> tuple[str, pd.DataFrame]:
    """The table in `folder`, with the name of its file. RunError where there is none, or two that differ."""
    there = {
        name: read(folder / name) for name, read in _READERS.items() if (folder / name).is_file()
    }
    if not there:
        raise RunError(f"{folder}: holds none of {', '.join((RECORDING, *_READERS))}")
    (name, first), *others = there.items()
    for other, table in others:
        if not _is_same(first, table):
            raise RunError(
                f"{folder}: {name} and {other} do not say the same: keep the one that is the run, and move "
                "the other out of the folder"
            )
    return name, first


def _is_same(a: pd.DataFrame, b: pd.DataFrame) -> bool:
    """Whether two tables hold the same numbers, as far as text keeps them, whatever order columns are in."""
    if set(a.columns) != set(b.columns) or len(a) != len(b):
        return False
    try:
        pd.testing.assert_frame_equal(a, b[a.columns], check_dtype=False, rtol=1e-6, atol=1e-9)
    except AssertionError:
        return False
    return True


def _run(
    path: Path,
    meta: RunMeta,
    rig: AnyRig | None,
    table: pd.DataFrame,
    states: pd.DataFrame,
    events: tuple[Event, ...],
    damage: str | None = None,
) -> Run:
    driven = rig if isinstance(rig, RigFile) else None
    bicycle = rig if isinstance(rig, BicycleFile) else None
    return Run(path, meta, driven, table, states, events, damage, bicycle)


def _fitting(rig: AnyRig | None, meta: RunMeta, source: Path) -> AnyRig | None:
    if rig is not None:
        require_rig(rig, meta, source)
    return rig


def _read_events(path: Path, start_s: float) -> tuple[Event, ...]:
    """The events of a folder; a last line that was cut is left out."""
    if not path.is_file():
        return ()
    events = []
    decoder = msgspec.json.Decoder(EventMessage)
    for number, line in enumerate(path.read_bytes().splitlines(keepends=True), start=1):
        try:
            events.append(_event(decoder.decode(line), start_s))
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            if line.endswith(b"\n"):
                raise RunError(f"{path}: line {number}: is no event: {error}") from error
    return tuple(events)


def _event(message: EventMessage, start_s: float) -> Event:
    severity = message.severity if message.severity in get_args(Severity) else "info"
    return Event(message.t - start_s, cast(Severity, severity), message.name, message.text)


def _load_mcap(path: Path, meta: RunMeta | None, rig: AnyRig | None) -> Run:
    source = McapSource(path)
    content = Content()
    offset_ns: int | None = None
    for message in source:
        if offset_ns is None:  # attachments come before the first message
            meta = meta or _attached_meta(source)
            offset_ns = _offset_ns(meta)
            rig = _fitting(rig, meta, path) or _attached_rig(source, meta)
            if isinstance(rig, RigFile):
                content = Content(rig.cue.future)
        content.take(message.topic, message.data, 1e-9 * (message.log_time_ns - offset_ns))
    content.finish()
    damage = "; ".join(filter(None, (source.damage, content.damage())))
    if meta is None:
        raise RunError(f"{path}: holds no message" + (f" ({damage})" if damage else ""))
    table = content.signals.table(str(path), signal_order(rig) if rig else ())
    if table.empty:
        raise RunError(f"{path}: holds no sample" + (f" ({damage})" if damage else ""))
    start_s = _start_s(meta)
    states = pd.DataFrame(content.states) if content.states else pd.DataFrame({"t": []})
    for frame in (table, states):
        frame["t"] -= start_s
    folder = path.parent if path.name == RECORDING else path
    events: tuple[Event, ...] = ()
    if folder != path:
        try:
            events = _read_events(path.parent / EVENTS, start_s)
        except RunError as error:  # the recording holds them as well
            damage = "; ".join(filter(None, (damage, str(error))))
    events = events or tuple(_event(e, start_s) for e in content.events)
    table = check_table(table, str(path), rig)
    return _run(folder, meta, rig, table, states, events, damage or None)


def _start_s(meta: RunMeta) -> float:
    return meta.recording.start_s if meta.recording else 0.0


def _offset_ns(meta: RunMeta) -> int:
    """Log time at the zero of the rig's clock, ns since 1970: as the recorder reckons it."""
    return 0 if meta.started is None else round((meta.started.timestamp() - _start_s(meta)) * 1e9)


def _attached_meta(source: McapSource) -> RunMeta:
    text = source.attachments.get(RUN_TOML)
    if text is None:
        raise RunError(f"{source.path}: is no recording of hil: it carries no {RUN_TOML}")
    where = f"{source.path}: {RUN_TOML}"
    try:
        return parse_meta(parse_toml(text, where), where)
    except ConfigError as error:
        raise RunError(str(error)) from error


def _attached_rig(source: McapSource, meta: RunMeta) -> AnyRig | None:
    text = source.attachments.get(RIG_TOML)
    if text is None:
        return None
    where = f"{source.path}: {RIG_TOML}"
    try:
        rig = parse_any_rig(parse_toml(text, where), where)
    except ConfigError as error:
        raise RunError(str(error)) from error
    return _fitting(rig, meta, source.path)
