"""Pages about frequency responses and AGARD measures: one HTML file each that needs nothing else."""

from __future__ import annotations

import cmath
import math
from html import escape
from pathlib import Path
from string import Template
from typing import Final

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.offline import get_plotlyjs
from plotly.subplots import make_subplots

from hil.errors import RunError
from hil.identify.frequency.agard import AgardAnalysis
from hil.identify.frequency.bla import Distortion
from hil.identify.frequency.frf import FrfAnalysis
from hil.identify.frequency.parametric import Estimate

Array = NDArray[np.float64]

BLUE, ORANGE, GREEN, PINK, GREY = "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#64748b"
"""Okabe and Ito's colours, which colour-blind readers tell apart. [M]"""
_LINKS: Final = {"cue to setpoints": GREEN, "setpoints to pose": ORANGE}
_FONT: Final = {"family": "Inter, system-ui, sans-serif", "size": 12, "color": "#334155"}
_PAGE: Final = Template("""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title>
<style>
:root { color-scheme: light; }
body { margin: 0; background: #f1f5f9; color: #0f172a;
       font: 15px/1.5 Inter, system-ui, -apple-system, "Segoe UI", sans-serif; }
main { max-width: 1200px; margin: 0 auto; padding: 28px 24px 60px; }
h1 { font-size: 24px; margin: 0 0 2px; letter-spacing: -0.01em; }
h2 { font-size: 16px; margin: 0 0 10px; }
p.sub { margin: 0 0 18px; color: #64748b; }
section { background: #fff; border: 1px solid #e2e8f0; border-radius: 10px;
          padding: 18px 20px; margin-bottom: 18px; overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 5px 14px 5px 0; white-space: nowrap; }
th { font-weight: 600; color: #475569; }
tr + tr > * { border-top: 1px solid #f1f5f9; }
.note { background: #fffbeb; border-color: #fcd34d; }
.dim { color: #94a3b8; }
</style>
<script>$plotly</script>
</head>
<body><main>
<h1>$title</h1>
<p class="sub">$subtitle</p>
$body
</main></body></html>
""")


def frf_page(a: FrfAnalysis, out_html: Path) -> Path:
    """Write the page of a frequency response; RunError where it cannot be written."""
    r = a.response
    if a.period_s:
        counts = ", ".join(map(str, a.periods))
        how = f"{len(a.periods)} realisation(s) of {counts} periods of {a.period_s:g} s"
    else:
        how = "not periodic, local polynomial method"
    parts = [_notes(a.notes), _section("Response", _bode(a))]
    if a.fits:
        parts.append(_section("Second order with delay", _fits(a)))
    if a.distortion is not None:
        parts.append(_section("Linear answer, distortion and noise", _levels(a.distortion)))
    parts.append(_section("Coherence", _coherence(a)))
    subtitle = f"{a.rig} · {how} · {', '.join(a.runs)}"
    return _write(out_html, f"{r.input_name} → {r.output_name}", subtitle, "".join(parts))


def agard_page(a: AgardAnalysis, out_html: Path) -> Path:
    """Write the page of AGARD measures; RunError where it cannot be written."""
    parts = [_notes(a.notes), _section("Excursion limits, each coordinate alone", _excursions(a))]
    if a.sines:
        parts.append(_section("Sinusoids: describing function and acceleration noise", _sines(a)))
        parts.append(_section("Noise by kind, over the fundamental", _embed(_noise_figure(a))))
    if a.thresholds:
        parts.append(_section("Dynamic threshold: acceleration steps felt to 63 %", _thresholds(a)))
    title = f"Motion system characteristics of {a.rig}"
    subtitle = "after AGARD Advisory Report 144, Dynamic Characteristics of Flight Simulator Motion Systems"
    return _write(out_html, title, subtitle, "".join(parts))


def _write(out_html: Path, title: str, subtitle: str, body: str) -> Path:
    page = _PAGE.substitute(
        title=escape(title), subtitle=escape(subtitle), body=body, plotly=get_plotlyjs()
    )
    try:
        out_html.write_text(page, encoding="utf-8")
    except OSError as error:
        raise RunError(f"{out_html}: cannot be written: {error.strerror}") from error
    return out_html


def _notes(notes: tuple[str, ...]) -> str:
    return "".join(f'<section class="note">{escape(note)}</section>' for note in notes)


