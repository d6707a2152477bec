"""The motorcycle platform's figure 3: what is on the bus, decoded from the recording's own log."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from hil.drives.describe import Described, Describer
from hil.frames import StampedFrame
from hil.runs.canlog import CAN_LOG, read_can_log
from hil.ui.page import FONT, PALETTE
from hil.ui.reproduce.bench import Played, Profiles
from hil.ui.reproduce.following import LEG
from hil.ui.reproduce.motorcycle_prose import BUS
from hil.ui.reproduce.report import Section, Table

Array = NDArray[np.float64]
SHOWN_S: Final = 0.042
SYSTEM_START: Final = 0x0DD
ERROR_FRAME: Final = 0x1B9
KINDS: Final = {
    "control": 0,
    "status": 5,
    "request": 1,
    "answer": 2,
    "gyro": 3,
    "accel": 3,
    "system": 4,
}
"""Colour of each kind of frame, an index of the palette."""


def bus_section(played: Played, profiles: Profiles) -> Section:
    """Figure 3, from a run's `can.log`."""
    rig = played.job.rig
    frames = read_can_log(played.run.path / CAN_LOG["candump"])
    describer = Describer(rig, next(iter(profiles.values())))
    said = [describer.describe(f.frame) for f in frames]
    starts = [k for k, f in enumerate(frames) if f.frame.can_id == SYSTEM_START]
    # a stretch in the middle of the motion, from one of the leg's requests on
    middle = frames[0].t_s + played.start_s + 0.5 * played.description.duration_s
    begin = next(
        k for k, f in enumerate(frames)
        if f.t_s > middle and said[k].source == LEG and "read position" in said[k].text
    )  # fmt: skip
    answers = {
        q: np.array(
            [
                f.t_s
                for f, d in zip(frames, said, strict=True)
                if d.source == LEG and q in d.values and d.name == "answer"
            ]
        )
        for q in ("position", "force")
    }
    moving = {q: np.diff(t[t > middle]) for q, t in answers.items()}
    waits = _waits(frames, said)
    ids = sorted({f.frame.can_id for f in frames})
    facts = {
        "position_interval_s": float(np.median(moving["position"])),
        "force_interval_s": float(np.median(moving["force"])),
        "answer_wait_s": float(np.median(waits)),
        "system_start_frames": float(len(starts)),
    }
    per_s = len(frames) / (frames[-1].t_s - frames[0].t_s)
    began_s = frames[starts[0]].t_s - frames[0].t_s
    errors = sum(f.frame.can_id == ERROR_FRAME for f in frames)
    early = sum(d.name == "control" for d in said[: starts[0]])
    rows = (
        ("System Start (0x0DD)", f"{len(starts)}, first {began_s:.3f} s after the first frame"),
        ("control frames before it", f"{early}"),
        (
            "error frames (0x1B9)",
            f"{errors}: no leg came to its limit" if not errors else f"{errors}",
        ),
        ("request → answer, median", f"{1e3 * np.median(waits):.2f} ms"),
        ("request → answer, 99 %", f"{1e3 * np.percentile(waits, 99):.2f} ms"),
        ("a drive's pair of request and answer", f"every {1e3 * rig.bus.cycle:.0f} ms"),
        ("position of a leg", f"every {1e3 * facts['position_interval_s']:.2f} ms"),
        ("torque of a leg", f"every {1e3 * facts['force_interval_s']:.2f} ms"),
        ("frames on the bus", f"{per_s:.0f} a second, {len(ids)} identifiers"),
    )
    table = Table(("on the recorded bus", ""), rows)
    pictures = (_lanes(frames, said, begin), _spoken(frames, said, begin))
    return Section(BUS, pictures, table, facts)


def _waits(frames: Sequence[StampedFrame], said: Sequence[Described]) -> Array:
    """From each of the leg's requests to its answer, s."""
    out, asked = [], None
    for f, d in zip(frames, said, strict=True):
        if d.source != LEG:
            continue
        if d.name == "request":
            asked = f.t_s
        elif d.name == "answer" and asked is not None:
            out.append(f.t_s - asked)
            asked = None
    return np.array(out)


def _lanes(frames: Sequence[StampedFrame], said: Sequence[Described], begin: int) -> go.Figure:
    """Each frame of the stretch in its sender's lane, over time."""
    zero = frames[begin].t_s - 0.001
    some = [
        k for k in range(max(begin - 20, 0), len(frames)) if 0.0 <= frames[k].t_s - zero <= SHOWN_S
    ]
    figure = go.Figure()
    for name in dict.fromkeys(KINDS):
        of = [k for k in some if said[k].name == name]
        if not of:
            continue
        figure.add_trace(
            go.Scatter(
                x=[1e3 * (frames[k].t_s - zero) for k in of],
                y=[f"{said[k].source} {_direction(name)}".strip() for k in of],
                mode="markers",
                name=name,
                marker={
                    "symbol": "square",
                    # a drive's control frame leaves with its request, which would hide it
                    "size": 17 if name == "control" else 10,
                    "color": PALETTE[KINDS[name]],
                },
                customdata=[[f"0x{frames[k].frame.can_id:03X}", said[k].text] for k in of],
                hovertemplate="%{x:.2f} ms  %{customdata[0]}  %{customdata[1]}<extra></extra>",
            )
        )
    lanes = [f"{a} {d}" for a in dict.fromkeys(said[k].source for k in some) for d in ("out", "in")]
    lanes = [x for x in lanes if x != "imu out"]
    figure.update_yaxes(categoryorder="array", categoryarray=lanes[::-1])
    figure.update_xaxes(title_text="ms", dtick=10)
    figure.update_layout(
        height=330, template="plotly_white", font=FONT,
        margin={"l": 90, "r": 20, "t": 40, "b": 46},
        legend={"orientation": "h", "y": 1.02, "yanchor": "bottom"},
    )  # fmt: skip
    return figure


def _direction(name: str) -> str:
    return "out" if name in ("control", "request") else "in"


def _spoken(frames: Sequence[StampedFrame], said: Sequence[Described], begin: int) -> str:
    """The leg's frames of the stretch in words."""
    zero, rows = frames[begin].t_s, []
    for f, d in zip(frames[begin:], said[begin:], strict=True):
        if f.t_s - zero > 0.0205:
            break
        if d.source == LEG:
            data = f.frame.data.hex(" ")
            rows.append(
                (f"{1e3 * (f.t_s - zero):.2f}", f"0x{f.frame.can_id:03X}", d.name, data, d.text)
            )
    return Table(("ms", "id", f"{LEG}'s frames", "bytes", "says"), tuple(rows)).html()
