"""Bus logs: written by python-can, read back as frames."""

from __future__ import annotations

from pathlib import Path

import can
import pytest

from hil.errors import RunError
from hil.frames import Frame, StampedFrame
from hil.runs.canlog import CanLogSink, read_can_log

FRAMES = [
    StampedFrame(1_700_000_000.000001, Frame(0x0DD, b"\x01\x02\x03")),
    StampedFrame(1_700_000_000.25, Frame(0x7FF, b"")),
    StampedFrame(1_700_000_001.5, Frame(0x18FF0102, bytes(range(8)), is_extended=True)),
    StampedFrame(1_700_000_002.0, Frame(0x123, b"", is_remote=True)),
]


@pytest.mark.parametrize(("kind", "name"), [("candump", "a.log"), ("blf", "a.blf")])
def test_what_is_written_is_read(tmp_path: Path, kind: str, name: str) -> None:
    sink = CanLogSink(tmp_path / name, kind, "can0")  # type: ignore[arg-type]
    for t, frame in FRAMES:
        sink.write(t, frame, is_sent=False)
    sink.close()
    read = read_can_log(tmp_path / name)
    assert [f.frame for f in read] == [f.frame for f in FRAMES]
    assert [f.t_s for f in read] == pytest.approx([f.t_s for f in FRAMES], abs=2e-6)


def test_asc_logs_of_other_tools_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a.asc"
    with can.ASCWriter(path) as writer:
        for t, frame in FRAMES[:2]:
            writer.on_message_received(
                can.Message(timestamp=t, arbitration_id=frame.can_id, is_extended_id=False,
                            data=frame.data)
            )  # fmt: skip
    assert [f.frame for f in read_can_log(path)] == [f.frame for f in FRAMES[:2]]


def test_candump_log_cut_in_a_line_is_read_up_to_it(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    sink = CanLogSink(path, "candump", "can0")
    for k in range(20):
        sink.write(1.0 + k, Frame(0x100 + k, bytes([k] * 8)), is_sent=False)
    sink.close()
    text = path.read_text()
    for size in range(text.index("\n"), len(text)):
        path.write_text(text[:size])
        read = read_can_log(path)
        assert [f.frame.can_id for f in read] == [0x100 + k for k in range(len(read))]
        assert all(len(f.frame.data) == 8 for f in read)
        assert len(read) >= text[:size].count("\n")


def test_blf_log_cut_anywhere_is_read_up_to_it(tmp_path: Path) -> None:
    path = tmp_path / "a.blf"
    sink = CanLogSink(path, "blf", "can0")
    for k in range(1500):
        sink.write(1.0 + 0.001 * k, Frame(k, bytes([k % 256] * 8)), is_sent=False)
    sink.close()
    data = path.read_bytes()
    counts = []
    for size in range(2000, len(data), 500):
        path.write_bytes(data[:size])
        read = read_can_log(path)
        assert [f.frame.can_id for f in read] == list(range(len(read)))
        counts.append(len(read))
    assert counts == sorted(counts)
    assert counts[-1] > 1300


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("a.log", b"(1.0) can0 123#11\nthis is no frame\n", "is no candump log after frame 1"),
        ("a.log", b"(1.0) can0 123##1112233\n", "frame 1 is CAN FD"),
        ("a.log", b"(1.0) can0 123#XY\n", "after frame 0"),
        ("a.log", b"\xff\xfe", "after frame 0"),
        ("a.blf", b"no blf", "holds no frame that can be read"),
        ("a.blf", b"LOGX" + bytes(200), "a.blf"),
        ("a.txt", b"", "named .log (candump), .blf and .asc"),
    ],
)
def test_what_is_no_log_gets_its_sentence(
    tmp_path: Path, name: str, content: bytes, sentence: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(RunError) as caught:
        read_can_log(path)
    assert sentence in str(caught.value)
    assert str(path) in str(caught.value)


def test_log_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="no such file"):
        read_can_log(tmp_path / "a.log")