def _section(title: str, body: str) -> str:
    return f"<section><h2>{escape(title)}</h2>{body}</section>"


def _bode(a: FrfAnalysis) -> str:
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.05)
    curves = [(f"{a.response.input_name} → {a.response.output_name}", a.response, BLUE)]
    curves += [(name, r, _LINKS[name]) for name, r in a.links.items()]
    for name, r, colour in curves:
        _curve(figure, 1, r.hz, r.gain_db, r.gain_band_db, name, colour, "dB")
        _curve(figure, 2, r.hz, r.phase_deg, r.phase_band_deg, name, colour, "°")
    whole = a.fits.get("filter by measured pose") or a.fits.get("whole")
    if whole is not None:
        gain = 20.0 * np.log10(np.abs(whole.model))
        phase = np.degrees(np.unwrap(np.angle(whole.model)))
        for row, y in ((1, gain), (2, phase)):
            figure.add_scatter(
                x=whole.hz,
                y=y,
                name="model",
                legendgroup="model",
                showlegend=row == 1,
                mode="lines",
                line={"color": "#0f172a", "width": 1.2, "dash": "dash"},
                row=row,
                col=1,
            )
    _style(figure, 620)
    figure.update_yaxes(title_text="gain, dB", row=1, col=1)
    figure.update_yaxes(title_text="phase, °", row=2, col=1)
    figure.update_xaxes(title_text="frequency, Hz", row=2, col=1)
    caption = '<p class="dim">Bars and bands: 95 % of noise'
    caption += " and of nonlinear distortion" if a.response.method == "realisations" else ""
    return _embed(figure) + caption + ".</p>"


def _curve(
    figure: go.Figure,
    row: int,
    hz: Array,
    y: Array,
    band: tuple[Array, Array],
    name: str,
    colour: str,
    unit: str,
) -> None:
    low, high = band
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    figure.add_scatter(
        x=np.concatenate([hz, hz[::-1]]),
        y=np.concatenate([high, low[::-1]]),
        fill="toself",
        fillcolor=f"rgba({red},{green},{blue},0.15)",
        line={"width": 0},
        hoverinfo="skip",
        legendgroup=name,
        showlegend=False,
        row=row,
        col=1,
    )
    figure.add_scatter(
        x=hz,
        y=y,
        name=name,
        legendgroup=name,
        showlegend=row == 1,
        mode="lines+markers" if len(hz) < 120 else "lines",
        marker={"size": 5},
        line={"color": colour, "width": 1.4},
        error_y={
            "type": "data",
            "symmetric": False,
            "array": high - y,
            "arrayminus": y - low,
            "thickness": 1,
            "width": 2,
        }
        if len(hz) < 120
        else None,
        hovertemplate=f"{name} %{{x:.3g}} Hz: %{{y:.2f}} {unit}<extra></extra>",
        row=row,
        col=1,
    )


def _fits(a: FrfAnalysis) -> str:
    head = "".join(
        f"<th>{x}</th>"
        for x in ("", "gain", "f, Hz", "damping", "delay, ms", "slow lag, ms", "misfit")
    )
    rows = [
        f"<tr><th>{escape(name)}</th>"
        + "".join(
            f"<td>{_estimate(fit.parameters[p], scale)}</td>"
            for p, scale in (("gain", 1.0), ("frequency", 1.0), ("damping", 1.0), ("delay", 1e3))
        )
        + f"<td>{1e3 * fit.low_frequency_delay_s:.1f}</td><td>{fit.misfit:.2f}</td></tr>"
        for name, fit in a.fits.items()
    ]
    text = (
        "Slow lag is τ + 2ζ/ω, by which slow motion is late. Misfit is the residual over its standard "
        "deviation: 1 where the model is right. “whole” is all that "
        "lies between input and output; “filter” is what is left when the daemon's shaping, and the rig "
        "file's drives with their friction at this speed, are taken off."
    )
    return f'<table><tr>{head}</tr>{"".join(rows)}</table><p class="dim">{text}</p>'


def _estimate(e: Estimate, scale: float) -> str:
    low, high = (scale * x for x in e.interval)
    text = f'{scale * e.value:.4g} <span class="dim">({low:.4g} … {high:.4g})</span>'
    return (
        text
        if e.is_told
        else f'<span class="dim">not told by these data ({low:.3g} … {high:.3g})</span>'
    )


