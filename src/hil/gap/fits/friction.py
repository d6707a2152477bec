"""Laws of friction at one place: which go together, which fit is another law in disguise, and how a law with
a peak at rest is found from a plain one."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Final

import numpy as np

from hil.gap.catalogue.leaves import STRIBECK
from hil.gap.fits.fit import fit
from hil.gap.fits.fitted import Calibrated, Fit, replay_cost
from hil.gap.fits.starts import relative
from hil.gap.record.leaf import Leaf

Report = Callable[[str], None]

PLAIN: Final = frozenset({"coulomb_friction", "viscous_friction"})
PEAKED: Final = "stribeck_friction"
DIRECTED: Final = "asymmetric_viscous_friction"
FRICTION: Final = PLAIN | {PEAKED, DIRECTED, "asymmetric_friction", "load_friction", "hysteresis"}
BESIDE: Final = frozenset({"viscous_friction", "load_friction"})
"""They may act beside another law, for they go with speed and load; the others are each other's forms."""
APART: Final = frozenset({"coulomb_friction", "hysteresis"})
"""These two may as well: what gives way over millimetres is no part of what slips at once."""
FIRST: Final = 0.1
"""Of its usual size, by which viscous friction differs between directions where a fit of that begins."""
OTHERWISE: Final = 0.25
"""Of its mean, by which viscous friction of two directions must differ to be no plain one of another law."""
OF_SPEED: Final = (
    "viscous_friction.coefficient",
    f"{DIRECTED}.positive",
    f"{DIRECTED}.negative",
)
BRISTLES_M: Final = 2.5e-4
"""m: way within which friction may build up: bristles bend before they slip, the more the harder they are
held. A hysteresis as narrow is that, and no effect of its own [R; those of all worlds are wider]."""
OWN: Final = 0.5
"""Of what a fit with bristles explains, the most that bristles of the rig's own friction may."""
LAWS: Final = 5
"""Laws that are fitted with bristles."""
NEARLY_ALL: Final = 0.8
"""Of a rig's own friction: no wear takes that much away."""
EQUAL: Final = 0.02
"""Of the sum of both directions, from which on friction that differs by less is plain friction [R]."""
PEAKS: Final = (1.6, 3.0)
"""Times the plain friction, that friction at rest may have where a peak is looked for."""

PEAK: Final = 1.8
"""Times the friction in motion, from which on that at rest is no way in which other friction differs from a
twin's [set on used-up cases of exams and of worlds of others: fitted to other laws 1.6 at most, to peaks 2.0
and more]."""


def may_join(leaf: Leaf, others: Sequence[Leaf]) -> bool:
    """Whether a leaf can act beside `others`: not itself again, no two forms of one law at one place."""
    return not any(
        leaf.name == x.name
        or (
            leaf.location == x.location
            and leaf.effect in FRICTION
            and x.effect in FRICTION
            and not {leaf.effect, x.effect} & BESIDE
            and {leaf.effect, x.effect} != APART
        )
        for x in others
    )


def nested(a: Sequence[Leaf], b: Sequence[Leaf]) -> bool:
    """Whether two sets differ by nothing but laws of friction at one place, or one holds the other."""
    only_a = [x for x in a if all(x.name != y.name for y in b)]
    only_b = [x for x in b if all(x.name != y.name for y in a)]
    if not only_a or not only_b:
        return True
    apart = (*only_a, *only_b)
    return len({x.location for x in apart}) == 1 and all(x.effect in FRICTION for x in apart)


def is_equal(f: Fit) -> bool:
    """Whether asymmetric friction of a fit is plain friction: EQUAL in both directions."""
    value = _values(f)
    sides = [
        [value.get(n, 0.0) for n in x.parameters]
        for x in f.leaves
        if x.effect == "asymmetric_friction"
    ]
    return any(abs(a - b) < EQUAL * abs(a + b) for a, b in sides)


