"""Gives a recording that was cut short its index and footer back."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from hil.errors import RunError
from hil.runs.folder import RECORDING, RUN_TOML, is_being_recorded, read_meta, write_meta
from hil.runs.mcapfile import McapSink, McapSource


@dataclass(frozen=True, slots=True)
class Repair:
    """What a repair found: `damage` is None where there was nothing to do."""

    path: Path
    messages: int
    damage: str | None


def repair_run(path: Path) -> Repair:
    """Rewrite the recording of a run folder, or an .mcap file, if it was cut or hurt.

    All messages that can be read are kept, in their order. The old file is replaced only once the
    new one is whole. RunError where no message is left or the disk does not take the new file.
    """
    if path.is_dir():
        path = path / RECORDING
    if not path.is_file():
        raise RunError(f"{path}: no such recording")
    if is_being_recorded(path):
        raise RunError(f"{path}: is being recorded right now")
    source = McapSource(path)
    count, last_ns = 0, 0
    for message in source:
        count, last_ns = count + 1, max(last_ns, message.log_time_ns)
    if source.damage is None:
        return Repair(path, count, None)
    if count == 0:
        raise RunError(f"{path}: holds no message that can be saved ({source.damage})")
    fresh = path.with_name(f".{path.name}.repaired")
    try:
        with fresh.open("wb") as stream:
            _copy(source, McapSink(stream, source.schemas))
        fresh.replace(path)
        _note_end(path.parent, last_ns)
    except OSError as error:
        fresh.unlink(missing_ok=True)
        raise RunError(f"{path}: cannot be repaired: {error.strerror}") from error
    return Repair(path, count, source.damage)


def _note_end(folder: Path, last_ns: int) -> None:
    """Say in `run.toml`, if it tells of this recording, when the recorder was cut off."""
    if not (folder / RUN_TOML).is_file():
        return
    meta = read_meta(folder)
    if meta.recording is not None and meta.recording.ended is None:
        ended = datetime.fromtimestamp(last_ns * 1e-9, UTC)
        note = {"ended": ended, "end_reason": "cut off; repaired"}
        recording = meta.recording.model_copy(update=note)
        write_meta(folder, meta.model_copy(update={"recording": recording}))


def _copy(source: McapSource, sink: McapSink) -> None:
    for name, data in source.attachments.items():
        sink.attach(name, "application/toml", data, 0)
    for message in McapSource(source.path):
        sink.write(
            message.topic, source.schema_of[message.topic], message.data, message.log_time_ns
        )
    sink.finish()
