"""One self-contained page of a diagnosis: what an engineer would hand to a colleague."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any, Final

import numpy as np
from plotly.graph_objects import Figure

from hil.errors import IdentificationError
from hil.gap import Diagnosis
from hil.gap.iso18571 import rate
from hil.ui.calibration_table import beside_effects, calibration_note, calibration_table
from hil.ui.diagnosis_data import Curves, best_first, curves, worst
from hil.ui.diagnosis_figures import evidence_figure, signal_figure, state_figure
from hil.ui.gap_figures import map_figure
from hil.ui.page import page, table
from hil.units import with_unit

SHOWN: Final = 3
"""Signals shown over time."""
_COLOUR: Final = {
    "identified": "#dc2626", "ambiguous": "#d97706", "unknown": "#7c3aed", "no_gap": "#16a34a",
}  # fmt: skip
_HELD = "shaded: held out, no fit has seen it; blank: not judged"
_SIGNALS: Final = (
    "Before, floor and times: of the whole record, each signal by itself. After: of what fits have seen. "
    "(The verdict's figures are of what they have not seen.) Likeness after ISO/TS 18571 rates corridor, "
    "phase, magnitude and slope from 0 to 1. It knows no noise floor and no cause: judge by floors."
)


def diagnosis_page(found: Diagnosis, out_html: Path, references: Sequence[str] = ()) -> Path:
    """Write the page about `found` to `out_html` and return that. RunError where it cannot be written.

    `references`: names of the healthy runs that it was calibrated on.
    """
    all_curves = curves(found)
    sections: list[tuple[str, str, Figure | str]] = [("Verdict", "", _verdict(found))]
    if found.located.findings:
        sections.append(("About the data", "", _findings(found)))
    if found.causes:
        sections.append(
            ("Causes", "Every candidate that was fitted through the twin, best first. Causes of one class "
             "cannot be told apart on these data. Intervals: 90 %.", _causes(found))
        )  # fmt: skip
        sections.append(
            ("Evidence", "Probability over all sets that hold the candidate; nats that the training data "
             "speak for it over no effect, freedom and autocorrelation paid for; what it takes off data that "
             "no fit has seen. Blue: the verdict.", evidence_figure(found))
        )  # fmt: skip
    sections.append(
        ("Gap map", "How many times its noise floor the residual is after calibration, by frequency band and "
         "by region of operation; written in: share of the whole explainable gap.",
         map_figure(found.located))
    )  # fmt: skip
    sections += [
        (
            f"Measured against twin: {escape(c.signal)}",
            f"{escape(c.name)}; {_HELD}",
            signal_figure(c),
        )
        for c in _shown(found, all_curves)
    ]
    state = state_figure(found, all_curves)
    if state is not None:
        sections.append(
            ("Measured minus twin over velocity and position", "Points: before. Lines: medians, over "
             "position by direction of travel, so that a loop between forth and back is hysteresis. A step "
             "at zero velocity is Coulomb friction, a slope viscous friction, a wave over position ripple. "
             "Where forces were set: the acceleration that the twin lacks.",
             state)
        )  # fmt: skip
    sections.append(("What these data cannot tell", "", _limits(found)))
    if found.next_experiment is not None:
        sections.append(("Next experiment", "", _pairs(found.next_experiment)))
    sections.append(("Signals", _SIGNALS, _signals(found, all_curves)))
    sections.append(
        (
            "Calibration that was taken out first",
            calibration_note(found, references),
            _nuisances(found),
        )
    )
    sections.append(("How it was computed", "", _method(found)))
    runs = escape(" · ".join(found.located.runs))
    if references:
        runs += escape(f"; what has changed since {' · '.join(references)}")
    return page(out_html, escape(f"{found.located.rig}: diagnosis of the gap"), runs, sections)


def _shown(found: Diagnosis, all_curves: Sequence[Curves]) -> list[Curves]:
    """For each of the worst signals the stretch with held-out data, else the last."""
    out = []
    for signal in worst(found, SHOWN):
        mine = [c for c in all_curves if c.signal == signal]
        held = [c for c in mine if c.held_from_s is not None]
        out += (held or mine)[-1:]
    return out


def _verdict(found: Diagnosis) -> str:
    colour = _COLOUR[found.verdict]
    text = (
        f'<p style="border-left:5px solid {colour};padding-left:14px;font-size:19px;margin:0 0 12px">'
        f"{escape(found.sentence)}</p>"
    )
    s = found.score
    if s is None:
        return text
    facts = [
        ("verdict", found.verdict),
        ("held-out rms before", f"{s.before:.2f}"),
        ("after", f"{s.after:.2f}"),
        ("floor", f"{s.floor:.2f}"),
    ]
    if s.shrink is not None:
        facts.append(("explainable gap gone", f"{100.0 * s.shrink:.0f} %"))
    if s.shrink_ci is not None:
        facts.append(("90 %", f"{100 * s.shrink_ci[0]:.0f} … {100 * s.shrink_ci[1]:.0f} %"))
    facts.append(("none of these", f"{100.0 * found.unknown:.1f} %"))
    cells = "".join(
        f'<div style="margin-right:34px"><div style="color:#64748b;font-size:13px">{escape(name)}</div>'
        f'<div style="font-size:20px">{escape(value)}</div></div>'
        for name, value in facts
    )
    over = escape(", ".join(s.signals))
    return (
        f'{text}<div style="display:flex;flex-wrap:wrap">{cells}</div>'
        f'<p class="note" style="margin-top:8px">Root mean squares in noise floors, over {over}, on '
        f"{escape(found.held_out)} alone, which no fit has seen.</p>"
    )


def _findings(found: Diagnosis) -> str:
    colour = {"error": "#b91c1c", "warning": "#92400e", "info": "inherit"}
    return _list(
        f'<span style="color:{colour[f.severity]}"><b>{escape(f.subject)}</b>: {escape(f.text)}</span>'
        for f in found.located.findings
    )


def _causes(found: Diagnosis) -> str:
    rows = []
    for c in best_first(found):
        values = "<br>".join(
            f"{escape(name)} "
            + escape(with_unit(f"{p.value:.4g} ({p.ci[0]:.4g} … {p.ci[1]:.4g})", p.unit))
            + (" <b>at its bound</b>" if p.at_bound else "")
            for name, p in c.parameters.items()
        )
        name = f"{c.effect.replace('_', ' ')} at {c.location}"
        rows.append(
            (f"<b>{escape(name)}</b>" if c in found.effects else escape(name), f"{c.probability:.3f}",
             str(c.group), values, "" if c.shrink is None else f"{100.0 * c.shrink:.0f} %",
             f"{c.gain:.0f}")
        )  # fmt: skip
    heads = ("cause", "probability", "class", "parameters", "shrink", "gain, nats")
    return table(heads, rows, numbers=(1, 2, 4, 5))


def _limits(found: Diagnosis) -> str:
    lines = [
        f"Not to be told apart here: {escape(', '.join(group))}."
        for group in found.tables()["classes"]
        if len(group) > 1
    ]
    if found.not_excited:
        lines.append(
            "Not excited, and so neither found nor excluded: "
            + escape(", ".join(found.not_excited))
            + "."
        )
    if found.score is None:
        lines.append("What stays below the floor: an effect smaller than that is not seen.")
    return (
        _list(lines)
        if lines
        else "<p>Every candidate would have shown, and none looks like another.</p>"
    )


def _signals(found: Diagnosis, all_curves: Sequence[Curves]) -> str:
    gap = found.tables()["gap"]["signals"]
    rows = []
    for s in found.located.signals:
        after = gap[s.signal].get("after")
        unit = escape(s.unit)
        rows.append(
            (escape(s.signal), f"{s.before:.3g} {unit}",
             "" if after is None else f"{after:.3g} {unit}", f"{s.noise_floor:.3g} {unit}", f"{s.ratio:.2f}",
             f"{100.0 * s.share:.0f} %", *_ratings(all_curves, s.signal))
        )  # fmt: skip
    heads = ("signal", "off before (rms)", "after", "floor", "times", "share of gap",
             "ISO/TS 18571 before", "after: corridor, phase, magnitude, slope")  # fmt: skip
    return table(heads, rows, numbers=(1, 2, 3, 4, 5, 6))


def _ratings(all_curves: Sequence[Curves], signal: str) -> tuple[str, str]:
    """Of the signal's longest stretch: overall before, and all of after (else of before)."""
    c = max((c for c in all_curves if c.signal == signal), key=lambda c: len(c.t), default=None)
    if c is None:
        return "", ""
    try:
        before = rate(c.t, c.measured, c.before)
        after = rate(c.t, c.measured, c.after) if np.isfinite(c.after).all() else before
    except IdentificationError as error:
        return "", escape(str(error))
    parts = (after.corridor, after.phase, after.magnitude, after.slope)
    return f"{before.overall:.3f} {before.grade}", (
        f"<b>{after.overall:.3f}</b> {after.grade}: {', '.join(f'{v:.3f}' for v in parts)}"
    )


