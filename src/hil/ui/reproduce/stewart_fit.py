"""The Stewart platform's parameter table: the two-stage estimate from leg lengths, and one with forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from scipy import stats

from hil.config import RigFile
from hil.identify.estimate import (
    LinearOptions,
    TwinProblem,
    grid_search,
    identify,
)
from hil.identify.estimate.fit import body_numbers
from hil.identify.estimate.gridsearch import ALIKE, GridResult
from hil.identify.estimate.names import FORCE_GAIN, with_numbers
from hil.identify.estimate.outputerror import fit
from hil.identify.replay import stretches
from hil.rigs import build_rig
from hil.ui.page import FONT
from hil.ui.reproduce import stewart_prose as prose
from hil.ui.reproduce.bench import Played
from hil.ui.reproduce.poses import DELAY
from hil.ui.reproduce.report import Lengths, Section, Table
from hil.ui.reproduce.stewart_rig import ROTATIONS, paper_model

Array = NDArray[np.float64]
K_C: Final = 25_000.0
"""N/m; K_p = 10 K_c, K_d = 0.8 s K_c of the rig file [R]."""
STATIC: Final = "all.static_ff"
COG: Final = ("mass.cog.x", "mass.cog.y", "mass.cog.z")
MOMENTS: Final = {"roll": "mass.inertia.xx", "pitch": "mass.inertia.yy", "yaw": "mass.inertia.zz"}
MASSES_KG: Final = (150.0, 600.0)
"""Bounds of m_c: the paper's, as reconstructed [R]. K_c is searched in proportion."""
GUESS: Final = {**dict.fromkeys(COG, 0.0), **dict.fromkeys(MOMENTS.values(), 200.0)}
"""Where the search begins: nothing of the truth."""


@dataclass(frozen=True, slots=True)
class Value:
    """An estimate with half of its 95 % interval."""

    value: float
    half: float

    def text(self, digits: int, factor: float = 1.0) -> str:
        """As in a table."""
        return f"{factor * self.value:.{digits}f} ± {factor * self.half:.{digits}f}"


@dataclass(frozen=True, slots=True)
class TwoStage:
    """What lengths alone tell with the paper's model, the mass being weighed."""

    values: Mapping[str, Value]
    grid: GridResult
    """Over m_c and K_c (times the fitted one)."""
    model: RigFile
    """The paper's model with these values."""

    @property
    def delay_s(self) -> float:
        """From a setpoint's frame to the drives acting on it, as the circle tells, s."""
        return self.values[DELAY].value


def two_stage(played: Mapping[str, Played], lengths: Lengths) -> TwoStage:
    """Circle first (CoG, K_c, K_s at the weighed mass), then a sweep an axis (moments, z of the CoG)."""
    rig = played["circle"].job.rig
    model = with_numbers(paper_model(rig), GUESS)
    values = _fitted(model, [played["circle"]], (*COG[:2], FORCE_GAIN, STATIC, DELAY))
    model = with_numbers(model, {n: v.value for n, v in values.items()})
    pieces = stretches(played["circle"].run)
    circle = TwinProblem(model, pieces, ("mass.m", FORCE_GAIN, DELAY), ("position",))
    # the gains of `model` are scaled already, so a gain of 1 belongs to its own mass
    shares = (MASSES_KG[0] / model.mass.m, MASSES_KG[1] / model.mass.m)
    axes = {"mass.m": (*MASSES_KG, lengths.grid), FORCE_GAIN: (*shares, lengths.grid)}
    grid = grid_search(circle, axes, rounds=1, refine=False)
    both = []
    for c in ROTATIONS:
        free = (MOMENTS[c], DELAY) if c == "yaw" else (MOMENTS[c], COG[2], DELAY)
        found = _fitted(model, [played[c]], free)
        values[MOMENTS[c]] = found[MOMENTS[c]]
        model = with_numbers(model, {MOMENTS[c]: found[MOMENTS[c]].value})
        if COG[2] in found:
            both.append(found[COG[2]])
    weights = np.array([1.0 / v.half**2 for v in both])
    values[COG[2]] = Value(
        float(np.average([v.value for v in both], weights=weights)), float(weights.sum() ** -0.5)
    )
    return TwoStage(values, grid, with_numbers(model, {COG[2]: values[COG[2]].value}))


