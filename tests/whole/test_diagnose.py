"""Effects on data made by the twin are found, nothing is found on healthy data, broken data is refused.

The twin makes the data here, so this shows that the machinery works, not how well it does: that is for
`hil gap exam`, whose world is another.
"""

from dataclasses import replace
from html import escape
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from hil.cli.gap_diagnose import all_but
from hil.configfile import load_rig
from hil.errors import IdentificationError, RunError
from hil.gap import diagnose, locate
from hil.gap.catalogue.leaves import find_leaves
from hil.gap.catalogue.nuisances import DELAY_S, LOOPS
from hil.gap.catalogue.sprung import BEND_HZ, SOFTER_HZ
from hil.gap.fits.training import candidates_of
from hil.gap.floor.rounding import step_of
from hil.gap.judged.causes import _parameters
from hil.gap.judged.verdict import not_excited
from hil.gap.record.leaf import Leaf
from hil.gap.rounds.twins import is_springs
from hil.rigs import Manipulator
from hil.sim import Twin
from hil.ui.calibration_table import beside_effects, calibration_table
from hil.ui.diagnosis_data import best_first
from hil.ui.diagnosis_page import diagnosis_page
from tests.gap.twin_runs import AXIS, effect, record

FRICTION_N = 30.0


@pytest.fixture(scope="module")
def healthy():
    return record()


@pytest.fixture(scope="module")
def friction():
    return diagnose(record(effect("coulomb_friction", force=FRICTION_N)), AXIS)


def test_healthy_data_has_no_gap(healthy):
    found = diagnose(healthy, AXIS)
    assert found.verdict == "no_gap"
    assert found.effects == ()
    assert found.tables()["gap"]["shrink"] is None


def test_friction_is_named_with_its_force_and_what_it_takes_away(friction):
    best = friction.causes[0]
    assert (best.effect, best.location) == ("coulomb_friction", "axis")
    low, high = best.parameters["force"].ci
    assert low < FRICTION_N < high
    assert best.parameters["force"].value == pytest.approx(FRICTION_N, rel=0.1)
    assert friction.score.after < 0.5 * friction.score.before
    assert friction.score.shrink > 0.9


def test_candidates_of_one_class_are_said_not_to_be_told_apart(friction):
    classes = friction.tables()["classes"]
    (mine,) = [g for g in classes if "axis.coulomb_friction" in g]
    assert "axis.asymmetric_friction" in mine


def test_a_small_effect_is_found_beside_one_that_makes_nearly_all_of_the_gap():
    rubs = effect("asymmetric_friction", positive=200.0, negative=60.0)
    late = effect("sensor_latency", "axis.position", delay=0.003)
    found = diagnose(record(rubs, late), AXIS)
    assert {c.effect for c in found.effects} == {"asymmetric_friction", "sensor_latency"}


def test_a_large_gap_without_any_candidate_is_unknown():
    found = diagnose(
        record(effect("coulomb_friction", force=FRICTION_N)),
        AXIS,
        without=all_but(AXIS, "sensor_misalignment"),
    )
    assert found.verdict == "unknown"
    assert "axis.force stands" in found.sentence
    assert found.tables()["causes"] == []


def test_the_place_is_force_at_the_axis(friction):
    (first, *_) = friction.located.where
    assert first.signal == "axis.force"


def test_leaves_leave_out_what_is_withheld_and_what_no_signal_shows(friction):
    c = friction.calibrated
    leaves = find_leaves(c.problem, c.vector, c.residual, ("backlash",))
    names = {leaf.name for leaf in leaves}
    assert "axis.coulomb_friction" in names
    assert not any("backlash" in n or n.startswith("imu") or "velocity.sensor" in n for n in names)
    assert all(leaf.starts for leaf in leaves)


def test_the_page_is_whole_in_itself_and_says_what_was_found(friction, tmp_path):
    page = diagnosis_page(friction, tmp_path / "page.html").read_text()
    for words in (
        "coulomb friction at axis",
        "Measured minus twin over velocity and position",
        "Not to be told apart",
        "ISO/TS 18571",
        "How it was computed",
    ):
        assert words in page
    assert "<script src=" not in page


