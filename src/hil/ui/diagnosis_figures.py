"""The pictures of a diagnosis: evidence by candidate, curves before and after, residual over state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from hil.gap import Diagnosis
from hil.gap.record.led import lacking
from hil.ui.diagnosis_data import Curves, best_first
from hil.ui.page import FONT, PALETTE
from hil.ui.report_data import Series, drawn

Array = NDArray[np.float64]

MOST_POINTS: Final = 2500
MOST_CAUSES: Final = 10
MEASURED, BEFORE, AFTER, FLOOR = "#64748b", PALETTE[1], PALETTE[0], "rgba(203,213,225,0.55)"
SLICES: Final = 40
LEAST: Final = 6
"""Samples of a slice that has a median."""
SPEAKING: Final = {
    *("coulomb_friction", "viscous_friction", "stribeck_friction", "asymmetric_friction"),
    *("asymmetric_viscous_friction",),
    *("load_friction", "backlash", "hysteresis", "force_ripple", "lead_error", "force_constant"),
}
"""Effects that are seen over velocity or position."""


def evidence_figure(found: Diagnosis) -> go.Figure:
    """Bars a candidate: probability, gain on training data, shrink on held-out data."""
    causes = best_first(found)[:MOST_CAUSES]
    names = [f"{c.location}.{c.effect}" for c in causes]
    if found.unknown > 0.0:
        names.append("none of these")
    columns = (
        ("probability", [c.probability for c in causes] + [found.unknown], ".3f", [0.0, 1.0]),
        ("gain over no effect, nats", [max(c.gain, 0.0) for c in causes], ".0f", None),
        ("gap gone on held-out data, %",
         [np.nan if c.shrink is None else 100.0 * c.shrink for c in causes], ".0f", None),
    )  # fmt: skip
    figure = make_subplots(
        rows=1, cols=3, shared_yaxes=True, horizontal_spacing=0.05,
        subplot_titles=[c[0] for c in columns],
    )  # fmt: skip
    chosen = {f"{c.location}.{c.effect}" for c in found.effects}
    colours = [PALETTE[0] if n in chosen else "#cbd5e1" for n in names]
    for col, (_, values, form, span) in enumerate(columns, start=1):
        shown = values[: len(names)]
        figure.add_bar(
            y=names[: len(shown)], x=shown, orientation="h", marker_color=colours[: len(shown)],
            text=[format(v, form) if np.isfinite(v) else "" for v in shown], textposition="auto",
            cliponaxis=False, showlegend=False, hoverinfo="skip", row=1, col=col,
        )  # fmt: skip
        if span is not None:
            figure.update_xaxes(range=span, row=1, col=col)
    figure.update_yaxes(autorange="reversed")
    figure.update_layout(
        height=150 + 30 * len(names), template="plotly_white", font=FONT, bargap=0.3,
        margin={"l": 210, "r": 30, "t": 70, "b": 30},
    )  # fmt: skip
    return figure


def signal_figure(c: Curves) -> go.Figure:
    """One signal: measured, twin before and after above, what is left of each below, within the floor."""
    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.04, row_heights=[0.5, 0.5]
    )
    has_after = bool(np.isfinite(c.after).all())
    lines = [("measured", c.measured, MEASURED, 3.0), ("twin before", c.before, BEFORE, 1.2)]
    if has_after:
        lines.append(("twin with the effect", c.after, AFTER, 1.2))
    for name, values, colour, width in lines:
        _line(figure, c.t, values, name, colour, width, 1)
    step = max(len(c.t) // 800, 1)
    for sign in (1.0, -1.0):
        figure.add_scatter(
            x=np.float32(c.t[::step]), y=np.float32(sign * 2.0 * c.sigma[::step]), mode="lines",
            line={"color": FLOOR, "width": 0.5}, fill="tonexty" if sign < 0.0 else None, fillcolor=FLOOR,
            hoverinfo="skip", name="twice the floor", showlegend=sign < 0.0, row=2, col=1,
        )  # fmt: skip
    _line(figure, c.t, c.measured - c.before, "left before", BEFORE, 1.0, 2)
    if has_after:
        _line(figure, c.t, c.measured - c.after, "left after", AFTER, 1.0, 2)
    if c.held_from_s is not None:
        figure.add_vrect(
            x0=max(c.held_from_s, float(c.t[0])), x1=float(c.t[-1]), fillcolor="#fde68a", opacity=0.22,
            line_width=0, layer="below", row="all", col=1,
        )  # fmt: skip
    figure.update_yaxes(title_text=f"<b>{c.signal}</b><br>{c.unit}", row=1, col=1)
    figure.update_yaxes(title_text=f"measured − twin<br>{c.unit}", row=2, col=1)
    figure.update_xaxes(title_text="t, s", row=2, col=1)
    figure.update_layout(
        height=460, template="plotly_white", font=FONT, margin={"l": 90, "r": 20, "t": 30, "b": 45},
        legend={"orientation": "h", "y": 1.1, "x": 0.0, "traceorder": "normal"},
    )  # fmt: skip
    return figure


def state_figure(found: Diagnosis, all_curves: Sequence[Curves]) -> go.Figure | None:
    """Force that the twin lacks over velocity, and over position by direction of travel; a row an actuator
    at which an effect sits that is seen so. None where there is none."""
    rig_names = getattr(found.located.evidence.problem.rig, "actuator_names", ())
    causes = found.effects or found.causes[:1]
    places = [c.location.partition(".")[0] for c in causes if c.effect in SPEAKING]
    rows = [(a, s) for a in dict.fromkeys(places) if a in rig_names
            for s in [_judged(found, all_curves, a)] if s is not None]  # fmt: skip
    if not rows:
        return None
    figure = make_subplots(
        rows=len(rows), cols=2, shared_yaxes=True, horizontal_spacing=0.03,
        vertical_spacing=0.15 / len(rows),
    )  # fmt: skip
    for k, (actuator, signal) in enumerate(rows, start=1):
        mine = [c for c in all_curves if c.signal == signal]
        states = [_state(found, c, actuator) for c in mine]
        velocity, position = (np.concatenate([s[i] for s in states]) for i in (0, 1))
        before = np.concatenate([_left(found, c, c.before) for c in mine])
        after = np.concatenate([_left(found, c, c.after) for c in mine])
        _cloud(figure, velocity, before, k, 1)
        _median(figure, velocity, before, "before", BEFORE, "solid", k, 1)
        if np.isfinite(after).all():
            _median(figure, velocity, after, "after", AFTER, "solid", k, 1)
        _cloud(figure, position, before, k, 2)
        slow = 0.02 * float(np.max(np.abs(velocity)))
        for word, rows_of, dash in (
            ("forth", velocity > slow, "solid"),
            ("back", velocity < -slow, "dot"),
        ):
            _median(
                figure, position[rows_of], before[rows_of], f"before, {word}", BEFORE, dash, k, 2
            )
            if np.isfinite(after).all():
                _median(
                    figure, position[rows_of], after[rows_of], f"after, {word}", AFTER, dash, k, 2
                )
        unit, what = mine[0].unit, f"<b>{signal}</b><br>measured − twin"
        if _is_led(found):
            what = f"<b>{actuator}</b><br>acceleration that the twin lacks"
            unit = f"{unit}/s²"
        figure.update_yaxes(title_text=f"{what}, {unit}", row=k, col=1)
        span = 1.1 * float(np.quantile(np.abs(before), 0.995))
        figure.update_yaxes(range=[-span, span], row=k)
        length = "rad" if unit in ("N·m", "rad", "rad/s²") else "m"
        figure.update_xaxes(title_text=f"velocity, {length}/s", row=k, col=1)
        figure.update_xaxes(title_text=f"position, {length}", row=k, col=2)
    seen: set[str] = set()
    for trace in figure.data:
        trace.showlegend = bool(trace.name) and trace.name not in seen
        seen.add(trace.name)
    figure.update_layout(
        height=110 + 270 * len(rows), template="plotly_white", font=FONT,
        margin={"l": 100, "r": 20, "t": 30, "b": 45},
        legend={"orientation": "h", "y": 1.12, "x": 0.0},
    )  # fmt: skip
    return figure


def _is_led(found: Diagnosis) -> bool:
    """Whether forces were set, so that none tells what the twin lacks: the motion does."""
    return bool(getattr(found.located.evidence.problem, "are_forces", False))


def _judged(found: Diagnosis, all_curves: Sequence[Curves], actuator: str) -> str | None:
    names = [c.signal for c in all_curves]
    quantities = ("position",) if _is_led(found) else ("force", "current", "position")
    return next((s for q in quantities if (s := f"{actuator}.{q}") in names), None)


def _left(found: Diagnosis, c: Curves, twin: Array) -> Array:
    """Measured less `twin` (N,); of a led twin the acceleration that it lacks."""
    left = c.measured - twin
    return lacking(c.t, left) if _is_led(found) else np.asarray(left)


def _state(found: Diagnosis, c: Curves, actuator: str) -> tuple[Array, Array]:
    """(velocity, position) of the twin at a curve's samples."""
    motion = found.located.evidence.motion[c.stretch]
    v, x = (
        np.interp(c.t, motion["t"], motion[f"{actuator}.{q}"]) for q in ("velocity", "position")
    )
    return np.asarray(v), np.asarray(x)


