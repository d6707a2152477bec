"""Opens the seals, sets answers beside diagnoses and marks them: all together, by rig, by severity."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from hil.errors import RunError
from hil.exam.case import ANSWER, RIG, name_pattern, read_answer, seal, seals_of
from hil.exam.intervals import Value
from hil.exam.marks import Mark, confusion, errors_of, marks_for, reliability_of
from hil.exam.paper import VERDICTS, Paper

FORMAT: Final = "hil-exam-marks/1"
SHOWN: Final = 3.0
"""Severity from which on marks have bounds to reach."""


@dataclass(frozen=True, slots=True)
class Group:
    """The marks of some of the papers."""

    name: str
    papers: int
    marks: tuple[tuple[Mark, Value], ...]


@dataclass(frozen=True, slots=True)
class Marked:
    """A marked exam."""

    papers: tuple[Paper, ...]
    groups: tuple[Group, ...]
    unsealed: tuple[str, ...]
    """Cases whose seals were not there to be checked."""
    unusable: tuple[tuple[str, str], ...]
    """Cases whose diagnosis is missing or broken, and what is wrong."""
    unanswered: tuple[str, ...] = ()
    """Cases that have no answer, and so no mark."""

    def tables(self) -> dict[str, Any]:
        """As JSON, format hil-exam-marks/1."""
        return {
            "format": FORMAT,
            "cases": len(self.papers),
            "unsealed": list(self.unsealed),
            "unanswered": list(self.unanswered),
            "unusable": [{"case": c, "what": w} for c, w in self.unusable],
            "groups": [
                {
                    "name": g.name,
                    "papers": g.papers,
                    "marks": [
                        {
                            "mark": m.name, **asdict(v), "least": m.least, "most": m.most,
                            "reached": m.is_reached(v),
                        }
                        for m, v in g.marks
                    ],
                }
                for g in self.groups
            ],
            "confusion": confusion(_judged(self.papers)),
            "reliability": reliability_of(_judged(self.papers)),
            "by_effect": errors_of(_judged(self.papers)),
            "wrong": [
                {
                    "case": p.id, "severity": p.severity, "was": [list(x) for x in p.truth] or p.true_row,
                    "verdict": p.verdict, "called": list(p.cause(0) or ()), "probability": p.probability,
                }
                for p in self.papers
                if _is_wrong(p)
            ],
        }  # fmt: skip


def mark_exam(
    diagnoses: Path,
    answers: Path,
    *,
    cases: Path | None = None,
    oracle: Path | None = None,
    known: Path | None = None,
    only: str = "",
) -> Marked:
    """Mark the diagnoses in a folder by the answers in another.

    Every answer is a case; one without a diagnosis counts as wrong. `cases`: where the seals are, if not in
    the diagnoses. `oracle`: diagnoses of `sit --baseline oracle`; `known`: those that knew the effects
    which were withheld here. `only`: a pattern that case names match.
    RunError where an answer does not fit its seal.
    """
    inner = answers / "answers"
    root = inner if inner.is_dir() else answers
    pattern = name_pattern(only)
    found = [p for p in sorted(root.glob(f"*/{ANSWER}")) if pattern.search(p.parent.name)]
    if not found:
        raise RunError(
            f"{root}: holds no answers (<id>/{ANSWER}){f' that match {only!r}' if only else ''}"
        )
    for folder in (diagnoses, cases, oracle, known):
        if folder is not None and not folder.is_dir():
            raise RunError(f"{folder}: no such folder")
    if cases is None and (root.parent / "cases").is_dir():
        cases = root.parent / "cases"
    papers, unsealed, broken, unusable = [], [], [], []
    for path in found:
        case, answer = path.parent.name, read_answer(path)
        said, what = _read(diagnoses / f"{case}.json")
        if what:
            unusable.append((case, what))
        seals = _seals(case, said, cases)
        if not seals:
            unsealed.append(case)
        elif not seals <= _hashes(path, answer):
            broken.append(case)
        best, whole = (
            _read(folder / f"{case}.json")[0] if folder is not None else None
            for folder in (oracle, known)
        )
        papers.append(Paper(case, answer, said, best, whole))
    if broken:
        raise RunError(
            f"{root}: answers that are not those that were sealed: {', '.join(broken)}; an exam with changed "
            "answers is not marked"
        )
    there = [p.parent.name for p in sorted(cases.glob(f"*/{RIG}"))] if cases is not None else []
    answered = {p.parent.name for p in found}
    return Marked(
        tuple(papers),
        tuple(_groups(papers)),
        tuple(unsealed),
        tuple(unusable),
        tuple(c for c in there if pattern.search(c) and c[0] != "." and c not in answered),
    )


def _read(path: Path) -> tuple[dict[str, Any], str]:
    """A diagnosis and what is wrong with it."""
    try:
        said = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {"verdict": "missing"}, "no diagnosis"
    except (OSError, ValueError) as error:
        return {"verdict": "broken"}, f"{path.name}: cannot be read: {error}"
    if not isinstance(said, dict) or "verdict" not in said:
        return {"verdict": "broken"}, f"{path.name}: has no verdict"
    if said["verdict"] == "error":
        return said, str(said.get("error", "failed"))
    if said["verdict"] not in VERDICTS:
        return {"verdict": "broken"}, f"{path.name}: {said['verdict']!r} is no verdict"
    try:
        Paper("", {"verdict": "no_gap"}, said).credible()
        said.get("gap", {}).get("shrink")
    except (AttributeError, TypeError, ValueError) as error:
        return {"verdict": "broken"}, f"{path.name}: its causes cannot be read: {error}"
    return said, ""


def _seals(case: str, said: Mapping[str, Any], cases: Path | None) -> set[str]:
    if cases is not None and (cases / case / RIG).is_file():
        return seals_of(cases / case)
    return set(said.get("exam", {}).get("seals", ()))


def _hashes(path: Path, answer: Mapping[str, Any]) -> set[str]:
    """What a seal may be: of the canonical JSON, or of the file as it is."""
    return {seal(answer), hashlib.sha256(path.read_bytes()).hexdigest()}


def _judged(papers: Sequence[Paper]) -> list[Paper]:
    """Papers at severities from which on marks count; those that do not say count too."""
    return [p for p in papers if p.severity is None or p.severity == 0.0 or p.severity >= SHOWN]


def _groups(papers: Sequence[Paper]) -> list[Group]:
    judged = _judged(papers)
    out = [_group(f"all, {SHOWN:g} times the floor and more", judged)]
    rigs = sorted({p.rig for p in papers})
    if len(rigs) > 1:
        out += [_group(rig, [p for p in judged if p.rig == rig]) for rig in rigs]
    for s in sorted({p.severity for p in papers if p.severity}):
        out.append(_group(f"severity {s:g}", [p for p in papers if p.severity == s]))
    return out


def _group(name: str, papers: Sequence[Paper]) -> Group:
    return Group(name, len(papers), tuple((m, m.count(papers)) for m in marks_for(papers)))


def _is_wrong(p: Paper) -> bool:
    match p.kind:
        case "none":
            return p.verdict != "no_gap"
        case "outside":
            return p.verdict != "unknown"
        case "several":
            return p.said_set != frozenset(p.truth)
        case _:
            return not p.is_exact()
