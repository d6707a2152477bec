"""The motorcycle platform's figure 8: mass and inertias by the adaptive law, beside least squares."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.identify.estimate import AdaptiveGradient, Identification, LinearOptions, identify
from hil.identify.estimate.body import force_rows
from hil.identify.estimate.linear import weighted
from hil.identify.estimate.prepare import Prepared, cutoff_of, prepare
from hil.identify.estimate.regression import Regression, regression
from hil.identify.experiments import Chirp
from hil.identify.replay import stretches
from hil.rigs.pack import kind_code, pack_geometry, pack_gravity, pack_legs, pack_reflected
from hil.ui.page import PALETTE
from hil.ui.reproduce.bench import Job, Played
from hil.ui.reproduce.curves import COMMANDED, Curve, Panel, panels
from hil.ui.reproduce.motorcycle_prose import ADAPTING
from hil.ui.reproduce.report import Lengths, Section, Table

Array = NDArray[np.float64]
DRIVEN: Final = ("yaw", "pitch", "roll")
SHOWN: Final = {"mass.m": ("m", "kg"), "mass.inertia.xx": ("I1", "kg m²"),
                "mass.inertia.yy": ("I2", "kg m²"), "mass.inertia.zz": ("I3", "kg m²")}  # fmt: skip
GAIN: Final = 0.003
"""Rows after which each parameter has gone 1/e of its way, inverse: by trial, as the paper's gains."""
PASSES: Final = 4
PAPER, OURS, UNBIASED = PALETTE[1], PALETTE[5], PALETTE[0]


def jobs(rig: RigFile, lengths: Lengths) -> list[Job]:
    """One chirp a coordinate, the others held."""
    return [
        Job(
            f"alone_{c}",
            Chirp(
                coordinates=(c,),
                share=0.7,
                f_min=0.3,
                f_max=3.0,
                duration_s=lengths.chirp_s,
                fade_s=1.5,
            ),
            rig,
            seed=k + 1,
        )
        for k, c in enumerate(DRIVEN)
    ]


