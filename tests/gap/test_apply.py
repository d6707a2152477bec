"""A diagnosis goes into a rig file, and whoever reads that file compensates what was found."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from hil.cli.app import app
from hil.config import LegMass
from hil.configfile import find_rig_file, load_bicycle, load_rig
from hil.control.friction import known_friction
from hil.control.trajectory import CueTrajectory
from hil.daemon.simulated import SimulatedSession, cue_at
from hil.drivefiles import load_profiles
from hil.errors import ConfigError
from hil.gap.apply import alarms, applied_text
from hil.identify.experiments.play import CLIENT, experiment_cues
from hil.sim import Twin
from tests.gap.twin_runs import AXIS, effect

AXIS_FILE = find_rig_file("axis").read_text(encoding="utf-8")


def cause(name, location="axis", probability=0.95, at_bound=False, **parameters):
    return {
        "effect": name,
        "location": location,
        "probability": probability,
        "parameters": {
            k: {"value": v, "ci": [0.95 * v, 1.05 * v], "unit": "N", "at_bound": at_bound}
            for k, v in parameters.items()
        },
    }


def answer(*causes, verdict="identified", effects=None):
    chosen = causes if verdict == "identified" else ()
    return {
        "format": "hil-diagnosis/1",
        "rig": "axis",
        "runs": ["run7"],
        "verdict": verdict,
        "gap": {"shrink": 0.94, "shrink_ci": [0.91, 0.96]},
        "causes": list(causes),
        "effects": list(chosen if effects is None else effects),
    }


def read(text, tmp_path):
    path = tmp_path / "new.toml"
    path.write_text(text, encoding="utf-8")
    return load_rig(path)


def test_the_effect_is_written_with_where_it_comes_from_and_the_file_keeps_its_words(tmp_path):
    text = applied_text(
        AXIS_FILE, answer(cause("coulomb_friction", force=31.234)), when="2026-02-01"
    )
    assert all(line in text for line in AXIS_FILE.splitlines())
    (line,) = read(text, tmp_path).effects
    assert (line.effect, line.location) == ("coulomb_friction", "axis")
    assert line.parameters == {"force": pytest.approx(31.234, abs=0.05)}
    for word in ("run7", "2026-02-01", "identified", "p = 0.95", "94 %", "91 .. 96 %"):
        assert word in line.provenance


def test_a_parameter_that_is_there_is_replaced_and_other_lines_stay(tmp_path):
    first = applied_text(AXIS_FILE, answer(cause("coulomb_friction", force=30.0)), when="one")
    first = applied_text(first, answer(cause("backlash", gap=4e-4)), when="two")
    text = applied_text(first, answer(cause("coulomb_friction", force=44.0)), when="three")
    friction, gap = read(text, tmp_path).effects
    assert friction.parameters == {"force": 44.0}
    assert "was 30" in friction.provenance
    assert gap.parameters == {"gap": 4e-4}


def test_where_a_parameter_came_from_is_kept_one_step_back_and_does_not_grow(tmp_path):
    text, lengths = AXIS_FILE, []
    for k, when in enumerate(("one", "two", "three", "four", "five")):
        found = answer(cause("coulomb_friction", force=30.0 + k, presliding=1e-5 * (1 + k)))
        text = applied_text(text, found, when=when)
        (line,) = read(text, tmp_path).effects
        lengths.append(len(line.provenance))
    assert lengths[2] <= lengths[1] + 2
    assert lengths[4] <= lengths[1] + 2
    assert "five" in line.provenance
    assert "force was 33, presliding was 4e-05: hil gap diagnose, run7, four" in line.provenance
    assert "three" not in line.provenance
    again = applied_text(text, found, when="five")
    (line,) = read(again, tmp_path).effects
    assert "was" not in line.provenance


def test_effects_given_inline_grow_inline(tmp_path):
    lines = 'effects = [{ effect = "backlash", location = "axis", parameters = { gap = 1e-4 } }]\n'
    text = applied_text(lines + AXIS_FILE, answer(cause("coulomb_friction", force=30.0)), when="x")
    assert [e.effect for e in read(text, tmp_path).effects] == ["backlash", "coulomb_friction"]


@pytest.mark.parametrize("verdict", ["unknown", "ambiguous"])
def test_what_is_not_identified_is_applied_only_when_picked(verdict, tmp_path):
    said = answer(
        cause("coulomb_friction", probability=0.5, force=30.0),
        cause("backlash", probability=0.4, gap=4e-4),
        verdict=verdict,
    )
    with pytest.raises(ConfigError, match=r"--pick: axis.coulomb_friction \(p = 0.50\)"):
        applied_text(AXIS_FILE, said, when="x")
    text = applied_text(AXIS_FILE, said, when="x", pick=["axis.backlash"])
    assert [e.effect for e in read(text, tmp_path).effects] == ["backlash"]
    with pytest.raises(ConfigError, match="not among the causes weighed"):
        applied_text(AXIS_FILE, said, when="x", pick=["axis.hysteresis"])


def test_no_gap_foreign_rigs_and_impossible_values_are_refused():
    with pytest.raises(ConfigError, match="nothing to apply"):
        applied_text(AXIS_FILE, answer(verdict="no_gap"), when="x")
    with pytest.raises(ConfigError, match="of the rig 'stewart'"):
        applied_text(AXIS_FILE, {**answer(), "rig": "stewart"}, when="x")
    with pytest.raises(ConfigError, match="outside"):
        applied_text(AXIS_FILE, answer(cause("backlash", gap=3.0)), when="x")


def told(key, value):
    """A finding about what belongs into the rig file."""
    return {"severity": "warning", "subject": key, "text": "they do so", "belongs": value}


def test_drives_that_were_found_to_rest_do_so_in_the_file(tmp_path):
    resting = {
        "severity": "warning",
        "subject": "bus.interpolation",
        "text": "they rest",
        "belongs": "linear_rests",
    }
    said = {**answer(cause("coulomb_friction", force=30.0)), "findings": [resting]}
    text = applied_text(AXIS_FILE, said, when="2026-02-01", source="d.json")
    rig = read(text, tmp_path)
    assert rig.bus.interpolation == "linear_rests"
    assert [e.effect for e in rig.effects] == ["coulomb_friction"]
    assert "was linear; hil gap diagnose, run7, 2026-02-01 (d.json)" in text
    alone = {**answer(verdict="no_gap"), "findings": [resting]}
    rig = read(applied_text(AXIS_FILE, alone, when="x"), tmp_path)
    assert (rig.bus.interpolation, rig.effects) == ("linear_rests", ())


def test_drives_that_were_found_to_feed_static_force_forward_do_so_in_the_file(tmp_path):
    feeding = {
        "severity": "warning",
        "subject": "actuators.law",
        "text": "they feed it",
        "belongs": ["cascade_static"] * 6,
    }
    said = {**answer(verdict="no_gap"), "rig": "stewart", "findings": [feeding]}
    own = find_rig_file("stewart").read_text(encoding="utf-8")
    text = applied_text(own, said, when="2026-02-01", source="d.json")
    assert [a.law for a in read(text, tmp_path).actuators] == ["cascade_static"] * 6
    assert text.count("was cascade; hil gap diagnose, run7, 2026-02-01 (d.json)") == 6


def test_friction_that_was_found_to_build_up_does_so_in_the_file(tmp_path):
    said = {**answer(verdict="no_gap"), "findings": [told("actuators.presliding", [2.8e-5])]}
    text = applied_text(AXIS_FILE, said, when="2026-02-01", source="d.json")
    assert [a.presliding for a in read(text, tmp_path).actuators] == [2.8e-5]
    assert "was 0.0; hil gap diagnose, run7, 2026-02-01 (d.json)" in text


def test_legs_that_were_found_to_weigh_something_do_so_in_the_file(tmp_path):
    own = find_rig_file("motorcycle").read_text(encoding="utf-8")
    nothing = LegMass().model_dump()
    half = {**nothing, "lower_mass": 1.23456, "upper_mass": 1.23456, "is_fed": False}
    weighing = told("actuators.leg", [half, half, nothing])
    said = {**answer(verdict="no_gap"), "rig": "motorcycle", "findings": [weighing]}
    text = applied_text(own, said, when="x")
    legs = [a.leg for a in read(text, tmp_path).actuators]
    assert [(x.lower_mass, x.is_fed) for x in legs] == [(1.23, False), (1.23, False), (0.0, True)]
    assert text.count("weighed nothing; hil gap diagnose") == 2


def test_a_rider_who_was_assumed_is_written_beside_what_he_does(tmp_path):
    own = find_rig_file("bicycle").read_text(encoding="utf-8")
    start, end = own.index("[rider]"), own.index("[bus]")
    leans = cause("rider_motion", "bicycle", gain=0.3)
    for text, mass in ((own[:start] + own[end:], 39.9), (own, 40.0)):
        new = tmp_path / f"{mass}.toml"
        told = applied_text(text, {**answer(leans), "rig": "bicycle"}, when="2026-02-01")
        new.write_text(told, encoding="utf-8")
        bicycle = load_bicycle(new)
        assert bicycle.rider.mass == pytest.approx(mass)
        assert [e.effect for e in bicycle.effects] == ["rider_motion"]


def test_a_parameter_at_its_bound_is_an_alarm():
    (said,) = alarms([cause("backlash", gap=0.02, at_bound=True)])
    assert "axis.backlash.gap stands at its bound" in said


def test_the_command_writes_a_new_file_and_never_over_one(tmp_path):
    diagnosis, new = tmp_path / "d.json", tmp_path / "new.toml"
    diagnosis.write_text(json.dumps(answer(cause("coulomb_friction", force=30.0))))
    told = ["gap", "apply", str(diagnosis), "--rig", "axis", "--out", str(new)]
    result = CliRunner().invoke(app, told, catch_exceptions=False)
    assert result.exit_code == 0
    assert "coulomb friction at axis: force 30 N" in result.output
    assert load_rig(new).effects[0].parameters == {"force": 30.0}
    with pytest.raises(ConfigError, match="exists already"):
        CliRunner().invoke(app, told, catch_exceptions=False)


def test_effects_of_friction_are_known_to_the_feed_forward():
    rig = AXIS.model_copy(
        update={
            "effects": (
                effect("coulomb_friction", force=30.0),
                effect("asymmetric_friction", positive=5.0, negative=-100.0),
                effect("viscous_friction", coefficient=40.0),
                effect("asymmetric_viscous_friction", positive=30.0, negative=-10.0),
                effect("backlash", gap=1e-4),
            )
        }
    )
    known = known_friction(rig)
    assert (known.viscous, known.positive, known.negative) == (170.0, 55.0, 0.0)


def test_a_drive_with_friction_pre_control_feeds_the_files_friction_forward():
    drive = AXIS.actuators[0].model_copy(update={"friction_ff": 1.0})
    rig = AXIS.model_copy(update={"actuators": (drive,)})
    late = rig.model_copy(update={"effects": (effect("coulomb_friction", force=60.0),)})
    sent = np.arange(0.0, 4.0, rig.bus.cycle)
    told = 0.1 * np.sin(2.0 * np.pi * 0.5 * sent)
    stamps = {"pose.position": sent}
    plain, knowing = Twin(rig), Twin(late)
    unknown = plain.table.from_effects(late.effects)
    job = {"axis": (sent, told)}
    errors = [
        np.std(twin.replay(job, stamps, vector)["pose.position"] - told)
        for twin, vector in ((plain, unknown), (knowing, None), (plain, None))
    ]
    assert errors[1] == pytest.approx(errors[2], rel=0.02)
    assert errors[0] > errors[1]


def ride(rig, hidden):
    """Poses (N,) of the simulated rig in mode computed_torque over one motion, m, in simulated time."""
    mode = rig.control.model_copy(update={"mode": "computed_torque"})
    rig = rig.model_copy(update={"control": mode})
    t = np.arange(0.0, 5.0, 0.01)
    pose = 0.06 * np.clip(t / 1.5, 0.0, 1.0) ** 2 * np.sin(2.0 * np.pi * 0.5 * t)
    session = SimulatedSession(rig, load_profiles(rig), seed=3, hidden=hidden)
    session.arm()
    start_s, went = session.now_s, []
    for cue in experiment_cues(CueTrajectory(rig.coordinates, t, pose[:, None]), rig, CLIENT):
        session.cue(cue_at(cue, start_s))
        went.append(session.simulated.plant.pose()[0])
    return np.array(went)


def test_friction_that_is_found_and_applied_is_compensated(tmp_path):
    found = answer(cause("coulomb_friction", force=118.0))
    applied = read(applied_text(AXIS_FILE, found, when="2026-02-01"), tmp_path)
    wanted = ride(AXIS, [])
    before = np.std(ride(AXIS, [effect("coulomb_friction", force=120.0)]) - wanted)
    # The rig has what the file says by now, and the 2 N that the diagnosis missed.
    rest = effect("asymmetric_friction", positive=2.0, negative=2.0)
    after = np.std(ride(applied, [rest]) - wanted)
    assert np.ptp(wanted) > 0.1
    assert before > 3e-4
    assert after < 0.3 * before


def test_a_mount_on_which_an_imu_was_found_to_swing_is_in_the_file(tmp_path):
    mount = {"frequency": [62.2813, 0.0, 0.0], "damping": 0.06}
    said = {**answer(verdict="no_gap"), "findings": [told("imu.mount", mount)]}
    text = applied_text(AXIS_FILE, said, when="x", source="d.json")
    rounded = {"frequency": [62.3, 0.0, 0.0], "damping": 0.06}
    assert read(text, tmp_path).imu.mount.model_dump(mode="json") == rounded
    (line,) = [x for x in text.splitlines() if x.startswith("mount")]
    assert "hil gap diagnose" in line
