"""Figures of the reproductions: panels of curves in one look, thinned to what a screen shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from hil.ui.page import FONT, PALETTE
from hil.ui.report_data import Series, thinned

Array = NDArray[np.float64]
MOST_POINTS: Final = 2500
COMMANDED, MEASURED, SIMULATED = "#94a3b8", PALETTE[1], PALETTE[0]
"""Colours of these three wherever they stand together."""
Look = Literal["solid", "dash", "dot", "markers"]


@dataclass(frozen=True, slots=True)
class Curve:
    """One curve; the same `name` is one entry of the legend in all panels. `band`: ± about y, (N,)."""

    name: str
    x: Array
    y: Array
    colour: str
    look: Look = "solid"
    band: Array | None = None


@dataclass(frozen=True, slots=True)
class Panel:
    """Curves over common axes."""

    title: str
    x_title: str
    y_title: str
    curves: Sequence[Curve]
    log_x: bool = False
    levels: Sequence[tuple[float, str]] = field(default=())
    """Horizontal lines with a word each."""


def panels(parts: Sequence[Panel], columns: int = 1, height: int = 260) -> go.Figure:
    """Panels in rows of `columns`, `height` px each."""
    rows = -(-len(parts) // columns)
    figure = make_subplots(
        rows=rows,
        cols=columns,
        subplot_titles=[p.title for p in parts],
        vertical_spacing=min(0.3, 74.0 / (height * rows)) if rows > 1 else 0.0,
        horizontal_spacing=0.09 if columns == 2 else 0.07,
    )
    seen: set[str] = set()
    for k, part in enumerate(parts):
        row, column = k // columns + 1, k % columns + 1
        for curve in part.curves:
            _draw(figure, curve, row, column, is_first=curve.name not in seen)
            seen.add(curve.name)
        for level, word in part.levels:
            figure.add_hline(
                level,
                line={"color": "#475569", "width": 1, "dash": "dot"},
                annotation={"text": word, "font": {"size": 11, "color": "#475569"}},
                row=row,
                col=column,
            )
        figure.update_xaxes(
            title={"text": part.x_title, "standoff": 4},
            type="log" if part.log_x else "linear",
            row=row,
            col=column,
        )
        figure.update_yaxes(title={"text": part.y_title, "standoff": 6}, row=row, col=column)
    figure.update_layout(
        height=height * rows + 98,
        margin={"l": 70, "r": 20, "t": 88, "b": 46},
        template="plotly_white",
        font=FONT,
        legend={
            "orientation": "h",
            "y": 1.0 + 26.0 / (height * rows),  # above the titles, below the toolbar
            "x": 0.0,
            "yanchor": "bottom",
        },
    )
    figure.update_annotations(font_size=12.5)
    return figure


def _draw(figure: go.Figure, curve: Curve, row: int, column: int, *, is_first: bool) -> None:
    x, y = curve.x, curve.y
    if curve.look != "markers":
        few = thinned(Series(curve.x, curve.y), MOST_POINTS)
        x, y = few.t, few.values
    marks = {"symbol": "circle-open", "size": 8, "line": {"width": 1.6}, "color": curve.colour}
    style: dict[str, object] = (
        {"mode": "markers", "marker": marks}
        if curve.look == "markers"
        else {"mode": "lines", "line": {"color": curve.colour, "width": 1.5, "dash": curve.look}}
    )
    if curve.band is not None and curve.look == "markers":
        style["error_y"] = {"array": np.float32(curve.band), "thickness": 1.2, "width": 3}
    elif curve.band is not None:
        _shade(figure, curve, row, column)
    figure.add_trace(
        go.Scatter(
            x=np.float32(x),
            y=np.float32(y),
            name=curve.name,
            legendgroup=curve.name,
            showlegend=is_first,
            hovertemplate=f"{curve.name} %{{y:.5g}}<extra></extra>",
            **style,
        ),
        row=row,
        col=column,
    )


def _shade(figure: go.Figure, curve: Curve, row: int, column: int) -> None:
    assert curve.band is not None
    r, g, b = (int(curve.colour[k : k + 2], 16) for k in (1, 3, 5))
    figure.add_trace(
        go.Scatter(
            x=np.float32(np.concatenate([curve.x, curve.x[::-1]])),
            y=np.float32(np.concatenate([curve.y + curve.band, (curve.y - curve.band)[::-1]])),
            mode="lines",
            fill="toself",
            fillcolor=f"rgba({r},{g},{b},0.15)",
            line={"width": 0},
            legendgroup=curve.name,
            showlegend=False,
            hoverinfo="skip",
        ),
        row=row,
        col=column,
    )
