"""Page of the AGARD measures: excursion limits, sinusoids with their noise by kind, dynamic threshold."""

from __future__ import annotations

import cmath
import math
from html import escape
from pathlib import Path

import numpy as np
import plotly.graph_objects as go

from hil.identify.frequency.agard import AgardAnalysis
from hil.ui.frequency_report import GREY, ORANGE, PINK, style
from hil.ui.page import page


def agard_page(a: AgardAnalysis, out_html: Path) -> Path:
    """Write the page of AGARD measures; RunError where it cannot be written."""
    sections: list[tuple[str, str, go.Figure | str]] = [
        *(("Note", "", escape(note)) for note in a.notes),
        (
            "Excursion limits, each coordinate alone",
            "Left by geometry, drives and weight at neutral; right by the rig file: workspace, cue limits.",
            _excursions(a),
        ),
    ]
    if a.sines:
        sections += [
            (
                "Sinusoids: describing function and acceleration noise",
                "Accelerations by the IMU where there is one; standard deviations, peak and bump excepted. "
                "Hysteresis is the width of the loop of pose over setpoints.",
                _sines(a),
            ),
            ("Noise by kind, over the fundamental", "", _noise_figure(a)),
        ]
    if a.thresholds:
        head = "Dynamic threshold: acceleration steps felt to 63 %"
        sections.append((head, "Bars: standard deviation from step to step.", _thresholds(a)))
    source = "after AGARD Advisory Report 144, Dynamic Characteristics of Flight Simulator Motion Systems"
    return page(out_html, f"Motion system characteristics of {escape(a.rig)}", source, sections)


def _excursions(a: AgardAnalysis) -> str:
    head = "".join(
        f"<th>{x}</th>"
        for x in (
            "",
            "travel",
            "speed",
            "acceleration",
            "operational travel",
            "speed",
            "acceleration",
        )
    )
    rows = "".join(
        f"<tr><th>{e.coordinate}</th><td>{e.low:.3f} … {e.high:.3f} {e.unit}</td>"
        f"<td>{e.velocity:.2f} {e.unit}/s</td><td>{e.acceleration:.1f} {e.unit}/s²</td>"
        f"<td>±{e.operational:g} {e.unit}</td><td>{e.operational_velocity:g} {e.unit}/s</td>"
        f"<td>{e.operational_acceleration:g} {e.unit}/s²</td></tr>"
        for e in a.excursions
    )
    return f"<table><tr>{head}</tr>{rows}</table>"


def _sines(a: AgardAnalysis) -> str:
    names = (
        *("", "Hz", "commanded", "gain", "phase", "noise ratio", "stochastic", "low-frequency"),
        *("high-frequency", "peak", "reversal bump", "hysteresis"),
    )
    rows = "".join(
        f"<tr><th>{s.coordinate}</th><td>{s.hz:.3g}</td><td>{s.commanded:.3g} {s.unit}</td>"
        f"<td>{abs(s.describing):.4f}</td><td>{math.degrees(cmath.phase(s.describing)):.1f}°</td>"
        f"<td>{s.noise_ratio:.2%}</td><td>{_small(s.stochastic)}</td><td>{_small(s.low_frequency)}</td>"
        f"<td>{_small(s.high_frequency)}</td><td>{_small(s.peak)}</td><td>{_small(s.reversal_bump)}</td>"
        f"<td>{_small(s.hysteresis)}</td></tr>"
        for s in a.sines
    )
    head = "".join(f"<th>{x}</th>" for x in names)
    return f"<table><tr>{head}</tr>{rows}</table>"


def _small(x: float) -> str:
    return "–" if math.isnan(x) else f"{x:.3g}"


def _noise_figure(a: AgardAnalysis) -> go.Figure:
    figure = go.Figure()
    labels = [f"{s.coordinate}<br>{s.hz:.3g} Hz<br>{s.commanded:.3g} {s.unit}" for s in a.sines]
    base = np.array([s.fundamental / math.sqrt(2.0) for s in a.sines])
    for name, colour, values in (
        ("stochastic", GREY, [s.stochastic for s in a.sines]),
        ("low-frequency nonlinear (2, 3)", ORANGE, [s.low_frequency for s in a.sines]),
        ("high-frequency nonlinear (4 …)", PINK, [s.high_frequency for s in a.sines]),
    ):
        figure.add_bar(x=labels, y=100.0 * np.array(values) / base, name=name, marker_color=colour)
    style(figure, 340)
    figure.update_layout(barmode="group")
    figure.update_xaxes(type="category", dtick=1, minor={"showgrid": False})
    figure.update_yaxes(title_text="% of the fundamental")
    return figure


def _thresholds(a: AgardAnalysis) -> go.Figure:
    figure = go.Figure()
    for name in dict.fromkeys(t.coordinate for t in a.thresholds):
        those = [t for t in a.thresholds if t.coordinate == name]
        figure.add_scatter(
            x=[t.size for t in those],
            y=[1e3 * t.time_s for t in those],
            error_y={"type": "data", "array": [1e3 * t.std_s for t in those]},
            name=name,
            mode="markers+lines",
            marker={"size": 8},
        )
    style(figure, 340)
    figure.update_xaxes(title_text=f"step of acceleration, {a.thresholds[0].unit}")
    figure.update_yaxes(title_text="time to 63 %, ms", rangemode="tozero")
    return figure