def with_forces(played: Mapping[str, Played]) -> dict[str, Value]:
    """Ten body parameters and friction from lengths and forces of the sweeps, legs' rotors known."""
    rig = played["roll"].job.rig
    runs = [played[c].run for c in ROTATIONS]
    found = identify(runs, rig, LinearOptions(body="full")).identification
    plain = {e.name: e.value for e in found.estimates}
    values = {n: Value(v, np.nan) for n, v in body_numbers(plain).items()}
    m = found["mass.m"]
    values["mass.m"] = Value(m.value, 0.5 * (m.ci95[1] - m.ci95[0]))
    for c in "xyz":
        e = found[f"mass.first_moment.{c}"]
        values[f"mass.cog.{c}"] = Value(
            values[f"mass.cog.{c}"].value, 0.5 * (e.ci95[1] - e.ci95[0]) / m.value
        )
    for k in ("xx", "yy", "zz"):
        e = found[f"mass.origin_inertia.{k}"]
        name = f"mass.inertia.{k}"
        values[name] = Value(values[name].value, 0.5 * (e.ci95[1] - e.ci95[0]))
    return values


def table_section(played: Mapping[str, Played], stages: TwoStage) -> Section:
    """The parameter table."""
    rig = played["circle"].job.rig
    ours = with_forces(played)
    paper = stages.values
    mass = rig.mass
    moments = [mass.inertia[k][k] for k in range(3)]
    gain = paper[FORCE_GAIN]
    weighed = f"{mass.m:g}: weighed"
    rows = [
        ("m_c, kg", "“5”", f"{mass.m:g}", weighed, ours["mass.m"].text(1)),
        ("x_cog, mm", "“.5 m”", *_body(COG[0], mass.cog[0], paper, ours, 1, 1e3)),
        ("y_cog, mm", "“-.5 m”", *_body(COG[1], mass.cog[1], paper, ours, 1, 1e3)),
        ("z_cog, mm", "“.5 m”, assumed", *_body(COG[2], mass.cog[2], paper, ours, 1, 1e3)),
        ("I_xx, kg m²", "“85”", *_body(MOMENTS["roll"], moments[0], paper, ours, 1)),
        ("I_yy, kg m²", "“85”", *_body(MOMENTS["pitch"], moments[1], paper, ours, 1)),
        ("I_zz, kg m²", "“5”", *_body(MOMENTS["yaw"], moments[2], paper, ours, 1)),
        ("K_c, kN/m", "“5” N/m", f"{K_C / 1e3:g}", gain.text(2, K_C / 1e3), "not asked"),
        ("K_s", "“.997”", "0.997", paper[STATIC].text(5), "not asked"),
    ]
    rotors = rotor_moments(rig)
    head = (
        "",
        "legible in the paper",
        "given to the simulated rig",
        "its model, lengths alone (± 95 %)",
        "ours, lengths and forces (± 95 %)",
    )
    ridge = stages.grid.alike
    spread = ridge[:, 0].max() / ridge[:, 0].min()
    facts = {
        "mass_true": mass.m,
        "mass_forces": ours["mass.m"].value,
        "mass_forces_half": ours["mass.m"].half,
        "ridge_mass_ratio": float(spread),
        "ridge_points": float(len(ridge)),
        "k_c": K_C * gain.value,
        "k_s": paper[STATIC].value,
        "setpoint_delay_s": stages.delay_s,
    }
    facts |= {f"{n}_lengths": paper[n].value for n in (*COG, *MOMENTS.values())}
    facts |= {f"{n}_forces": ours[n].value for n in (*COG, *MOMENTS.values())}
    words = prose.TABLE.filled(
        ratio=spread,
        points=len(ridge),
        all=len(stages.grid.points),
        xx=paper[MOMENTS["roll"]].value,
        true_xx=moments[0],
        rotor_xx=rotors[0],
        zz=paper[MOMENTS["yaw"]].value,
        true_zz=moments[2],
        rotor_zz=rotors[2],
        z_half=1e3 * paper[COG[2]].half,
        x_half=1e3 * paper[COG[0]].half,
        m_half=ours["mass.m"].half,
    )
    figure = ridge_figure(stages.grid, gain.value, mass.m)
    return Section(words, (figure,), Table(head, tuple(rows)), facts)


