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
from hil.gap.shares import above_noise, explained, largest_ratio
from hil.gap.starts import changes_of

Report = Callable[[str], None]

SINGLES: Final = 5
"""Candidates that are fitted alone."""
FIRST: Final = 3
WORTH: Final = 0.25
"""Of the best linear gain, below which none but the FIRST candidates are fitted: a gain may be illusory."""
CHANCE: Final = 3.0
"""Of the linear gain, no candidate is worth a fit below."""
PAIRS: Final = 3
"""Further effects that are tried beside the best single or pair."""
LEFT: Final = 1.35
"""Floors on any signal from which on more than one effect is looked for."""
PROMISE: Final = 0.3
"""Of what the others leave above the floor, the least that a further effect takes in the linear picture."""
ADDS: Final = 0.5
"""Of what the others leave, the least that a further effect must explain: less is how laws differ."""
WELL: Final = 0.96
"""Share explained from which on lost frames are not looked for."""
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
    return fits + _joint_fits(c, fits, search, leaves, say)


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
    least = max(WORTH * proposals[0].gain, CHANCE) if proposals else CHANCE
    out = [
        p for k, p in enumerate(proposals[:SINGLES])
        if p.gain >= (CHANCE if k < FIRST else least)
    ]  # fmt: skip
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
    for _ in ("pairs", "triples"):
        if not heads or largest_ratio(c, heads[0]) < LEFT:
            break
        new: list[Fit] = []
        for head, p in _proposed(c, heads, search, leaves):
            leaf = leaves[p.leaves[0]]
            some = (*head.leaves, leaf)
            say("fitting " + " + ".join(x.name for x in some))
            start = search.felt(changes_of([leaf], p.starts, c.problem))
            if not start:
                continue  # it changes nothing that these data would show
            joint = fit(c, some, {**_relative(c, head), **start}, p.z)
            if joint is not None and _is_itself(joint) and _adds(c, [*fits[1:], *out], joint):
                new.append(joint)
        out += new
        least = min(f.cost(c.train) + f.prior_cost for f in heads)
        better = [f for f in new if f.cost(c.train) + f.prior_cost < least]
        heads = sorted(better, key=lambda f: f.cost(c.train) + f.prior_cost)[:1]
    return out


def _adds(c: Calibrated, fits: Sequence[Fit], joint: Fit) -> bool:
    """Whether each effect of a set explains most of what the others leave, as far as those were fitted."""
    names = {leaf.name for leaf in joint.leaves}
    parts = [f for f in fits if {leaf.name for leaf in f.leaves} < names]
    return all(explained(c, f, joint) > ADDS for f in parts)


def _proposed(
    c: Calibrated, heads: Sequence[Fit], search: Search, leaves: Sequence[Leaf]
) -> list[tuple[Fit, Proposal]]:
    """Each head with the leaves that could explain much of what it leaves: most for the best head."""
    out: dict[frozenset[str], tuple[Fit, Proposal]] = {}
    for head, count in zip(heads, (PAIRS, PAIRS - 1), strict=False):
        least = PROMISE * above_noise(c, head)
        rest = Search(replace(c, z=head.z), search.bank, head.white).alone()
        able = [
            p for p in rest
            if p.gain > least and _may_join(leaves[p.leaves[0]], head.leaves)
        ]  # fmt: skip
        for p in able[:count]:
            names = frozenset({leaves[p.leaves[0]].name, *(x.name for x in head.leaves)})
            out.setdefault(names, (head, p))
    return list(out.values())


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
