"""Cases are made, sealed, sat and found again; whatever fails is kept as a failure."""

from __future__ import annotations

import json
import shutil
import time
import tomllib
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from hil.cli.exam import app
from hil.config import Effect
from hil.configfile import load_rig
from hil.errors import ConfigError, RunError
from hil.exam import Order, Sitting, load_case, make_exam, mark_exam, seal, sit_exam
from hil.exam.baselines import sit_baseline
from hil.exam.case import case_folders, read_answer, write_case
from hil.exam.make import make_case
from hil.exam.menu import OF_LOOPS, effects_of, possible
from hil.exam.odd import outside_of
from hil.exam.rigs import draw_rig
from hil.exam.severity import Bench
from hil.exam.sit import sit_case
from hil.exam.world import OUTSIDE, Scatter, build_world
from hil.gap.catalogue.nuisances import default_nuisances
from tests.exam.worlds import sway

ORDER = Order(
    rigs=("axis",), seed=3000, severities=(3.0,), kinds=("single",), effects=("coulomb_friction",)
)
CONTRACT = {"format", "rig", "mode", "started", "note", "role", "answer_sha256", "payload"}


@pytest.fixture(scope="module")
def exam(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("exam")
    make_exam(ORDER, 2, out, jobs=1)
    return out


def test_a_case_holds_the_contract_and_no_hint(exam: Path) -> None:
    for folder in case_folders(exam):
        case = load_case(folder)
        answer = read_answer(exam / "answers" / folder.name / "answer.json")
        assert {p.name for p in folder.iterdir() if p.is_file()} == {"rig.toml"}
        assert case.rig.effects == ()
        for run in sorted(folder.glob("run*/run.toml")):
            told = tomllib.loads(run.read_text())
            assert set(told) <= {
                "format",
                "rig",
                "mode",
                "started",
                "note",
                "role",
                "answer_sha256",
                "payload",
            }
            assert told["answer_sha256"] == seal(answer)
            assert "friction" not in run.read_text()
        assert all(r.duration_s > 15.0 for r in case.runs)


def test_an_answer_says_what_was_put_in(exam: Path) -> None:
    answer = read_answer(next((exam / "answers").glob("*/answer.json")))
    assert answer["verdict"] == "identified"
    assert [e["effect"] for e in answer["effects"]] == ["coulomb_friction"]
    assert max(answer["traces"][0].values()) == pytest.approx(3.0, rel=0.13)


def test_the_same_number_makes_the_same_case(exam: Path, tmp_path: Path) -> None:
    make_case(ORDER, 1, tmp_path)
    case = ORDER.case_id(1)
    for name in ("cases", "answers"):
        files = sorted(p.relative_to(exam) for p in (exam / name / case).rglob("*") if p.is_file())
        assert files == sorted(
            p.relative_to(tmp_path) for p in (tmp_path / name / case).rglob("*") if p.is_file()
        )
    again, first = load_case(tmp_path / "cases" / case), load_case(exam / "cases" / case)
    assert all(a.table.equals(b.table) for a, b in zip(again.runs, first.runs, strict=True))


def test_cases_that_are_there_are_not_made_again(exam: Path) -> None:
    said: list[str] = []
    before = {p: p.stat().st_mtime_ns for p in exam.rglob("*") if p.is_file()}
    make_exam(ORDER, 2, exam, jobs=1, on_done=lambda case, text: said.append(text))
    assert said == ["is there already"] * 2
    assert before == {p: p.stat().st_mtime_ns for p in exam.rglob("*") if p.is_file()}


def test_reference_runs_are_healthy(tmp_path: Path) -> None:
    order = replace(ORDER, seed=3002, severities=(10.0,), effects=("sensor_bias",))
    make_case(order, 0, tmp_path)
    case = load_case(tmp_path / "cases" / order.case_id(0))
    offset = read_answer(tmp_path / "answers" / case.id / "answer.json")["effects"][0][
        "parameters"
    ]["offset"]
    mean = [float(np.nanmedian(r.table["axis.force"])) for r in (*case.runs, *case.references)]
    assert mean[0] == pytest.approx(offset, rel=0.2)
    assert abs(mean[1]) < 0.2 * abs(offset)


def test_orders_for_what_there_is_not_are_refused() -> None:
    with pytest.raises(ConfigError, match="'lorry' is no rig of exam cases"):
        Order(rigs=("lorry",))
    with pytest.raises(ConfigError, match="'quadruple' is no kind"):
        Order(kinds=("quadruple",))
    with pytest.raises(ConfigError, match="severities above 0"):
        Order(severities=(0.0,))
    with pytest.raises(ConfigError, match="'speed' is no mode"):
        Order(mode="speed")
    with pytest.raises(ConfigError, match=r"scatter = 9 lies outside 0\.\.5"):
        Order(scatter=9.0)
    with pytest.raises(ConfigError, match="a bicycle has no drives"):
        Order(rigs=("bicycle",), mode="force")


def test_a_case_whose_drives_are_told_forces_says_so(tmp_path: Path) -> None:
    order = replace(ORDER, mode="force")
    make_case(order, 0, tmp_path)
    case = load_case(tmp_path / "cases" / order.case_id(0))
    assert case.rig.control.mode == "computed_torque"
    for run in (*case.runs, *case.references):
        assert run.meta.mode == "force"
        assert "axis.force_setpoint" in run.table
        assert "axis.setpoint" not in run.table


def test_drives_that_are_told_forces_have_no_loops_to_be_wrong() -> None:
    rng = np.random.default_rng(1)
    for name in ("axis", "stewart"):
        own, told = (draw_rig(name, rng, is_told=told) for told in (False, True))
        assert set(OF_LOOPS) & set(effects_of(own, set()))
        assert not set(OF_LOOPS) & set(effects_of(told, set()))
        assert not set(OF_LOOPS) & set(possible(name, "force"))
        assert set(OF_LOOPS) & set(possible(name))
        assert "setpoint_rounding" in outside_of(own, OUTSIDE)
        assert "setpoint_rounding" not in outside_of(told, OUTSIDE)


@pytest.mark.parametrize("size", [1.0, 2.0])
def test_a_healthy_rig_stays_within_what_a_calibration_allows(size: float) -> None:
    rig = load_rig("motorcycle")
    allowed = {n.name: 3.0 * n.sd for n in default_nuisances(rig, [])}
    for seed in range(20):
        world = build_world(rig, Scatter(seed, size))
        assert abs(world.true[1][0] - rig.mass.m) < allowed["platform.payload_mass.mass"]
        cog = world.true[1][1:4] - np.array(rig.mass.cog)
        assert np.all(np.abs(cog) < allowed["platform.payload_cog.x"])
        assert np.all(np.abs(world.setpoint_delay_s) < allowed["leg1.transport_delay.delay"])


def test_severity_counts_floors_of_the_most_touched_signal() -> None:
    rig = load_rig("axis")
    bench = Bench.of(rig, Scatter(4), sway(rig, 6.0), (1, 2), with_imu=False)
    assert bench.trace(()) == dict.fromkeys(bench.floor, 0.0)
    line = Effect(effect="sensor_bias", location="axis.force", parameters={"offset": 50.0})
    assert bench.trace((line,))["axis.force"] == pytest.approx(50.0 / bench.floor["axis.force"])


def _seat(exam: Path, out: Path, **more: Any) -> Sitting:
    return Sitting(out, answers=exam / "answers", **more)


def test_the_oracle_finds_what_it_was_told_and_the_gap_shrinks(exam: Path, tmp_path: Path) -> None:
    case = case_folders(exam)[0]
    sit_case(case, _seat(exam, tmp_path, baseline="oracle"))
    said = json.loads((tmp_path / f"{case.name}.json").read_text())
    true = read_answer(exam / "answers" / case.name / "answer.json")["effects"][0]["parameters"][
        "force"
    ]
    assert said["causes"][0]["parameters"]["force"]["value"] == pytest.approx(true, rel=0.4)
    assert said["gap"]["after"] < said["gap"]["before"]
    assert said["nats"] > 50.0  # evidence for what is there, and not for what is not
    absent = {"effect": "force_constant", "location": "axis", "parameters": {"scale": 1.1}}
    other = sit_baseline("oracle", load_case(case), {"effects": [absent]})
    assert other["nats"] < said["nats"] / 10.0
    marked = mark_exam(tmp_path, exam / "answers", oracle=tmp_path, only=case.name)
    shown = {m.name: v.value for m, v in marked.groups[0].marks}
    assert shown["leaf and location right"] == 1.0


def test_a_sitting_goes_on_where_it_stopped(exam: Path, tmp_path: Path) -> None:
    names = [f.name for f in case_folders(exam)]
    (tmp_path / f"{names[0]}.json").write_text('{"verdict": "no_gap"}')
    said: list[str] = []
    sit_exam(
        exam,
        _seat(exam, tmp_path, baseline="random"),
        jobs=1,
        on_done=lambda case, text: said.append(case),
    )
    assert said == names[1:]
    assert json.loads((tmp_path / f"{names[0]}.json").read_text()) == {"verdict": "no_gap"}


def test_a_folder_of_diagnoses_is_of_one_sitter(exam: Path, tmp_path: Path) -> None:
    case = case_folders(exam)[0].name
    sit_exam(exam, _seat(exam, tmp_path, baseline="random"), jobs=1, only=case)
    before = (tmp_path / f"{case}.json").read_bytes()
    others: list[tuple[dict[str, Any], str]] = [
        ({"baseline": "oracle"}, "by random, not by oracle"),
        ({}, "by random, not by diagnose"),
        (
            {"baseline": "random", "without": "auto"},
            "with nothing withheld, not coulomb_friction",
        ),
        (
            {"baseline": "random", "without": ("backlash",)},
            "with nothing withheld, not backlash",
        ),
    ]
    for other, said in others:
        with pytest.raises(
            ConfigError, match=rf"{case}\.json: was sat {said}\nname another folder"
        ):
            sit_exam(exam, _seat(exam, tmp_path, **other), jobs=1)
    assert [p.read_bytes() for p in tmp_path.iterdir()] == [before]


@pytest.mark.parametrize("broken", ["", "{", "[]", '{"effects": []}'])
def test_a_file_that_is_no_diagnosis_is_sat_again(exam: Path, tmp_path: Path, broken: str) -> None:
    case = case_folders(exam)[0].name
    (tmp_path / f"{case}.json").write_text(broken)
    said: list[str] = []
    seat = _seat(exam, tmp_path, baseline="random")
    sit_exam(exam, seat, jobs=1, only=case, on_done=lambda case, text: said.append(text))
    assert [text[text.index("(") :] for text in said] == ["(sat again: its file was no diagnosis)"]
    assert "verdict" in json.loads((tmp_path / f"{case}.json").read_text())


def test_a_sitting_says_what_is_there_already(exam: Path, tmp_path: Path) -> None:
    words = ["sit", str(exam), "--out", str(tmp_path), "--baseline", "random", "--jobs", "1"]
    for told in (1, 2):
        done = CliRunner().invoke(app, words)
        assert done.exit_code == 0, done.exception
        assert ("2 of 2 have a diagnosis in" in done.stderr) == (told == 2)


def test_a_case_that_fails_or_takes_too_long_is_kept_as_an_error(
    exam: Path, tmp_path: Path
) -> None:
    case = case_folders(exam)[0]
    sit_case(case, _seat(exam, tmp_path, baseline="oracle", limit_s=0.05))
    said = json.loads((tmp_path / f"{case.name}.json").read_text())
    assert said["verdict"] == "error"
    assert "longer than 0.05 s" in said["error"]
    broken = tmp_path / "cases" / "bad"
    broken.mkdir(parents=True)
    (broken / "rig.toml").write_text("name = 3")
    sit_case(broken, _seat(exam, tmp_path, baseline="random"))
    assert "ConfigError" in json.loads((tmp_path / "bad.json").read_text())["error"]


def test_a_limit_that_is_told_where_nobody_listens_is_told_again(
    exam: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def diagnose(*runs: Any, **how: Any) -> Any:
        with suppress(TimeoutError):  # as where memory is being collected
            time.sleep(60.0)
        time.sleep(60.0)

    monkeypatch.setattr("hil.gap.bicycle.diagnose_any", diagnose)
    case = case_folders(exam)[0]
    sit_case(case, Sitting(tmp_path, limit_s=0.05))
    assert "longer than 0.05 s" in json.loads((tmp_path / f"{case.name}.json").read_text())["error"]


def test_withheld_effects_that_a_cases_rig_has_not_do_not_fail_it(
    exam: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    withheld = []

    def diagnose(*runs: Any, without: list[str], **how: Any) -> Any:
        withheld.extend(without)
        return SimpleNamespace(tables=lambda: {"verdict": "no_gap"})

    monkeypatch.setattr("hil.gap.bicycle.diagnose_any", diagnose)
    sitting = Sitting(tmp_path, without=("wheel_slip", "backlash"))
    assert sit_case(case_folders(exam)[0], sitting).startswith("no_gap")
    assert withheld == ["backlash"]


def test_folders_without_cases_or_answers_are_named(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"holds no case; a case is a folder with rig\.toml"):
        case_folders(tmp_path)
    with pytest.raises(RunError, match="holds no answers"):
        mark_exam(tmp_path, tmp_path)


def test_kinds_that_need_more_effects_than_may_be_are_left_out(tmp_path: Path) -> None:
    order = Order(rigs=("axis",), seed=3003, severities=(10.0,), effects=("coulomb_friction",))
    kinds = ("double", "single")
    make_case(replace(order, kinds=kinds), 0, tmp_path)
    answer = read_answer(tmp_path / "answers" / order.case_id(0) / "answer.json")
    assert [e["effect"] for e in answer["effects"]] == ["coulomb_friction"]


def test_what_is_misspelt_is_named_before_anything_is_done(exam: Path, tmp_path: Path) -> None:
    seat = Sitting(tmp_path / "said")
    with pytest.raises(ConfigError, match="no exam case can hold backlsh"):
        make_exam(Order(rigs=("axis",), effects=("backlsh",)), 1, tmp_path / "exam")
    with pytest.raises(ConfigError, match="no case of axis can be double with backlash alone"):
        make_case(Order(rigs=("axis",), effects=("backlash",), kinds=("double",)), 0, tmp_path)
    with pytest.raises(ConfigError, match="no effect backlsh that could be withheld"):
        sit_exam(exam, replace(seat, without=("backlsh", "wheel_slip")))
    with pytest.raises(ConfigError, match=r"'\(' is no pattern"):
        sit_exam(exam, seat, only="(")
    with pytest.raises(RunError, match="nowhere: no such folder"):
        sit_exam(exam, replace(seat, baseline="oracle", answers=tmp_path / "nowhere"))
    with pytest.raises(ConfigError, match=r"'\(' is no pattern"):
        mark_exam(tmp_path, exam / "answers", only="(")
    for folder in ("oracle", "known", "cases"):
        with pytest.raises(RunError, match="nowhere: no such folder"):
            mark_exam(tmp_path, exam / "answers", **{folder: tmp_path / "nowhere"})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", [["make", "--cases", "1"], ["sit", "EXAM"]])
def test_a_file_in_the_place_of_a_folder_for_answers_is_named(
    exam: Path, tmp_path: Path, command: list[str]
) -> None:
    (tmp_path / "taken").write_text("mine")
    words = [str(exam) if word == "EXAM" else word for word in command]
    done = CliRunner().invoke(app, [*words, "--out", str(tmp_path / "taken")])
    assert isinstance(done.exception, RunError)
    assert "taken is no folder" in str(done.exception)


def test_making_an_exam_goes_on_where_it_stopped(exam: Path) -> None:
    words = ["make", "--out", str(exam), "--cases", "1", "--rigs", "axis", "--seed", "3000",
             "--severity", "3", "--kinds", "single", "--effects", "coulomb_friction"]  # fmt: skip
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.exception
    assert "is there already" in done.stderr


def copied(exam: Path, to: Path) -> Path:
    shutil.copytree(exam, to)
    return to


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ({"severities": (10.0,)}, r"severities \[3\.0\]"),
        (
            {"kinds": ("none",), "effects": ()},
            r"kinds \['single'\], effects \['coulomb_friction'\]",
        ),
        ({"mode": "force"}, "mode position"),
        ({"scatter": 2.0}, "scatter 1.0"),
    ],
)
def test_a_folder_holds_cases_made_with_the_same_options(
    exam: Path, other: dict[str, Any], said: str
) -> None:
    for seed in (ORDER.seed, ORDER.seed + 5):
        with pytest.raises(ConfigError, match=rf"made with other options \({said}\)"):
            make_exam(replace(ORDER, seed=seed, **other), 2, exam, jobs=1)


@pytest.mark.parametrize("untold", ["options", "scatter"])
def test_a_folder_that_does_not_say_its_options_goes_on(
    exam: Path, tmp_path: Path, untold: str
) -> None:
    old = copied(exam, tmp_path / "old")
    for path in old.glob("answers/*/answer.json"):
        answer = read_answer(path)
        made = answer["made_with"]
        del (made if untold == "options" else made["options"])[untold]
        path.write_text(json.dumps(answer))
    said: list[str] = []
    make_exam(ORDER, 2, old, jobs=1, on_done=lambda case, text: said.append(text))
    assert said == ["is there already"] * 2


@pytest.mark.parametrize("lacking", ["cases/{}/rig.toml", "answers/{}/answer.json"])
def test_a_case_that_lacks_something_is_named_and_nothing_is_made(
    exam: Path, tmp_path: Path, lacking: str
) -> None:
    half, case = copied(exam, tmp_path / "half"), ORDER.case_id(1)
    (half / lacking.format(case)).unlink()
    before = {p: p.read_bytes() for p in half.rglob("*") if p.is_file()}
    with pytest.raises(RunError, match=rf"{case}.*, and the case is made anew"):
        make_exam(ORDER, 3, half, jobs=1)
    assert before == {p: p.read_bytes() for p in half.rglob("*") if p.is_file()}


def test_no_answer_is_changed_where_its_case_cannot_be_written(
    exam: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    half, case = copied(exam, tmp_path / "half"), ORDER.case_id(0)
    answer = half / "answers" / case / "answer.json"
    before = answer.read_bytes()
    tables = [(r.table, "diagnose", None) for r in load_case(half / "cases" / case).runs]
    other = {"verdict": "no_gap", "effects": []}
    rig = load_rig("axis")
    with pytest.raises(RunError, match=f"{case}: cannot be written: .* exists already"):
        write_case(case, rig, tables, other, 0, half)
    shutil.rmtree(half / "cases" / case)

    def full(table: Any, path: Path, **how: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pandas.DataFrame.to_parquet", full)
    with pytest.raises(RunError, match=f"{case}: cannot be written: No space left on device"):
        write_case(case, rig, tables, other, 0, half)
    assert answer.read_bytes() == before
    assert [p.name for p in (half / "cases").iterdir()] == [ORDER.case_id(1)]


def test_the_command_line_teaches_and_marks(exam: Path, tmp_path: Path) -> None:
    run = CliRunner()
    assert "seals" in run.invoke(app, ["--help"]).output
    done = run.invoke(
        app, ["sit", str(exam), "--out", str(tmp_path), "--baseline", "random", "--jobs", "1"]
    )
    assert done.exit_code == 0, done.output
    done = run.invoke(
        app,
        [
            "mark",
            str(tmp_path),
            "--answers",
            str(exam / "answers"),
            "--json",
            str(tmp_path / "marks.json"),
        ],
    )
    assert done.exit_code == 0, done.output
    assert "top-1 by class" in done.output
    marks = json.loads((tmp_path / "marks.json").read_text())
    assert marks["format"] == "hil-exam-marks/1"
    assert marks["unsealed"] == []
