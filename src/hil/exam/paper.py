"""One marked paper: a case's answer beside its diagnosis, and every yes or no that marks count.

A leaf is an effect of the catalogue; a leaf at its location is what a cause names. A class is the set of
causes that the diagnosis itself says it cannot tell apart. What others made may lack any key but the
contract's; what is missing is None here, and a diagnosis that is missing or broken is wrong everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

Leaf = tuple[str, str]
UNKNOWN: Final[Leaf] = ("unknown", "")
SET_SHARE: Final = 0.9
CONFIDENT: Final = 0.9
EVIDENT: Final = 10.0
"""Nats for an effect, once it is told, from which on a diagnosis could have asked for it: less is chance
among the many that it tries."""
NAMED: Final = ("identified", "ambiguous")
VERDICTS: Final = (*NAMED, "unknown", "no_gap")


@dataclass(frozen=True, slots=True)
class Paper:
    """A case with its truth and what was said of it."""

    id: str
    answer: Mapping[str, Any]
    said: Mapping[str, Any]
    """The diagnosis; verdict "missing", "broken" or "error" where there is none."""
    oracle: Mapping[str, Any] | None = None
    known: Mapping[str, Any] | None = None
    """The diagnosis of the same case that knew all effects, where this one was not allowed to."""

    # --- the truth -----------------------------------------------------------------------------------
    @property
    def truth(self) -> tuple[Leaf, ...]:
        """Effects that are there, at their places."""
        return tuple((e["effect"], e["location"]) for e in self.answer.get("effects", ()))

    @property
    def kind(self) -> str:
        """none, single, several, or outside."""
        if self.answer["verdict"] == "unknown" or self.answer.get("outside"):
            return "outside"
        return {0: "none", 1: "single"}.get(len(self.truth), "several")

    @property
    def rig(self) -> str:
        """The rig's name, as answer or diagnosis give it."""
        return str(self.answer.get("rig") or self.said.get("rig") or "?")

    @property
    def severity(self) -> float | None:
        """Of the effect; 0 for a case without; None where the answer does not say."""
        if self.kind == "none":
            return 0.0
        value = self.answer.get("severity")
        return None if value is None else float(value)

    @property
    def without(self) -> tuple[str, ...]:
        """Effects that the diagnosis was not allowed to know."""
        return tuple(self.said.get("exam", {}).get("without", ()))

    # --- what was said -------------------------------------------------------------------------------
    @property
    def verdict(self) -> str:
        """One of the four verdicts, or missing, broken, error."""
        return str(self.said["verdict"])

    @property
    def is_named(self) -> bool:
        """Whether causes are what the verdict stands for."""
        return self.verdict in NAMED and bool(self.causes)

    @property
    def causes(self) -> list[Mapping[str, Any]]:
        """Candidates, best first."""
        return list(self.said.get("causes") or ())

    def cause(self, k: int) -> Leaf | None:
        """The candidate number k as effect and location, None where nothing is named."""
        if not self.is_named or k >= len(self.causes):
            return None
        return _leaf(self.causes[k])

    @property
    def probability(self) -> float:
        """Of the first cause, 0 where nothing is named."""
        return float(self.causes[0].get("probability") or 0.0) if self.is_named else 0.0

    @property
    def said_set(self) -> frozenset[Leaf]:
        """The effects that the verdict stands for."""
        if not self.is_named:
            return frozenset()
        listed = self.said.get("effects") or self.causes[:1]
        return frozenset(_leaf(e) for e in listed)

    @property
    def called(self) -> str:
        """Column of the confusion matrix: the first cause's effect, or the verdict."""
        first = self.cause(0)
        return first[0] if first else self.verdict

    @property
    def true_row(self) -> str:
        """Row of the confusion matrix."""
        if self.kind == "single":
            return self.truth[0][0]
        return {"none": "no_gap", "outside": "outside", "several": "several"}[self.kind]

    # --- right or wrong ------------------------------------------------------------------------------
    def is_leaf(self, rank: int = 1) -> bool:
        """Whether a true effect is among the first `rank` causes, wherever they place it."""
        effects = {e for e, _ in self.truth}
        found = [self.cause(k) for k in range(rank)]
        return any(c is not None and c[0] in effects for c in found)

    def is_place(self) -> bool:
        """Whether the first cause stands where a true effect does."""
        first = self.cause(0)
        return first is not None and first[1] in {place for _, place in self.truth}

    def is_exact(self) -> bool:
        """Whether the first cause is a true effect at its place."""
        return self.cause(0) in self.truth

    def is_class(self) -> bool:
        """Whether a true effect at its place is in the class of the first cause, or the leaf is right."""
        return self.is_leaf() or any(leaf in self.truth for leaf in self.first_class())

    def first_class(self) -> list[Leaf]:
        """The causes that the diagnosis cannot tell from its first one, itself among them."""
        if not self.is_named:
            return []
        number = self.causes[0].get("class")
        if number is None:
            return [_leaf(self.causes[0])]
        return [_leaf(c) for c in self.causes if c.get("class") == number]

    def is_nearest(self) -> bool:
        """Whether what is named first stands in the class that the true effect has where it is known: nothing
        in these data tells the two apart."""
        rows = [(_leaf(c), c.get("class")) for c in (self.known or {}).get("causes") or ()]
        numbers = {leaf: n for leaf, n in rows if n is not None}
        mine = numbers.get(self.cause(0) or UNKNOWN)
        return mine is not None and any(numbers.get(leaf) == mine for leaf in self.truth)

    def credible(self) -> list[Leaf]:
        """The fewest causes whose probabilities add up to SET_SHARE.

        "Something unknown" is one of them where the diagnosis gives it a probability of its own.
        """
        return [leaf for leaf, _ in self._credible()]

    @property
    def credible_probability(self) -> float:
        """What these causes add up to: more than SET_SHARE, for causes come whole, and no more than 1, though
        effects that act together each have their own."""
        return min(sum(chance for _, chance in self._credible()), 1.0)

    def _credible(self) -> list[tuple[Leaf, float]]:
        chances = [(_leaf(c), float(c.get("probability") or 0.0)) for c in self.causes]
        chances.append((UNKNOWN, float(self.said.get("unknown_probability") or 0.0)))
        out, total = [], 0.0
        for leaf, chance in sorted(chances, key=lambda x: -x[1]):
            if total >= SET_SHARE - 1e-9 or chance <= 0.0:
                break
            out.append((leaf, chance))
            total += chance
        return out

    # --- how far -------------------------------------------------------------------------------------
    @property
    def shrink(self) -> float | None:
        """Held-out shrink by the diagnosis."""
        return _number(self.said.get("gap", {}).get("shrink"))

    @property
    def shrink_share(self) -> float | None:
        """Shrink as a share of the oracle's, where both have one worth dividing by."""
        best = _number((self.oracle or {}).get("gap", {}).get("shrink"))
        if best is None or best < 0.1 or self.shrink is None:
            return None
        return self.shrink / best

    @property
    def is_evident(self) -> bool | None:
        """Whether the oracle, which was told the effects, finds evidence for them; None: it did not say."""
        nats = _number((self.oracle or {}).get("nats"))
        return None if nats is None else nats >= EVIDENT

    @property
    def is_harmful(self) -> bool | None:
        """Whether what was named makes held-out data worse."""
        gap = self.said.get("gap", {})
        before, after = _number(gap.get("before")), _number(gap.get("after"))
        if before is None or after is None:
            return None
        return after > before

    @property
    def seconds(self) -> float | None:
        """Time that the diagnosis took, for 30 s of record."""
        exam = self.said.get("exam", {})
        took, recorded = _number(exam.get("seconds")), _number(exam.get("recorded_s"))
        return None if took is None or not recorded else took * 30.0 / recorded


def _leaf(cause: Mapping[str, Any]) -> Leaf:
    return str(cause.get("effect")), str(cause.get("location"))


def _number(value: Any) -> float | None:
    if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
        return None
    return float(value)
