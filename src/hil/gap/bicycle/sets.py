"""Candidates of a ride alone, in pairs and in threes.

An effect of a ride often shows in the few seconds in which one pulls away or brakes, so that neither what is
usual nor a share of the whole tells whether another effect acts beside it: what a set leaves above noise and
tolerances does, in nats. Sets on the way need only be better than what they grew from. Those that are handed
on are whole: each of their effects explains most of what the others leave.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from hil.gap.bicycle.heard import is_heard
from hil.gap.catalogue.nuisances import LIMIT
from hil.gap.fits.fit import fit
from hil.gap.fits.fitted import Calibrated, Fit
from hil.gap.fits.shares import above_noise
from hil.gap.fits.starts import changes_of, relative
from hil.gap.record.leaf import Leaf
from hil.gap.search.candidates import FIRST, SINGLES, alone_again, promising
from hil.gap.search.linear import Proposal, Search
from hil.gap.search.standing import adds

Report = Callable[[str], None]

NATS: Final = 20.0
"""What a set must leave for a further effect to be looked for, and what that must take: of the loss of fits,
where samples count as if they were independent [set on training cases]."""
FEW: Final = 10.0
"""The same of what takes it where something was found or a gap is unknown, however little is left [set on
used-up rides 624 and 625]."""
PROMISE: Final = 0.15
"""Of what the others leave, the least that a further effect takes in the linear picture."""
HEADS: Final = ((3, 2, 2), (2, 2))
"""Further effects tried beside each of the best singles, and of the best pairs."""
BLIND: Final = 2
"""Further effects that are fitted where the linear picture promises nothing: few wild seconds spoil it."""
DISTANCE: Final = (
    "rear_wheel.wheel_radius", "rear_wheel.wheel_slip", "rear_wheel.sensor_scale"
)  # fmt: skip
"""All scale the way that is ridden: where one is weighed, all are."""
SPRUNG: Final = {
    "bicycle.front_suspension": ("bicycle.tyre_compliance", 2.0),
    "bicycle.tyre_compliance": ("bicycle.front_suspension", 0.5),
}
"""Two tyres pitch a bicycle as a fork of half their stiffness does: each is begun where the other ends, for
the linear picture of stiff springs tells little of soft ones."""
ADDS: Final = 0.5
"""Of what the others leave, the least that an effect of a whole set explains: less is how laws differ."""


def fit_sets(
    c: Calibrated,
    none: Fit,
    known: Sequence[Fit],
    search: Search,
    leaves: Sequence[Leaf],
    say: Report,
    is_missing: bool = False,
) -> list[Fit]:
    """`none`, then all fits that may be the answer: those `known` already, of one effect each at first, and
    what they grow to.

    `is_missing`: something may act beside them, however little they seem to leave: a noise model that holds a
    bicycle's tolerances too takes a second effect for them.
    """
    least = FEW if is_missing else NATS
    tried: dict[frozenset[str], Fit] = {_key(f): f for f in known}
    for size, counts in enumerate(HEADS, 1):
        able = sorted((f for f in tried.values() if len(f.leaves) == size), key=_cost_on(c))
        for head, count in zip(able, counts, strict=False):
            for p in _further(c, head, search, leaves, is_missing)[:count]:
                leaf = leaves[p.leaves[0]]
                some = (*head.leaves, leaf)
                key = frozenset(x.name for x in some)
                start = search.felt(changes_of([leaf], p.starts, c.problem), p)
                if key in tried or not start:
                    continue
                say("fitting " + " + ".join(x.name for x in some))
                joint = fit(c, some, {**relative(c, head), **start}, p.z, found=head.names)
                if joint is None or _cost_on(c)(joint) > _cost_on(c)(head) - least:
                    continue
                if is_heard(c, joint):
                    tried[key] = joint
    alone = [f for f in tried.values() if len(f.leaves) == 1]
    for f in _exchanged(c, alone, list(tried.values()), say):
        tried.setdefault(_key(f), f)
    fits = alone_again(c, [none, *tried.values()], say)[1:]
    return [none, *(f for f in fits if adds(c, fits, f, ADDS))]


def fit_alone(c: Calibrated, search: Search, leaves: Sequence[Leaf], say: Report) -> list[Fit]:
    """Fits of one effect each, of those that the linear picture promises something of."""
    ranked = search.alone()
    able = promising(ranked)
    some = able[:SINGLES] or ranked[:FIRST]
    if any(leaves[p.leaves[0]].name in DISTANCE for p in some):
        some += [p for p in able[SINGLES:] if leaves[p.leaves[0]].name in DISTANCE]
    some += [
        p for p in ranked if all(p is not x for x in some) and _is_pulled(c, leaves[p.leaves[0]])
    ]
    out = []
    for k, p in enumerate(some):
        leaf = leaves[p.leaves[0]]
        start = search.felt(changes_of([leaf], p.starts, c.problem), p)
        if not start:
            continue
        say(f"fitting {leaf.name} ({k + 1})")
        found = fit(c, [leaf], start, p.z)
        if found is not None and is_heard(c, found):
            out.append(found)
    for f in _sprung(c, out, leaves, say):
        same = [x for x in out if x.is_of(f.leaves)]
        if all(f.total(c) < x.total(c) for x in same):
            out = [*(x for x in out if x not in same), f]
    return out


def _is_pulled(c: Calibrated, leaf: Leaf) -> bool:
    """Whether a nuisance that is a parameter of `leaf` stands at its bound: little is left of what pulls."""
    return any(
        n.name in leaf.parameters and abs(z) > LIMIT - 1e-3
        for n, z in zip(c.nuisances, c.z.tolist(), strict=True)
    )


def _sprung(c: Calibrated, alone: Sequence[Fit], leaves: Sequence[Leaf], say: Report) -> list[Fit]:
    """Tyres in the place of a fork, and the other way round."""
    by_name, out = {leaf.name: leaf for leaf in leaves}, []
    for f in alone:
        mine = f.leaves[0].name
        other, times = SPRUNG.get(mine, ("", 1.0))
        if other not in by_name:
            continue
        say(f"fitting {other} in place of {mine}")
        start = {
            n.replace(mine, other): times * v
            for n, v in zip(f.names, f.values.tolist(), strict=True)
        }
        found = fit(c, [by_name[other]], start, f.z)
        if found is not None:
            out.append(found)
    return out


def _exchanged(c: Calibrated, alone: Sequence[Fit], tried: Sequence[Fit], say: Report) -> list[Fit]:
    """The best set with each of DISTANCE in the place of another: no ride tells them apart."""
    best = min((f for f in tried if len(f.leaves) > 1), key=_cost_on(c), default=None)
    if best is None:
        return []
    out = []
    for leaf in (x for x in best.leaves if x.name in DISTANCE):
        kept = {n: v for n, v in relative(c, best).items() if n not in leaf.parameters}
        others = [x for x in best.leaves if x is not leaf]
        for x in (f for f in alone if f.leaves[0].name in DISTANCE and f.leaves[0] is not leaf):
            some = (*others, *x.leaves)
            say("fitting " + " + ".join(y.name for y in some))
            joint = fit(c, some, kept | relative(c, x), best.z, found=(*kept, *x.names))
            if joint is not None:
                out.append(joint)
    return out


def _further(
    c: Calibrated, head: Fit, search: Search, leaves: Sequence[Leaf], is_missing: bool
) -> list[Proposal]:
    """What could explain much of what `head` leaves, best first."""
    left = above_noise(c, head)
    if left < NATS and not is_missing:
        return []
    have = {x.name for x in head.leaves}
    rest = search.beside(head).alone()
    least = max(PROMISE * left, FEW if is_missing else NATS)
    others = [p for p in rest if leaves[p.leaves[0]].name not in have]
    return [p for p in others if p.gain > least] or others[: 0 if is_missing else BLIND]


def _key(f: Fit) -> frozenset[str]:
    return frozenset(x.name for x in f.leaves)


def _cost_on(c: Calibrated) -> Callable[[Fit], float]:
    return lambda f: f.total(c)
