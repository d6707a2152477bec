"""What comes out: a rig file with provenance, JSON, a page, and the command that makes them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from hil.cli.app import app
from hil.configfile import data_folder, load_rig, rig_toml, write_rig_file
from hil.errors import ConfigError, IdentificationError, RunError
from hil.identify.estimate.result import Estimate, Identification
from hil.identify.estimate.rigfile import updated_rig_text
from hil.runs.folder import RunMeta, write_meta
from tests.identify.estimate_data import as_run, multisine, play

TEXT = (data_folder("configs") / "motorcycle.toml").read_text()


def _estimate(name: str, value: float, nominal: float, *, identifiable: bool = True) -> Estimate:
    return Estimate(
        name=name, unit="", value=value, nominal=nominal, std=0.01 * abs(value),
        ci90=(0.98 * value, 1.02 * value), ci95=(0.975 * value, 1.025 * value),
        identifiable=identifiable, reason="" if identifiable else "too quiet",
    )  # fmt: skip


def _result(*estimates: Estimate) -> Identification:
    return Identification(
        rig="motorcycle", runs=("20260101_a",), method="iv", estimates=estimates, fit={}, rank=1,
        condition=1.0, untold=(), effective_samples=100.0,
    )  # fmt: skip


def _loaded(text: str, folder: Path):  # type: ignore[no-untyped-def]
    path = folder / "new.toml"
    path.write_text(text)
    return load_rig(path)


def test_told_values_are_written_with_provenance_and_comments_stay(tmp_path: Path) -> None:
    result = _result(
        _estimate("mass.m", 211.0, 200.0),
        _estimate("mass.inertia.yy", 47.0, 45.0),
        _estimate("leg2.coulomb", 41.0, 30.0),
        _estimate("slide.viscous", 99.0, 60.0, identifiable=False),
        _estimate("leg1.transport_delay.delay", 0.004, 0.0),
    )
    text = updated_rig_text(TEXT, result, "2026-02-03")
    rig = _loaded(text, tmp_path)
    assert rig.mass.m == 211.0
    assert rig.mass.inertia[1][1] == 47.0
    assert rig.mass.inertia[0][0] == 18.0
    assert rig.actuators[1].coulomb == 41.0
    assert rig.actuators[2].viscous == 60.0
    assert rig.effects[0].parameters == {"delay": 0.004}
    assert "iv, 20260101_a, 2026-02-03" in rig.effects[0].provenance
    assert "was 200; iv, 20260101_a, 2026-02-03" in text
    assert "torque_constant = 0.55              # N·m/A [M]" in text
    assert "iv, 20260101_a, 2026-02-03" in rig.note


def test_a_group_gain_scales_every_drive(tmp_path: Path) -> None:
    stewart = (data_folder("configs") / "stewart_pd.toml").read_text()
    text = updated_rig_text(stewart, _result(_estimate("all.force_gain", 1.2, 1.0)), "today")
    rig = _loaded(text, tmp_path)
    assert {a.position_gain for a in rig.actuators} == {300000.0}
    assert {a.speed_gain for a in rig.actuators} == {24000.0}


def test_ten_body_parameters_become_centre_of_gravity_and_inertia(tmp_path: Path) -> None:
    m, x, z = 210.0, -0.38, 0.42
    first = {"x": m * x, "y": 0.0, "z": m * z}
    origin = {"xx": 18 + m * z * z, "yy": 45 + m * (x * x + z * z), "zz": 40 + m * x * x}
    origin |= {"xy": 0.0, "xz": -m * x * z, "yz": 0.0}
    told = [_estimate("mass.m", m, 200.0)]
    told += [_estimate(f"mass.first_moment.{k}", v, 0.0) for k, v in first.items()]
    told += [_estimate(f"mass.origin_inertia.{k}", v, 0.0) for k, v in origin.items()]
    rig = _loaded(updated_rig_text(TEXT, _result(*told), "today"), tmp_path)
    assert rig.mass.cog == pytest.approx((x, 0.0, z), abs=1e-4)
    assert rig.mass.inertia[1][1] == pytest.approx(45.0, abs=1e-2)
    assert rig.mass.inertia[0][2] == pytest.approx(0.0, abs=1e-2)


def test_nothing_told_writes_nothing() -> None:
    quiet = _result(_estimate("mass.m", 211.0, 200.0, identifiable=False))
    with pytest.raises(IdentificationError, match="tell none of the parameters"):
        updated_rig_text(TEXT, quiet, "today")


def test_a_rig_that_cannot_be_is_not_written() -> None:
    with pytest.raises(ConfigError, match=r"mass\.m"):
        updated_rig_text(TEXT, _result(_estimate("mass.m", -5.0, 200.0)), "today")


def test_a_file_that_stands_there_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text("mine")
    with pytest.raises(ConfigError, match="exists already"):
        write_rig_file(path, TEXT)
    assert path.read_text() == "mine"


@pytest.fixture
def played(tmp_path: Path) -> Path:
    """A run of the axis with a load of 104 kg."""
    rig = load_rig("axis")
    run = as_run(play(rig, multisine(rig, 6.0, 1, 3.0), truth={"mass.m": 104.0}), rig)
    folder = tmp_path / "run"
    folder.mkdir()
    write_meta(folder, RunMeta(rig="axis"))
    (folder / "rig.toml").write_text(rig_toml(rig))
    run.table.to_parquet(folder / "signals.parquet")
    return folder


def test_a_page_that_fails_costs_neither_the_rig_file_nor_the_answer(
    played: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*given: object) -> None:
        raise IdentificationError("fit.html: cannot be written: No space left on device")

    monkeypatch.setattr("hil.cli.identify.fit_page", full)
    new, page = tmp_path / "new.toml", tmp_path / "fit.html"
    words = ["identify", str(played), "--rig", "axis", "--out", str(new), "--page", str(page)]
    answer = CliRunner().invoke(app, words)
    assert isinstance(answer.exception, RunError)
    assert "No space left" in str(answer.exception)
    assert "mass.m" in answer.stdout
    assert load_rig(new).mass.m == pytest.approx(104.0, rel=0.03)


def test_the_command_fits_writes_and_shows(played: Path, tmp_path: Path) -> None:
    new, page = tmp_path / "new.toml", tmp_path / "fit.html"
    arguments = [
        "identify",
        str(played),
        "--rig",
        "axis",
        "--out",
        str(new),
        "--page",
        str(page),
        "--json",
    ]
    answer = CliRunner().invoke(app, arguments)
    assert answer.exit_code == 0, answer.output
    result = json.loads(answer.stdout)
    assert result["format"] == "hil-identification/1"
    assert result["estimates"][0]["name"] == "mass.m"
    assert load_rig(new).mass.m == pytest.approx(104.0, rel=0.03)
    assert "left over velocity" in page.read_text()
