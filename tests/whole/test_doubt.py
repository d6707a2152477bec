"""What is none of the catalogue is not named for its nearest neighbour, and what looks like noise is not."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import hil.gap.judged.doubt as module
from hil.gap.catalogue.sprung import stiffness_at
from hil.gap.diagnose import consider
from hil.gap.fits.heldout import Score
from hil.gap.fits.shares import usually_explained
from hil.gap.judged import constancy, verdict
from hil.gap.judged.looped import is_spring
from hil.gap.judged.verdict import _is_unseen, usual_of
from hil.gap.located.result import Place
from hil.gap.record.leaf import Leaf
from tests.gap.twin_runs import AXIS, record


@pytest.mark.parametrize(("over_m", "spring"), [(0.002, False), (0.04, False), (0.3, True)])
def test_a_hysteresis_that_follows_the_place_alone_is_a_spring(over_m, spring):
    names = ("axis.hysteresis.force", "axis.hysteresis.displacement")
    leaf = Leaf("hysteresis", "axis", names, (), None)
    t_s = np.arange(0.0, 20.0, 0.01)
    way_m = 0.06 * np.sin(2.0 * np.pi * 0.17 * t_s) + 0.03 * np.sin(2.0 * np.pi * 0.71 * t_s)
    problem = SimpleNamespace(motion=lambda vector: [{"axis.position": way_m}])
    fit = SimpleNamespace(names=names, values=np.array([40.0, over_m]), vector=None)
    assert is_spring(SimpleNamespace(problem=problem), fit, leaf) is spring
    problem = SimpleNamespace(motion=lambda vector: [{"axis.position": np.zeros(9)}])
    assert is_spring(SimpleNamespace(problem=problem), fit, leaf)


def test_what_varies_is_set_off_against_what_explains_the_same_and_nothing_else(monkeypatch):
    frame = record()
    sent = frame[["t", "axis.setpoint"]].dropna()
    speed = np.gradient(sent["axis.setpoint"], sent["t"])
    frame["axis.force"] += np.interp(frame["t"], sent["t"], 4e3 * speed * np.abs(speed))
    seen = consider(frame, AXIS)
    c, none = seen.calibrated, seen.fits[0]
    drag = next(f for f in seen.fits if [x.name for x in f.leaves] == ["axis.viscous_friction"])
    monkeypatch.setattr(constancy, "_others", lambda *_: [])
    alone = constancy.variation(c, none, drag, seen.bank, 1.0)
    assert alone.goes_with == "speed"
    assert alone.share > constancy.FAINT
    left = drag.white[c.train][:, None]
    elsewhere = np.zeros_like(left)
    (part,) = (x.part for x in c.problem.series if x.signal == "axis.position")
    at = np.zeros(c.problem.size, dtype=bool)
    at[part] = True
    elsewhere[at[c.train]] = left[at[c.train]]
    for column, expected in ((elsewhere, alone.share), (left, 0.0)):
        monkeypatch.setattr(constancy, "_others", lambda *_, x=column: [x])
        share = constancy.variation(c, none, drag, seen.bank, 1.0).share
        assert share == pytest.approx(expected, rel=0.25, abs=1e-3)


def test_what_is_left_of_a_gap_of_hundreds_of_floors_is_held_against_all_of_it():
    """A limit that is up to a twentieth off from first to last, beside noise of one floor."""
    rng, past = np.random.default_rng(0), np.linspace(-1.0, 1.0, 4000)
    trace = 500.0 * np.sin(np.linspace(0.0, 60.0, 4000))
    noise = rng.standard_normal(4000)
    varied = (past * trace)[:, None]
    share = constancy._of_energy(trace + noise, 0.05 * past * trace + noise, trace[:, None], varied)
    assert share == pytest.approx(0.05**2 / 3.0, rel=0.05)
    assert share < constancy.FAINT


@pytest.mark.parametrize(
    ("names", "values", "usual"),
    [
        (("drives.clock_drift.rate",), (-9e-6,), ["drives.clock_drift"]),
        (("drives.clock_drift.rate",), (6e-5,), []),
        (
            ("drives.clock_drift.rate", "axis.coulomb_friction.force"),
            (9e-6, 40.0),
            ["drives.clock_drift"],
        ),
        (
            ("axis.lead_error.amplitude", "axis.lead_error.period"),
            (-2e-6, 0.005),
            ["axis.lead_error"],
        ),
        (
            ("axis.lead_error.amplitude", "axis.lead_error.period"),
            (9e-6, 0.005),
            ["axis.lead_error"],
        ),
        (("axis.lead_error.amplitude", "axis.lead_error.period"), (10e-6, 0.005), []),
        (("axis.compliance.stiffness", "axis.compliance.damping"), (2e7, 3e3), ["axis.compliance"]),
        (("axis.compliance.stiffness", "axis.compliance.damping"), (5e6, 3e3), []),
        (("axis.lead_error.scale",), (1.02,), []),
        (
            ("axis.loop_gain.position", "axis.loop_gain.speed", "axis.loop_gain.integral"),
            (0.979, 1.061, 0.977),
            ["axis.loop_gain"],
        ),
        (("axis.loop_gain.position", "axis.loop_gain.speed"), (0.967, 1.09), ["axis.loop_gain"]),
        (("axis.loop_gain.position", "axis.loop_gain.speed"), (0.96, 1.0), []),
        (("axis.loop_gain.position", "axis.loop_gain.speed"), (1.0, 1.1), []),
    ],
)
def test_clocks_screws_and_loops_that_differ_as_any_do_are_no_finding(names, values, usual):
    effects = dict.fromkeys(tuple(n.split(".")[:2]) for n in names)
    leaves = tuple(
        Leaf(e, at, tuple(n for n in names if n.startswith(f"{at}.{e}.")), (), None)
        for at, e in effects
    )
    f = SimpleNamespace(leaves=leaves, names=names, values=np.array(values))
    assert [leaf.name for leaf in usual_of(f, AXIS)] == usual


@pytest.mark.parametrize(
    ("swings_hz", "floors", "is_frame"), [(36.0, 1.3, True), (36.0, 1.6, False), (25.0, 1.3, False)]
)
def test_a_spring_that_shows_no_more_than_a_frame_on_its_mounts_is_no_finding(
    swings_hz, floors, is_frame, monkeypatch
):
    names = ("axis.compliance.stiffness", "axis.compliance.damping")
    leaf = Leaf("compliance", "axis", names, (), None)
    values = np.array([stiffness_at(AXIS.actuators[0], swings_hz), 3e3])
    f = SimpleNamespace(leaves=(leaf,), names=names, values=values)
    monkeypatch.setattr(verdict, "traces", lambda c, none, f: {"imu.accel_z": floors})
    c = SimpleNamespace(problem=SimpleNamespace(rig=AXIS))
    assert verdict._is_frame(c, None, f) is is_frame


@pytest.mark.parametrize(
    ("effect_name", "shrink", "unknown", "is_unseen"),
    [
        ("velocity_saturation", None, 0.2, True),
        ("velocity_saturation", None, 0.04, False),
        ("velocity_saturation", 0.5, 0.2, False),
        ("compliance", None, 0.2, False),
    ],
)
def test_a_limit_that_leaves_much_must_show_in_unseen_data(effect_name, shrink, unknown, is_unseen):
    f = SimpleNamespace(leaves=(Leaf(effect_name, "axis", (), (), "axis"),))
    assert _is_unseen(f, SimpleNamespace(shrink=shrink), unknown) is is_unseen


def doubted(
    monkeypatch,
    share: float,
    gain: float,
    after: float,
    shrink: float | None,
    effect: str = "loop_gain",
    *,
    floor: float = 0.5,
    surely: tuple[float, float] | None = None,
    at_bound: bool = False,
) -> float:
    """The chance that a fit of which nothing varies is none of the catalogue; unseen data begin at one."""
    monkeypatch.setattr(module, "variation", lambda *a: None)
    monkeypatch.setattr(module, "largest_ratio", lambda c, f: 2.0)
    leaf = Leaf(effect, "axis", (f"axis.{effect}.size",), (), "axis")
    bounded = leaf.parameters if at_bound else ()
    f = SimpleNamespace(leaves=(leaf,), at_bound=bounded, names=(), values=np.array([]))
    told = module.Told(share, gain, Score(("axis.force",), 1.0, after, floor, shrink, surely))
    c = SimpleNamespace(problem=SimpleNamespace(discount=20.0))
    return module.doubt(c, None, f, told, None, 1.0)[0]


@pytest.mark.parametrize("shrink", [None, 0.98])
def test_what_wants_more_than_any_rig_has_is_doubted_whatever_unseen_data_say(monkeypatch, shrink):
    """A rig that slides into its end stop was a tenth of a position, with 0.97."""
    sure, beyond = (
        doubted(monkeypatch, 0.99, 90.0, 0.02, shrink, "sensor_scale", floor=0.01, at_bound=b)
        for b in (False, True)
    )
    assert sure < 0.1
    assert beyond >= module.AT_BOUND


@pytest.mark.parametrize(("after", "is_doubtful"), [(1.0, False), (1.04, False), (1.1, True)])
def test_what_leaves_unseen_data_further_off_is_not_there(monkeypatch, after, is_doubtful):
    assert (doubted(monkeypatch, 0.98, 300.0, after, None) > 0.5) is is_doubtful


@pytest.mark.parametrize(
    ("gain", "effect", "is_doubtful"),
    [(300.0, "backlash", False), (60.0, "backlash", True), (300.0, "compliance", True)],
)
def test_flanks_that_meet_beyond_doubt_meet_elsewhere_in_unseen_data(
    monkeypatch, gain, effect, is_doubtful
):
    for shrink in (None, -0.6):
        assert (doubted(monkeypatch, 0.6, gain, 1.3, shrink, effect) > 0.5) is is_doubtful


@pytest.mark.parametrize(
    ("gain", "effect", "is_doubtful"),
    [(41.0, "backlash", False), (25.0, "backlash", True), (41.0, "hysteresis", True)],
)
def test_flanks_that_nothing_else_looks_like_need_take_little_off_unseen_data(
    monkeypatch, gain, effect, is_doubtful
):
    assert (doubted(monkeypatch, 0.6, gain, 0.98, 0.02, effect) > 0.5) is is_doubtful


@pytest.mark.parametrize(("shrink", "is_doubtful"), [(0.97, False), (0.85, True)])
def test_few_nats_are_no_chance_where_unseen_data_lose_their_gap(monkeypatch, shrink, is_doubtful):
    assert (doubted(monkeypatch, 0.97, 1.3, 1.0 - shrink, shrink) > 0.5) is is_doubtful


@pytest.mark.parametrize(("surely", "is_doubtful"), [((0.97, 1.0), False), ((0.4, 1.0), True)])
def test_nor_where_a_small_gap_of_theirs_surely_goes(monkeypatch, surely, is_doubtful):
    doubt = doubted(monkeypatch, 0.97, 3.6, 0.8, 1.0, floor=0.8, surely=surely)
    assert (doubt > 0.5) is is_doubtful


@pytest.mark.parametrize(
    ("effect", "shrink", "is_doubtful"),
    [("force_ripple", 0.22, True), ("force_ripple", 0.45, False), ("loop_gain", 0.22, False)],
)
def test_a_wave_must_show_at_other_places(monkeypatch, effect, shrink, is_doubtful):
    assert (
        doubted(monkeypatch, 0.97, 265.0, 1.0 - 0.5 * shrink, shrink, effect) > 0.5
    ) is is_doubtful


@pytest.mark.parametrize("are_at_odds", [False, True])
def test_frictions_at_odds_are_in_doubt_however_much_goes_off_unseen_data(monkeypatch, are_at_odds):
    monkeypatch.setattr(module, "is_at_odds", lambda f: are_at_odds)
    assert (doubted(monkeypatch, 0.99, 300.0, 0.1, 0.9) > 0.5) is are_at_odds


def test_between_impacts_a_gap_is_explained_whatever_the_impacts_leave():
    usual = {"none": {"axis.force": 2.0, "imu.accel_x": 3.2}, "fit": {"axis.force": 1.0, "imu.accel_x": 1.3},
             "floors": {"axis.force": 1.0, "imu.accel_x": 1.0}}  # fmt: skip
    noise = SimpleNamespace(usual=lambda problem, rows: usual[rows])
    c = SimpleNamespace(problem=None, noise=noise, usual_floors=usual["floors"])
    none, fit = SimpleNamespace(residual="none"), SimpleNamespace(residual="fit")
    assert usually_explained(c, none, fit) == pytest.approx(1.0 - 0.69 / 12.24, abs=1e-3)
    assert usually_explained(c, none, none) == 0.0


@pytest.mark.parametrize(("rms", "is_gap"), [(0.08, False), (0.15, True)])
def test_a_slow_force_that_is_a_trifle_of_the_rigs_own_friction_is_no_gap_alone(rms, is_gap):
    """Beside the little noise that a slow band has, any force towers."""
    drag_n = rms * AXIS.actuators[0].coulomb
    place = Place(
        "axis.force", (0.0, 0.3), "everywhere", 0.9, (0.8, 1.0), 1.0, drag_n, drag_n / 7.0
    )
    signal = SimpleNamespace(signal="axis.force", ratio=1.1)
    problem = SimpleNamespace(rig=AXIS)
    located = SimpleNamespace(
        signals=(signal,), where=(place,), evidence=SimpleNamespace(problem=problem)
    )
    assert (verdict._loudest(located) is place) is is_gap