def is_peak(f: Fit) -> bool:
    """Whether friction of a fit has a peak at rest that stands out from what it is in motion."""
    value = _values(f)
    peaks = [
        (value.get(f"{x.name}.static", 0.0), value.get(f"{x.name}.coulomb", 0.0))
        for x in f.leaves
        if x.effect == PEAKED
    ]
    return any(static >= PEAK * coulomb > 0.0 for static, coulomb in peaks)


def is_at_odds(f: Fit) -> bool:
    """Whether a law of friction of a fit takes away where another at the same place adds: both are bent to
    one law that is neither, as drag with the square of speed is [of 2000 diagnoses of exams and other worlds
    two were so, both of effects from outside]."""
    value = _values(f)
    laws = [(x, _levels(x, value)) for x in f.leaves if x.effect in FRICTION]
    return any(
        a.location == b.location and max(less, default=0.0) < 0.0 < min(more, default=0.0)
        for (a, less), (b, more) in itertools.permutations(laws, 2)
    )


def _levels(leaf: Leaf, value: Mapping[str, float]) -> list[float]:
    """How much friction a law adds: its parameters that are no width or speed."""
    widths = ("velocity", "displacement", "presliding")
    return [value[n] for n in leaf.parameters if n in value and not n.endswith(widths)]


def is_itself(c: Calibrated, f: Fit) -> bool:
    """Whether no effect of a fit has gone where it is another one: a hysteresis as narrow as BRISTLES_M or a
    Stribeck curve that rises from rest is plain friction, friction that nearly goes one way and grows
    the other a constant force; and no friction drives, whatever law it has."""
    value = _values(f)
    own = {a.name: a.coulomb for a in c.problem.rig.actuators}
    if any(map(_is_narrow, value.items())) or _drives(value, own):
        return False
    for leaf in f.leaves:
        if leaf.effect == PEAKED and value.get(f"{leaf.name}.static", 0.0) < value.get(
            f"{leaf.name}.coulomb", 0.0
        ):
            return False
        if leaf.effect == "asymmetric_friction":
            less, more = sorted(value.get(n, 0.0) for n in leaf.parameters)
            if more > 0.0 and less < -NEARLY_ALL * own[leaf.location]:
                return False
    return True


def _is_narrow(named: tuple[str, float]) -> bool:
    return named[0].endswith(".hysteresis.displacement") and named[1] < BRISTLES_M


def bristled(c: Calibrated, alone: Sequence[Fit], fits: Sequence[Fit], say: Report) -> list[Fit]:
    """Laws of friction among `fits` with bristles, where a narrow hysteresis that was fitted `alone` explains
    more than each of them: the LAWS best ones at its place, once more. The first of `fits` has no effects."""
    out = []
    for narrow in (f for f in alone if any(map(_is_narrow, _values(f).items()))):
        place = narrow.leaves[0].location
        laws = [
            f for f in fits
            if any(x.location == place and x.effect in FRICTION - {"hysteresis"} for x in f.leaves)
        ]  # fmt: skip
        laws.sort(key=lambda f: f.total(c))
        if not laws or laws[0].total(c) < narrow.total(c):
            continue
        width = _values(narrow)[f"{narrow.leaves[0].name}.displacement"]
        for f in laws[:LAWS]:
            say("fitting " + " + ".join(x.name for x in f.leaves) + " with bristles")
            start = {**relative(c, f), f"{place}.coulomb_friction.presliding": width}
            found = fit(c, f.leaves, start, f.z)
            if found is not None and is_itself(c, found) and not _is_own(c, fits[0], found, place):
                out.append(found)
    return out


def _is_own(c: Calibrated, none: Fit, f: Fit, place: str) -> bool:
    """Whether most of what a fit with bristles explains goes without its friction: the rig's own has bristles
    as well, and that is no effect."""
    k = c.problem.table.index(f"{place}.coulomb_friction.presliding")
    row = np.array(none.vector)
    row[k] = f.vector[k]
    left = replay_cost(c, c.problem.answers(row)[0]) + c.problem.discount * none.prior_cost
    return none.total(c) - left > OWN * (none.total(c) - f.total(c))


