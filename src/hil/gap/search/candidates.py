"""The candidates that are worth a fit alone: those of the linear picture, and what no column shows.

The linear picture ranks; each of the best is fitted through the twin. `hil.gap.search.joint` has those
together.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Final

from hil.gap.catalogue.bank import Bank
from hil.gap.fits.evidence import FAINT, gain, weigh
from hil.gap.fits.fit import fit
from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.fits.frames import EFFECT as LOST
from hil.gap.fits.frames import fit_lost_frames
from hil.gap.fits.friction import (
    DIRECTED,
    FRICTION,
    PEAKED,
    PLAIN,
    bristled,
    directed,
    is_itself,
    peaked,
)
from hil.gap.fits.shares import RARE, explained, most_left
from hil.gap.fits.starts import changes_of, relative
from hil.gap.record.leaf import Leaf
from hil.gap.search.joint import LEFT, is_whole, joint_fits
from hil.gap.search.linear import Proposal, Search
from hil.gap.search.replayed import least_left, struck, suspects
from hil.gap.search.rivals import ended

Report = Callable[[str], None]

SINGLES: Final = 5
"""Candidates that are fitted alone."""
MOST: Final = 9
ALIKE: Final = 0.95
"""Of the best linear gain, above which up to MOST candidates are fitted: all that it cannot tell apart."""
FIRST: Final = 3
WORTH: Final = 0.25
"""Of the best linear gain, below which none but the FIRST candidates are fitted: a gain may be illusory."""
CHANCE: Final = 3.0
"""Of the linear gain, no candidate is worth a fit below."""
UNPROMISING: Final = 2
"""Candidates that are fitted where none promises anything: a limit that acts once is missed by a little."""
NEARLY: Final = 0.9
"""Of what the best explains, that friction must to be looked at once more for either direction."""
POORLY: Final = 0.75
"""Share explained up to which springs, gaps and limits are replayed one by one: what no column shows is
looked like by what does."""
LIKELIEST: Final = 3
"""Fits from whose nuisances the one without effects is begun anew."""
WELL: Final = 0.96
"""Share explained from which on lost frames are not looked for."""


def fit_candidates(
    c: Calibrated,
    none: Fit,
    bank: Bank,
    is_large: bool,
    without: Collection[str],
    say: Report,
    seen: Sequence[Fit] = (),
) -> list[Fit]:
    """`none`, then all that was fitted; several effects together only where the gap stands by itself
    (`is_large`), or one of them has some evidence. `seen`: fits beside other noise."""
    search, leaves = Search(c, bank), bank.leaves
    alone = _single_fits(c, none, search, leaves, without, say, seen)
    fits = [none, *ended(c, none, [f for f in alone if is_itself(c, f)], say)]
    if is_large or gain(weigh(c, fits)[0]) > FAINT:
        fits += joint_fits(c, fits, search, leaves, without, say)
        fits = alone_again(c, fits, say)
    if len(min(fits, key=lambda f: f.total(c)).leaves) > 1:
        fits = [none, *ended(c, none, fits[1:], say)]
    fits = _bettered(c, fits, bristled(c, alone, fits, say))
    fits += _peaked_fits(c, fits, leaves, say)
    fits = fits if DIRECTED in without else fits + _directed_fits(c, fits, without, say)
    return out_of_traps(c, fits)


def fitted_again(
    c: Calibrated,
    none: Fit,
    fits: Sequence[Fit],
    bank: Bank,
    is_large: bool,
    without: Collection[str],
    say: Report,
) -> list[Fit]:
    """`fits` beside other noise, of which `none` is: where the best of them is one effect and leaves nothing
    there either, single ones once more, else all that is worth a fit."""
    seen = [replace(f, white=c.noise.whiten(c.problem, f.residual)) for f in fits if f.leaves]
    best = min(seen, key=lambda f: f.total(c))
    if len(best.leaves) > 1 or not is_whole(c, best, RARE):
        again = fit_candidates(c, none, bank, is_large, without, say, seen)
        fits = _bettered(c, again, seen)
        if not any(f.is_of(best.leaves) for f in fits if f is not best):
            say("fitting " + " + ".join(x.name for x in best.leaves) + " once more")
            anew = fit(c, best.leaves, relative(c, best), best.z)
            fits = fits if anew is None else _bettered(c, fits, [anew])
        return fits
    alone = _single_fits(c, none, Search(c, bank), bank.leaves, without, say, seen)
    found = _bettered(c, seen, [f for f in alone if is_itself(c, f)])
    return out_of_traps(c, [none, *ended(c, none, found, say)])


def out_of_traps(c: Calibrated, fits: Sequence[Fit]) -> list[Fit]:
    """`fits`, the first of them without effects, that one anew from where the likeliest put the nuisances:
    costs are rugged in time, and what an effect has helped out of a trap is not explained by it. Where that
    leaves less, so may those effects from there."""
    none, *others = fits
    if gain(weigh(c, fits)[0]) <= FAINT:
        return list(fits)
    likeliest = sorted(others, key=lambda f: f.total(c))[:LIKELIEST]
    begun = [fit(c, (), {}, f.z) for f in likeliest]
    freed = min((none, *(f for f in begun if f is not None)), key=lambda f: f.total(c))
    if freed.total(c) > none.total(c) - FAINT * c.problem.discount:
        return list(fits)
    anew = [
        fit(c, f.leaves, relative(c, f), freed.z)
        for f in likeliest
        if all(leaf.effect != LOST for leaf in f.leaves)
    ]
    return [freed, *_bettered(c, others, [f for f in anew if f is not None])]


def _bettered(c: Calibrated, fits: Sequence[Fit], found: Sequence[Fit]) -> list[Fit]:
    """`fits` and each of those `found`, in the place of those of the same effects where it is better."""
    out = list(fits)
    for f in found:
        same = [x for x in out if x.is_of(f.leaves)]
        if all(f.total(c) < x.total(c) for x in same):
            out = [*(x for x in out if all(x is not y for y in same)), f]
    return out


def _single_fits(
    c: Calibrated,
    none: Fit,
    search: Search,
    leaves: Sequence[Leaf],
    without: Collection[str],
    say: Report,
    seen: Sequence[Fit],
) -> list[Fit]:
    out = []
    proposals = search.alone()
    for k, p in enumerate(_worth_a_fit(proposals, leaves)):
        leaf = leaves[p.leaves[0]]
        say(f"fitting {leaf.name} ({k + 1})")
        start = search.felt(changes_of([leaf], p.starts, c.problem), p)
        found = fit(c, [leaf], start, p.z) if start else None
        if found is not None:
            out.append(found)
    out += _peaked_fits(c, out, leaves, say)
    well = max((explained(c, none, f) for f in out), default=0.0)
    held = struck(c, min((none, *out), key=lambda f: f.total(c)))
    if well < POORLY or held:
        promise = {leaves[p.leaves[0]].name: p.gain for p in proposals}
        suspected = suspects(c, none, leaves, held, promise)
        out = _bettered(c, out, _replayed(c, none, suspected, seen, say))
    if LOST not in without and well < WELL:
        say("looking for lost frames")
        lost = fit_lost_frames(c, none)
        if lost is not None:
            out.append(lost)
    return out


def alone_again(c: Calibrated, fits: Sequence[Fit], say: Report) -> list[Fit]:
    """`fits`, each effect of the best set alone once more, begun where the set put it and the nuisances: what
    a second effect has helped out of a trap needs no second effect."""
    best = min(fits, key=lambda f: f.total(c) + f.extra_cost)
    if len(best.leaves) < 2 or any(leaf.effect == LOST for leaf in best.leaves):
        return list(fits)
    values, out = relative(c, best), list(fits)
    for leaf in best.leaves:
        say(f"fitting {leaf.name} alone once more")
        start = {n: values[n] for n in leaf.parameters if n in values}
        found = fit(c, [leaf], start, best.z)
        k = next((k for k, f in enumerate(out) if f.leaves == (leaf,)), None)
        if k is not None and found is not None and found.total(c) < out[k].total(c):
            out[k] = found
    return out


def _replayed(
    c: Calibrated, none: Fit, suspected: Sequence[Leaf], seen: Sequence[Fit], say: Report
) -> list[Fit]:
    """Springs, gaps and limits that a scan finds where nothing explains the gap, or where actuators are held
    off beside what does: no column shows them. Those that are `seen` need no second scan."""
    out = []
    for leaf in suspected:
        known = next((f for f in seen if f.is_of([leaf])), None)
        if known is None:
            say(f"looking for {leaf.name} by replays")
            start = least_left(c, none, leaf)
            found = fit(c, [leaf], start) if start else None
        else:
            say(f"fitting {leaf.name} once more")
            found = fit(c, [leaf], relative(c, known), known.z)
        if found is not None:
            out.append(found)
    return out


def promising(proposals: Sequence[Proposal]) -> list[Proposal]:
    """Those of `proposals`, best first, whose gain is neither chance nor small beside the best one's."""
    least = max(WORTH * proposals[0].gain, CHANCE) if proposals else CHANCE
    return [p for k, p in enumerate(proposals) if p.gain >= (CHANCE if k < FIRST else least)]


