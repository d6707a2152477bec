"""Two and three candidates together, where the best alone leave something; lost frames beside others."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Final

import numpy as np

from hil.gap.catalogue.nature import LIMITS
from hil.gap.fits.evidence import ALIKE, distance
from hil.gap.fits.fit import fit
from hil.gap.fits.fitted import Calibrated, Fit, loss, spread_of
from hil.gap.fits.frames import EFFECT as LOST
from hil.gap.fits.frames import fit_lost_frames
from hil.gap.fits.friction import is_itself, may_join
from hil.gap.fits.shares import RARE, above_noise, most_left
from hil.gap.fits.starts import changes_of, relative
from hil.gap.record.leaf import Leaf
from hil.gap.search.linear import Proposal, Search
from hil.gap.search.replayed import left_by
from hil.gap.search.standing import BROUGHT_BACK, adds, cost_of
from hil.gap.search.unseen import (
    AS_GOOD,
    MOST,
    NATS,
    PROMISE,
    SWAPS,
    exchanged,
    unseen_pairs,
    unseen_triples,
)

Report = Callable[[str], None]

PAIRS: Final = 3
"""Further effects that are tried beside the best single or pair."""
LEFT: Final = 1.1
"""Floors on any signal from which on more than one effect is looked for."""
NEARLY: Final = 0.7
"""Of what an effect of the best set explains alone, what another must to be tried in its place; and of its
trace, by how much less the two must differ."""


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
    singles = sorted(
        (f for f in fits[1:] if f.leaves[0].name in known), key=lambda f: cost_of(c, f)
    )
    heads = _unlike(c, singles)
    for _ in ("pairs", "triples"):
        if not heads or is_whole(c, heads[0], LEFT):
            break
        new: list[Fit] = []
        tried: list[Fit] = []
        for head, p in _proposed(c, heads, search, leaves):
            leaf = leaves[p.leaves[0]]
            some = (*head.leaves, leaf)
            say("fitting " + " + ".join(x.name for x in some))
            start = search.felt(changes_of([leaf], p.starts, c.problem), p)
            if not start:
                continue  # it changes nothing that these data would show
            joint = fit(c, some, {**relative(c, head), **start}, p.z, found=head.names)
            if joint is not None and is_itself(c, joint):
                tried.append(joint)
                new += [joint] if adds(c, [*fits[1:], *out], joint) else []
        if most_left(c, heads[0]) > RARE:
            new += [f for f in _limited(c, heads[0], leaves, say) if adds(c, [*fits[1:], *out], f)]
        if not out:
            new += unseen_pairs(c, fits, new, search, leaves, say)
        new += _swapped(c, fits, singles, new, say)
        new += exchanged(c, [*fits[1:], *out, *new], [*tried, *new], search, leaves, say)
        new += _as_good(c, [*fits[1:], *out, *new], new, search, leaves, say)
        out += new
        least = min(cost_of(c, f) for f in heads)
        best = heads[0]
        heads = sorted((f for f in new if cost_of(c, f) < least), key=lambda f: cost_of(c, f))[:1]
        if not heads:
            out += unseen_triples(c, [*fits[1:], *out], best, search, leaves, say)
    if LOST not in without:
        out += _with_lost(c, fits, out, known, say)
    return out


def is_whole(c: Calibrated, head: Fit, left: float) -> bool:
    """Whether a fit leaves nothing, `left` floors at most, that a further effect could explain or bring
    nuisances back by."""
    return most_left(c, head) < left and head.prior_cost < BROUGHT_BACK


def _limited(c: Calibrated, head: Fit, leaves: Sequence[Leaf], say: Report) -> list[Fit]:
    """`head` with the limit beside it whose starts, replayed there, leave least; none where all leave more.

    How hard a limit is hit changes with whatever else acts: what it does alone says little of that.
    """
    spread = spread_of(c, head.white)
    least, found = float(np.sum(loss(head.white[c.train] / spread))), None
    for leaf in leaves:
        if leaf.effect not in LIMITS or not may_join(leaf, head.leaves):
            continue
        limit, knee = leaf.parameters
        values = [s.columns[0][limit] for s in leaf.starts]
        costs = left_by(c, head, [limit], [(value,) for value in values])
        best = int(np.argmin(costs))
        if costs[best] < least:
            least, found = costs[best], (leaf, {limit: values[best], knee: 0.0})
    if found is None:
        return []
    leaf, start = found
    say("fitting " + " + ".join(x.name for x in (*head.leaves, leaf)))
    joint = fit(c, [*head.leaves, leaf], {**relative(c, head), **start}, head.z, found=head.names)
    return [joint] if joint is not None and is_itself(c, joint) else []


def _unlike(c: Calibrated, ranked: Sequence[Fit]) -> list[Fit]:
    """The best fit and the best of those that do not answer as it does, of each its simplest like."""
    best = ranked[:1]
    others = [f for f in ranked[1:] if distance(c, best[0], f) > ALIKE][:1]
    return [
        min((f for f in ranked if distance(c, h, f) <= ALIKE), key=lambda f: len(f.names))
        for h in (*best, *others)
    ]


def _swapped(
    c: Calibrated, fits: Sequence[Fit], singles: Sequence[Fit], new: Sequence[Fit], say: Report
) -> list[Fit]:
    """The best of `new` sets with one effect exchanged for another that alone explains nearly as much.

    What a set was begun with is what looks best alone: a delay and a latency change places beside others.
    """
    best = min(new, key=lambda f: cost_of(c, f), default=None)
    if best is None:
        return []
    alone = {f.leaves[0].name: f for f in singles}
    have = {leaf.name for f in new for leaf in f.leaves}
    tries = [
        (leaf, x) for x in singles for leaf in best.leaves
        if x.leaves[0].name not in have and leaf.name in alone and _is_near(c, fits[0], alone[leaf.name], x)
        and may_join(x.leaves[0], [y for y in best.leaves if y is not leaf])
    ]  # fmt: skip
    out = []
    for leaf, x in tries[:SWAPS]:
        some = (*(y for y in best.leaves if y is not leaf), *x.leaves)
        say("fitting " + " + ".join(y.name for y in some))
        kept = {n: v for n, v in relative(c, best).items() if n not in leaf.parameters}
        joint = fit(c, some, kept | relative(c, x), best.z, found=(*kept, *x.names))
        if joint is not None and is_itself(c, joint) and adds(c, [*fits[1:], *new], joint):
            out.append(joint)
    return out


def _as_good(
    c: Calibrated,
    fits: Sequence[Fit],
    new: Sequence[Fit],
    search: Search,
    leaves: Sequence[Leaf],
    say: Report,
) -> list[Fit]:
    """The best of `new` sets with one effect exchanged for what the linear picture hardly tells from it
    beside the others: what looks best alone need not be what is there."""
    best = min(new, key=lambda f: cost_of(c, f), default=None)
    if best is None:
        return []
    tries = []
    for leaf in best.leaves:
        others = [x for x in best.leaves if x is not leaf]
        head = min((f for f in fits if f.is_of(others)), key=lambda f: cost_of(c, f), default=None)
        if head is None and len(others) > 1:  # of what was exchanged, never fitted without it
            say("fitting " + " + ".join(x.name for x in others))
            kept = {n: v for n, v in relative(c, best).items() if n not in leaf.parameters}
            head = fit(c, others, kept, best.z, found=tuple(kept))
        if head is None:
            continue
        rest = search.beside(head).alone()
        own = next((p.gain for p in rest if leaves[p.leaves[0]].name == leaf.name), np.inf)
        tries += [
            (p.gain / own if own > 0.0 else np.inf, head, x, p) for p in rest if p.gain > AS_GOOD * own
            and may_join(x := leaves[p.leaves[0]], head.leaves)
            and not any(f.is_of((*head.leaves, x)) for f in fits)
        ]  # fmt: skip
    tries.sort(key=lambda t: -t[0])
    out: list[Fit] = []
    for _, head, x, p in tries[:MOST]:
        start = search.felt(changes_of([x], p.starts, c.problem), p)
        if not start:
            continue
        say("fitting " + " + ".join(y.name for y in (*head.leaves, x)))
        joint = fit(c, (*head.leaves, x), {**relative(c, head), **start}, p.z, found=head.names)
        if joint is not None and is_itself(c, joint) and adds(c, fits, joint):
            out.append(joint)
    return out


def _is_near(c: Calibrated, none: Fit, f: Fit, x: Fit) -> bool:
    """Whether `x` explains nearly as much as `f` does, and nearly the same."""
    gain, other = cost_of(c, none) - cost_of(c, f), cost_of(c, none) - cost_of(c, x)
    return other > NEARLY * gain and distance(c, f, x) < NEARLY * distance(c, none, f)


def _with_lost(
    c: Calibrated, fits: Sequence[Fit], joint: Sequence[Fit], known: Collection[str], say: Report
) -> list[Fit]:
    """Lost frames beside the best of the other fits, where that leaves something."""
    others = [f for f in (*fits[1:], *joint) if f.leaves[0].name in known]
    heads = _unlike(c, sorted(others, key=lambda f: cost_of(c, f)))
    if not heads or above_noise(c, heads[0]) < NATS:
        return []
    best = heads[0]
    say("looking for lost frames beside " + " + ".join(x.name for x in best.leaves))
    found = fit_lost_frames(c, best)
    return [found] if found is not None and adds(c, [*fits[1:], *joint], found) else []


def _proposed(
    c: Calibrated, heads: Sequence[Fit], search: Search, leaves: Sequence[Leaf]
) -> list[tuple[Fit, Proposal]]:
    """Each head with the leaves that could explain much of what it leaves: most for the best head."""
    out: dict[frozenset[str], tuple[Fit, Proposal]] = {}
    for head, count in zip(heads, (PAIRS, PAIRS - 1), strict=False):
        least = max(PROMISE * above_noise(c, head), NATS)
        rest = search.beside(head).alone()
        able = [p for p in rest if p.gain > least and may_join(leaves[p.leaves[0]], head.leaves)]
        limits = [
            p for p in rest if leaves[p.leaves[0]].effect in LIMITS and NATS < p.gain <= least
        ]
        for p in (*able[:count], *limits[:1]):  # a limit a little off its value takes far less
            names = frozenset({leaves[p.leaves[0]].name, *(x.name for x in head.leaves)})
            out.setdefault(names, (head, p))
    return list(out.values())
