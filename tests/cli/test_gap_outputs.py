"""What `hil gap locate` and `diagnose` write: looked at before they compute, and never lost together."""

from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from hil.cli.app import app
from hil.errors import RunError

FOUND = SimpleNamespace(to_json=lambda: b"{}", verdict="no_gap")


@pytest.fixture
def computed(monkeypatch):
    """How often the long computation was begun; its answer costs nothing."""
    begun = []

    def compute(*given, **how):
        begun.append(given)
        return FOUND

    for module, call in (("gap", "locate_any"), ("gap_diagnose", "diagnose_any")):
        monkeypatch.setattr(f"hil.cli.{module}.{call}", compute)
        monkeypatch.setattr(f"hil.cli.{module}.load_run", lambda path, rig: path)
    for module, name in (("gap", "gap_page"), ("gap_diagnose", "diagnosis_page")):
        monkeypatch.setattr(
            f"hil.cli.{module}.{name}", lambda found, path, *names: path.write_text("page")
        )
    monkeypatch.setattr("hil.cli.gap._show", lambda found: None)
    monkeypatch.setattr("hil.cli.gap_diagnose.show", lambda found: None)
    return begun


def told(command, *options):
    said = ["gap", command, "run", "--rig", "axis", *map(str, options)]
    return CliRunner().invoke(app, said, catch_exceptions=False)


@pytest.mark.parametrize("command", ["locate", "diagnose"])
def test_folders_of_answers_are_made(command, computed, tmp_path):
    answer, page = tmp_path / "a" / "b" / "x.json", tmp_path / "c" / "y.html"
    assert told(command, "--json", answer, "--report", page).exit_code == 0
    assert answer.read_text() == "{}\n"
    assert page.read_text() == "page"


@pytest.mark.parametrize("command", ["locate", "diagnose"])
def test_files_are_there_though_nobody_reads_the_text(command, computed, tmp_path, monkeypatch):
    def gone(found):
        raise BrokenPipeError

    monkeypatch.setattr("hil.cli.gap._show", gone)
    monkeypatch.setattr("hil.cli.gap_diagnose.show", gone)
    answer, page = tmp_path / "x.json", tmp_path / "y.html"
    with pytest.raises(BrokenPipeError):
        told(command, "--json", answer, "--report", page)
    assert answer.read_text() == "{}\n"
    assert page.read_text() == "page"


@pytest.mark.parametrize("command", ["locate", "diagnose"])
def test_a_place_that_cannot_be_written_is_named_before_anything_is_computed(
    command, computed, tmp_path
):
    (tmp_path / "file").write_text("")
    with pytest.raises(RunError, match=r"x\.json: cannot be written: .*file is no folder"):
        told(command, "--json", tmp_path / "file" / "x.json")
    with pytest.raises(RunError, match="is a folder, not a file"):
        told(command, "--report", tmp_path)
    assert not computed


@pytest.mark.parametrize("command", ["locate", "diagnose"])
def test_where_one_file_fails_the_other_is_written(command, computed, tmp_path, monkeypatch):
    page, answer = tmp_path / "y.html", tmp_path / "x.json"

    def full():
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(FOUND, "to_json", full)
    with pytest.raises(RunError, match=r"x\.json: cannot be written: No space left"):
        told(command, "--json", answer, "--report", page)
    assert page.read_text() == "page"
