"""The picture of a PC's latency: how often the loop woke how late, over the bands that matter."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Final

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from hil.daemon.latency import BANDS_US, Latency
from hil.ui.page import FONT, page

BAND_NAMES: Final = ("excellent", "good", "loops in the drives", "late")
_BAND_COLOURS: Final = ("#dcfce7", "#fef9c3", "#ffedd5", "#fee2e2")
_LOOP, _TRIP = "#2563eb", "#ea580c"
_LOWEST_US, _HIGHEST_US = 1.0, 100_000.0


def latency_figure(measured: Latency) -> go.Figure:
    """Histograms of lateness and round trip on logarithmic axes; lateness below 1 µs is drawn there."""
    figure = go.Figure()
    edges = np.geomspace(_LOWEST_US, _HIGHEST_US, 101)
    _bars(figure, "lateness of the loop", measured.late_us, edges, _LOOP)
    if measured.round_trip_us.size:
        _bars(figure, "bus round trip", measured.round_trip_us, edges, _TRIP)
    bounds = (_LOWEST_US, *BANDS_US, _HIGHEST_US)
    for low, high, name, colour in zip(
        bounds[:-1], bounds[1:], BAND_NAMES, _BAND_COLOURS, strict=True
    ):
        figure.add_vrect(low, high, fillcolor=colour, layer="below", line_width=0)
        _label(figure, float(np.sqrt(low * high)), 1.06, name, "#64748b")
    cycle_us = measured.cycle_s * 1e6
    figure.add_vline(cycle_us, line={"color": "#dc2626", "width": 1.5, "dash": "dash"})
    _label(figure, cycle_us, 0.98, "a whole cycle", "#dc2626")
    ticks = [10.0**k for k in range(6)]
    figure.update_xaxes(
        type="log",
        title_text="time",
        range=[0.0, 5.0],
        tickvals=ticks,
        ticktext=["1 µs", "10 µs", "100 µs", "1 ms", "10 ms", "100 ms"],
    )
    figure.update_yaxes(type="log", title_text="times", dtick=1)
    figure.update_layout(
        template="plotly_white",
        barmode="overlay",
        bargap=0.0,
        height=420,
        margin={"l": 70, "r": 30, "t": 60, "b": 50},
        legend={"orientation": "h", "y": -0.2},
        font=dict(FONT),
    )
    return figure


def figures(values_us: NDArray[np.float64]) -> tuple[float, float, float]:
    """Median, 99th percentile and maximum."""
    p50, p99 = np.percentile(values_us, (50, 99))
    return float(p50), float(p99), float(values_us.max())


def latency_report(measured: Latency, out_html: Path) -> Path:
    """Write the picture as a page that needs nothing else; RunError where it cannot be written."""
    p50, p99, highest = figures(measured.late_us)
    said = (
        f"{measured.late_us.size} wakes every {measured.cycle_s * 1e3:g} ms: median {p50:.0f} µs, "
        f"99 % {p99:.0f} µs, worst {highest:.0f} µs, {measured.overruns} cycles missed"
    )
    rights = escape("; ".join(measured.rights))
    section = ("How late the loop woke", rights, latency_figure(measured))
    return page(out_html, "Latency of this PC", said, [section])


def _label(figure: go.Figure, at_us: float, height: float, text: str, colour: str) -> None:
    """Text at `at_us`: annotations on logarithmic axes stand at the logarithm, unlike shapes."""
    figure.add_annotation(
        x=float(np.log10(at_us)),
        y=height,
        yref="paper",
        text=text,
        showarrow=False,
        font={"color": colour},
    )


def _bars(
    figure: go.Figure,
    name: str,
    values_us: NDArray[np.float64],
    edges: NDArray[np.float64],
    colour: str,
) -> None:
    counts, _ = np.histogram(np.clip(values_us, _LOWEST_US, _HIGHEST_US), edges)
    figure.add_bar(
        x=np.sqrt(edges[1:] * edges[:-1]),
        y=counts,
        width=np.diff(edges),
        name=name,
        marker={"color": colour, "line": {"width": 0}},
        opacity=0.75,
        hovertemplate="%{x:.0f} µs: %{y}<extra></extra>",
    )
