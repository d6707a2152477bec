"""Raw bus logs: written as candump text or Vector BLF, read from those and from ASC.

python-can does the formats; here they meet `StampedFrame`, and a log whose end is missing is still
read as far as it goes.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import StringIO
from pathlib import Path
from typing import IO, Any, Final, Literal

import can
from can.io import ASCReader, BLFReader, BLFWriter, CanutilsLogReader, CanutilsLogWriter
from can.io.blf import BLFParseError

from hil.errors import RunError
from hil.frames import Frame, StampedFrame

CAN_LOG: Final = {"candump": "can.log", "blf": "can.blf"}
"""File name in a run folder, by format."""

FORMATS: Final = {".log": "candump", ".blf": "BLF", ".asc": "ASC"}
"""Format of a bus log by the ending of its name."""

_CONTAINER_BYTES: Final = 4096
"""BLF is written in containers of this size, some 80 frames: what a killed process may lose."""


class CanLogSink:
    """Appends frames to a new log; `flush` hands them to the operating system."""

    def __init__(self, path: Path, kind: Literal["candump", "blf"], channel: str) -> None:
        self._stream: IO[Any]
        if kind == "candump":
            self._stream = path.open("w", encoding="ascii")
            self._writer = CanutilsLogWriter(self._stream, channel=channel)
        else:
            self._stream = path.open("wb")
            self._writer = BLFWriter(self._stream, max_container_size=_CONTAINER_BYTES)

    def write(self, t_epoch_s: float, frame: Frame, *, is_sent: bool) -> None:
        """Add one frame, stamped in seconds since 1970."""
        self._writer.on_message_received(
            can.Message(
                timestamp=t_epoch_s,
                arbitration_id=frame.can_id,
                is_extended_id=frame.is_extended,
                is_remote_frame=frame.is_remote,
                is_error_frame=frame.is_error,
                data=None if frame.is_remote else frame.data,
                is_rx=not is_sent,
            )
        )

    def flush(self) -> None:
        """Hand what is written to the operating system."""
        self._stream.flush()

    def close(self) -> None:
        """Finish the log and close it."""
        try:
            self._writer.stop()
        finally:
            self._stream.close()


def read_can_log(path: Path) -> list[StampedFrame]:
    """The frames of a candump (.log), BLF (.blf) or ASC (.asc) log, s since 1970 where it says so.

    A log that was cut short is read as far as it goes. RunError names the file and the last good
    frame where it is none of these formats or holds CAN FD frames.
    """
    if not path.is_file():
        raise RunError(f"{path}: no such file")
    frames: list[StampedFrame] = []
    try:
        for message in _messages(path):
            if message.is_fd:
                raise RunError(f"{path}: frame {len(frames) + 1} is CAN FD; hil reads classic CAN")
            frames.append(StampedFrame(message.timestamp, _frame(message)))
    except (ValueError, IndexError, KeyError, UnicodeDecodeError, BLFParseError) as error:
        raise RunError(
            f"{path}: is no {FORMATS[path.suffix.lower()]} log after frame {len(frames)}: {error}"
        ) from error
    except (EOFError, struct.error, zlib.error):
        if not frames:
            raise RunError(f"{path}: holds no frame that can be read") from None
    return frames


def _messages(path: Path) -> Iterator[can.Message]:
    kind = FORMATS.get(path.suffix.lower())
    if kind is None:
        raise RunError(f"{path}: hil reads bus logs named .log (candump), .blf and .asc")
    # The stream is ours: a reader that fails on its first bytes leaves its own open.
    if kind == "candump":
        yield from CanutilsLogReader(StringIO(_whole_lines(path)))
    elif kind == "BLF":
        with path.open("rb") as stream:
            yield from BLFReader(stream)
    else:
        with path.open(encoding="utf-8", errors="replace") as text:
            yield from ASCReader(text)


def _whole_lines(path: Path) -> str:
    """The text without a last line that was cut: one with fewer fields than the line before."""
    text = path.read_text(encoding="ascii")
    lines = text.split("\n")
    if lines[-1] and len(lines) > 1 and len(lines[-1].split()) < len(lines[-2].split()):
        lines.pop()
    return "\n".join(lines)


def _frame(message: can.Message) -> Frame:
    return Frame(
        message.arbitration_id,
        bytes(message.data),
        message.is_extended_id and not message.is_error_frame,
        message.is_remote_frame,
        message.is_error_frame,
    )
