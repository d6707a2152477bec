"""The text's own two gaps: found, named, applied, and gone from another ride; what to ride next where not."""

from __future__ import annotations

import json
import tomllib
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from hil.bicycle.analysis import analyse
from hil.bicycle.manoeuvres import MANOEUVRES, Manoeuvre, manoeuvre
from hil.bicycle.path import slalom, u_turns
from hil.bicycle.recorded import prepare
from hil.config import BicycleFile
from hil.configfile import find_rig_file, load_bicycle, parse_any_rig
from hil.errors import ConfigError, IdentificationError
from hil.gap.apply import applied_text
from hil.gap.bicycle import diagnose_rides, locate_rides
from hil.gap.bicycle.locate import NARROW
from hil.gap.bicycle.next import propose_ride, write_ride_proposal
from hil.runs import load_run
from tests.bicycle.rides import run_of

NOMINAL = load_bicycle("bicycle")
THERE_AND_BACK = Manoeuvre("there-and-back", "ride there and back", lambda: u_turns(20.0), 5.0, 3.6)
ROUND_MARKS = Manoeuvre("round-marks", "ride round marks", lambda: slalom(60.0), 5.0, 3.6)


def ridden(way, seed, effect, **parameters):
    tables = NOMINAL.model_dump()
    tables["effects"] = [{"effect": effect, "location": "bicycle", "parameters": parameters}]
    run = run_of(way.ride(BicycleFile.model_validate(tables), seed))
    return replace(run, path=Path(way.name))


@pytest.fixture(scope="module")
def forked():
    """A ride, and another that no fit sees, of a bicycle with a front suspension."""
    return [
        ridden(way, seed, "front_suspension", stiffness=9e3, damping=400.0)
        for way, seed in ((THERE_AND_BACK, 41), (ROUND_MARKS, 42))
    ]


@pytest.fixture(scope="module")
def found(forked):
    return diagnose_rides(forked, NOMINAL)


def test_a_front_suspension_is_named_by_its_pitch_rate(found):
    by_signal = {s.signal: s.ratio for s in found.located.signals}
    assert max(by_signal, key=by_signal.get) == "imu.gyro_y"
    assert by_signal["imu.gyro_z"] < 2.0, "yaw knows next to nothing of it"
    assert found.verdict == "identified"
    (cause,) = found.effects
    assert (cause.effect, cause.location) == ("front_suspension", "bicycle")
    low, high = cause.parameters["stiffness"].ci
    assert low < 9e3 < high
    assert found.score.shrink > 0.85
    assert cause.probability < 0.9, "a bracket that bends would look the same"
    assert "bracket bends would look the same" in found.sentence


def test_once_applied_it_is_gone_from_the_other_ride(forked, found):
    answer = json.loads(found.to_json())
    text = applied_text(
        find_rig_file("bicycle").read_text(), answer, when="2026-11-21", source="ride.json"
    )
    assert "hil gap diagnose, there-and-back, round-marks, 2026-11-21 (ride.json)" in text
    rig = parse_any_rig(tomllib.loads(text), "applied")
    (effect,) = rig.effects
    assert effect.effect == "front_suspension"
    other = forked[1]
    assert locate_rides([other], NOMINAL).is_gap
    assert not locate_rides([other], rig).is_gap
    without, with_fork = (
        {c.signal: c.rms for c in analyse(prepare(other, r)).compared if c.filtered}
        for r in (NOMINAL, rig)
    )
    assert with_fork["imu.gyro_y"] < 0.6 * without["imu.gyro_y"]
    assert with_fork["imu.accel_x"] < 0.8 * without["imu.accel_x"]
    assert with_fork["imu.gyro_z"] == pytest.approx(without["imu.gyro_z"], rel=0.1)


def test_tyres_alone_are_told_from_a_fork():
    runs = [
        ridden(way, seed, "tyre_compliance", stiffness=8e4, damping=200.0)
        for way, seed in ((THERE_AND_BACK, 43), (ROUND_MARKS, 44))
    ]
    answer = diagnose_rides(runs, NOMINAL)
    assert answer.verdict in ("identified", "ambiguous")
    assert answer.causes[0].effect == "tyre_compliance"
    low, high = answer.causes[0].parameters["stiffness"].ci
    assert low < 8e4 < high
    assert answer.score.shrink > 0.7