def _line(
    figure: go.Figure, t: Array, values: Array, name: str, colour: str, width: float, row: int
) -> None:
    x, y = drawn(Series(t, values), MOST_POINTS)
    figure.add_scatter(
        x=np.float32(x), y=np.float32(y), mode="lines", name=name,
        line={"color": colour, "width": width}, hovertemplate=name + " %{y:.4g}<extra></extra>",
        row=row, col=1,
    )  # fmt: skip


def _cloud(figure: go.Figure, x: Array, y: Array, row: int, col: int) -> None:
    step = max(len(x) // MOST_POINTS, 1)
    figure.add_scatter(
        x=np.float32(x[::step]), y=np.float32(y[::step]), mode="markers", name="", hoverinfo="skip",
        marker={"color": BEFORE, "size": 3, "opacity": 0.25}, row=row, col=col,
    )  # fmt: skip


def _median(
    figure: go.Figure, x: Array, y: Array, name: str, colour: str, dash: str, row: int, col: int
) -> None:
    """Line of medians over slices of `x`."""
    if len(x) < LEAST:
        return
    edges = np.linspace(float(x.min()), float(x.max()) + 1e-12, SLICES + 1)
    slot = np.digitize(x, edges) - 1
    held = [k for k in range(SLICES) if np.sum(slot == k) >= LEAST]
    figure.add_scatter(
        x=[0.5 * (edges[k] + edges[k + 1]) for k in held],
        y=[float(np.median(y[slot == k])) for k in held],
        mode="lines", name=name, line={"color": colour, "width": 2, "dash": dash},
        hovertemplate=f"median {name} %{{y:.4g}}<extra></extra>", row=row, col=col,
    )  # fmt: skip
