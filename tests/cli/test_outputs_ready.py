"""Commands that compute for long look first whether what they write can be written."""

import pytest
from typer.testing import CliRunner

from hil.cli.app import app
from hil.errors import HilError, RunError

PAGES = {
    "identify run --rig axis --page": "identify.identify",
    "identify frf run --rig axis --report": "identify_frequency.analyse",
    "identify agard run --rig axis --report": "identify_frequency.agard",
    "latency --html": "latency.measure_latency",
    "reproduce motorcycle --out": "reproduce.motorcycle_report",
    "reproduce stewart --fast --runs": "reproduce.stewart_report",
    "reproduce bicycle --out": "reproduce.bicycle_report",
    "bicycle analyse run --rig bicycle --report": "bicycle.analyse",
}
RIG_FILES = {
    "identify run --rig axis --out": "identify.identify",
    "bicycle calibrate bicycle run --out": "bicycle_record.calibrate",
}


@pytest.fixture
def told(monkeypatch):
    """A command that writes to `path`; whoever begins to compute fails."""

    def run(line, call, path):
        def compute(*given, **how):
            raise AssertionError("computes")

        module = call.partition(".")[0]
        monkeypatch.setattr(f"hil.cli.{call}", compute)
        monkeypatch.setattr(f"hil.cli.{module}.load_run", lambda *given: None, raising=False)
        CliRunner().invoke(app, [*line.split(), str(path)], catch_exceptions=False)

    return run


@pytest.mark.parametrize("line", PAGES | RIG_FILES)
def test_a_place_that_cannot_be_written_is_named_before_anything_is_computed(told, tmp_path, line):
    (tmp_path / "file").write_text("")
    with pytest.raises(RunError, match=r"cannot be written: .* is no folder"):
        told(line, (PAGES | RIG_FILES)[line], tmp_path / "file" / "x")


@pytest.mark.parametrize("line", RIG_FILES)
def test_a_rig_file_that_stands_there_is_named_before_anything_is_computed(told, tmp_path, line):
    (tmp_path / "mine.toml").write_text("# mine")
    with pytest.raises(RunError, match=r"mine\.toml: exists already; name another file with --out"):
        told(line, RIG_FILES[line], tmp_path / "mine.toml")
    assert (tmp_path / "mine.toml").read_text() == "# mine"


def test_excursion_limits_are_those_of_a_rig_that_is_named():
    result = CliRunner().invoke(app, ["identify", "agard"])
    assert not isinstance(result.exception, HilError)
    assert result.exit_code == 2
    assert "--rig" in result.output