def ridge_figure(grid: GridResult, scale: float, mass_kg: float) -> go.Figure:
    """Rise of -2 log likelihood over m_c and K_c, and the points that nothing tells apart."""
    masses, gains = (np.unique(grid.points[:, k]) for k in (0, 1))
    rise = grid.rise.reshape(len(masses), len(gains))
    k_c = K_C * scale * gains / 1e3
    figure = go.Figure(
        go.Heatmap(
            x=masses,
            y=k_c,
            z=np.log10(1.0 + rise.T),
            colorscale="Viridis_r",
            colorbar={"title": {"text": "log₁₀(1 + rise)"}},
            hovertemplate="m %{x:.0f} kg, K_c %{y:.1f} kN/m: %{z:.2f}<extra></extra>",
        )
    )
    alike = grid.rise < ALIKE
    figure.add_scatter(
        x=grid.points[alike, 0],
        y=K_C * scale * grid.points[alike, 1] / 1e3,
        mode="markers",
        marker={"symbol": "circle-open", "size": 14, "color": "#dc2626", "line": {"width": 2}},
        name="as good as the best (95 %)",
    )
    line = np.array(MASSES_KG)
    figure.add_scatter(
        x=line,
        y=K_C * scale / 1e3 * line / mass_kg,
        mode="lines",
        line={"color": "#dc2626", "dash": "dot", "width": 1.5},
        name="K_c in proportion to m_c",
    )
    figure.add_scatter(
        x=[mass_kg],
        y=[K_C / 1e3],
        mode="markers",
        marker={"symbol": "star", "size": 15, "color": "#0f172a"},
        name="given to the simulated rig",
    )
    figure.update_xaxes(title_text="m_c, kg")
    figure.update_yaxes(title_text="K_c, kN/m", range=[float(k_c[0]) * 0.6, float(k_c[-1]) * 1.1])
    figure.update_layout(
        height=420, template="plotly_white", font=FONT,
        margin={"l": 70, "r": 20, "t": 50, "b": 46},
        legend={"orientation": "h", "y": 1.02, "yanchor": "bottom"},
    )  # fmt: skip
    return figure


def rotor_moments(rig: RigFile) -> Array:
    """(3,) what the legs' rotor masses add about roll, pitch and yaw at neutral, kg m²."""
    bare = with_numbers(rig, {"all.reflected_mass": 0.0})
    q = np.zeros(len(rig.coordinates))
    more = build_rig(rig).mass_matrix(q) - build_rig(bare).mass_matrix(q)
    return np.asarray(np.diag(more)[3:])


def _fitted(model: RigFile, played: Sequence[Played], names: tuple[str, ...]) -> dict[str, Value]:
    pieces = [piece for p in played for piece in stretches(p.run)]
    found = fit(TwinProblem(model, pieces, names, ("position",)))
    reach = float(stats.t.ppf(0.975, found.dof))
    half = reach * np.sqrt(np.diag(found.covariance))
    return {n: Value(float(v), float(h)) for n, v, h in zip(names, found.values, half, strict=True)}


def _body(
    name: str,
    true: float,
    paper: Mapping[str, Value],
    ours: Mapping[str, Value],
    digits: int,
    factor: float = 1.0,
) -> tuple[str, str, str]:
    return (
        f"{factor * true:g}",
        paper[name].text(digits, factor),
        ours[name].text(digits, factor),
    )
