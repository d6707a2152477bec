"""Plots of a ride as "Validation of multibody modeling and simulation using an instrumented bicycle" has
them (its figures 5 to 10), with turns shaded."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from hil.bicycle.analysis import Analysis
from hil.ui.page import FONT, PALETTE

Array = NDArray[np.float64]

MODEL, MEASURED, OTHER = PALETTE[1], PALETTE[0], PALETTE[2]
FAINT: Final = "rgba(0,114,178,0.25)"
TURNING: Final = 0.25
"""rad/s of yaw from which a ride turns."""
MOST_POINTS: Final = 2000

Line = tuple[str, Array, Array, str, float]
"""Name, instants, values, colour and width."""


def path_figure(a: Analysis) -> go.Figure:
    """The wheels' traces on the road, from the first sample on."""
    m = a.motion
    figure = go.Figure()
    for name, x, y, colour in (
        ("front wheel", m.front_contact[:, 0], m.front_contact[:, 1], OTHER),
        ("rear wheel", m.q[:, 0], m.q[:, 1], MODEL),
    ):
        x, y = _few(x), _few(y)
        figure.add_scatter(x=x, y=y, mode="lines", name=name, line={"color": colour, "width": 1.5})
    for name, k, symbol in (("start", 0, "circle"), ("end", -1, "x")):
        figure.add_scatter(
            x=[m.q[k, 0]], y=[m.q[k, 1]], mode="markers", name=name,
            marker={"color": "#0f172a", "size": 9, "symbol": symbol},
        )  # fmt: skip
    figure.update_yaxes(scaleanchor="x", title_text="y, m")
    figure.update_xaxes(title_text="x, m")
    return _laid(figure, 472)


def told_figure(a: Analysis) -> go.Figure:
    """What was measured: lean, speed of the wheel and steer, as they came and smooth."""
    t = a.motion.t_s
    raw, soft = a.ride.angles, a.told
    rows: list[tuple[str, Sequence[Line]]] = [
        ("lean, rad", [("raw", t, raw[:, 0], FAINT, 1.0), ("smooth", t, soft.angle[:, 0], MEASURED, 1.5)]),
        ("speed, m/s", [("speed", t, a.motion.speed, MEASURED, 1.5)]),
        ("steer, rad", [("raw", t, raw[:, 2], FAINT, 1.0), ("smooth", t, soft.angle[:, 2], MEASURED, 1.5)]),
    ]  # fmt: skip
    return _rows(a, rows, 1)


def imu_figure(a: Analysis, signals: Sequence[tuple[str, str]]) -> go.Figure | None:
    """IMU signals beside the model: raw, and both through the same filter; None where none was recorded."""
    t = a.motion.t_s
    rows: list[tuple[str, Sequence[Line]]] = []
    for signal, label in signals:
        if signal not in a.filtered:
            continue
        measured, model = a.filtered[signal]
        rows.append(
            (
                label,
                [
                    ("measured, raw", t, a.measured[signal], FAINT, 1.0),
                    ("measured", t, measured, MEASURED, 1.6),
                    ("model", t, model, MODEL, 1.6),
                ],
            )
        )
    return _rows(a, rows, 1) if rows else None


def torque_figure(a: Analysis) -> go.Figure:
    """Steer and drive torque, the latter beside the reduced inertia's, and the lean torque left over."""
    m, t = a.motion, a.motion.t_s
    rows: list[tuple[str, Sequence[Line]]] = [
        ("steer torque, N·m", [("steer torque (left +)", t, m.steer_torque, MODEL, 1.5)]),
        (
            "drive torque, N·m",
            [
                ("multiplier", t, m.drive_torque, MODEL, 1.5),
                ("reduced inertia and drag", t, a.reduced_torque, OTHER, 1.5),
            ],
        ),
        ("lean torque left, N·m", [("lean torque", t, a.lean_torque, MEASURED, 1.2)]),
    ]
    return _rows(a, rows, 1)


def force_figure(a: Analysis) -> go.Figure:
    """Normal forces, transverse force of the front wheel, friction demand of both."""
    m, t = a.motion, a.motion.t_s
    demand = np.where((m.speed > 0.5)[:, None], m.friction_demand, np.nan)
    rows: list[tuple[str, Sequence[Line]]] = [
        (
            "normal force, N",
            [("front", t, m.normal[:, 1], MODEL, 1.5), ("rear", t, m.normal[:, 0], MEASURED, 1.5)],
        ),
        (
            "tangential, N",
            [
                ("front, to its left", t, m.tangential[:, 1, 1], MODEL, 1.5),
                ("rear, forward", t, m.tangential[:, 0, 0], MEASURED, 1.5),
            ],
        ),
        (
            "friction demand",
            [("front", t, demand[:, 1], MODEL, 1.5), ("rear", t, demand[:, 0], MEASURED, 1.5)],
        ),
    ]
    return _rows(a, rows, 1)


def _rows(a: Analysis, rows: Sequence[tuple[str, Sequence[Line]]], columns: int) -> go.Figure:
    figure = make_subplots(
        rows=len(rows), cols=columns, shared_xaxes=True, vertical_spacing=0.09 / len(rows)
    )
    shown: set[str] = set()
    for k, (label, lines) in enumerate(rows, start=1):
        for name, t, values, colour, width in lines:
            figure.add_scatter(
                x=np.float32(_few(t)), y=np.float32(_few(values)), mode="lines", name=name,
                legendgroup=f"{name}{colour}", showlegend=f"{name}{colour}" not in shown,
                line={"color": colour, "width": width}, row=k, col=1,
            )  # fmt: skip
            shown.add(f"{name}{colour}")
        figure.update_yaxes(title_text=label, row=k, col=1)
    for start, end in _turns(a):
        figure.add_vrect(
            x0=start, x1=end, fillcolor="#e2e8f0", opacity=0.5, line_width=0, layer="below",
            row="all", col=1,
        )  # fmt: skip
    figure.update_xaxes(title_text="t, s", row=len(rows), col=1)
    return _laid(figure, 142 + 170 * len(rows))


def _turns(a: Analysis) -> list[tuple[float, float]]:
    """Spans in which the ride turns."""
    turning = np.abs(a.motion.qd[:, 2]) > TURNING
    edges = np.flatnonzero(np.diff(np.concatenate([[0], turning.astype(int), [0]])))
    t = a.motion.t_s
    spans = [(float(t[i]), float(t[k - 1])) for i, k in zip(edges[::2], edges[1::2], strict=True)]
    return [(start, end) for start, end in spans if end - start > 0.5]


def _few(values: Array) -> Array:
    step = max(len(values) // MOST_POINTS, 1)
    return values[::step]


def _laid(figure: go.Figure, height: int) -> go.Figure:
    figure.update_layout(
        height=height, template="plotly_white", font=dict(FONT),
        margin={"l": 70, "r": 20, "t": 72, "b": 45},  # two rows of names below the toolbar
        legend={"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0.0},
    )  # fmt: skip
    return figure
