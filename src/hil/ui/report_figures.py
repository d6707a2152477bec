"""The figures of a report: everything over one time axis, and the histogram of lateness."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from hil.signals import Event
from hil.ui.page import FONT, PALETTE
from hil.ui.report_data import Array, Quantity, RunView, Series, thinned

MOST_POINTS: Final = 3000
"""Points of one curve: two on each pixel of a wide screen. Lowest and highest values survive."""

MOST_MARKS: Final = 200
"""Events drawn as lines through all rows; more of them are dots in the top row only."""

CUE, SETPOINT, MEASURED = "#94a3b8", "#2563eb", "#ea580c"

STATE_COLOURS: Final = {
    "offline": "#cbd5e1",
    "preparing": "#fde68a",
    "parked": "#bae6fd",
    "ready": "#a7f3d0",
    "engaged": "#4ade80",
    "parking": "#93c5fd",
    "fault": "#f87171",
    "emergency": "#dc2626",
}
SEVERITY_COLOURS: Final = {"info": "#64748b", "warning": "#d97706", "fault": "#dc2626"}

_ROW_PX: Final = 190
_TOP_ROW_PX: Final = 70


@dataclass(slots=True)
class _Row:
    title: str
    unit: str
    curves: list[tuple[str, Series, str, bool]] = field(default_factory=list)
    """Name, samples, colour, whether it is a staircase or dashed helper line."""


def time_figure(shown: RunView) -> go.Figure:
    """States and events, poses, actuators, errors, forces and IMU above each other."""
    rows = [row for row in _rows(shown) if any(len(c[1].t) for c in row.curves)]
    heights = [_TOP_ROW_PX, *([_ROW_PX] * len(rows))]
    total = sum(heights) + 26 * len(rows)
    figure = make_subplots(
        rows=len(heights),
        cols=1,
        shared_xaxes=True,
        row_heights=heights,
        vertical_spacing=26 / total if rows else 0.0,
    )
    _draw_states(figure, shown)
    for k, row in enumerate(rows, start=2):
        _draw_row(figure, k, row)
    _draw_events(figure, shown.run.events, len(heights))
    figure.update_layout(
        height=total + 80,
        margin={"l": 70, "r": 150, "t": 20, "b": 50},
        template="plotly_white",
        font=FONT,
        hovermode="x",
        hoverlabel={"namelength": -1},
    )
    figure.update_xaxes(showspikes=True, spikemode="across", spikethickness=1, spikecolor="#94a3b8")
    t = shown.run.table["t"]
    figure.update_xaxes(range=[float(t.iloc[0]), float(t.iloc[-1])])
    figure.update_xaxes(title_text="t, s", showticklabels=True, row=len(heights), col=1)
    return figure


def lateness_figure(lateness_us: Array) -> go.Figure:
    """How many cycles began how late, counts on a logarithmic axis."""
    counts, edges = np.histogram(lateness_us, bins=min(120, max(20, len(lateness_us) // 20)))
    figure = go.Figure(
        go.Bar(
            x=np.float32(0.5 * (edges[1:] + edges[:-1])),
            y=counts,
            width=np.float32(np.diff(edges)),
            marker={"color": SETPOINT, "line": {"width": 0}},
            hovertemplate="%{x:.0f} µs: %{y} cycles<extra></extra>",
        )
    )
    for share, colour in ((50, "#16a34a"), (99, "#d97706"), (100, "#dc2626")):
        value = float(np.percentile(lateness_us, share))
        name = "max" if share == 100 else f"p{share}"
        figure.add_vline(
            value,
            line={"color": colour, "width": 1.5, "dash": "dot"},
            annotation={"text": f"{name} {value:.0f} µs", "font": {"color": colour}},
            annotation_position={50: "top left", 99: "top right", 100: "bottom right"}[share],
        )
    figure.update_layout(
        height=320,
        margin={"l": 70, "r": 150, "t": 30, "b": 50},
        template="plotly_white",
        font=FONT,
        bargap=0.0,
    )
    figure.update_yaxes(type="log", title_text="cycles", dtick=1)
    figure.update_xaxes(title_text="lateness of the loop, µs")
    return figure


def _rows(shown: RunView) -> list[_Row]:
    rows = [_quantity_row(q) for q in (*shown.coordinates, *shown.actuators)]
    for title, quantities in (
        ("pose error", shown.coordinates),
        ("actuator error", shown.actuators),
    ):
        for unit in dict.fromkeys(q.unit for q in quantities):
            row = _Row(title, unit)
            for i, q in enumerate(quantities):
                if q.unit == unit:
                    row.curves.append((q.name, q.error, PALETTE[i % 6], False))
            rows.append(row)
    unit = next((f.unit for f in shown.forces.values()), "N")
    rows.append(_coloured("force", unit, shown.forces))
    angles = {n: s for n, s in shown.told.items() if n != "rear_wheel"}
    rows.append(_coloured("angle", "°", angles))
    rows.append(_coloured("rear wheel", "rad", {"rear_wheel": shown.told["rear_wheel"]}))
    for title, unit, key in (("rate", "rad/s", "imu.gyro"), ("specific force", "m/s²", "imu.acc")):
        part = {n.removeprefix("imu."): s for n, s in shown.imu.items() if n.startswith(key)}
        rows.append(_coloured(title, unit, part))
    return rows


def _quantity_row(q: Quantity) -> _Row:
    return _Row(
        q.name,
        q.unit,
        [
            ("cue", q.cue, CUE, True),
            ("setpoint", q.setpoint, SETPOINT, False),
            ("measured", q.measured, MEASURED, False),
        ],
    )


def _coloured(title: str, unit: str, series: dict[str, Series]) -> _Row:
    curves = [(name, s, PALETTE[i % 6], False) for i, (name, s) in enumerate(series.items())]
    return _Row(title, unit, curves)


def _draw_row(figure: go.Figure, k: int, row: _Row) -> None:
    legend = f"legend{k}"
    for name, series, colour, is_helper in row.curves:
        if not len(series.t):
            continue
        few = thinned(series, MOST_POINTS)
        figure.add_scatter(
            x=np.float32(few.t),
            y=np.float32(few.values),
            name=name,
            mode="lines",
            line={"color": colour, "width": 1.2, "dash": "dot" if is_helper else "solid"},
            legend=legend,
            hovertemplate=f"{name} %{{y:.4g}} {row.unit}<extra></extra>",
            row=k,
            col=1,
        )
    axis = figure.layout[f"yaxis{k}"]
    axis.title.text = f"<b>{row.title}</b><br>{'deg' if row.unit == '°' else row.unit}"
    axis.title.standoff = 8
    figure.layout[legend] = {
        "x": 1.01,
        "y": axis.domain[1],
        "yanchor": "top",
        "bgcolor": "rgba(0,0,0,0)",
        "tracegroupgap": 0,
    }


def _draw_states(figure: go.Figure, shown: RunView) -> None:
    for stay in shown.stays:
        figure.add_bar(
            x=[stay.end_s - stay.start_s],
            base=[stay.start_s],
            y=["state"],
            orientation="h",
            name=stay.state,
            marker={"color": STATE_COLOURS.get(stay.state, "#e5e7eb"), "line": {"width": 0}},
            text=stay.state,
            textposition="inside",
            insidetextanchor="middle",
            textangle=0,
            showlegend=False,
            hovertemplate=f"{stay.state}, {stay.start_s:.2f} to {stay.end_s:.2f} s<extra></extra>",
            row=1,
            col=1,
        )
    figure.update_layout(barmode="overlay", uniformtext={"minsize": 9, "mode": "hide"})
    figure.update_yaxes(row=1, col=1, showgrid=False, fixedrange=True)


def _draw_events(figure: go.Figure, events: tuple[Event, ...], rows: int) -> None:
    for severity, colour in SEVERITY_COLOURS.items():
        those = [e for e in events if e.severity == severity]
        if not those:
            continue
        figure.add_scatter(
            x=[e.t_s for e in those],
            y=["event"] * len(those),
            mode="markers",
            marker={"symbol": "diamond", "size": 9, "color": colour},
            name=severity,
            customdata=[[e.name, e.text] for e in those],
            hovertemplate="<b>%{customdata[0]}</b> %{customdata[1]}<extra></extra>",
            showlegend=False,
            row=1,
            col=1,
        )
    marked = [e for e in events if e.severity != "info"][:MOST_MARKS]
    figure.layout.shapes = [
        {
            "type": "line",
            "x0": e.t_s,
            "x1": e.t_s,
            "xref": f"x{rows}" if rows > 1 else "x",
            "yref": "paper",
            "y0": 0.0,
            "y1": 1.0,
            "line": {"color": SEVERITY_COLOURS[e.severity], "width": 1, "dash": "dash"},
            "opacity": 0.6,
        }
        for e in marked
    ]