def _levels(d: Distortion) -> str:
    figure = go.Figure()
    curves: list[tuple[str, Array, Array, str, str]] = [
        ("linear answer", d.hz, d.linear, BLUE, "circle"),
        ("noise of one period", d.hz, d.noise, GREY, "line-ew-open"),
    ]
    if d.nonlinear is not None:
        curves.append(("nonlinear, by realisations", d.hz, d.nonlinear, PINK, "diamond"))
    for lines in d.lines:
        colour = GREEN if lines.kind == "even" else ORANGE
        symbol = "square" if lines.kind == "even" else "triangle-up"
        curves.append((f"{lines.kind} lines left out", lines.hz, lines.level, colour, symbol))
        curves.append(
            (f"noise there ({lines.kind})", lines.hz, lines.noise, colour, "line-ew-open")
        )
    for name, hz, level, colour, symbol in curves:
        figure.add_scatter(
            x=hz,
            y=20.0 * np.log10(np.where(level > 0.0, level, np.nan)),
            name=name,
            mode="markers",
            marker={"color": colour, "symbol": symbol, "size": 8, "line": {"width": 1.5}},
            hovertemplate=f"{name} %{{x:.3g}} Hz: %{{y:.1f}} dB<extra></extra>",
        )
    _style(figure, 400)
    figure.update_yaxes(title_text=f"amplitude, dB re 1 {d.unit}")
    figure.update_xaxes(title_text="frequency, Hz")
    said = [
        f"{x.kind}: {x.distortion:.3g} {d.unit} a line"
        if x.is_seen
        else f"{x.kind}: not seen above {x.floor:.3g} {d.unit} a line"
        for x in d.lines
    ]
    text = "; ".join(said) or "the multisine leaves no lines out: even and odd cannot be told apart"
    return _embed(figure) + f'<p class="dim">Distortion {escape(text)}.</p>'


def _coherence(a: FrfAnalysis) -> str:
    figure = go.Figure()
    curves = [("whole", a.response, BLUE), *((n, r, _LINKS[n]) for n, r in a.links.items())]
    lowest = 1.0
    for name, r, colour in curves:
        lowest = min(lowest, float(r.coherence.min()))
        figure.add_scatter(
            x=r.hz,
            y=r.coherence,
            name=name,
            mode="lines+markers" if len(r.hz) < 120 else "lines",
            line={"color": colour, "width": 1.4},
        )
    _style(figure, 280)
    figure.update_yaxes(
        title_text="coherence", range=[max(0.0, lowest - 0.1 * (1.02 - lowest)), 1.005]
    )
    figure.update_xaxes(title_text="frequency, Hz")
    return _embed(figure)


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
    text = "Left by geometry, drives and weight at neutral; right by the rig file's workspace and cue limits."
    return f'<table><tr>{head}</tr>{rows}</table><p class="dim">{text}</p>'


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
    text = (
        "Accelerations by the IMU where there is one; standard deviations, peak and bump excepted. "
        "Hysteresis is the width of the loop of pose over setpoints."
    )
    return f'<table><tr>{head}</tr>{rows}</table><p class="dim">{text}</p>'


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
    _style(figure, 340)
    figure.update_layout(barmode="group")
    figure.update_xaxes(type="category", dtick=1, minor={"showgrid": False})
    figure.update_yaxes(title_text="% of the fundamental")
    return figure


def _thresholds(a: AgardAnalysis) -> str:
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
    _style(figure, 340)
    figure.update_xaxes(title_text=f"step of acceleration, {a.thresholds[0].unit}")
    figure.update_yaxes(title_text="time to 63 %, ms", rangemode="tozero")
    return _embed(figure)


def _style(figure: go.Figure, height: int) -> None:
    figure.update_layout(
        height=height,
        margin={"l": 70, "r": 20, "t": 40, "b": 50},
        template="plotly_white",
        font=_FONT,
        modebar={"orientation": "v"},
        legend={"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0.0},
        colorway=[BLUE, ORANGE, GREEN, PINK, GREY],
    )
    figure.update_xaxes(type="log", minor={"showgrid": True, "gridcolor": "#f1f5f9"})


def _embed(figure: go.Figure) -> str:
    config = {"responsive": True, "displaylogo": False, "scrollZoom": False}
    return str(figure.to_html(full_html=False, include_plotlyjs=False, config=config))