def _nuisances(found: Diagnosis) -> str:
    known = () if found.calibrated is None else found.calibrated.nuisances
    means = {n.name: n.mean for n in known}
    return calibration_table(found.located.nuisances, means, beside_effects(found))


def _method(found: Diagnosis) -> str:
    held = escape(found.held_out)
    return _list(
        (
            f"Floor: {escape(found.located.floor_text)}.",
            "Before anything is called a gap, what a calibration would remove is refitted within its priors: "
            f"{escape(_kinds(found))}. Every candidate is fitted with these free.",
            "Candidates: every effect of the catalogue at every place where the recorded signals could show "
            "it; the best are fitted through the whole twin, alone and together.",
            "Evidence: residuals whitened by the floor's own autocorrelation, robust to single outliers, "
            "freedom paid for by Laplace's approximation.",
            f"Held out: {held}. Nothing was chosen or fitted on it; intervals by drawing blocks of a second "
            "again.",
            "Shrink: (before − after) / (before − floor). It can pass 100 % where after falls below the "
            "floor.",
        )
    )


def _kinds(found: Diagnosis) -> str:
    """What the nuisances are, by the catalogue's names."""
    names = (n.name.split(".")[-2].replace("_", " ") for n in found.located.nuisances)
    return ", ".join(dict.fromkeys(names))


def _pairs(proposal: dict[str, Any]) -> str:
    rows = [(escape(str(k)), escape(str(v))) for k, v in proposal.items()]
    return table(("", ""), rows)


def _list(items: Iterable[str]) -> str:
    return "<ul>" + "".join(f"<li>{item}</li>" for item in items) + "</ul>"
