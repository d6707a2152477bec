"""Gives a recording that was cut short its index and footer back."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from tempfile import NamedTemporaryFile

from mcap.records import Message

from hil.errors import RunError
from hil.runs.folder import RECORDING, RUN_TOML, is_being_recorded, read_meta, write_meta
from hil.runs.mcapfile import McapRecords, copy_records


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
    recording = path.with_name(RECORDING)  # a journal beside it is written as long as that is
    if is_being_recorded(recording if recording.is_file() else path):
        raise RunError(f"{path}: is being recorded right now")
    records = McapRecords(path)
    count, last_ns = 0, 0
    for record in records:
        if isinstance(record, Message):
            count, last_ns = count + 1, max(last_ns, record.log_time)
    if records.damage is None:
        return Repair(path, count, None)
    if count == 0:
        raise RunError(f"{path}: holds no message that can be saved ({records.damage})")
    fresh: Path | None = None
    try:
        with NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as stream:
            fresh = Path(stream.name)  # its own: another repair may be at the same file
            copy_records(path, stream)
        shutil.copymode(path, fresh)
        fresh.replace(path)
        if path == recording:
            _note_end(path.parent, last_ns)
    except OSError as error:
        if fresh is not None:
            fresh.unlink(missing_ok=True)
        raise RunError(f"{path}: cannot be repaired: {error.strerror}") from error
    return Repair(path, count, records.damage)


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
