"""Amplitudes that single samples do not spoil, sensitivities that learn, effects that are another one."""

from types import SimpleNamespace

import numpy as np
import pytest

from hil.gap.catalogue.nuisances import default_nuisances
from hil.gap.fits.about import LOOSER, STIFFER
from hil.gap.fits.evidence import _peaks
from hil.gap.fits.fit import _as_moved, _is_stuck, fit
from hil.gap.fits.friction import is_at_odds, is_equal, is_itself, is_peak
from hil.gap.fits.heldout import split
from hil.gap.fits.starts import relative
from hil.gap.fits.training import begin, candidates_of
from hil.gap.judged.doubt import is_beyond
from hil.gap.located.locate import locate
from hil.gap.search.linear import Search
from hil.sim.parameters import ParameterTable
from tests.gap.twin_runs import AXIS, effect, record


def amplitude(frame, name: str) -> float:
    """What the linear picture of the search would begin a fit of `name` with."""
    e = locate(frame, AXIS).evidence
    parts = split(e.problem, e.noise, e.residual)
    c, none = begin(e, parts, default_nuisances(AXIS, e.problem.signals), {}, 0)
    bank = candidates_of(c, none, ())
    (found,) = (p for p in Search(c, bank).alone() if bank.leaves[p.leaves[0]].name == name)
    return float(found.starts[0][1][0])


def test_kicks_do_not_spoil_what_a_mass_looks_like():
    heavy = record(effect("actuator_inertia", mass=67.5), duration_s=6.0)
    kicked, rng = heavy.copy(), np.random.default_rng(3)
    answered = heavy.index[heavy["axis.force"].notna()]
    for first in rng.choice(len(answered) - 3, 30, replace=False):
        kicked.loc[answered[first : first + 3], "axis.force"] += rng.choice([-300.0, 300.0])
    true = 67.5 / ParameterTable(AXIS)["axis.actuator_inertia.mass"].scale
    for frame in (heavy, kicked):
        assert amplitude(frame, "axis.actuator_inertia") == pytest.approx(true, rel=0.25)


def test_sensitivities_learn_what_a_step_did():
    rng = np.random.default_rng(1)
    found, true = rng.standard_normal((2, 50, 4))
    step = rng.standard_normal(4)
    learnt = _as_moved(found, (true - found) @ step, step)
    assert learnt @ step == pytest.approx(true @ step)
    across = np.array([step[1], -step[0], 0.0, 0.0])
    assert learnt @ across == pytest.approx(found @ across)
    assert _as_moved(found, np.ones(50), 1e-3 * step) is found


def test_nothing_is_tried_about_what_another_fit_has_found(monkeypatch):
    """A spring's cost is rugged: six others about its own are looked at, and six about the best, once."""
    e = locate(
        record(effect("compliance", stiffness=2e5, damping=400.0), duration_s=4.0), AXIS
    ).evidence
    parts = split(e.problem, e.noise, e.residual)
    c, none = begin(e, parts, default_nuisances(AXIS, e.problem.signals), {}, 0)
    leaf = next(x for x in candidates_of(c, none, ()).leaves if x.name == "axis.compliance")
    replayed: list[int] = []
    answers = c.problem.answers
    monkeypatch.setattr(
        c.problem,
        "answers",
        lambda rows: replayed.append(len(np.atleast_2d(rows))) or answers(rows),
    )

    def fitted(start, **how):
        replayed.clear()
        found = fit(c, [leaf], start, **how)
        assert found is not None
        return found, replayed[1:3]

    start = {"axis.compliance.stiffness": 2e5, "axis.compliance.damping": 400.0}
    first, asked = fitted(start)
    again, asked_again = fitted(relative(c, first), z=first.z, found=first.names)
    assert asked == [len(STIFFER), len(LOOSER) * 2]
    assert 6 not in asked_again
    assert again.total(c) <= first.total(c) + 1e-6


def fit_of(name: str, values: dict[str, float], *at_bound: str) -> SimpleNamespace:
    """As much of a fit of one effect as is asked here."""
    names = tuple(f"axis.{name}.{p}" for p in values)
    leaf = SimpleNamespace(effect=name, location="axis", name=f"axis.{name}", parameters=names)
    ends = tuple(f"axis.{name}.{p}" for p in at_bound)
    numbers = np.array(list(values.values()))
    return SimpleNamespace(leaves=(leaf,), names=names, values=numbers, at_bound=ends)


