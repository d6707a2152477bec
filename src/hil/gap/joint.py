"""Two and three candidates together, where the best alone leave something; lost frames beside others."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Final

from hil.gap.evidence import ALIKE, distance
from hil.gap.fit import Calibrated, Fit, fit
from hil.gap.frames import EFFECT as LOST
from hil.gap.frames import fit_lost_frames
from hil.gap.friction import is_itself, may_join
from hil.gap.leaves import Leaf
from hil.gap.search import Proposal, Search
from hil.gap.shares import above_noise, explained, largest_ratio
from hil.gap.starts import changes_of, relative

Report = Callable[[str], None]

PAIRS: Final = 3
"""Further effects that are tried beside the best single or pair."""
LEFT: Final = 1.15
"""Floors on any signal from which on more than one effect is looked for."""
PROMISE: Final = 0.15
"""Of what the others leave above the floor, the least that a further effect takes in the linear picture."""
NATS: Final = 40.0
"""The least that it takes at all: of the loss of fits, where samples count as if they were independent."""
ADDS: Final = 0.5
"""Of what the others leave, the least that a further effect must explain: less is how laws differ."""


def joint_fits(
    c: Calibrated,
    fits: Sequence[Fit],
    search: Search,
    leaves: Sequence[Leaf],
    without: Collection[str],
    say: Report,
) -> list[Fit]:
    """Pairs and triples; `fits`: the twin without effects, then single ones."""
    out: list[Fit] = []
    known = {leaf.name for leaf in leaves}
    ranked = sorted(fits[1:], key=lambda f: _cost(c, f))
    heads = _unlike(c, [f for f in ranked if f.leaves[0].name in known])
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
            joint = fit(c, some, {**relative(c, head), **start}, p.z)
            if joint is not None and is_itself(joint) and _adds(c, [*fits[1:], *out], joint):
                new.append(joint)
        out += new
        least = min(_cost(c, f) for f in heads)
        heads = sorted((f for f in new if _cost(c, f) < least), key=lambda f: _cost(c, f))[:1]
    if LOST not in without:
        out += _with_lost(c, fits, out, known, say)
    return out


def _unlike(c: Calibrated, ranked: Sequence[Fit]) -> list[Fit]:
    """The best fit, and the best of those that do not answer as it does."""
    return [*ranked[:1], *(f for f in ranked[1:] if distance(c, ranked[0], f) > ALIKE)][:2]


def _cost(c: Calibrated, f: Fit) -> float:
    return f.cost(c.train) + f.prior_cost + f.extra_cost


def _with_lost(
    c: Calibrated, fits: Sequence[Fit], joint: Sequence[Fit], known: Collection[str], say: Report
) -> list[Fit]:
    """Lost frames beside the best of the other fits, where that leaves something."""
    others = [f for f in (*fits[1:], *joint) if f.leaves[0].name in known]
    best = min(others, key=lambda f: _cost(c, f), default=None)
    if best is None or above_noise(c, best) < NATS:
        return []
    say("looking for lost frames beside " + " + ".join(x.name for x in best.leaves))
    found = fit_lost_frames(c, best)
    return [found] if found is not None and _adds(c, [*fits[1:], *joint], found) else []


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
        least = max(PROMISE * above_noise(c, head), NATS)
        rest = Search(replace(c, z=head.z), search.bank, head.white).alone()
        able = [p for p in rest if p.gain > least and may_join(leaves[p.leaves[0]], head.leaves)]
        for p in able[:count]:
            names = frozenset({leaves[p.leaves[0]].name, *(x.name for x in head.leaves)})
            out.setdefault(names, (head, p))
    return list(out.values())