def test_the_page_gives_what_has_a_dimension_its_unit_and_nothing_else(friction, tmp_path):
    (cause,) = friction.effects
    scale = replace(cause.parameters["force"], value=1.4, ci=(1.3, 1.5), unit="1")
    scaled = replace(cause, parameters={"scale": scale})
    found = replace(friction, causes=(scaled,), effects=(scaled,))
    page = diagnosis_page(found, tmp_path / "page.html").read_text()
    assert "scale 1.4 (1.3 … 1.5)</td>" in page
    (force,) = [s for s in friction.located.signals if s.signal == "axis.force"]
    assert f"{force.noise_floor:.3g} N</td>" in page


def test_the_page_says_which_data_each_of_its_figures_covers(friction, tmp_path):
    page = diagnosis_page(friction, tmp_path / "page.html").read_text()
    assert f"on {escape(friction.held_out)} alone, which no fit has seen" in page
    assert "of the whole record, each signal by itself" in page


def test_the_page_lists_the_nuisances_that_there_are(friction, tmp_path):
    page = diagnosis_page(friction, tmp_path / "page.html").read_text()
    assert "payload mass, viscous friction, coulomb friction" in page
    assert "base tilt" not in page


def test_a_nuisance_at_its_bound_is_back_beside_the_named_effect(friction):
    far = [n.name for n in friction.located.nuisances if n.at_bound]
    beside = beside_effects(friction)
    assert far
    assert "axis.coulomb_friction.force" not in beside
    assert not any(beside[name].at_bound for name in far if name in beside)
    page = calibration_table(friction.located.nuisances, {}, beside)
    assert "is the effect" in page


def test_the_page_names_the_references_and_what_they_let_expect(friction, tmp_path):
    page = diagnosis_page(friction, tmp_path / "page.html", ["monday", "friday"]).read_text()
    assert "what has changed since monday · friday" in page
    assert "healthy references (monday, friday)" in page
    (first, *_) = friction.located.nuisances
    assert f"+0.125 ± {first.prior_sd:.2g}" in calibration_table([first], {first.name: 0.125})
    assert "+0.125" not in calibration_table([first])


def test_causes_of_one_probability_stand_by_what_speaks_for_them(friction):
    less, more, first = (
        replace(friction.causes[0], location=name, probability=p, gain=gain)
        for name, p, gain in (("less", 0.4503, 9.0), ("more", 0.4501, 70.0), ("first", 0.9, 1.0))
    )
    shown = best_first(replace(friction, causes=(less, more, first)))
    assert [c.location for c in shown] == ["first", "more", "less"]


def test_wrong_units_are_refused_and_the_signal_is_named(healthy):
    frame = healthy.assign(**{"axis.position": 1000.0 * healthy["axis.position"]})
    with pytest.raises(RunError, match=r"axis\.position.*millimetres"):
        locate(frame, AXIS)


@pytest.mark.parametrize(("factor", "asked"), [(1e-3, "kN"), (1e3, "milli")])
def test_a_force_in_another_unit_is_refused_whatever_gap_it_has(factor: float, asked: str):
    worn = record(effect("coulomb_friction", force=3.0 * FRICTION_N))
    worn["axis.force"] *= factor
    with pytest.raises(IdentificationError, match=rf"axis\.force.*{asked}"):
        locate(worn, AXIS)


def test_one_record_given_twice_is_refused(healthy):
    with pytest.raises(IdentificationError, match=r"frame 1 and frame 2.*given twice"):
        locate([healthy, healthy.assign(t=healthy["t"] + 100.0)], AXIS)


def test_what_the_references_have_already_is_no_change():
    worn = effect("coulomb_friction", force=FRICTION_N)
    found = diagnose(record(worn, seed=2), AXIS, references=[record(worn)])
    assert found.verdict == "no_gap"
    (told,) = (f.text for f in found.located.findings if f.subject == "references")
    assert "coulomb friction" in told
    worse = effect("coulomb_friction", force=2.0 * FRICTION_N)
    found = diagnose(record(worse, seed=2), AXIS, references=[record(worn)])
    (cause,) = found.effects
    assert cause.effect == "coulomb_friction"
    assert cause.parameters["force"].value == pytest.approx(2.0 * FRICTION_N, rel=0.1)