@pytest.mark.parametrize(
    ("positive", "negative", "is_friction"),
    [(60.0, 10.0, True), (30.0, -8.0, True), (30.0, -20.0, False), (-12.0, -11.0, True)],
)
def test_friction_that_goes_one_way_and_grows_the_other_is_a_constant_force(
    positive: float, negative: float, is_friction: bool
):
    """The axis has 20 N of its own."""
    c = SimpleNamespace(problem=SimpleNamespace(rig=AXIS))
    f = fit_of("asymmetric_friction", {"positive": positive, "negative": negative})
    assert is_itself(c, f) is is_friction


@pytest.mark.parametrize(("negative", "are_equal"), [(59.5, True), (57.0, False)])
def test_friction_that_is_equal_in_both_directions_is_plain(negative: float, are_equal: bool):
    assert (
        is_equal(fit_of("asymmetric_friction", {"positive": 59.6, "negative": negative}))
        is are_equal
    )


@pytest.mark.parametrize(
    ("viscous", "coulomb", "static", "is_one_law"),
    [
        (320.0, -29.0, -4.0, True),
        (320.0, 29.0, 60.0, False),
        (-40.0, -10.0, -5.0, False),
        (320.0, -5.0, 20.0, False),
    ],
)
def test_friction_that_takes_away_what_another_adds_at_its_place_is_another_law(
    viscous: float, coulomb: float, static: float, is_one_law: bool
):
    drag = fit_of("viscous_friction", {"coefficient": viscous})
    peak = fit_of("stribeck_friction", {"velocity": 0.07, "coulomb": coulomb, "static": static})
    both = SimpleNamespace(
        leaves=drag.leaves + peak.leaves,
        names=drag.names + peak.names,
        values=np.concatenate([drag.values, peak.values]),
    )
    assert is_at_odds(both) is is_one_law
    assert not is_at_odds(peak)


@pytest.mark.parametrize(
    ("static", "coulomb", "stands_out"),
    [(88.0, 42.0, True), (70.0, 42.0, False), (50.0, -10.0, False), (-80.0, -40.0, False)],
)
def test_a_peak_at_rest_stands_out_where_it_is_no_other_friction_that_differs(
    static: float, coulomb: float, stands_out: bool
):
    values = {"coulomb": coulomb, "static": static, "velocity": 0.02}
    assert is_peak(fit_of("stribeck_friction", values)) is stands_out


@pytest.mark.parametrize(
    ("static", "more", "is_free"), [(88.0, 9.0, True), (88.0, 3.0, False), (60.0, 9.0, False)]
)
def test_a_peak_that_stands_out_and_explains_more_does_not_pay_for_its_parameters(
    static: float, more: float, is_free: bool
):
    none = SimpleNamespace(leaves=(), names=(), values=np.empty(0), at_bound=())
    plain = fit_of("coulomb_friction", {"force": 42.0})
    peaked = fit_of("stribeck_friction", {"coulomb": 41.0, "static": static, "velocity": 0.02})
    logs = np.array([0.0, 1000.0, 1000.0 + more])
    assert _peaks([none, plain, peaked], logs) == ([(2, [1])] if is_free else [])


def test_an_effect_all_of_whose_parameters_are_at_their_bounds_is_beyond_any_rig():
    stuck = fit_of("velocity_saturation", {"limit": 0.0}, "limit")
    half = fit_of("load_friction", {"coefficient": 0.1, "asymmetry": 1.0}, "asymmetry")
    assert is_beyond(stuck.leaves, stuck)
    assert not is_beyond(half.leaves, half)


@pytest.mark.parametrize(("deviation_rad", "is_stuck"), [(0.01, True), (1.1, False)])
def test_a_parameter_that_data_leave_free_is_not_stuck_at_its_bound(
    deviation_rad: float, is_stuck: bool
):
    p = ParameterTable(AXIS)["imu.sensor_misalignment.z"]
    assert _is_stuck(p, p.to_search(p.lower), deviation_rad) is is_stuck
