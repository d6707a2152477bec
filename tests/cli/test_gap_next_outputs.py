"""What `hil gap next` writes goes over nothing that stands there, which shows before it computes."""

import json
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from hil.cli.app import app
from hil.configfile import load_rig
from hil.errors import LimitViolation, RunError
from hil.gap.next import write_proposal
from tests.exam.worlds import sway

PAIRS = {
    "axis": (("backlash", "axis", {"gap": 3e-4}), ("coulomb_friction", "axis", {"force": 15.0})),
    "bicycle": (
        ("sensor_latency", "imu", {"delay": 0.02}),
        ("sensor_misalignment", "imu", {"y": 0.03}),
    ),
}


def answer_of(rig):
    """An answer file that leaves two candidates."""
    causes = [
        {"effect": effect, "location": location, "probability": 0.5, "class": 0,
         "parameters": {name: {"value": value} for name, value in parameters.items()}}
        for effect, location, parameters in PAIRS[rig]
    ]  # fmt: skip
    return {"format": "hil-diagnosis/1", "rig": rig, "verdict": "ambiguous", "causes": causes,
            "effects": [], "gap": {"signals": {}}}  # fmt: skip


@pytest.fixture
def told(monkeypatch, tmp_path):
    """The command with `--out`; whoever begins to compute fails."""

    def compute(*given, **how):
        raise AssertionError("computes")

    for name in ("propose", "propose_ride"):
        monkeypatch.setattr(f"hil.cli.gap_next.{name}", compute)

    def run(rig, to):
        path = tmp_path / "diagnosis.json"
        path.write_text(json.dumps(answer_of(rig)))
        said = ["gap", "next", str(path), "--rig", rig, "--out", str(tmp_path / to)]
        CliRunner().invoke(app, said, catch_exceptions=False)

    return run


@pytest.mark.parametrize(
    ("rig", "there"),
    [
        ("axis", "healthy.csv"),
        ("axis", "healthy.toml"),
        ("bicycle", "healthy.toml"),
        ("bicycle", "healthy_imu_sensor_latency"),
    ],
)
def test_what_stands_there_is_named_before_anything_is_computed(told, tmp_path, rig, there):
    (tmp_path / there).write_text("mine")
    with pytest.raises(RunError, match=f"{there}: exists already; name another file with --out"):
        told(rig, "healthy.toml")
    assert (tmp_path / there).read_text() == "mine"


@pytest.mark.parametrize("rig", PAIRS)
def test_what_is_written_is_toml(told, rig):
    with pytest.raises(RunError, match=r"next\.csv: an .* is a \.toml file"):
        told(rig, "next.csv")


def test_what_cannot_be_played_leaves_no_motion_in_the_way(tmp_path, monkeypatch):
    def refuse(*given):
        raise LimitViolation("axis: too far")

    monkeypatch.setattr("hil.gap.next.write.design", refuse)
    rig = load_rig("axis")
    sketch = SimpleNamespace(trajectory=sway(rig, 2.0), payload_kg=0.0)
    with pytest.raises(LimitViolation):
        write_proposal(
            tmp_path / "next.toml", SimpleNamespace(rig=rig, sketch=sketch, sentence="sways")
        )
    assert not list(tmp_path.iterdir())