@pytest.mark.parametrize(("more", "named"), [(0.18, []), (0.25, ["coulomb_friction"])])
def test_friction_may_differ_from_the_references_as_warmth_makes_it(more, named):
    """Where a drive's current is quiet enough to show it."""
    calm = AXIS.noise.model_copy(update={"force": 1.0, "force_step": 0.5})
    rig = AXIS.model_copy(update={"noise": calm})
    warm = effect("coulomb_friction", force=more * AXIS.actuators[0].coulomb)
    found = diagnose(record(warm, rig=rig, seed=7), rig, references=[record(rig=rig, seed=8)])
    assert [x.effect for x in found.effects] == named


def test_what_is_named_was_excited(friction):
    named = {f"{x.location}.{x.effect}" for x in friction.effects}
    assert not named & set(friction.not_excited)
    c, first = friction.calibrated, friction.best
    bank = candidates_of(c, friction.none, ())
    silent = replace(bank, columns=0.0 * bank.columns)
    assert set(not_excited(c, silent)) - set(not_excited(c, silent, first)) == named
    assert len(not_excited(c, silent)) == len(bank.leaves)


def test_a_rig_that_never_moved_is_refused():
    t = np.arange(0.0, 8.0, 0.01)
    noise = np.random.default_rng(1).normal(scale=2e-5, size=len(t))
    frame = pd.DataFrame({"t": t, "axis.setpoint": 0.0 * t, "axis.position": noise})
    with pytest.raises(IdentificationError, match=r"never moved|nothing moved"):
        locate(frame, AXIS)


def test_a_force_rounded_so_coarsely_that_it_stays_on_one_step_is_no_stuck_sensor(healthy):
    coarse = healthy.copy()
    coarse["axis.force"] = 100.0 * np.round(coarse["axis.force"] / 100.0)
    found = diagnose(coarse, AXIS)
    assert found.verdict == "identified"
    (cause,) = found.effects
    assert (cause.effect, cause.location) == ("sensor_quantisation", "axis.force")
    assert cause.parameters["step"].value == pytest.approx(100.0)
    assert not any("stuck" in f.text for f in found.located.findings)


def test_a_step_is_read_from_two_levels_between_which_a_signal_goes_to_and_fro():
    often = np.repeat([0.0, 699.0, 0.0, 699.0, 0.0, 699.0, 0.0], 20)
    assert step_of(often) == pytest.approx(699.0)
    assert step_of(often + 100.0) is None  # no grid that rounding makes
    assert step_of(np.repeat([0.0, 699.0], 70)) is None  # a sensor that died


@pytest.mark.parametrize("own", [0.0, 0.0026])
def test_a_step_is_read_from_a_wheel_that_turns_by_several_of_them_each_time(own):
    rng = np.random.default_rng(3)
    turned = np.cumsum(rng.choice([3, 4], 3000)) * 0.031
    told = np.round(turned / own) * own if own else turned
    assert step_of(told, own) == pytest.approx(0.031, rel=1e-5)
    assert step_of(np.cumsum(rng.uniform(0.09, 0.13, 3000)), own) is None


def test_a_force_that_changes_once_and_never_again_is_a_stuck_sensor(healthy):
    dead = healthy.copy()
    dead["axis.force"] = dead["axis.force"].where(dead["axis.force"].isna(), 640.0)
    dead.loc[dead["t"] < 1.5, "axis.force"] *= 0.0
    with pytest.raises(IdentificationError, match=r"axis\.force.*stuck"):
        diagnose(dead, AXIS)


def test_viscous_friction_of_either_direction_is_found_where_it_alone_is_asked_for():
    worn = record(effect("asymmetric_viscous_friction", positive=260.0, negative=20.0))
    found = diagnose(worn, AXIS, without=all_but(AXIS, "asymmetric_viscous_friction"))
    (cause,) = found.effects
    assert cause.effect == "asymmetric_viscous_friction"
    assert cause.parameters["positive"].value == pytest.approx(260.0, rel=0.15)


