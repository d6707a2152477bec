"""The calibration of a page: where each nuisance went, what was expected, where it stands beside an effect.

Before any effect is in the twin a nuisance at its bound says that there is a gap, which it tries to swallow.
With the effect in it must be back.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

from hil.gap import Diagnosis
from hil.gap.catalogue.nuisances import LIMIT
from hil.gap.located.residual import Fitted
from hil.ui.page import table
from hil.units import with_unit

AT: Final = 1e-3
"""Prior deviations by which what stands at its bound may miss it."""
ALONE: Final = (
    "Where the twin without any effect puts them, each within what a healthy rig may be off its file. One at "
    "its bound has met something larger than a calibration sets right: a gap, or a wrong number in the rig "
    "file."
)
BESIDE: Final = (
    " With the named effect in the twin they must be back (last columns); one that is at its bound there, "
    "too, is an alarm: the rig file is wrong in it, or something else acts."
)


@dataclass(frozen=True, slots=True)
class Beside:
    """A nuisance with the named effects in the twin."""

    change: float
    """From the rig file's value."""
    at_bound: bool


def beside_effects(found: Diagnosis) -> dict[str, Beside]:
    """Of each nuisance that is no parameter of the named effects; empty where none is named."""
    c, best = found.calibrated, found.best
    if c is None or best is None or not found.effects:
        return {}
    own = {name for leaf in best.leaves for name in leaf.parameters}
    return {
        n.name: Beside(n.mean + n.sd * z, abs(z) > LIMIT - AT)
        for n, z in zip(c.nuisances, best.z.tolist(), strict=True)
        if n.name not in own
    }


def calibration_note(found: Diagnosis, references: Sequence[str]) -> str:
    """What the table shows and what one at its bound means, in HTML."""
    text = ALONE + (BESIDE if beside_effects(found) else "")
    if references:
        names = escape(", ".join(references))
        text += f" Expected is what the healthy references ({names}) have, ± how far a rig drifts from them."
    return text


def calibration_table(
    fitted: Sequence[Fitted],
    means: Mapping[str, float] | None = None,
    beside: Mapping[str, Beside] | None = None,
) -> str:
    """HTML of the nuisances `fitted`; `means`: of priors that references moved away from the rig file's."""
    heads = ["parameter", "off the rig file by", "expected", ""]
    if beside:
        heads += ["with the effect", ""]
    is_moved = any((means or {}).values())
    rows = []
    for n in fitted:
        mean = f"{(means or {}).get(n.name, 0.0):+.3g} " if is_moved else ""
        row = [
            escape(n.name), escape(with_unit(f"{n.change:+.3g} ± {n.sd:.1g}", n.unit)),
            f"{mean}± {n.prior_sd:.2g}", _bound(n.at_bound),
        ]  # fmt: skip
        if beside:
            b = beside.get(n.name)
            row += (
                ["is the effect", ""]
                if b is None
                else [escape(with_unit(f"{b.change:+.3g}", n.unit)), _bound(b.at_bound)]
            )
        rows.append(row)
    return table(heads, rows, numbers=(1, 2, 4))


def _bound(is_there: bool) -> str:
    return "<b>at its bound</b>" if is_there else ""
