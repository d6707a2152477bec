"""Marks of diagnoses that were made by hand, so that every mark is known beforehand."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from hil.errors import RunError
from hil.exam import mark_exam, seal
from hil.exam.intervals import brier, calibration_error, reliability, share
from hil.exam.mark import Marked
from hil.exam.marks import MARKS
from hil.exam.paper import Paper
from hil.exam.sizes import sizes

AT_3 = "all, 3 times the floor and more"


def _effect(effect: str, location: str = "axis", **parameters: float) -> dict[str, Any]:
    return {"effect": effect, "location": location, "parameters": parameters}


def _cause(effect: str, location: str = "axis", p: float = 0.95, **more: Any) -> dict[str, Any]:
    return {"effect": effect, "location": location, "probability": p, "parameters": {}, **more}


def _answer(verdict: str, *effects: dict[str, Any], severity: float | None = 3.0) -> dict[str, Any]:
    out: dict[str, Any] = {"verdict": verdict, "effects": list(effects), "rig": "axis"}
    if severity is not None:
        out["severity"] = severity
    return out


def _said(verdict: str, *causes: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"verdict": verdict, "causes": list(causes), "effects": list(causes[:1]), **more}


def _exam(
    folder: Path, papers: dict[str, tuple[dict[str, Any], dict[str, Any] | str | None]]
) -> Marked:
    """Write answers and diagnoses (with seals), and mark them."""
    for case, (answer, said) in papers.items():
        (folder / "answers" / case).mkdir(parents=True)
        (folder / "answers" / case / "answer.json").write_text(json.dumps(answer))
        (folder / "said").mkdir(exist_ok=True)
        if isinstance(said, str):
            (folder / "said" / f"{case}.json").write_text(said)
        elif said is not None:
            note = {"seals": [seal(answer)], **said.get("exam", {})}
            (folder / "said" / f"{case}.json").write_text(json.dumps({**said, "exam": note}))
    return mark_exam(folder / "said", folder / "answers")


def _value(marked: Marked, mark: str, group: str = AT_3) -> float | None:
    found = next(g for g in marked.groups if g.name == group)
    return next(v.value for m, v in found.marks if m.name == mark)


BACKLASH, COULOMB = _effect("backlash", gap=1e-3), _effect("coulomb_friction", force=50.0)


def test_marks_of_a_small_exam_are_those_counted_by_hand(tmp_path: Path) -> None:
    marked = _exam(
        tmp_path,
        {
            "right": (_answer("identified", BACKLASH), _said("identified", _cause("backlash"))),
            "second": (
                _answer("identified", BACKLASH),
                _said("ambiguous", _cause("hysteresis", p=0.6), _cause("backlash", p=0.4)),
            ),
            "elsewhere": (
                _answer("identified", BACKLASH), _said("identified", _cause("backlash", "leg2")),
            ),
            "shy": (_answer("identified", COULOMB), _said("unknown", _cause("coulomb_friction"))),
            "null": (_answer("no_gap", severity=0.0), _said("no_gap")),
            "alarm": (_answer("no_gap", severity=0.0), _said("identified", _cause("backlash"))),
            "odd": (_answer("unknown"), _said("unknown")),
            "odd named": (_answer("unknown"), _said("identified", _cause("backlash", p=0.99))),
        },
    )  # fmt: skip
    assert _value(marked, "top-1 by leaf") == 0.5
    assert _value(marked, "top-2 by leaf") == 0.75
    assert _value(marked, "location right") == 0.5
    assert _value(marked, "leaf and location right") == 0.25
    assert _value(marked, "false alarms on null cases") == 0.5
    assert _value(marked, "outside effects called unknown") == 0.5
    assert _value(marked, "outside effects named, p > 0.9") == 0.5
    assert _value(marked, "catalogue effects called unknown") == 0.25
    assert _value(marked, "90 % set holds the truth") == pytest.approx(2.0 / 3.0)
    assert _value(marked, "what that set itself states") > 0.9
    assert _value(marked, "mean size of the 90 % set") == pytest.approx(4.0 / 3.0)
    table = marked.tables()
    assert table["confusion"]["backlash"] == {"backlash": 2, "hysteresis": 1}
    assert {w["case"] for w in table["wrong"]} == {
        "second",
        "elsewhere",
        "shy",
        "alarm",
        "odd named",
    }
    assert json.loads(json.dumps(table)) == table


def test_a_class_is_right_where_it_holds_the_truth(tmp_path: Path) -> None:
    marked = _exam(
        tmp_path,
        {
            "class": (
                _answer("identified", _effect("force_constant", scale=0.9)),
                _said(
                    "ambiguous",
                    _cause("payload_mass", "platform", 0.5, **{"class": 1}),
                    _cause("backlash", p=0.1, **{"class": 2}),
                    _cause("force_constant", p=0.4, **{"class": 1}),
                ),
            ),
            "no class": (
                _answer("identified", _effect("force_constant", scale=0.9)),
                _said(
                    "ambiguous",
                    _cause("payload_mass", "platform", 0.5),
                    _cause("force_constant", p=0.5),
                ),
            ),
        },
    )
    assert _value(marked, "top-1 by class") == 0.5
    assert _value(marked, "top-1 by leaf") == 0.0


def test_several_effects_are_marked_as_a_set(tmp_path: Path) -> None:
    both = _answer("identified", BACKLASH, COULOMB)
    causes = (_cause("coulomb_friction"), _cause("backlash", p=0.9))
    marked = _exam(
        tmp_path,
        {
            "both": (both, {**_said("identified", *causes), "effects": [BACKLASH, COULOMB]}),
            "one": (both, _said("identified", *causes)),
        },
    )
    assert _value(marked, "several: the whole set right") == 0.5
    assert _value(marked, "several: first cause right") == 1.0


def test_what_is_missing_or_broken_counts_as_wrong_and_is_named(tmp_path: Path) -> None:
    truth = _answer("identified", BACKLASH)
    marked = _exam(
        tmp_path,
        {
            "good": (truth, _said("identified", _cause("backlash"))),
            "missing": (truth, None),
            "torn": (truth, '{"verdict": "identi'),
            "strange": (truth, {"verdict": "perhaps", "causes": []}),
            "failed": (truth, {"verdict": "error", "error": "RunError: no file"}),
            "odd causes": (truth, {"verdict": "identified", "causes": ["backlash"]}),
            "null failed": (_answer("no_gap", severity=0.0), None),
        },
    )
    assert _value(marked, "top-1 by leaf") == pytest.approx(1.0 / 6.0)
    assert _value(marked, "false alarms on null cases") == 1.0
    assert _value(marked, "diagnoses missing or broken") == pytest.approx(6.0 / 7.0)
    told = dict(marked.unusable)
    assert set(told) == {"missing", "torn", "strange", "failed", "odd causes", "null failed"}
    assert told["failed"] == "RunError: no file"


def test_cases_without_an_answer_are_named(tmp_path: Path) -> None:
    for case in ("kept", "lost", ".half"):
        (tmp_path / "cases" / case).mkdir(parents=True)
        (tmp_path / "cases" / case / "rig.toml").touch()
    marked = _exam(tmp_path, {"kept": (_answer("no_gap"), _said("no_gap"))})
    assert marked.unanswered == ("lost",)
    assert marked.tables()["unanswered"] == ["lost"]


def test_a_changed_answer_breaks_its_seal(tmp_path: Path) -> None:
    _exam(
        tmp_path, {"a": (_answer("identified", BACKLASH), _said("identified", _cause("backlash")))}
    )
    path = tmp_path / "answers" / "a" / "answer.json"
    path.write_text(json.dumps(_answer("identified", COULOMB)))
    with pytest.raises(RunError, match="not those that were sealed: a;"):
        mark_exam(tmp_path / "said", tmp_path / "answers")


def test_the_seal_does_not_depend_on_how_json_is_written(tmp_path: Path) -> None:
    _exam(
        tmp_path, {"a": (_answer("identified", BACKLASH), _said("identified", _cause("backlash")))}
    )
    path = tmp_path / "answers" / "a" / "answer.json"
    path.write_text(json.dumps(json.loads(path.read_text()), indent=4, sort_keys=True))
    assert len(mark_exam(tmp_path / "said", tmp_path / "answers").papers) == 1


def test_answers_by_others_need_the_contract_only(tmp_path: Path) -> None:
    bare = {"verdict": "identified", "effects": [BACKLASH]}
    plain = {"verdict": "identified", "causes": [{"effect": "backlash", "location": "axis"}]}
    for case in ("x", "y"):
        (tmp_path / case).mkdir()
        (tmp_path / case / "answer.json").write_text(json.dumps(bare))
    (tmp_path / "said").mkdir()
    (tmp_path / "said" / "x.json").write_text(json.dumps(plain))
    (tmp_path / "said" / "y.json").write_text(json.dumps({**plain, "rig": "motorcycle"}))
    marked = mark_exam(tmp_path / "said", tmp_path)
    assert marked.unsealed == ("x", "y")
    assert _value(marked, "leaf and location right") == 1.0
    assert _value(marked, "shrink over the oracle's, median") is None
    assert {g.name for g in marked.groups} == {AT_3, "?", "motorcycle"}


def test_severities_below_the_bound_are_marked_apart(tmp_path: Path) -> None:
    marked = _exam(
        tmp_path,
        {
            "faint": (_answer("identified", BACKLASH, severity=1.0), _said("no_gap")),
            "clear": (_answer("identified", BACKLASH), _said("identified", _cause("backlash"))),
        },
    )
    assert _value(marked, "top-1 by leaf") == 1.0
    assert _value(marked, "effects called no_gap", "severity 1") == 1.0


def test_what_is_missed_is_set_against_what_the_oracle_sees_of_it() -> None:
    answer, missed = _answer("identified", BACKLASH), _said("no_gap")
    papers = [
        Paper("seen", answer, missed, {"nats": 35.0}),
        Paper("hidden", answer, missed, {"nats": 4.7}),
        Paper("not sat", answer, missed),
        Paper("named", answer, _said("identified", _cause("backlash")), {"nats": 500.0}),
        Paper("healthy", _answer("no_gap"), missed, {"gap": {"shrink": None}}),
    ]
    assert [p.is_evident for p in papers] == [True, False, None, True, None]
    mark = next(m for m in MARKS if m.name == "of them evident to the oracle")
    value = mark.count(papers)
    assert (value.value, value.count) == (0.5, 2)


def test_shrink_is_set_against_the_oracle_and_harm_is_counted(tmp_path: Path) -> None:
    answer = _answer("identified", BACKLASH)
    gaps = {"good": (0.9, 1.0), "leak": (1.0, 1.0), "harm": (-0.1, 5.2)}
    papers = []
    for case, (shrink, after) in gaps.items():
        gap = {"before": 5.0, "after": after, "noise_floor": 1.0, "shrink": shrink}
        papers.append(
            Paper(
                case,
                answer,
                _said("identified", _cause("backlash"), gap=gap),
                {"gap": {"shrink": 0.9}},
            )
        )
    assert [p.shrink_share for p in papers] == pytest.approx([1.0, 1.111, -0.111], abs=1e-3)
    assert [p.is_harmful for p in papers] == [False, False, True]


def test_parameters_count_from_neutral_and_vectors_as_a_whole() -> None:
    said = {
        "scale": {"value": 1.08, "ci": [1.05, 1.09]},
        "amplitude": {"value": 1.0, "ci": None},
    }
    answer = _answer("identified", _effect("force_constant", scale=1.1))
    one = sizes(
        Paper("", answer, _said("identified", {**_cause("force_constant"), "parameters": said}))
    )
    assert [s.error for s in one] == pytest.approx([0.2])
    assert one[0].covered == (False,)
    where = _effect("payload_cog", "platform", x=0.03, y=0.0, z=0.04)
    found = {
        c: {"value": v, "ci": [v - 0.01, v + 0.01]}
        for c, v in (("x", 0.03), ("y", 0.005), ("z", 0.04))
    }
    cog = {**_cause("payload_cog", "platform"), "parameters": found}
    vector = sizes(Paper("", _answer("identified", where), _said("identified", cog)))
    assert [s.error for s in vector] == pytest.approx([0.1])
    assert vector[0].covered == (True, True, True)


def test_phases_a_turn_apart_are_the_same() -> None:
    wave = _effect("force_ripple", amplitude=5.0, period=0.01, phase=5.03)
    for value, is_held in ((-1.25, True), (-1.0, False), (5.03, True)):
        phase = {"phase": {"value": value, "ci": [value - 0.1, value + 0.1]}}
        said = _said("identified", {**_cause("force_ripple"), "parameters": phase})
        found = {s.name: s for s in sizes(Paper("", _answer("identified", wave), said))}
        assert found["phase"].covered == (is_held,)


def test_withheld_effects_have_marks_of_their_own(tmp_path: Path) -> None:
    note = {"exam": {"without": ["backlash"]}}

    def other(p: float) -> dict[str, Any]:
        return _cause("hysteresis", p=p)

    marked = _exam(
        tmp_path,
        {
            "unknown": (_answer("identified", BACKLASH), {**_said("unknown"), **note}),
            "sure": (
                _answer("identified", BACKLASH),
                {**_said("identified", _cause("hysteresis", p=0.97)), **note},
            ),
            "modest": (
                _answer("identified", BACKLASH),
                {**_said("ambiguous", _cause("hysteresis", p=0.5)), **note},
            ),
            "blind": (_answer("identified", BACKLASH), {**_said("no_gap"), **note}),
        },
    )
    assert _value(marked, "left out: unknown or p ≤ 0.9") == 0.5
    assert _value(marked, "left out: called unknown") == 0.25
    assert _value(marked, "left out: another leaf, p > 0.9") == 0.25


def test_what_nothing_tells_from_a_withheld_effect_is_its_nearest_class(tmp_path: Path) -> None:
    truth = _answer("identified", _effect("payload_mass", "platform", mass=20.0))
    note = {"exam": {"without": ["payload_mass"]}}

    def named(effect: str, p: float) -> dict[str, Any]:
        return {**_said("identified", _cause(effect, p=p)), **note}

    _exam(
        tmp_path,
        {
            "alike": (truth, named("actuator_inertia", 0.97)),
            "other": (truth, named("coulomb_friction", 0.97)),
            "modest": (truth, named("coulomb_friction", 0.6)),
            "blind": (truth, {**_said("no_gap"), **note}),
        },
    )
    whole = _said(
        "ambiguous",
        {**_cause("payload_mass", "platform", p=0.49), "class": 0},
        {**_cause("actuator_inertia", p=0.48), "class": 0},
        {**_cause("coulomb_friction", p=0.0), "class": 1},
    )
    (tmp_path / "known").mkdir()
    for case in ("alike", "other", "modest", "blind"):
        (tmp_path / "known" / f"{case}.json").write_text(json.dumps(whole))
    folders = (tmp_path / "said", tmp_path / "answers")
    marked = mark_exam(*folders, known=tmp_path / "known")
    assert _value(marked, "the same, or named within its class") == 0.5
    assert _value(marked, "left out: unknown or p ≤ 0.9") == 0.25
    assert _value(mark_exam(*folders), "the same, or named within its class") is None


def test_wilsons_interval_is_the_published_one() -> None:
    found = share([True] * 8 + [False] * 2)
    assert (found.low, found.high) == pytest.approx((0.4902, 0.9433), abs=1e-4)
    nothing = share([False] * 200)
    assert nothing.low == 0.0
    assert nothing.high == pytest.approx(0.0188, abs=1e-4)


def test_calibration_of_known_statements() -> None:
    stated, came = [0.95] * 20 + [0.55] * 20, [True] * 19 + [False] + [True] * 11 + [False] * 9
    assert calibration_error(stated, came).value == pytest.approx(0.0, abs=1e-12)
    assert brier(stated, came).value == pytest.approx(
        (19 * 0.05**2 + 0.95**2 + 11 * 0.45**2 + 9 * 0.55**2) / 40
    )
    assert calibration_error([0.95] * 10, [True] * 5 + [False] * 5).value == pytest.approx(0.45)
    assert [(r["from"], r["count"]) for r in reliability(stated, came)] == [(0.5, 20), (0.9, 20)]


def test_a_set_may_hold_something_unknown() -> None:
    said = _said("ambiguous", _cause("backlash", p=0.6), _cause("hysteresis", p=0.05))
    paper = Paper("", _answer("identified", BACKLASH), {**said, "unknown_probability": 0.35})
    assert paper.credible() == [("backlash", "axis"), ("unknown", "")]
    assert paper.credible_probability == pytest.approx(0.95)


def test_a_set_states_no_more_than_all() -> None:
    """Effects that act together have a probability each."""
    said = _said("identified", _cause("backlash", p=0.85), _cause("hysteresis", p=0.75))
    paper = Paper("", _answer("identified", BACKLASH), said)
    assert paper.credible() == [("backlash", "axis"), ("hysteresis", "axis")]
    assert paper.credible_probability == 1.0
