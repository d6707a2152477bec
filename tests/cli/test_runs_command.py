"""`hil runs` on the command line: for a person whatever the names are, and for a script."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from hil.cli.app import app

run = CliRunner().invoke
NOTE = "took the [/b] cable off [red] :sun:"


@pytest.fixture
def runs(tmp_path):
    """A folder of one run, with names that a terminal could take for more than names."""
    folder = tmp_path / "ru [/b] ns" / "one [red]"
    folder.mkdir(parents=True)
    head = f'format = "hil-run/1"\nrig = "axis"\nnote = "{NOTE}"\n'
    folder.joinpath("run.toml").write_text(head)
    folder.joinpath("signals.csv").write_text("t,axis.position\n0.0,0.1\n0.1,0.2\n")
    return folder.parent


def test_list_writes_json_for_a_script(runs):
    result = run(app, ["runs", "list", str(runs), "--json"])
    assert result.exit_code == 0
    (told,) = json.loads(result.output)
    assert Path(told["path"]) == runs / "one [red]"
    assert told["note"] == NOTE


def test_brackets_in_names_and_notes_are_no_markup(runs):
    result = run(app, ["runs", "list", str(runs)], env={"COLUMNS": "200"})
    assert result.exit_code == 0
    assert "one [red]" in result.output
    assert NOTE in result.output


@pytest.mark.parametrize("words", [["show"], ["show", "--json"], ["report"]])
def test_a_run_of_any_name_is_shown(runs, words):
    result = run(app, ["runs", *words, str(runs / "one [red]")])
    assert result.exit_code == 0