def open_diagnosis(*causes):
    """A diagnosis that leaves candidates: (effect, location, parameters, probability)."""
    return {
        "format": "hil-diagnosis/1", "rig": "bicycle", "runs": ["a"], "verdict": "ambiguous",
        "gap": {"signals": {f"imu.{s}": {} for s in ("gyro_y", "gyro_z", "accel_x", "accel_z")}},
        "effects": [],
        "causes": [
            {"effect": e, "location": at, "probability": p, "class": 0,
             "parameters": {k: {"value": v} for k, v in values.items()}}
            for e, at, values, p in causes
        ],
    }  # fmt: skip


LATE_IMU = ("sensor_latency", "imu", {"delay": 0.02}, 0.5)
TURNED_IMU = ("sensor_misalignment", "imu", {"x": 0.0, "y": 0.03, "z": 0.0}, 0.5)


def test_the_next_manoeuvre_is_a_sentence_for_the_rider_and_a_ride_to_hold_it_against(tmp_path):
    proposal = propose_ride(
        open_diagnosis(LATE_IMU, TURNED_IMU), NOMINAL, manoeuvres=[ROUND_MARKS, THERE_AND_BACK]
    )
    assert proposal.split.right > 0.95
    assert proposal.manoeuvre in (ROUND_MARKS, THERE_AND_BACK)
    assert "it tells sensor latency at imu from sensor misalignment at imu" in proposal.sentence
    folders = write_ride_proposal(tmp_path / "next.toml", proposal)
    told = tomllib.loads((tmp_path / "next.toml").read_text())
    assert told["manoeuvre"] == proposal.manoeuvre.name
    assert sorted(told["simulated"].values()) == sorted(f.name for f in folders)
    late = load_run(next(f for f in folders if f.name.endswith("latency")), NOMINAL)
    assert late.table["imu.gyro_z"].notna().sum() > 1000


def test_what_no_ride_tells_apart_is_said():
    radius = ("wheel_radius", "rear_wheel", {"scale": 1.02}, 0.6)
    encoder = ("sensor_scale", "rear_wheel", {"scale": 0.9804}, 0.4)
    left = open_diagnosis(radius, encoder)
    left["gap"]["signals"] |= {"imu.gyro_x": {}, "imu.accel_y": {}, "bicycle.lean_torque": {}}
    proposal = propose_ride(left, NOMINAL, manoeuvres=[ROUND_MARKS, manoeuvre("eight")])
    assert "Another sensor is needed" in proposal.sentence


def test_on_thin_wheels_less_is_allowed_for_and_a_ride_tells_more():
    late = ("sensor_latency", "steer", {"delay": 0.006}, 0.5)
    scale = ("sensor_scale", "steer", {"scale": 0.985}, 0.5)
    on_tyres = open_diagnosis(late, scale)
    on_tyres["gap"]["signals"] |= {"imu.gyro_x": {}, "imu.accel_y": {}, "bicycle.lean_torque": {}}
    on_thin = {**on_tyres, "findings": [asdict(NARROW)]}
    tyres, thin = (
        propose_ride(some, NOMINAL, manoeuvres=[ROUND_MARKS]) for some in (on_tyres, on_thin)
    )
    assert tyres.split.right < 0.9
    assert thin.split.right > 0.95


def test_one_candidate_leaves_nothing_to_ride_for():
    with pytest.raises(IdentificationError, match="nothing to tell apart"):
        propose_ride(open_diagnosis(LATE_IMU), NOMINAL)


def test_manoeuvres_have_names_and_instructions():
    assert len({m.name for m in MANOEUVRES}) == len(MANOEUVRES)
    assert all(m.instruction[0].islower() and m.instruction[-1] != "." for m in MANOEUVRES)
    assert manoeuvre("hard-surges").vigour == 2.0
    with pytest.raises(ConfigError, match="no manoeuvre: u-turns, slalom"):
        manoeuvre("wheelie")
