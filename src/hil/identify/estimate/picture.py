"""One page about a fit: measured force beside the predicted, and what is left over velocity."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Final

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from hil.errors import IdentificationError
from hil.identify.estimate.fit import Curves
from hil.identify.estimate.result import Identification

MOST_POINTS: Final = 4000
MEASURED, PREDICTED, LEFT = "#ea580c", "#2563eb", "#0f766e"


def fit_page(result: Identification, curves: Sequence[Curves], out_html: Path) -> Path:
    """Write the page, self-contained, and return its path. IdentificationError where it cannot be written."""
    body = go.Figure.to_html(
        _figure(curves), full_html=False, include_plotlyjs=True, config={"displaylogo": False}
    )
    rows = "".join(
        f"<tr><td>{escape(e.name)}</td><td>{e.value:.5g}</td><td>{e.ci95[0]:.5g} … {e.ci95[1]:.5g}</td>"
        f"<td>{escape(e.unit)}</td><td>{e.nominal:.5g}</td><td>{escape(e.reason) or 'told'}</td></tr>"
        for e in result.estimates
    )
    notes = "".join(f"<li>{escape(n)}</li>" for n in result.notes)
    title = escape(f"{result.rig}: identified by {result.method}")
    page = (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        "<style>body{font:15px/1.5 system-ui,sans-serif;margin:24px;color:#0f172a}"
        "td,th{padding:3px 14px 3px 0;text-align:left;font-variant-numeric:tabular-nums}</style></head>"
        f"<body><h1>{title}</h1><p>{escape(', '.join(result.runs))}</p>"
        "<table><tr><th>parameter</th><th>value</th><th>95 %</th><th>unit</th><th>rig file</th>"
        f"<th>do these data tell it?</th></tr>{rows}</table><ul>{notes}</ul>{body}</body></html>"
    )
    try:
        out_html.write_text(page, encoding="utf-8")
    except OSError as error:
        raise IdentificationError(f"{out_html}: cannot be written: {error.strerror}") from error
    return out_html


def _figure(curves: Sequence[Curves]) -> go.Figure:
    titles = [x for c in curves for x in (f"{c.name}: force", f"{c.name}: left over velocity")]
    figure = make_subplots(
        rows=max(len(curves), 1), cols=2, subplot_titles=titles, column_widths=[0.68, 0.32]
    )
    for row, c in enumerate(curves, start=1):
        step = max(len(c.t_s) // MOST_POINTS, 1)
        shown = slice(None, None, step)
        for name, y, colour in (
            ("measured", c.measured, MEASURED),
            ("predicted", c.predicted, PREDICTED),
        ):
            line = go.Scattergl(
                x=c.t_s[shown], y=y[shown], name=name, line={"color": colour, "width": 1.2},
                legendgroup=name, showlegend=row == 1,
            )  # fmt: skip
            figure.add_trace(line, row=row, col=1)
        left = go.Scattergl(
            x=c.velocity[shown], y=(c.measured - c.predicted)[shown], mode="markers",
            marker={"color": LEFT, "size": 3, "opacity": 0.5}, showlegend=False,
        )  # fmt: skip
        figure.add_trace(left, row=row, col=2)
        figure.update_xaxes(title_text="s", row=row, col=1)
        figure.update_xaxes(title_text="m/s", row=row, col=2)
        figure.update_yaxes(title_text="N", row=row, col=1)
    figure.update_layout(height=300 * max(len(curves), 1) + 80, template="plotly_white")
    return figure