def _values(f: Fit) -> dict[str, float]:
    return dict(zip(f.names, f.values.tolist(), strict=True))


def _drives(value: Mapping[str, float], own: Mapping[str, float]) -> bool:
    """Whether friction that a fit has put somewhere is less than none, the rig's own with it."""
    laws = ("coulomb_friction.force", f"{PEAKED}.coulomb", f"{PEAKED}.static")
    return any(value.get(f"{a}.{law}", 0.0) < -most for a, most in own.items() for law in laws)


def directed(c: Calibrated, base: Fit, location: str) -> list[Fit]:
    """`base`, in which friction acts at `location`, with viscous friction of either direction in its place,
    and that alone; none where both directions are nearly alike, or the twin cannot stand with it."""
    gone = [x for x in base.leaves if x.location == location and x.effect in FRICTION]
    others = [x for x in base.leaves if x not in gone]
    names = tuple(f"{location}.{DIRECTED}.{p}" for p in ("positive", "negative"))
    leaf = Leaf(DIRECTED, location, names, (), location, len(c.problem.rig.actuators))
    found = relative(c, base)
    same = found.get(f"{location}.viscous_friction.coefficient", 0.0)
    step = FIRST * c.problem.table[names[0]].scale
    sides = {names[0]: same + step, names[1]: same - step}
    kept = {n: v for n, v in found.items() if any(n in x.parameters for x in others)}
    tried = [fit(c, [*others, leaf], kept | sides, base.z)]
    if others:
        tried.append(fit(c, [leaf], sides, base.z))
    return [f for f in tried if f is not None and _differs(c, f, location)]


def _differs(c: Calibrated, f: Fit, location: str) -> bool:
    """Whether viscous friction is another one in either direction, the rig's own with it."""
    own = next(a.viscous for a in c.problem.rig.actuators if a.name == location)
    index = [c.problem.table.index(f"{location}.{x}") for x in OF_SPEED]
    viscous, ahead, back = (float(f.vector[i]) for i in index)
    mean = own + viscous + 0.5 * (ahead + back)
    return abs(ahead - back) > OTHERWISE * mean


def peaked(c: Calibrated, base: Fit, leaf: Leaf) -> Fit | None:
    """`base`, in which Coulomb friction acts where `leaf` does, with `leaf` in its place: friction with a
    peak at rest; None where no peak helps.

    How long a peak holds the rig decides when it breaks loose, so no linear picture from a twin without one
    finds it.
    """
    plain = f"{leaf.location}.coulomb_friction.force"
    table = c.problem.table
    own = table.index(plain)
    added = float(base.vector[own] - c.vector[own])
    names = [f"{leaf.name}.{p}" for p in ("coulomb", "static", "velocity")]
    index = [table.index(n) for n in names]
    most = next(a.velocity_max for a in c.problem.rig.actuators if a.name == leaf.location)
    options = list(itertools.product(PEAKS, [share * most for share in STRIBECK]))
    rows = np.tile(base.vector, (len(options), 1))
    rows[:, own] = c.vector[own]
    for row, (peak, speed) in zip(rows, options, strict=True):
        row[index] = (added, peak * added, speed)
    costs = [replay_cost(c, a) for a in c.problem.answers(rows)]
    best = int(np.argmin(costs))
    if not costs[best] < base.cost(c.train):
        return None
    start = {n: v for n, v in relative(c, base).items() if n != plain}
    start |= dict(zip(names, rows[best][index].tolist(), strict=True))
    others = [x for x in base.leaves if x.name != f"{leaf.location}.coulomb_friction"]
    return fit(c, [*others, leaf], start, base.z)
