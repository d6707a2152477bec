"""Page of a frequency response: Bode plot with bands, models, distortion against noise, coherence."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Final

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from hil.identify.frequency.bla import Distortion
from hil.identify.frequency.frf import FrfAnalysis
from hil.identify.frequency.parametric import Estimate
from hil.ui.page import FONT, PALETTE, page

Array = NDArray[np.float64]

BLUE, ORANGE, GREEN, PINK = PALETTE[:4]
GREY: Final = "#64748b"
_LINKS: Final = {"cue to setpoints": GREEN, "setpoints to pose": ORANGE}


def frf_page(a: FrfAnalysis, out_html: Path) -> Path:
    """Write the page of a frequency response; RunError where it cannot be written."""
    r = a.response
    if a.period_s:
        counts = ", ".join(map(str, a.periods))
        how = f"{len(a.periods)} realisation(s) of {counts} periods of {a.period_s:g} s"
    else:
        how = "not periodic, local polynomial method"
    bands = "Bars and bands: 95 % of noise"
    bands += " and of nonlinear distortion." if r.method == "realisations" else "."
    sections: list[tuple[str, str, go.Figure | str]] = [
        *(("Note", "", escape(note)) for note in a.notes),
        ("Response", bands, _bode(a)),
    ]
    if a.fits:
        sections.append(("Second order with delay", MODELS, _fits(a)))
    if a.distortion is not None:
        said = _said(a.distortion)
        sections.append(("Linear answer, distortion and noise", said, _levels(a.distortion)))
    sections.append(("Coherence", "", _coherence(a)))
    title = escape(f"{r.input_name} → {r.output_name}")
    return page(out_html, title, escape(f"{a.rig} · {how} · {', '.join(a.runs)}"), sections)


MODELS: Final = (
    "Slow lag is τ + 2ζ/ω, by which slow motion is late. Misfit is the residual over its standard deviation: "
    "1 where the model is right. “whole” is all that lies between input and output; “filter” is what is left "
    "when the daemon's shaping, and the rig file's drives with their friction at this speed, are taken off."
)


def _bode(a: FrfAnalysis) -> go.Figure:
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
    style(figure, 620)
    figure.update_yaxes(title_text="gain, dB", row=1, col=1)
    figure.update_yaxes(title_text="phase, °", row=2, col=1)
    figure.update_xaxes(title_text="frequency, Hz", row=2, col=1)
    return figure


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
    return f"<table><tr>{head}</tr>{''.join(rows)}</table>"


def _estimate(e: Estimate, scale: float) -> str:
    low, high = (scale * x for x in e.interval)
    text = f'{scale * e.value:.4g} <span class="dim">({low:.4g} … {high:.4g})</span>'
    return (
        text
        if e.is_told
        else f'<span class="dim">not told by these data ({low:.3g} … {high:.3g})</span>'
    )


def _levels(d: Distortion) -> go.Figure:
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
    style(figure, 400)
    figure.update_yaxes(title_text=f"amplitude, dB re 1 {d.unit}")
    figure.update_xaxes(title_text="frequency, Hz")
    return figure


def _said(d: Distortion) -> str:
    said = [
        f"{x.kind}: {x.distortion:.3g} {d.unit} a line"
        if x.is_seen
        else f"{x.kind}: not seen above {x.floor:.3g} {d.unit} a line"
        for x in d.lines
    ]
    if not said:
        return "The multisine leaves no lines out: even and odd distortion cannot be told apart."
    return escape(f"Distortion {'; '.join(said)}.")


def _coherence(a: FrfAnalysis) -> go.Figure:
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
    style(figure, 280)
    figure.update_yaxes(
        title_text="coherence", range=[max(0.0, lowest - 0.1 * (1.02 - lowest)), 1.005]
    )
    figure.update_xaxes(title_text="frequency, Hz")
    return figure


def style(figure: go.Figure, height: int) -> None:
    """The look of these pages: frequency on a logarithmic axis, legend above."""
    figure.update_layout(
        height=height,
        margin={"l": 70, "r": 20, "t": 40, "b": 50},
        template="plotly_white",
        font=FONT,
        modebar={"orientation": "v"},
        legend={"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0.0},
        colorway=list(PALETTE),
    )
    figure.update_xaxes(type="log", minor={"showgrid": True, "gridcolor": "#f1f5f9"})
