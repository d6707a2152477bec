"""Where a rig can go, as numbers and as a page: ranges, share of the box of limits, conditioning."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from itertools import combinations
from pathlib import Path
from typing import Final

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots
from scipy.stats import qmc

from hil.config import RigFile
from hil.errors import KinematicsError
from hil.rigs import Manipulator, condition_map, single_axis_ranges, stroke_violations
from hil.ui.page import FONT, PALETTE, page

Array = NDArray[np.float64]

SAMPLES: Final = 4096
"""Poses of the box that are looked at: the share inside the strokes is known to about a percent."""
SEED: Final = 1
SLICE: Final = 81
"""Points of a slice on each axis."""
FARTHEST: Final = 4.0
"""Slices end at so many times the limits, where strokes do not end them before."""
MAP_POINTS: Final = {1: 201, 3: 11, 6: 4}
"""Points of the condition map on each axis, by the number of coordinates."""


@dataclass(frozen=True, slots=True)
class Survey:
    """A rig's workspace in numbers; m, rad."""

    coordinates: tuple[str, ...]
    rotates: tuple[bool, ...]
    """Which of them are angles."""
    ranges: Array
    """(n, 2) each coordinate alone, the others neutral, up to the end of a stroke."""
    limits: Array
    """(n,) the rig file's ±limits."""
    box_share: float
    """Share of the box of all limits that lies inside every stroke less its margin."""
    blocking: dict[str, float]
    """By actuator: share of the poses outside in which it is outside its stroke."""
    condition_neutral: float
    """Condition number of the Jacobian, rotations measured at the characteristic length."""
    condition_worst: float
    """The worst of those poses of the box's grid that lie inside the strokes."""
    is_singular: bool
    """Whether the Jacobian's determinant changes its sign among them."""
    length_m: float
    """Characteristic length: makes rotations comparable with translations."""


def survey(rig: RigFile, manipulator: Manipulator, length_m: float = 0.5) -> Survey:
    """Look at the workspace of `rig`; seconds for six coordinates."""
    limits = np.asarray(rig.limits)
    margin = rig.safety.stroke_margin
    draws = qmc.Sobol(manipulator.n, rng=np.random.default_rng(SEED)).random(SAMPLES)
    outside = 0
    blocking = dict.fromkeys(rig.actuator_names, 0)
    for q in limits * (2.0 * draws - 1.0):
        names = _outside(manipulator, q, margin)
        outside += bool(names)
        for name in names:
            blocking[name] += 1
    conditions = condition_map(manipulator, MAP_POINTS[manipulator.n], length_m)
    inside = np.array([not _outside(manipulator, q, margin) for q in conditions.poses])
    at_neutral = manipulator.jacobian(manipulator.neutral) / _lengths(rig, length_m)
    neutral = float(np.linalg.cond(at_neutral))
    determinants = conditions.determinant[inside]
    return Survey(
        rig.coordinates,
        tuple(rig.rotates(c) for c in rig.coordinates),
        single_axis_ranges(manipulator),
        limits,
        1.0 - outside / SAMPLES,
        {name: n / outside if outside else 0.0 for name, n in blocking.items()},
        neutral,
        max(neutral, float(np.max(conditions.condition[inside], initial=0.0))),
        bool(len(determinants)) and bool(np.min(determinants) < 0.0 < np.max(determinants)),
        length_m,
    )


def workspace_page(found: Survey, rig: RigFile, manipulator: Manipulator, out_html: Path) -> Path:
    """Write the page of `found` to `out_html` and return that; RunError where it cannot be written."""
    sections: list[tuple[str, str, go.Figure | str]] = [
        ("Each coordinate alone", "The others stay neutral.", _ranges_table(found)),
        ("Ranges and limits", "", ranges_figure(found)),
    ]
    if manipulator.n > 1:
        note = (
            "Pairs of coordinates, the others neutral. Colour: condition number of the Jacobian; white: a "
            "stroke has ended; frame: the rig file's limits."
        )
        sections.append(("Slices", note, slices_figure(found, rig, manipulator)))
    subtitle = (
        f"{100.0 * found.box_share:.3g} % of the box of all limits lies inside the strokes · condition "
        f"number {found.condition_neutral:.3g} at neutral, {found.condition_worst:.3g} at worst "
        f"(rotations at {found.length_m:g} m)"
    )
    return page(out_html, escape(f"Workspace of {rig.name}"), escape(subtitle), sections)