def test_actuators_that_never_move_are_left_out_of_the_answer():
    rig = load_rig("motorcycle")
    sent = np.arange(0.0, 9.0, rig.bus.cycle)
    home = Manipulator(rig).inverse(np.zeros(3))
    sway = 0.06 * np.clip(sent - 0.5, 0.0, 1.0) * (np.sin(2.0 * sent) + 0.3 * np.sin(7.0 * sent))
    told = {a: np.full(len(sent), rho) for a, rho in zip(rig.actuator_names, home, strict=True)}
    told["slide"] = told["slide"] + sway
    stamps = {f"{a}.{q}": sent + 0.003 for a in told for q in ("position", "force")}
    heavy = effect("actuator_inertia", "slide", mass=90.0)
    twin = Twin(rig.model_copy(update={"effects": (heavy,)}))
    values = twin.replay({a: (sent, v) for a, v in told.items()}, stamps)
    rng = np.random.default_rng(4)
    columns = {"t": sent} | {f"{a}.setpoint": v for a, v in told.items()}
    late = {"t": sent + 0.003}
    for name, v in values.items():
        spread = rig.noise.position if name.endswith("position") else rig.noise.force
        late[name] = v + spread * rng.standard_normal(len(v))
    run = pd.concat([pd.DataFrame(columns), pd.DataFrame(late)]).sort_values("t", kind="stable")
    found = diagnose(run.reset_index(drop=True), rig)
    assert found.best is not None
    signals = found.tables()["gap"]["signals"]
    assert "slide.force" in signals
    assert "leg1.position" not in signals
    assert all(np.isfinite(s["after"]) for s in signals.values())


def test_a_phase_is_told_within_the_first_turn():
    wave = effect("force_ripple", amplitude=60.0, period=0.005, phase=5.0)
    found = diagnose(record(wave), AXIS)
    assert [x.effect for x in found.effects] == ["force_ripple"]
    assert found.effects[0].parameters["phase"].value == pytest.approx(5.0, abs=0.4)


def test_an_interval_holds_what_a_healthy_rig_has_of_the_same(friction):
    c = friction.calibrated
    leaf = Leaf("transport_delay", "axis", ("axis.transport_delay.delay",), (), "axis")
    told = {"names": leaf.parameters, "values": np.array([1e-3]), "search_sd": np.array([1e-9])}
    for nuisances, half_s in ((c.nuisances, np.hypot(1.3e-4, 1.645 * DELAY_S)), ((), 1.3e-4)):
        fit = replace(friction.best, **told)
        low, high = _parameters(replace(c, nuisances=nuisances), fit, leaf, 1.0)["delay"].ci
        assert 0.5 * (high - low) == pytest.approx(half_s, rel=1e-3)


def test_an_interval_of_a_gain_holds_what_any_drives_loops_seem_to_be_off_by(friction):
    gains = ("axis.loop_gain.position", "axis.loop_gain.speed", "axis.loop_gain.integral")
    leaf = Leaf("loop_gain", "axis", gains, (), "axis")
    told = {"names": gains, "values": np.array([0.8, 1.0, 1.0]), "search_sd": np.full(3, 1e-9)}
    values = _parameters(friction.calibrated, replace(friction.best, **told), leaf, 1.0)
    halves = {name: 0.5 * (v.ci[1] - v.ci[0]) for name, v in values.items()}
    other_law = {"position": 0.13 * 0.2, "speed": 0.0, "integral": 0.0}
    for name, half in halves.items():
        assert half == pytest.approx(np.hypot(LOOPS[name], other_law[name]), rel=1e-3)


@pytest.mark.parametrize(
    ("verdict", "effects", "bend_hz", "is_better", "stands"),
    [
        ("no_gap", (), BEND_HZ, False, True),
        ("no_gap", (), SOFTER_HZ, True, False),  # so soft a screw is a finding
        ("identified", ("force_constant",), SOFTER_HZ, True, True),
        ("identified", ("force_constant",), SOFTER_HZ, False, False),
        ("identified", ("loop_gain",), BEND_HZ, True, False),
        ("unknown", (), BEND_HZ, True, False),
    ],
)
def test_a_twin_on_springs_is_believed_where_it_needs_none_or_names_another(
    verdict: str, effects: tuple[str, ...], bend_hz: float, is_better: bool, stands: bool
):
    told = SimpleNamespace(verdict=verdict, effects=[SimpleNamespace(effect=x) for x in effects])
    assert is_springs(told, bend_hz, is_better=is_better, is_worse=False) is stands
    # what the stiff twin says explains more than springs alone: they are not all there is
    if verdict == "no_gap":
        assert not is_springs(told, bend_hz, is_better=is_better, is_worse=True)
