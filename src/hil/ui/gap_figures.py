"""The pictures of a located gap: maps of signal, band and region, residuals over time and over state."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from hil.gap import Located
from hil.gap.record.regions import DIMENSIONS
from hil.ui.page import FONT
from hil.ui.report_data import Series, drawn

Array = NDArray[np.float64]

MOST_POINTS: Final = 3000
MOST_SIGNALS: Final = 8
"""Rows of residuals over time: the strongest."""
LEFT, FLOOR, LINE = "#0f766e", "#cbd5e1", "#b91c1c"
SCALE: Final = ((0.0, "#f8fafc"), (0.25, "#fde68a"), (0.6, "#f97316"), (1.0, "#7f1d1d"))
HIGHEST: Final = 10.0
"""Times the floor at which the colours end."""
REGIONS: Final = tuple(r for names in DIMENSIONS.values() for r in names)


def map_figure(found: Located) -> go.Figure:
    """Signals by bands, and signals by regions: times the floor, with the share of the gap written in."""
    cells = found.evidence.cells
    names = found.evidence.problem.signals
    bands = sorted({b[0] for b in cells.band})
    total = _whole(found)
    by_band = _grid(len(names), len(bands))
    by_region = _grid(len(names), len(REGIONS))
    for c, (band, region, dimension) in enumerate(
        zip(cells.band, cells.region, cells.dimension, strict=True)
    ):
        row = int(cells.signal[c])
        if dimension == "":
            _add(by_band, row, bands.index(band[0]), found, c)
        else:
            _add(by_region, row, REGIONS.index(region), found, c)
    tops = [max(b[1] for b in cells.band if b[0] == low) for low in bands]
    labels = [f"{low:g}–{top:.3g}" for low, top in zip(bands, tops, strict=True)]
    figure = make_subplots(
        cols=2, rows=1, shared_yaxes=True, horizontal_spacing=0.02, column_widths=[0.4, 0.6],
        subplot_titles=("by frequency band, Hz", "by region of operation"),
    )  # fmt: skip
    for col, (grid, x) in enumerate(((by_band, labels), (by_region, list(REGIONS))), start=1):
        shown = [name.replace("_", " ") for name in x]
        figure.add_trace(_heat(shown, list(names), grid, total, bar=col == 2), row=1, col=col)
    figure.update_yaxes(autorange="reversed")
    figure.update_xaxes(tickangle=-40)
    figure.update_layout(
        height=190 + 26 * len(names), template="plotly_white", font=FONT,
        margin={"l": 110, "r": 20, "t": 40, "b": 110},
    )  # fmt: skip
    return figure


def signal_figure(found: Located, signal: str) -> go.Figure:
    """Bands by regions of one signal."""
    cells = found.evidence.cells
    s = found.evidence.problem.signals.index(signal)
    mine = [c for c in range(len(cells.band)) if cells.signal[c] == s]
    bands = sorted({cells.band[c] for c in mine})
    columns = [r for r in ("everywhere", *REGIONS) if any(cells.region[c] == r for c in mine)]
    total = _whole(found)
    grid = _grid(len(bands), len(columns))
    for c in mine:
        _add(grid, bands.index(cells.band[c]), columns.index(cells.region[c]), found, c)
    labels = [f"{low:g}–{high:.3g} Hz" for low, high in bands]
    shown = [c.replace("_", " ") for c in columns]
    figure = go.Figure(_heat(shown, labels, grid, total, bar=True))
    figure.update_xaxes(tickangle=-40)
    figure.update_layout(
        title={"text": f"<b>{signal}</b>: bands by regions", "font": {"size": 14}},
        height=180 + 28 * len(bands), template="plotly_white", font=FONT,
        margin={"l": 110, "r": 20, "t": 40, "b": 110},
    )  # fmt: skip
    return figure


def time_figure(found: Located) -> go.Figure:
    """Residual of the strongest signals over time within twice the floor, stretches one after the other."""
    e = found.evidence
    strongest = sorted(found.signals, key=lambda s: (-s.share, -s.ratio))[:MOST_SIGNALS]
    rows = [s for s in found.signals if s in strongest]
    figure = make_subplots(rows=len(rows), cols=1, shared_xaxes=True, vertical_spacing=0.02)
    for k, s in enumerate(rows, start=1):
        for x in (x for x in e.problem.series if x.signal == s.signal):
            kept = e.problem.kept[x.part]
            t = e.problem.t_s[x.part][kept]
            if not len(t):
                continue
            sigma = 2.0 * e.noise.sigma[x.part][kept]
            step = max(len(t) // (MOST_POINTS // 3), 1)
            for sign in (1.0, -1.0):
                figure.add_scatter(
                    x=np.float32(t[::step]), y=np.float32(sign * sigma[::step]), mode="lines",
                    line={"color": FLOOR, "width": 1}, fill="tonexty" if sign < 0.0 else None,
                    fillcolor="rgba(203,213,225,0.55)", hoverinfo="skip", showlegend=False, row=k, col=1,
                )  # fmt: skip
            line_t, left = drawn(Series(t, e.residual[x.part][kept]), MOST_POINTS)
            figure.add_scatter(
                x=np.float32(line_t), y=np.float32(left), mode="lines", showlegend=False,
                line={"color": LEFT, "width": 1},
                hovertemplate=f"{s.signal} %{{y:.4g}} {s.unit}<extra></extra>", row=k, col=1,
            )  # fmt: skip
        figure.update_yaxes(title_text=f"<b>{s.signal}</b><br>{s.unit}", row=k, col=1)
    figure.update_xaxes(title_text="t, s", row=len(rows), col=1)
    figure.update_layout(
        height=90 + 130 * len(rows), template="plotly_white", font=FONT,
        margin={"l": 100, "r": 20, "t": 15, "b": 45},
    )  # fmt: skip
    return figure


def state_figure(found: Located) -> go.Figure | None:
    """Force residual (else position) of each actuator over its velocity and its position; None without."""
    e = found.evidence
    actuators = [
        (a, q)
        for a in e.problem.rig.actuator_names
        for q in [_judged_quantity(found, a)]
        if q is not None
    ]
    if not actuators:
        return None
    figure = make_subplots(
        rows=len(actuators), cols=2, shared_yaxes=True, horizontal_spacing=0.03,
        vertical_spacing=0.15 / len(actuators),
    )  # fmt: skip
    for k, (a, quantity) in enumerate(actuators, start=1):
        name = f"{a}.{quantity}"
        left, velocity, position = _over_state(found, name, a)
        step = max(len(left) // MOST_POINTS, 1)
        for col, state in ((1, velocity), (2, position)):
            figure.add_scattergl(
                x=np.float32(state[::step]), y=np.float32(left[::step]), mode="markers", showlegend=False,
                marker={"color": LEFT, "size": 3, "opacity": 0.35}, hoverinfo="skip", row=k, col=col,
            )  # fmt: skip
            x, y = _medians(state, left)
            figure.add_scatter(
                x=x, y=y, mode="lines", showlegend=False, line={"color": LINE, "width": 2},
                hovertemplate="median %{y:.4g}<extra></extra>", row=k, col=col,
            )  # fmt: skip
        unit = next(s.unit for s in found.signals if s.signal == name)
        figure.update_yaxes(title_text=f"<b>{name}</b><br>{unit}", row=k, col=1)
        span = float(np.quantile(np.abs(left), 0.998))
        figure.update_yaxes(range=[-1.1 * span, 1.1 * span], row=k)
    rotary = "rad" in (found.signals[0].unit, *(s.unit for s in found.signals))
    length = "rad" if rotary and not any(s.unit == "m" for s in found.signals) else "m"
    figure.update_xaxes(title_text=f"velocity, {length}/s", row=len(actuators), col=1)
    figure.update_xaxes(title_text=f"position, {length}", row=len(actuators), col=2)
    figure.update_layout(
        height=100 + 210 * len(actuators), template="plotly_white", font=FONT,
        margin={"l": 100, "r": 20, "t": 15, "b": 45},
    )  # fmt: skip
    return figure


def _whole(found: Located) -> float:
    """The explainable gap that shares are of: infinite where there is none, so that nothing has a share."""
    cells = found.evidence.cells
    floor = cells.floor.sum(axis=1)
    clear = [
        c
        for c, d in enumerate(cells.dimension)
        if d == "" and cells.score[c] > 6.0 and cells.energy[c].sum() > 1.25**2 * floor[c]
    ]
    return float(cells.excess[clear].sum()) if found.is_gap and clear else math.inf


def _grid(rows: int, columns: int) -> Array:
    """(3, rows, columns): energy, floor, excess."""
    return np.zeros((3, rows, columns))


def _add(grid: Array, row: int, column: int, found: Located, c: int) -> None:
    cells = found.evidence.cells
    grid[:, row, column] += (
        cells.energy[c].sum(),
        cells.floor[c].sum(),
        cells.excess[c].sum(),
    )


def _heat(x: list[str], y: list[str], grid: Array, total: float, *, bar: bool) -> go.Heatmap:
    with np.errstate(divide="ignore", invalid="ignore"):
        times = np.sqrt(np.where(grid[1] > 0.0, grid[0] / grid[1], np.nan))
    share = grid[2] / total
    text = np.where((share >= 0.01) & (times > 1.25), np.char.mod("%.0f %%", 100.0 * share), "")
    return go.Heatmap(
        x=x, y=y, z=np.log10(np.clip(times, 1.0, HIGHEST)), customdata=times, text=text,
        texttemplate="%{text}", colorscale=[list(c) for c in SCALE], zmin=0.0, zmax=1.0, xgap=1, ygap=1,
        showscale=bar, hovertemplate="%{y}, %{x}: %{customdata:.2f} times the floor<extra></extra>",
        colorbar={"title": {"text": "times<br>floor"}, "tickvals": [0.0, 0.301, 0.699, 1.0],
                  "ticktext": ["1", "2", "5", "10+"], "thickness": 12},
    )  # fmt: skip


def _judged_quantity(found: Located, actuator: str) -> str | None:
    names = [s.signal for s in found.signals]
    return next((q for q in ("force", "current", "position") if f"{actuator}.{q}" in names), None)


def _over_state(found: Located, signal: str, actuator: str) -> tuple[Array, Array, Array]:
    """Residual, velocity and position of all judged samples of a signal."""
    e = found.evidence
    left, velocity, position = [], [], []
    for x in (x for x in e.problem.series if x.signal == signal):
        kept = e.problem.kept[x.part]
        t = e.problem.t_s[x.part][kept]
        motion = e.motion[x.stretch]
        left.append(e.residual[x.part][kept])
        velocity.append(np.interp(t, motion["t"], motion[f"{actuator}.velocity"]))
        position.append(np.interp(t, motion["t"], motion[f"{actuator}.position"]))
    return np.concatenate(left), np.concatenate(velocity), np.concatenate(position)


def _medians(x: Array, y: Array) -> tuple[Array, Array]:
    """Medians of y over 40 slices of x that hold enough samples."""
    edges = np.linspace(float(x.min()), float(x.max()) + 1e-12, 41)
    slot = np.digitize(x, edges) - 1
    rows = [
        (0.5 * (edges[k] + edges[k + 1]), float(np.median(y[slot == k])))
        for k in range(40)
        if np.sum(slot == k) >= 8
    ]
    found = np.array(rows).reshape(-1, 2)
    return found[:, 0], found[:, 1]
