"""The candidates that are worth a fit: alone, what no column shows, then two and three together.

The linear picture ranks; each of the best is fitted through the twin. Where little is left, no more are.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from hil.gap.bank import ABSOLUTE
from hil.gap.fit import Calibrated, Fit, fit
from hil.gap.frames import EFFECT as LOST
from hil.gap.frames import fit_lost_frames
from hil.gap.leaves import Leaf, Start
from hil.gap.search import Proposal, Search
from hil.gap.shares import explained, largest_ratio
from hil.gap.starts import changes_of

Report = Callable[[str], None]

SINGLES: Final = 5
"""Candidates that are fitted alone."""
WORTH: Final = 0.25
"""Of the best linear gain, below which no candidate is fitted."""
CHANCE: Final = 3.0
"""Of the linear gain, no candidate is worth a fit below."""
PAIRS: Final = 3
LEFT: Final = 1.35
"""Floors on any signal from which on more than one effect is looked for."""
WELL: Final = 0.96
"""Share explained from which on nothing more is looked for."""
FRICTION: Final = frozenset(
    {"coulomb_friction", "viscous_friction", "stribeck_friction", "asymmetric_friction", "load_friction",
     "hysteresis"}
)  # fmt: skip
PLAIN: Final = frozenset({"coulomb_friction", "viscous_friction"})
ROUNDED: Final = "sensor_quantisation"


def fit_candidates(
    c: Calibrated,
    none: Fit,
    search: Search,
    leaves: Sequence[Leaf],
    without: Collection[str],
    steps: dict[str, float],
    say: Report,
) -> list[Fit]:
    """`none`, then all that was fitted; `steps`: by signal, those that its values come in."""
    fits = [none, *_single_fits(c, none, search, leaves, without, steps, say)]
    fits = [f for f in fits if _is_itself(f)]
    return fits + [f for f in _joint_fits(c, fits, search, leaves, say) if _is_itself(f)]


def _single_fits(
    c: Calibrated,
    none: Fit,
    search: Search,
    leaves: Sequence[Leaf],
    without: Collection[str],
    steps: dict[str, float],
    say: Report,
) -> list[Fit]:
    out = []
    for k, p in enumerate(_worth_a_fit(search.alone(), leaves)):
        leaf = leaves[p.leaves[0]]
        say(f"fitting {leaf.name} ({k + 1})")
        start = search.felt(changes_of([leaf], p.starts, c.problem))
        found = fit(c, [leaf], start, p.z) if start else None
        if found is not None:
            out.append(found)
    well = max((explained(c, none, f) for f in out), default=0.0)
    if LOST not in without and well < WELL:
        say("looking for lost frames")
        lost = fit_lost_frames(c, none)
        if lost is not None:
            out.append(lost)
    out += [_rounded(c, none, signal, step) for signal, step in steps.items()]
    return out


def _worth_a_fit(proposals: Sequence[Proposal], leaves: Sequence[Leaf]) -> list[Proposal]:
    """The best proposals; where a law of friction is among them, the plain laws at its place as well."""
    least = max(WORTH * proposals[0].gain, CHANCE)
    out = [p for p in proposals[:SINGLES] if p.gain >= least]
    rubs = {x.location for x in (leaves[p.leaves[0]] for p in out) if x.effect in FRICTION}
    plain = [
        p for p in proposals[SINGLES:]
        if leaves[p.leaves[0]].effect in PLAIN and leaves[p.leaves[0]].location in rubs
        and p.gain >= CHANCE
    ]  # fmt: skip
    return out + plain


def _is_itself(f: Fit) -> bool:
    """Whether no effect of a fit has gone where it is another law of the rig's own friction near standstill:
    a hysteresis as narrow as it may be, a Stribeck curve that rises from rest."""
    if any(n.endswith(".hysteresis.displacement") for n in f.at_bound):
        return False
    value = dict(zip(f.names, f.values.tolist(), strict=True))
    return not any(
        value.get(f"{leaf.name}.static", 0.0) < value.get(f"{leaf.name}.coulomb", 0.0)
        for leaf in f.leaves
        if leaf.effect == "stribeck_friction"
    )


def _rounded(c: Calibrated, none: Fit, signal: str, step: float) -> Fit:
    """The twin whose `signal` comes in steps; values on a grid cannot be chance, so they earn by count."""
    name = f"{signal}.sensor_quantisation.step"
    leaf = Leaf(ROUNDED, signal, (name,), (Start({}, ({name: step},)),), None)
    vector = np.array(none.vector)
    vector[c.problem.table.index(name)] = step
    residual = c.problem.measured - c.problem.answers(vector)[0]
    count = sum(int(c.train[x.part].sum()) for x in c.problem.series if x.signal == signal)
    return replace(
        none, leaves=(leaf,), names=(name,), values=np.array([step]), search_sd=np.array([1e-3 * step]),
        vector=vector, residual=residual, white=c.noise.whiten(c.problem, residual),
        extra_cost=-5.0 * count,
    )  # fmt: skip


def _joint_fits(
    c: Calibrated, fits: Sequence[Fit], search: Search, leaves: Sequence[Leaf], say: Report
) -> list[Fit]:
    """Pairs and triples, where the best single or pair leaves something."""
    out: list[Fit] = []
    known = {leaf.name for leaf in leaves}
    ranked = sorted(fits[1:], key=lambda f: f.cost(c.train) + f.prior_cost + f.extra_cost)
    heads = [f for f in ranked if f.leaves[0].name in known][:2]
    for size in (2, 3):
        if not heads or largest_ratio(c, heads[0]) < LEFT or explained(c, fits[0], heads[0]) > WELL:
            break
        new: list[Fit] = []
        for p in _proposed(c, heads, search, leaves)[: PAIRS + 2 - size]:
            some = [leaves[k] for k in p.leaves]
            say("fitting " + " + ".join(leaf.name for leaf in some))
            start = search.felt(changes_of(some, p.starts, c.problem))
            head = next((h for h in heads if all(x in some for x in h.leaves)), None)
            if head is not None:
                start.update(_relative(c, head))
            if not all(set(leaf.parameters) & start.keys() for leaf in some):
                continue  # one of them changes nothing that these data would show
            joint = fit(c, some, start, p.z if head is None else head.z)
            if joint is not None:
                new.append(joint)
        out += new
        heads = sorted(new, key=lambda f: f.cost(c.train) + f.prior_cost)[:1]
    return out


def _proposed(
    c: Calibrated, heads: Sequence[Fit], search: Search, leaves: Sequence[Leaf]
) -> list[Proposal]:
    """Each head with the leaves that could explain what it leaves, best first."""
    index = {leaf.name: k for k, leaf in enumerate(leaves)}
    out: dict[tuple[int, ...], Proposal] = {}
    for head in heads:
        fixed = tuple(index[leaf.name] for leaf in head.leaves)
        rest = Search(c, search.bank, head.white).alone()
        others = [p.leaves[0] for p in rest if _may_join(leaves[p.leaves[0]], head.leaves)]
        for k in others[: PAIRS + 1]:
            found = search.set_of((*fixed, k))
            if found is not None:
                out.setdefault(tuple(sorted(found.leaves)), found)
    return sorted(out.values(), key=lambda p: -p.gain)


def _may_join(leaf: Leaf, others: Sequence[Leaf]) -> bool:
    """Whether a leaf can act beside `others`: not itself again, no second law of friction at one place."""
    return not any(
        leaf.name == x.name
        or (leaf.location == x.location and leaf.effect in FRICTION and x.effect in FRICTION)
        for x in others
    )


def _relative(c: Calibrated, f: Fit) -> dict[str, float]:
    """Values of fitted parameters as starts give them: for a twin without effects."""
    out = {}
    for name, value in zip(f.names, f.values.tolist(), strict=True):
        p = c.problem.table[name]
        now = float(c.vector[c.problem.table.index(name)])
        is_added = p.search == "linear" and np.isfinite(p.neutral) and p.parameter not in ABSOLUTE
        out[name] = value - now + p.neutral if is_added else value
    return out