@dataclass(frozen=True, slots=True)
class History:
    """Parameters of the law over its record."""

    t_s: Array
    """(N,) the runs one after another, as often as they were passed."""
    values: Array
    """(N, 4) m, I1, I2, I3."""
    worst: float
    """Largest dt eig(K YᵀY) of a step: stable below 2."""

    @property
    def final(self) -> Array:
        """(4,) mean over the last pass, in which single steps still wander."""
        return np.asarray(self.values[-len(self.values) // PASSES :].mean(axis=0))


def adapting_section(played: Mapping[str, Played]) -> Section:
    """Figure 8."""
    runs = [played[f"alone_{c}"] for c in DRIVEN]
    rig = runs[0].job.rig
    problem = problem_of(runs)
    linear = weighted(problem)
    sigma_n = linear.sigma_n
    paper = history(problem, as_printed(problem, rig), 4, sigma_n)
    ours = history(problem, problem.y, len(problem.columns), sigma_n)
    found = identify([p.run for p in runs], rig, LinearOptions(method="wls")).identification
    told = np.array([e.value for e in found.estimates])
    # what least squares was corrected by biases every estimator of these rows alike
    bias = (linear.values - told)[:4]
    raw = problem_of(runs, differenced)
    plain = history(raw, raw.y, len(raw.columns), sigma_n)
    figure = panels(
        [_panel(k, paper, ours, bias[k], found) for k in range(4)], columns=2, height=240
    )  # fmt: skip
    rows, facts = [], {"adaptive_step": ours.worst}
    for k, (name, (short, unit)) in enumerate(SHOWN.items()):
        e = found[name]
        rows.append(
            (
                f"{short}, {unit}",
                f"{e.nominal:.1f}",
                f"{paper.final[k]:.1f}",
                f"{plain.final[k]:.1f}",
                f"{ours.final[k]:.1f}",
                f"{ours.final[k] - bias[k]:.1f}",
                f"{e.value:.2f}",
                f"{e.ci95[0]:.2f} … {e.ci95[1]:.2f}",
            )
        )
        key = name.removeprefix("mass.").replace(".", "_")
        facts |= {
            f"{key}_true": e.nominal,
            f"{key}_paper_law": float(paper.final[k]),
            f"{key}_law": float(ours.final[k]),
            f"{key}_law_unbiased": float(ours.final[k] - bias[k]),
            f"{key}_wls": e.value,
            f"{key}_low": e.ci95[0],
            f"{key}_high": e.ci95[1],
        }
    friction_of = {n: found[n] for n in ("leg1.viscous", "leg1.coulomb", "slide.coulomb")}
    friction = ", ".join(
        f"{n.replace('.', ' ')} {e.value:.3g} {e.unit} (true {e.nominal:g})"
        for n, e in friction_of.items()
    )
    words = ADAPTING.filled(
        wrong=paper.final[2],
        right=found["mass.inertia.yy"].nominal,
        friction=friction,
        bias=abs(bias[2]),
        law=ours.final[2] - bias[2],
        least=found["mass.inertia.yy"].value,
        worst=ours.worst,
        held=sum(found[n].ci95[0] <= found[n].nominal <= found[n].ci95[1] for n in SHOWN),
    )
    head = (
        "",
        "true (rig file)",
        "law, platform alone",
        "law, projected, plain differences",
        "law, projected",
        "law, projected, less bias",
        "least squares",
        "95 %",
    )
    return Section(words, (figure,), Table(head, tuple(rows)), facts)


def problem_of(
    runs: Sequence[Played], change: Callable[[Played, Prepared], Prepared] | None = None
) -> Regression:
    """The linear problem of all runs, through one filter, or as `change` makes of that."""
    rig = runs[0].job.rig
    pieces = [(p, piece) for p in runs for piece in stretches(p.run)]
    cutoff_hz = min(cutoff_of(piece, rig) for _, piece in pieces)
    made = [(p, prepare(piece, rig, cutoff_hz)) for p, piece in pieces]
    return regression(rig, [change(*m) if change else m[1] for m in made], cutoff_hz)


def differenced(played: Played, prepared: Prepared) -> Prepared:
    """The same instants with plain differences of the samples for speed and acceleration."""
    rig, t = played.job.rig, prepared.t_s
    step_s = float(np.median(np.diff(t)))

    def samples(quantity: str) -> Array:
        series = [played.samples(f"{a}.{quantity}") for a in rig.actuator_names]
        return np.column_stack([np.interp(t, *s) for s in series])

    rho = samples("position")
    speed = np.gradient(rho, step_s, axis=0)
    acceleration = np.gradient(speed, step_s, axis=0)
    qd, qdd = np.zeros_like(rho), np.zeros_like(rho)
    body, own = np.empty_like(prepared.body), np.empty_like(prepared.own)
    force_rows(
        kind_code(rig), pack_geometry(rig), pack_legs(rig), pack_gravity(rig),
        prepared.q, speed, acceleration, qd, qdd, body, own,
    )  # fmt: skip
    return replace(
        prepared,
        rho=rho, rho_dot=speed, rho_ddot=acceleration, qd=qd, qdd=qdd,
        force=samples("force"), sign=np.sign(speed), body=body, own=own,
    )  # fmt: skip


def as_printed(problem: Regression, rig: RigFile) -> Array:
    """Forces (N, n) that the paper's model has to explain: rotors not taken off."""
    acceleration = np.concatenate([p.rho_ddot for p in problem.prepared])
    return np.asarray(problem.y + pack_reflected(rig) * acceleration)


def history(problem: Regression, force: Array, unknowns: int, sigma_n: Array) -> History:
    """Law (36) with a step a row over the first `unknowns` columns, from zero.

    Rows of an actuator are divided by its noise sigma_n (n,). K is diagonal: GAIN over each column's mean
    square, so that all parameters go at one pace.
    """
    weight = problem.keep / sigma_n
    Y = problem.W[:, :, :unknowns] * weight[:, :, None]
    tau = force * weight
    gain = GAIN / np.mean(np.sum(Y**2, axis=1), axis=0)
    law = AdaptiveGradient(np.zeros(unknowns), gain, normalised=False)
    values = np.empty((PASSES * len(Y), 4))
    for k in range(len(values)):
        law.update(Y[k % len(Y)], tau[k % len(Y)])
        values[k] = law.values[:4]
    step_s = float(np.median(np.diff(problem.prepared[0].t_s)))
    return History(np.asarray(step_s * np.arange(len(values))), values, law.worst)


def _panel(k: int, paper: History, ours: History, bias: float, found: Identification) -> Panel:
    name, (short, unit) = list(SHOWN.items())[k]
    e = found[name]
    t = ours.t_s
    ends = np.array([t[0], t[-1]])
    half = np.full(2, 0.5 * (e.ci95[1] - e.ci95[0]))
    curves = [
        Curve("law (36), platform alone", paper.t_s, paper.values[:, k], PAPER),
        Curve("law (36), projected, friction estimated", t, ours.values[:, k], OURS),
        Curve("the same, less the sampling's bias", t, ours.values[:, k] - bias, UNBIASED),
        Curve("least squares, 95 %", ends, np.full(2, e.value), PALETTE[2], "dash", half),
        Curve("true", ends, np.full(2, e.nominal), COMMANDED, "dot"),
    ]
    return Panel(short, "time of the records, s", unit, curves)