def ranges_figure(found: Survey) -> go.Figure:
    """Bars from end to end of each coordinate, the limits as frames; lengths and angles apart."""
    groups = [
        (unit, factor, [k for k, r in enumerate(found.rotates) if r == rotary])
        for unit, factor, rotary in (("mm", 1e3, False), ("deg", 180.0 / np.pi, True))
    ]
    groups = [group for group in groups if group[2]]
    figure = make_subplots(rows=1, cols=len(groups), horizontal_spacing=0.12)
    for column, (unit, factor, members) in enumerate(groups, start=1):
        names = [found.coordinates[k] for k in reversed(members)]
        ends = factor * found.ranges[members[::-1]]
        limits = factor * found.limits[members[::-1]]
        for base, width, thick, colour, label in (
            (ends[:, 0], np.diff(ends, axis=1)[:, 0], 0.55, PALETTE[5], "inside the strokes"),
            (-limits, 2.0 * limits, 0.22, PALETTE[0], "limits of the rig file"),
        ):
            figure.add_trace(
                go.Bar(
                    x=width,
                    base=base,
                    y=names,
                    width=thick,
                    orientation="h",
                    name=label,
                    marker={"color": colour},
                    showlegend=column == 1,
                    hovertemplate=f"%{{base:.4g}} to %{{x:.4g}} {unit}<extra>%{{y}}</extra>",
                ),
                row=1,
                col=column,
            )
        figure.update_xaxes(title_text=unit, zeroline=True, row=1, col=column)
    tallest = max(len(members) for _, _, members in groups)
    figure.update_layout(
        barmode="overlay",
        height=110 + 46 * tallest,
        margin={"l": 70, "r": 20, "t": 34, "b": 46},
        template="plotly_white",
        font=FONT,
        legend={"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0.0},
    )
    return figure


def slices_figure(found: Survey, rig: RigFile, manipulator: Manipulator) -> go.Figure:
    """Condition number over pairs of lengths and pairs of angles."""
    pairs = [
        pair
        for pair in combinations(range(manipulator.n), 2)
        if found.rotates[pair[0]] == found.rotates[pair[1]]
    ]
    slices = [_slice(found, rig, manipulator, pair) for pair in pairs]
    worst = max(float(np.nanmax(values)) for _, _, values in slices)
    best = min(float(np.nanmin(values)) for _, _, values in slices)
    rows = -(-len(pairs) // 3)
    figure = make_subplots(rows=rows, cols=3, horizontal_spacing=0.08, vertical_spacing=0.14)
    for number, (pair, (x, y, values)) in enumerate(zip(pairs, slices, strict=True)):
        row, column = number // 3 + 1, number % 3 + 1
        figure.add_trace(
            go.Heatmap(
                x=np.float32(x),
                y=np.float32(y),
                z=np.float32(values),
                coloraxis="coloraxis",
                hoverongaps=False,
                hovertemplate="%{x:.3g}, %{y:.3g}: %{z:.3g}<extra></extra>",
            ),
            row=row,
            col=column,
        )
        factors = [_scale(found.rotates[k]) for k in pair]
        width, height = (f[0] * found.limits[k] for f, k in zip(factors, pair, strict=True))
        figure.add_shape(
            type="rect", x0=-width, x1=width, y0=-height, y1=height, row=row, col=column,
            line={"color": PALETTE[1], "width": 2},
        )  # fmt: skip
        for update, k, (_, unit) in zip(
            (figure.update_xaxes, figure.update_yaxes), pair, factors, strict=True
        ):
            update(
                title={"text": f"{rig.coordinates[k]}, {unit}", "standoff": 4}, row=row, col=column
            )
    figure.update_layout(
        height=360 * rows + 40,
        margin={"l": 60, "r": 20, "t": 30, "b": 46},
        template="plotly_white",
        font=FONT,
        coloraxis={
            "colorscale": "Viridis_r",
            "cmin": best,
            "cmax": max(worst, best + 1e-9),
            "colorbar": {"title": {"text": "cond J"}, "thickness": 14},
        },
    )
    return figure


def _slice(
    found: Survey, rig: RigFile, manipulator: Manipulator, pair: tuple[int, int]
) -> tuple[Array, Array, Array]:
    """Axes in mm or degrees, condition numbers (y, x), NaN outside the strokes."""
    margin, lengths = rig.safety.stroke_margin, _lengths(rig, found.length_m)
    axes = []
    for k in pair:
        reach = min(float(np.max(np.abs(found.ranges[k]))), FARTHEST * found.limits[k])
        reach = 1.05 * max(reach, found.limits[k])
        axes.append(np.linspace(-reach, reach, SLICE))
    values = np.full((SLICE, SLICE), np.nan)
    q = np.zeros(manipulator.n)
    for i, y in enumerate(axes[1]):
        for j, x in enumerate(axes[0]):
            q[list(pair)] = x, y
            if not _outside(manipulator, q, margin):
                values[i, j] = np.linalg.cond(manipulator.jacobian(q) / lengths)
    scales = [_scale(found.rotates[k])[0] for k in pair]
    return scales[0] * axes[0], scales[1] * axes[1], values


def _outside(manipulator: Manipulator, q: Array, margin: float) -> tuple[str, ...]:
    """Actuators outside their stroke less margin; all of them where the mechanism does not close."""
    try:
        return tuple(v.actuator for v in stroke_violations(manipulator, q, margin))
    except KinematicsError:
        return manipulator.actuators


def _lengths(rig: RigFile, length_m: float) -> Array:
    return np.array([length_m if rig.rotates(c) else 1.0 for c in rig.coordinates])


def _scale(rotates: bool) -> tuple[float, str]:
    return (180.0 / np.pi, "deg") if rotates else (1e3, "mm")


def _ranges_table(found: Survey) -> str:
    head = "".join(f'<th class="n">{t}</th>' for t in ("from", "to", "range", "limit", "unit"))
    rows = "".join(
        f"<tr><td>{escape(name)}</td>"
        + "".join(f'<td class="n">{text}</td>' for text in cells)
        + "</tr>"
        for name, *cells in range_rows(found)
    )
    return f"<table><tr><th>coordinate</th>{head}</tr>{rows}</table>"


def range_rows(found: Survey) -> list[tuple[str, str, str, str, str, str]]:
    """Name, from, to, range, ±limit and unit of each coordinate, as text."""
    rows = []
    for name, rotates, (low, high), limit in zip(
        found.coordinates, found.rotates, found.ranges, found.limits, strict=True
    ):
        factor, unit = _scale(rotates)
        low, high, limit = (factor * float(x) for x in (low, high, limit))
        rows.append((name, f"{low:.1f}", f"{high:.1f}", f"{high - low:.1f}", f"±{limit:.1f}", unit))
    return rows
