"""The marks of an exam: what is counted over which papers, with what it should reach.

Each mark takes papers and gives a `Value`. Right or wrong counts over all papers of its kind: a diagnosis
that is missing, broken, or named nothing where there was something is wrong, never left out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from hil.exam.intervals import (
    NOTHING,
    Value,
    brier,
    calibration_error,
    mean,
    median,
    reliability,
    share,
)
from hil.exam.paper import CONFIDENT, Paper
from hil.exam.sizes import sizes

Papers = Sequence[Paper]
SECONDS: Final = {"axis": 10.0, "motorcycle": 30.0, "stewart": 60.0}
LEAK: Final = 1.05


@dataclass(frozen=True, slots=True)
class Mark:
    """One line of the table."""

    name: str
    count: Callable[[Papers], Value]
    least: float | None = None
    most: float | None = None
    unit: str = "%"

    def is_reached(self, value: Value) -> bool | None:
        """None where nothing was counted or nothing is asked."""
        if value.value is None or (self.least is None and self.most is None):
            return None
        low = self.least is None or value.value >= self.least
        return low and (self.most is None or value.value <= self.most)


def _of(papers: Papers, *kinds: str) -> list[Paper]:
    return [p for p in papers if p.kind in kinds]


def _singles(test: Callable[[Paper], bool]) -> Callable[[Papers], Value]:
    return lambda papers: share([test(p) for p in _of(papers, "single")])


def _false_alarms(papers: Papers) -> Value:
    return share([p.verdict != "no_gap" for p in _of(papers, "none")])


def _sets(papers: Papers) -> Value:
    return share([p.said_set == frozenset(p.truth) for p in _of(papers, "several")])


def _first_of_several(papers: Papers) -> Value:
    return share([p.is_exact() for p in _of(papers, "several")])


def _missed_though_evident(papers: Papers) -> Value:
    missed = [p for p in _of(papers, "single", "several") if p.verdict == "no_gap"]
    return share([p.is_evident for p in missed if p.is_evident is not None])


def _unknown_recall(papers: Papers) -> Value:
    return share([p.verdict == "unknown" for p in _of(papers, "outside")])


def _wrongly_unknown(papers: Papers) -> Value:
    return share([p.verdict == "unknown" for p in _of(papers, "single", "several")])


def _missed(papers: Papers) -> Value:
    return share([p.verdict == "no_gap" for p in _of(papers, "single", "several", "outside")])


def _confident_on_outside(papers: Papers) -> Value:
    return share([p.probability > CONFIDENT for p in _of(papers, "outside")])


def _stated(papers: Papers) -> tuple[list[float], list[bool]]:
    """Probability of each first cause that was named, and whether it was there."""
    named = [p for p in papers if p.is_named]
    return [p.probability for p in named], [p.is_exact() for p in named]


def _brier(papers: Papers) -> Value:
    stated, came = _stated(papers)
    return brier(stated, came) if stated else NOTHING


def _ece(papers: Papers) -> Value:
    stated, came = _stated(papers)
    return calibration_error(stated, came) if stated else NOTHING


def _credible(papers: Papers) -> list[Paper]:
    return [p for p in _of(papers, "single") if p.is_named]


def _set_coverage(papers: Papers) -> Value:
    return share([p.truth[0] in p.credible() for p in _credible(papers)])


def _set_stated(papers: Papers) -> Value:
    return mean([p.credible_probability for p in _credible(papers)])


def _set_size(papers: Papers) -> Value:
    return mean([len(p.credible()) for p in _credible(papers)])


def _errors(main: bool) -> Callable[[Papers], Value]:
    return lambda papers: median(
        [
            s.error
            for p in _of(papers, "single")
            for s in sizes(p)
            if s.error is not None and (s.is_main or not main)
        ]
    )


def _cover(papers: Papers) -> Value:
    return share([c for p in _of(papers, "single") for s in sizes(p) for c in s.covered])


def _shrink(papers: Papers) -> Value:
    found = [p.shrink_share for p in _of(papers, "single", "several")]
    return median([x for x in found if x is not None])


def _leaks(papers: Papers) -> Value:
    found = [p.shrink_share for p in _of(papers, "single", "several")]
    return share([x > LEAK for x in found if x is not None])


def _harmful(papers: Papers) -> Value:
    return share([bool(p.is_harmful) for p in papers if p.is_named and p.is_harmful is not None])


def _unusable(papers: Papers) -> Value:
    return share([p.verdict in ("missing", "broken", "error") for p in papers])


def _seconds(papers: Papers) -> Value:
    return median([s for p in papers if (s := p.seconds) is not None])


MARKS: Final = (
    Mark("top-1 by class", _singles(Paper.is_class), least=0.95),
    Mark("top-1 by leaf", _singles(lambda p: p.is_leaf(1)), least=0.85),
    Mark("top-2 by leaf", _singles(lambda p: p.is_leaf(2)), least=0.95),
    Mark("location right", _singles(Paper.is_place), least=0.97),
    Mark("leaf and location right", _singles(Paper.is_exact)),
    Mark("several: the whole set right", _sets),
    Mark("several: first cause right", _first_of_several),
    Mark("false alarms on null cases", _false_alarms, most=0.01),
    Mark("effects called no_gap", _missed),
    Mark("of them evident to the oracle", _missed_though_evident),
    Mark("outside effects called unknown", _unknown_recall, least=0.85),
    Mark("catalogue effects called unknown", _wrongly_unknown, most=0.05),
    Mark("outside effects named, p > 0.9", _confident_on_outside),
    Mark("Brier score of the first cause", _brier, unit=""),
    Mark("expected calibration error", _ece, most=0.05, unit=""),
    Mark("90 % set holds the truth", _set_coverage, least=0.87, most=0.93),
    Mark("what that set itself states", _set_stated),
    Mark("mean size of the 90 % set", _set_size, most=1.6, unit=""),
    Mark("shrink over the oracle's, median", _shrink, least=0.9, unit=""),
    Mark("shrink > 1.05 of the oracle's", _leaks),
    Mark("harmful additions", _harmful, most=0.01),
    Mark("parameter error, median", _errors(True), most=0.08),
    Mark("parameter error, all parameters", _errors(False)),
    Mark("90 % interval holds the truth", _cover, least=0.85, most=0.95),
    Mark("diagnoses missing or broken", _unusable, most=0.0),
    Mark("time for 30 s of record, median", _seconds, unit="s"),
)
"""In the order of the table; bounds are those that the project set itself."""


def _withheld(papers: Papers) -> list[Paper]:
    return [p for p in papers if {e for e, _ in p.truth} & set(p.without)]


def _left_unknown(papers: Papers) -> Value:
    return share([p.verdict == "unknown" for p in _withheld(papers)])


def _left_confident(papers: Papers) -> Value:
    return share([p.probability > CONFIDENT for p in _withheld(papers)])


def _left_honest(papers: Papers) -> Value:
    return share(
        [
            p.verdict in ("unknown", "identified", "ambiguous") and p.probability <= CONFIDENT
            for p in _withheld(papers)
        ]
    )


def _left_near(papers: Papers) -> Value:
    held = [p for p in _withheld(papers) if p.known is not None]
    return share(
        [
            p.verdict == "unknown"
            or (p.is_named and (p.probability <= CONFIDENT or p.is_nearest()))
            for p in held
        ]
    )


WITHHELD_MARKS: Final = (
    Mark("left out: unknown or p ≤ 0.9", _left_honest, least=0.9),
    Mark("the same, or named within its class", _left_near),
    Mark("left out: called unknown", _left_unknown),
    Mark("left out: another leaf, p > 0.9", _left_confident, most=0.1),
    Mark("left out: called no_gap", _missed),
    Mark("diagnoses missing or broken", _unusable, most=0.0),
)
"""Where each effect was withheld from the diagnosis that had to find it (`sit --without auto`)."""


def marks_for(papers: Papers) -> tuple[Mark, ...]:
    """The marks that fit how these papers were sat; a rig alone has its own bound of time."""
    if papers and all(p.without for p in papers if p.truth) and any(p.without for p in papers):
        return WITHHELD_MARKS
    rigs = {p.rig for p in papers}
    if len(rigs) == 1 and (limit := SECONDS.get(next(iter(rigs)))) is not None:
        return (*MARKS[:-1], Mark(MARKS[-1].name, MARKS[-1].count, most=limit, unit="s"))
    return MARKS


def confusion(papers: Papers) -> dict[str, dict[str, int]]:
    """Rows: what it was; columns: what it was called; counts."""
    rows: dict[str, Counter[str]] = {}
    for p in papers:
        rows.setdefault(p.true_row, Counter())[p.called] += 1
    return {row: dict(columns.most_common()) for row, columns in sorted(rows.items())}


def reliability_of(papers: Papers) -> list[dict[str, float]]:
    """The reliability table of first causes."""
    stated, came = _stated(papers)
    return reliability(stated, came) if stated else []


def errors_of(papers: Papers) -> dict[str, dict[str, Any]]:
    """By effect: cases, leaf right, location right, median parameter error."""
    out = {}
    for effect in sorted({p.truth[0][0] for p in _of(papers, "single")}):
        mine = [p for p in _of(papers, "single") if p.truth[0][0] == effect]
        out[effect] = {
            "count": len(mine),
            "leaf": share([p.is_leaf() for p in mine]).value,
            "class": share([p.is_class() for p in mine]).value,
            "location": share([p.is_place() for p in mine]).value,
            "parameter_error": _errors(True)(mine).value,
        }
    return out
