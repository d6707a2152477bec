"""Sets no part of which looks like anything alone: found in the linear picture of the whole.

Beside an effect that stands where another is, or for two at once, nothing that is really there explains
much: a hysteresis beside a mass that is not known yet is friction that goes with the load. In the linear
picture all of a set move together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

from hil.gap.fits.fit import fit
from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.fits.friction import is_itself, may_join
from hil.gap.fits.shares import above_noise
from hil.gap.fits.starts import changes_of
from hil.gap.record.leaf import Leaf
from hil.gap.search.linear import Proposal, Search
from hil.gap.search.standing import adds, cost_of

Report = Callable[[str], None]

PROMISE: Final = 0.15
"""Of what is left above the floor, the least that a further effect, or three instead of a set, must take more
in the linear picture."""
NATS: Final = 40.0
"""The least that it takes at all: of the loss of fits, where samples count as if they were independent."""
SWAPS: Final = 3
"""Sets that are fitted with one effect exchanged."""
AS_GOOD: Final = 0.9
"""Of what an effect takes beside the others of a set, or three together, in the linear picture, above which
that hardly tells another from it: up to MOST of those are fitted."""
MOST: Final = 6
WIDE: Final = 8
"""Pairs with an effect of the best set, and thirds beside each of those, that are looked at together."""
TOGETHER: Final = 12
"""Best single candidates of which every two are looked at together."""


def unseen_pairs(
    c: Calibrated,
    fits: Sequence[Fit],
    new: Sequence[Fit],
    search: Search,
    leaves: Sequence[Leaf],
    say: Report,
) -> list[Fit]:
    """The best two together of which neither need look good alone: what best explains both may be a third."""
    have = [{x.name for x in f.leaves} for f in new]
    for p in search.pairs(search.alone()[:TOGETHER]):
        a, b = (leaves[k] for k in p.leaves)
        if {a.name, b.name} not in have and may_join(a, [b]) and may_join(b, [a]):
            return _begun(c, fits, [p], search, leaves, say)
    return []


def unseen_triples(
    c: Calibrated,
    fits: Sequence[Fit],
    best: Fit,
    search: Search,
    leaves: Sequence[Leaf],
    say: Report,
) -> list[Fit]:
    """Three together that hold one effect of the `best` set, beside which nothing stands alone: another of
    them hides in what the third leaves, or what stands for both is in the best set."""
    own = _pictured(best, search, leaves)
    if own is None:
        return []

    def able(p: Proposal) -> list[int]:
        beside = [leaves[k] for k in p.leaves]
        return [k for k, leaf in enumerate(leaves) if may_join(leaf, beside)]

    least = own.gain + max(PROMISE * above_noise(c, best), NATS)
    found: dict[frozenset[int], Proposal] = {}
    for k in own.leaves:
        kept = search.set_of((k,))
        for pair in search.with_one_more(kept, able(kept))[:WIDE] if kept else []:
            for p in search.with_one_more(pair, able(pair))[:WIDE]:
                if p.gain > least:
                    found.setdefault(frozenset(p.leaves), p)
    ranked = sorted(found.values(), key=lambda p: -p.gain)
    alike = [p for p in ranked if p.gain > AS_GOOD * ranked[0].gain]
    return _begun(c, fits, alike[:MOST], search, leaves, say)


def exchanged(
    c: Calibrated,
    fits: Sequence[Fit],
    tried: Sequence[Fit],
    search: Search,
    leaves: Sequence[Leaf],
    say: Report,
) -> list[Fit]:
    """The best of the sets that were `tried`, whether or not it stands, with one effect exchanged for those
    with which the linear picture of the whole set explains more: what an effect does beside others that are
    far off, for another stood where it does, tells nothing of it."""
    best = min(tried, key=lambda f: cost_of(c, f), default=None)
    own = None if best is None else _pictured(best, search, leaves)
    if own is None:
        return []
    tries = []
    for gone in own.leaves:
        kept = [(k, start) for k, start in zip(own.leaves, own.starts, strict=True) if k != gone]
        others = replace(own, leaves=tuple(k for k, _ in kept), starts=tuple(s for _, s in kept))
        beside = [leaves[k] for k in others.leaves]
        able = [
            k for k, leaf in enumerate(leaves)
            if k != gone and may_join(leaf, beside) and not any(f.is_of((*beside, leaf)) for f in fits)
        ]  # fmt: skip
        tries += [p for p in search.with_one_more(others, able) if p.gain > own.gain + NATS]
    tries.sort(key=lambda p: -p.gain)
    return _begun(c, fits, tries[:SWAPS], search, leaves, say)


def _pictured(f: Fit, search: Search, leaves: Sequence[Leaf]) -> Proposal | None:
    """The effects of a fit as the linear picture has them; None where it does not know all of them."""
    place = {leaf.name: k for k, leaf in enumerate(leaves)}
    mine = [place[x.name] for x in f.leaves if x.name in place]
    return search.set_of(tuple(mine)) if len(mine) == len(f.leaves) else None


def _begun(
    c: Calibrated,
    fits: Sequence[Fit],
    proposals: Sequence[Proposal],
    search: Search,
    leaves: Sequence[Leaf],
    say: Report,
) -> list[Fit]:
    """Whole sets as the linear picture proposes them, those that stand beside `fits`."""
    out = []
    for p in proposals:
        some = [leaves[k] for k in p.leaves]
        start = search.felt(changes_of(some, p.starts, c.problem), p)
        if not start:
            continue
        say("fitting " + " + ".join(x.name for x in some))
        joint = fit(c, some, start, p.z)
        if joint is not None and is_itself(c, joint) and adds(c, fits, joint):
            out.append(joint)
    return out
