"""A page about a designed experiment: the motion, what it asks of the actuators, its limits and lines."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Final

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from hil.config import RigFile
from hil.identify.experiments import Design
from hil.rigs import build_rig
from hil.ui.page import FONT, PALETTE, page

MOST_POINTS: Final = 2500


def experiment_page(design: Design, rig: RigFile, out_html: Path) -> Path:
    """Write the page to `out_html` and return that. RunError where it cannot be written."""
    described = design.description
    share = max(use.share for use in design.uses)
    subtitle = (
        f"{described.duration_s:.1f} s for {rig.name} · uses {100.0 * share:.0f} % of the limit nearest to it"
        f" · shaping changes it by {100.0 * design.shaped.relative:.2g} % of its peak"
    )
    sections = [
        ("Motion", "Shaded: the parts that are meant for measuring.", motion_figure(design, rig)),
        ("Limits used", "", limits_figure(design)),
    ]
    if described.period_s and described.lines:
        note = "Grey: multiples of 1/period that stay empty; what is measured there is distortion."
        sections.append(("Lines", note, lines_figure(design)))
    title = f"{described.plan.kind}: {', '.join(described.coordinates)}"
    return page(out_html, escape(title), escape(subtitle), sections)


def motion_figure(design: Design, rig: RigFile) -> go.Figure:
    """Position, speed and acceleration of the coordinates that move, and actuators' positions."""
    trajectory = design.trajectory
    moving = [k for k in range(len(rig.coordinates)) if np.ptp(trajectory.poses[:, k]) > 1e-9]
    velocity, acceleration, _ = trajectory.derivatives()
    thin = max(1, len(trajectory.t_s) // MOST_POINTS)
    manipulator = build_rig(rig)
    rho = np.array([manipulator.inverse(q) for q in trajectory.poses[::thin]])
    rows: list[tuple[str, NDArray[np.float64], list[str]]] = []
    names = [rig.coordinates[k] for k in moving]
    unit = "/".join(dict.fromkeys("rad" if rig.rotates(c) else "m" for c in names))
    for title, values in (
        (f"position, {unit}", trajectory.poses),
        (f"speed, {unit}/s", velocity),
        (f"acceleration, {unit}/s²", acceleration),
    ):
        rows.append((title, values[::thin][:, moving], names))
    length = "rad" if rig.is_rotary else "m"
    rows.append((f"actuators from neutral, {length}", rho - rho[0], list(rig.actuator_names)))
    figure = make_subplots(rows=len(rows), cols=1, shared_xaxes=True, vertical_spacing=0.03)
    t = trajectory.t_s[::thin]
    for row, (title, values, labels) in enumerate(rows, start=1):
        for k, label in enumerate(labels):
            figure.add_trace(
                go.Scatter(
                    x=np.float32(t),
                    y=np.float32(values[:, k]),
                    name=label,
                    legendgroup="actuators" if row == len(rows) else label,
                    showlegend=row in (1, len(rows)),
                    line={"color": PALETTE[k % len(PALETTE)], "width": 1.4},
                ),
                row=row,
                col=1,
            )
        figure.update_yaxes(title_text=title, row=row, col=1)
    for segment in design.description.segments:
        figure.add_vrect(
            segment.start_s, segment.end_s, fillcolor="#2563eb", opacity=0.05, line_width=0,
            row="all", col=1,
        )  # fmt: skip
    figure.update_xaxes(title_text="t, s", row=len(rows), col=1)
    figure.update_layout(
        height=190 * len(rows) + 60,
        margin={"l": 80, "r": 140, "t": 30, "b": 46},
        template="plotly_white",
        font=FONT,
        hovermode="x",
    )
    return figure


def limits_figure(design: Design) -> go.Figure:
    """Bars: share of each limit."""
    shown = sorted((u for u in design.uses if u.share > 0.005), key=lambda u: u.share)
    figure = go.Figure(
        go.Bar(
            x=[100.0 * u.share for u in shown],
            y=[f"{u.rule} of {u.name}" for u in shown],
            orientation="h",
            marker={"color": [PALETTE[1] if u.share > 0.9 else PALETTE[0] for u in shown]},
            hovertext=[str(u) for u in shown],
            hoverinfo="text",
        )
    )
    figure.update_xaxes(range=[0, 105], title_text="% of limit")
    figure.update_layout(
        height=60 + 22 * len(shown),
        margin={"l": 190, "r": 140, "t": 30, "b": 46},
        template="plotly_white",
        font=FONT,
        bargap=0.35,
    )
    return figure


def lines_figure(design: Design) -> go.Figure:
    """Amplitude spectrum of one measured period, excited and detection lines apart."""
    described = design.description
    first = described.segments[0]
    start = round(first.start_s * described.rate_hz)
    count = round(described.period_s * described.rate_hz)
    poses = design.trajectory.poses[start : start + count]
    spectrum = 2.0 * np.abs(np.fft.rfft(poses, axis=0)) / count
    figure = go.Figure()
    for k, lines in enumerate(described.lines):
        column = design.trajectory.coordinates.index(lines.coordinate)
        harmonics = np.array(lines.excited)
        figure.add_trace(
            go.Scatter(
                x=harmonics / described.period_s,
                y=spectrum[harmonics, column],
                mode="markers",
                name=lines.coordinate,
                marker={"color": PALETTE[k % len(PALETTE)], "size": 8},
            )
        )
    floor = min(float(np.min(trace.y)) for trace in figure.data)
    empty = np.array(described.detection)
    for parity, name, symbol in ((1, "odd detection", "x"), (0, "even detection", "line-ns-open")):
        at = empty[empty % 2 == parity] / described.period_s
        figure.add_trace(
            go.Scatter(
                x=at,
                y=np.full(len(at), 0.5 * floor),
                mode="markers",
                name=name,
                marker={"color": "#94a3b8", "symbol": symbol, "size": 8},
            )
        )
    figure.update_yaxes(type="log", title_text="amplitude, m or rad", exponentformat="power")
    figure.update_xaxes(type="log", title_text="frequency, Hz")
    figure.update_layout(
        height=340,
        margin={"l": 80, "r": 140, "t": 30, "b": 46},
        template="plotly_white",
        font=FONT,
    )
    return figure
