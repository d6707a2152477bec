"""Logs of messages: MCAP with JSON channels, and CAN logs (BLF, ASC, candump) with a DBC."""

from __future__ import annotations

import json
from array import array
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import cantools
import numpy as np

from hil.errors import RunError
from hil.runs.canlog import read_can_log
from hil.runs.importing.source import Column, Stamps, no_such
from hil.runs.importing.units import unit_name
from hil.runs.mcapfile import McapSource


class MessageSource:
    """Values by group (topic or CAN message) and field, each group with its own stamps, ns since 1970."""

    row_word = "message"

    def __init__(self, path: Path, what: str, separator: str) -> None:
        self.path = path
        self._what = what
        self._separator = separator
        self._ns: dict[str, array[int]] = {}
        self._values: dict[str, dict[str, array[float]]] = {}
        self._units: dict[str, str] = {}
        self._notes: list[str] = []
        self._known: list[str] = []

    def column(self, name: str) -> Column:
        """Values of a field, NaN in messages that lack it."""
        group, _, field = name.rpartition(self._separator)
        values = self._values.get(group, {}).get(field)
        if values is None or not len(values) or np.isnan(np.frombuffer(values)).all():
            raise no_such(self.path, self._what, name, self._known)
        numbers = np.frombuffer(values).copy()
        wrong = np.flatnonzero(np.isinf(numbers))
        if wrong.size:
            raise RunError(
                f"{self.path}: {name}, message {int(wrong[0]) + 1}: is not a finite number"
            )
        return Column(numbers, group)

    def stamps(self, name: str | None, group: str, *, dates: bool) -> Stamps:
        """The field `name` of the group's own messages, or the stamps of the log."""
        if name is None:
            return np.frombuffer(self._ns[group], dtype=np.int64).copy()
        if dates:
            raise RunError(f'{self.path}: {name}: unit "datetime" is for text and parquet')
        return self.column(f"{group}{self._separator}{name}").values

    def unit_of(self, name: str) -> str | None:
        """The unit that the log's description gives, in hil's spelling."""
        return self._units.get(name)

    def notes(self) -> Iterable[str]:
        """What was passed over."""
        return self._notes

    def _want(self, names: Iterable[str]) -> dict[str, list[str]]:
        """Fields by group; room is made for each."""
        wanted: dict[str, list[str]] = {}
        for name in sorted(names):
            group, _, field = name.rpartition(self._separator)
            wanted.setdefault(group, []).append(field)
            self._ns.setdefault(group, array("q"))
            self._values.setdefault(group, {})[field] = array("d")
        return wanted


class McapMessages(MessageSource):
    """JSON messages of an MCAP file; names are `topic:field`; fields of fields, and elements, with dots."""

    def __init__(self, path: Path, wanted: set[str], time_fields: set[str]) -> None:
        super().__init__(path, "field", ":")
        fields = self._want(
            wanted | {f"{name.rpartition(':')[0]}:{t}" for name in wanted for t in time_fields}
        )
        source = McapSource(path)
        seen: dict[str, None] = {}
        broken = Counter[str]()
        for message in source:
            if message.topic in seen and message.topic not in fields:
                continue
            try:
                content = json.loads(message.data)
            except (ValueError, RecursionError):
                broken[message.topic] += 1
                continue
            if message.topic not in seen:
                seen[message.topic] = None
                self._known += [f"{message.topic}:{f}" for f in _numbers_in(content)]
            group = fields.get(message.topic)
            if group is None:
                continue
            self._ns[message.topic].append(message.log_time_ns)
            for field in group:
                self._values[message.topic][field].append(_number(content, field))
        for topic, count in broken.items():
            self._notes.append(f"{count} messages of {topic} are no JSON")
        if source.damage:
            self._notes.append(source.damage.removeprefix(f"{path}: "))
        if not seen:
            raise RunError(f"{path}: holds no message in JSON")


class CanMessages(MessageSource):
    """Frames of a CAN log decoded by a DBC; names are `Message.Signal`."""

    def __init__(self, path: Path, wanted: set[str], time_fields: set[str], dbc: Path) -> None:
        super().__init__(path, "signal", ".")
        try:
            database: Any = cantools.database.load_file(dbc)
        except (OSError, cantools.database.Error, UnicodeDecodeError) as error:
            raise RunError(f"{dbc}: cannot be read as a DBC: {error}") from error
        self._known = [f"{m.name}.{s.name}" for m in database.messages for s in m.signals]
        for name in wanted:
            if name not in self._known:
                raise no_such(dbc, "signal", name, self._known)
        fields = self._want(
            wanted | {f"{name.rpartition('.')[0]}.{t}" for name in wanted for t in time_fields}
        )
        by_id = {(m.frame_id, m.is_extended_frame): m for m in database.messages}
        for m in database.messages:
            for s in m.signals:
                if s.unit and unit_name(s.unit):
                    self._units[f"{m.name}.{s.name}"] = str(unit_name(s.unit))
        frames = read_can_log(path)
        unknown, short = Counter[str](), Counter[str]()
        for stamped in frames:
            frame = stamped.frame
            if frame.is_error or frame.is_remote:
                continue
            message = by_id.get((frame.can_id, frame.is_extended))
            if message is None:
                unknown[f"0x{frame.can_id:03X}"] += 1
                continue
            group = fields.get(message.name)
            if group is None:
                continue
            try:
                decoded = message.decode(frame.data, decode_choices=False, allow_truncated=True)
            except cantools.database.DecodeError:
                short[message.name] += 1
                continue
            self._ns[message.name].append(round(stamped.t_s * 1e9))
            for field in group:
                self._values[message.name][field].append(float(decoded.get(field, np.nan)))
        if unknown:
            listed = ", ".join(f"{n} of {i}" for i, n in unknown.most_common(4))
            self._notes.append(f"frames that {dbc.name} does not describe: {listed}")
        for name, count in short.items():
            self._notes.append(f"{count} frames of {name} do not fit {dbc.name}")
        absent = sorted(name for name in wanted if not len(self._ns[name.rpartition(".")[0]]))
        if absent:
            raise RunError(f"{path}: no frame of the log carries {', '.join(absent)}")


def _number(content: Any, field: str) -> float:
    for part in field.split("."):
        if isinstance(content, list) and part.isdigit() and int(part) < len(content):
            content = content[int(part)]
        elif isinstance(content, dict):
            content = content.get(part)
        else:
            return float("nan")
    try:
        return float(content) if isinstance(content, int | float) else float("nan")
    except OverflowError:  # a whole number of some hundred digits
        return float("inf")


def _numbers_in(message: Any, limit: int = 50) -> list[str]:
    """Dotted names of the numbers in one JSON message."""
    found: list[str] = []

    def walk(content: Any, name: str) -> None:
        if isinstance(content, dict | list):
            inside = content.items() if isinstance(content, dict) else enumerate(content)
            for key, value in inside:
                walk(value, f"{name}.{key}" if name else str(key))
        elif isinstance(content, int | float) and len(found) < limit:
            found.append(name)

    walk(message, "")
    return found
