"""What any rig has and a fine encoder shows, a screw's wobble, its give and a drive's filters: the twin has
it, too.

Left to the candidates it takes places in sets from what is wrong, and what it explains is missing where a
cause must explain most of a gap. It is no finding (`hil.gap.judged.verdict`), whatever else is there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from hil.config import Effect
from hil.gap.fits.evidence import weigh
from hil.gap.fits.fitted import Fit
from hil.gap.judged.clear import asked
from hil.gap.judged.verdict import usual_of
from hil.gap.located.sanity import Finding
from hil.gap.record.leaf import Leaf
from hil.gap.rounds.question import Question
from hil.gap.rounds.round import Considered, considered
from hil.units import with_unit

FINE: Final = frozenset({"lead_error", "loop_gain", "compliance"})
"""Effects of which that is so."""
TURNS: Final = 2
"""Times that is asked: beside a screw's wobble a drive's filters show."""


def with_usual(q: Question, mine: Considered) -> Considered:
    """`mine`, or all once more by a twin that has of those effects what the best fit has, where that is no
    more than any rig's: what else there is may be seen beside it."""
    for _ in range(TURNS):
        best = weigh(mine.calibrated, mine.fits)[0][0].fit
        own = [_line(best, leaf) for leaf in usual_of(best, mine.rig) if leaf.effect in FINE]
        if not own or mine.gain() < asked(mine.calibrated).nats:
            break
        q.say(f"once more with {_named(mine, own)}, no larger than any rig's")
        known = {(x.effect, x.location) for x in own}
        old, clocks = mine.rig.effects, mine.located.evidence.problem.clocks
        effects = (*(x for x in old if (x.effect, x.location) not in known), *own)
        twin = mine.rig.model_copy(update={"effects": effects})
        had = [x for x in mine.usual if (x.effect, x.location) not in known]
        other = considered(q, q.locate(twin, clocks), mine.parts, mine.bank)
        mine = replace(other, usual=(*had, *own))
    return mine


def found(mine: Considered) -> Finding:
    """What the reader must know where the twin has something so."""
    return Finding(
        "info", "twin",
        f"has {_named(mine, mine.usual)}, as the records show, no larger than any healthy rig's: what is "
        "shown is that twin's",
    )  # fmt: skip


def _line(f: Fit, leaf: Leaf) -> Effect:
    values = {
        n.rpartition(".")[2]: v
        for n, v in zip(f.names, f.values.tolist(), strict=True)
        if n in leaf.parameters
    }
    return Effect(effect=leaf.effect, location=leaf.location, parameters=values)


def _named(mine: Considered, effects: Sequence[Effect]) -> str:
    table = mine.calibrated.problem.table

    def values(x: Effect) -> str:
        units = {k: table[f"{x.location}.{x.effect}.{k}"].unit for k in x.parameters}
        return ", ".join(with_unit(f"{k} {v:.3g}", units[k]) for k, v in x.parameters.items())

    return " and ".join(
        f"{x.effect.replace('_', ' ')} ({values(x)}) at {x.location}" for x in effects
    )