def _worth_a_fit(proposals: Sequence[Proposal], leaves: Sequence[Leaf]) -> list[Proposal]:
    """The best proposals, more where ALIKE; where a law of friction is among them, the plain laws as well."""
    good = promising(proposals) or list(proposals[:UNPROMISING])
    alike = sum(p.gain > ALIKE * good[0].gain for p in good[:MOST])
    out = good[: max(SINGLES, alike)]
    rubs = {x.location for x in (leaves[p.leaves[0]] for p in out) if x.effect in FRICTION}
    plain = [
        p for p in proposals[len(out) :]
        if leaves[p.leaves[0]].effect in PLAIN and leaves[p.leaves[0]].location in rubs
        and p.gain >= CHANCE
    ]  # fmt: skip
    return out + plain


def _directed_fits(
    c: Calibrated, fits: Sequence[Fit], without: Collection[str], say: Report
) -> list[Fit]:
    """Viscous friction of either direction for other friction, where that is among the best and leaves
    something; by itself where no other friction may be named."""
    if set(without) >= FRICTION - {DIRECTED}:
        return [f for a in c.problem.rig.actuators for f in directed(c, fits[0], a.name)]
    ranked = sorted(fits[1:], key=lambda f: f.total(c))
    if not ranked or most_left(c, ranked[0]) < LEFT:
        return []
    well = explained(c, fits[0], ranked[0])
    for f in ranked:
        rubs = sorted({x.location for x in f.leaves if x.effect in FRICTION})
        if rubs and explained(c, fits[0], f) > NEARLY * well:
            say(f"fitting {rubs[0]}.{DIRECTED} in place of other friction")
            return directed(c, f, rubs[0])
    return []


def _peaked_fits(
    c: Calibrated, fits: Sequence[Fit], leaves: Sequence[Leaf], say: Report
) -> list[Fit]:
    """Friction with a peak at rest for plain friction, where friction is best and leaves something."""
    ranked = sorted(fits, key=lambda f: f.total(c))
    if not ranked or most_left(c, ranked[0]) < LEFT:
        return []
    rubs = {x.location for x in ranked[0].leaves if x.effect in FRICTION}
    out = []
    for leaf in leaves:
        plain = f"{leaf.location}.coulomb_friction"
        base = next((f for f in ranked if any(x.name == plain for x in f.leaves)), None)
        if leaf.effect == PEAKED and leaf.location in rubs and base is not None:
            say(f"fitting {leaf.name} in place of {plain}")
            found = peaked(c, base, leaf)
            out += [found] if found is not None and is_itself(c, found) else []
    return out
