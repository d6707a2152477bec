"""Every experiment on every rig keeps every limit, starts and ends at rest, and passes shaping unchanged."""

from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hil.configfile import load_rig, parse_settings
from hil.control.trajectory import CueTrajectory, check
from hil.errors import ConfigError, LimitViolation
from hil.identify.experiments import (
    PLANS,
    Chirp,
    Circle,
    Custom,
    Design,
    Heave,
    Multisine,
    Step,
    Sweep,
    design,
)
from hil.rigs import build_rig, stroke_violations

RIGS = ("axis", "motorcycle", "stewart", "simona")
SHORT = {
    "step": {"count": 1, "hold_s": 0.6},
    "chirp": {"duration_s": 5.0, "f_min": 0.4, "f_max": 4.0, "fade_s": 1.0},
    "sweep": {"duration_s": 4.0, "f_min": 0.5, "fade_s": 1.0},
    "multisine": {
        "period_s": 3.0, "f_min": 0.3, "f_max": 2.5, "periods": 1, "realisations": 1, "fade_s": 1.0,
    },
    "circle": {"period_s": 5.0, "fade_s": 3.0},
    "heave": {"cycles": 2, "frequency": 0.5, "fade_s": 1.5},
}  # fmt: skip


@cache
def rig_file(name):
    return load_rig(name)


@cache
def made(rig: str, kind: str, **options) -> Design:
    return design(PLANS[kind](**SHORT[kind], **options), rig_file(rig))


def assert_playable(result: Design, rig_name: str):
    rig = rig_file(rig_name)
    manipulator = build_rig(rig)
    trajectory = result.trajectory
    assert check(trajectory, rig, manipulator) == ()
    for q in trajectory.poses[::20]:
        assert stroke_violations(manipulator, q, rig.safety.stroke_margin) == ()
    velocity, acceleration, _ = trajectory.derivatives()
    for ends in (velocity[[0, -1]], acceleration[[0, -1]], trajectory.poses[[0, -1]]):
        assert np.max(np.abs(ends)) < 1e-9
    assert all(use.share <= 1.0 for use in result.uses)
    assert result.shaped.held_back == ""
    assert result.shaped.relative < 0.05


@pytest.mark.parametrize("kind", SHORT)
@pytest.mark.parametrize("rig", RIGS)
def test_every_experiment_on_every_rig_keeps_every_limit(rig, kind):
    if kind == "circle" and rig == "axis":
        with pytest.raises(ConfigError, match="needs two coordinates"):
            made(rig, kind)
        return
    assert_playable(made(rig, kind), rig)


@settings(
    max_examples=3, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
@given(
    rig=st.sampled_from(RIGS),
    kind=st.sampled_from(["chirp", "sweep", "heave", "multisine", "step"]),
    amplitude=st.floats(1e-3, 10.0),
    data=st.data(),
)
def test_whatever_amplitude_is_asked_for_limits_are_kept_or_it_is_refused(
    rig, kind, amplitude, data
):
    names = rig_file(rig).coordinates
    coordinates = data.draw(st.lists(st.sampled_from(names), min_size=1, max_size=2, unique=True))
    plan = PLANS[kind](**SHORT[kind], coordinates=tuple(coordinates), amplitude=(amplitude,))
    try:
        result = design(plan, rig_file(rig))
    except LimitViolation:
        return
    assert_playable(result, rig)
    assert result.description.amplitude[0] == pytest.approx(amplitude * result.description.scale)
    assert (result.description.scale < 1.0 - 1e-4) == bool(result.description.scaled_because)


def test_a_share_is_used_of_the_limit_that_is_reached_first():
    result = made("motorcycle", "sweep", share=0.3)
    assert max(use.share for use in result.uses) == pytest.approx(0.3, rel=0.03)


def test_the_published_circle_fits_the_stewart_platform_as_it_is():
    """0.25 m in 40 s; its legs run from 0.972 to 1.177 m (worked out from the joints' coordinates)."""
    rig = rig_file("stewart")
    result = design(Circle(fade_s=6.0), rig)
    assert result.description.amplitude == pytest.approx((0.25, 0.25), rel=1e-4)
    manipulator = build_rig(rig)
    segment = result.description.segments[0]
    t = result.trajectory.t_s
    on_it = result.trajectory.poses[(t >= segment.start_s) & (t <= segment.end_s)]
    assert np.hypot(on_it[:, 0], on_it[:, 1]) == pytest.approx(np.full(len(on_it), 0.25), rel=1e-4)
    legs = np.array([manipulator.inverse(q) for q in on_it[::10]])
    assert (legs.min(), legs.max()) == pytest.approx((0.972, 1.177), abs=1e-3)
    assert segment.end_s - segment.start_s == pytest.approx(40.0)


def test_a_step_of_one_leg_moves_that_leg_alone_by_one_centimetre():
    rig = rig_file("motorcycle")
    manipulator = build_rig(rig)
    result = design(Step(actuators=("leg1",), **SHORT["step"]), rig)
    rho = np.array([manipulator.inverse(q) for q in result.trajectory.poses])
    moved = np.max(rho, axis=0) - np.min(rho, axis=0)
    assert moved == pytest.approx([0.01, 0.0, 0.0], abs=1e-8)


def test_a_step_that_has_to_be_smaller_still_moves_one_leg_alone():
    rig = rig_file("motorcycle")
    manipulator = build_rig(rig)
    result = design(Step(actuators=("leg2",), amplitude=(0.3,), **SHORT["step"]), rig)
    rho = np.array([manipulator.inverse(q) for q in result.trajectory.poses[::5]])
    assert result.description.scale < 0.9
    assert np.ptp(rho[:, [0, 2]], axis=0) == pytest.approx([0.0, 0.0], abs=1e-8)
    assert np.ptp(rho[:, 1]) == pytest.approx(result.description.amplitude[0], rel=1e-6)


def test_steps_rest_between_and_their_onsets_are_known():
    result = made("axis", "step")
    t, x = result.trajectory.t_s, result.trajectory.poses[:, 0]
    up, down = result.description.segments
    assert x[t <= up.start_s] == pytest.approx(0.0)
    assert x[np.argmin(np.abs(t - up.end_s))] == pytest.approx(0.01)
    assert x[t <= down.start_s][-20:] == pytest.approx(np.full(20, 0.01))
    assert x[t < down.end_s][-1] == pytest.approx(0.0, abs=1e-12)


def period_spectra(result: Design) -> np.ndarray:
    """Amplitudes (periods, lines, coordinates) of each measured period of the design."""
    d = result.description
    count = round(d.period_s * d.rate_hz)
    found = []
    for segment in d.segments:
        for k in range(segment.periods):
            first = round((segment.start_s + k * d.period_s) * d.rate_hz)
            rows = result.trajectory.poses[first : first + count]
            found.append(2.0 * np.abs(np.fft.rfft(rows, axis=0)) / count)
    return np.array(found)


MULTISINE = Multisine(
    coordinates=("pitch", "yaw"), period_s=4.0, f_min=0.25, f_max=4.0, periods=2, realisations=2,
    lines="odd_random", group=3, fade_s=1.0,
)  # fmt: skip


@pytest.fixture(scope="module")
def zippered():
    return design(MULTISINE, rig_file("motorcycle"))


def test_a_multisine_has_power_exactly_on_its_lines(zippered):
    spectra = period_spectra(zippered)
    coordinates = zippered.trajectory.coordinates
    assert len(spectra) == 4
    for lines in zippered.description.lines:
        column = spectra[:, :, coordinates.index(lines.coordinate)]
        excited = np.array(lines.excited)
        strongest = np.max(column)
        assert np.min(column[:, excited]) > 1e-3 * strongest
        assert np.max(np.delete(column, excited, axis=1)) < 1e-9 * strongest
    assert np.max(spectra[:, :, coordinates.index("roll")]) == 0.0


def test_realisations_differ_in_phase_and_not_in_amplitude(zippered):
    spectra = period_spectra(zippered)
    assert spectra[0] == pytest.approx(spectra[2], abs=1e-12)
    d = zippered.description
    first, second = (round(s.start_s * d.rate_hz) for s in d.segments)
    poses = zippered.trajectory.poses
    assert np.max(np.abs(poses[first : first + 100] - poses[second : second + 100])) > 1e-3
    assert [s.realisation for s in d.segments] == [0, 1]


def test_lines_are_odd_dealt_out_and_some_stay_empty_for_detection(zippered):
    d = zippered.description
    pitch, yaw = (set(lines.excited) for lines in d.lines)
    assert not pitch & yaw
    assert all(k % 2 for k in pitch | yaw)
    odd_empty = {k for k in d.detection if k % 2}
    assert odd_empty | pitch | yaw == set(range(1, 17, 2))
    assert len(odd_empty) == 2  # eight odd lines are two whole groups of three
    assert {k for k in d.detection if k % 2 == 0} == set(range(2, 17, 2))


def test_all_lines_are_equally_strong_in_speed(zippered):
    spectra = period_spectra(zippered)[0]
    lines = zippered.description.lines[0]
    harmonics = np.array(lines.excited)
    speed = harmonics * spectra[harmonics, zippered.trajectory.coordinates.index("pitch")]
    assert speed == pytest.approx(np.full(len(speed), speed[0]), rel=1e-9)


def test_full_and_chosen_lines():
    full = made("axis", "multisine", lines="full").description
    assert full.lines[0].excited == tuple(range(1, 8))
    assert full.detection == ()
    chosen = design(
        Multisine(harmonics=(2, 5, 11), **SHORT["multisine"]), rig_file("axis")
    ).description
    assert chosen.lines[0].excited == (2, 5, 11)


def test_trying_phases_lowers_the_crest_factor():
    def crest(draws):
        plan = Multisine(draws=draws, **SHORT["multisine"], lines="full")
        x = period_spectra_rows(design(plan, rig_file("axis")))
        return np.max(np.abs(x)) / np.sqrt(np.mean(x**2))

    assert crest(50) < crest(1)


def period_spectra_rows(result: Design) -> np.ndarray:
    d = result.description
    first = round(d.segments[0].start_s * d.rate_hz)
    return np.gradient(result.trajectory.poses[:, 0])[first : first + round(d.period_s * d.rate_hz)]


def test_the_sinusoid_is_one_of_the_frequency_and_amplitude_asked_for():
    result = design(
        Heave(amplitude=(0.03,), cycles=4, frequency=0.5, fade_s=2.0), rig_file("stewart")
    )
    segment = result.description.segments[0]
    t = result.trajectory.t_s
    inside = (t >= segment.start_s) & (t < segment.end_s - 1e-9)
    heave = result.trajectory.poses[inside, 2]
    basis = np.column_stack([f(2 * np.pi * 0.5 * t[inside]) for f in (np.sin, np.cos)])
    fitted, residual, *_ = np.linalg.lstsq(basis, heave, rcond=None)
    assert np.hypot(*fitted) == pytest.approx(0.03, rel=1e-6)
    assert np.sqrt(residual[0] / len(heave)) < 1e-7
    assert segment.periods == 4


def test_the_chirp_is_of_constant_amplitude_in_displacement():
    result = design(Chirp(f_min=0.5, f_max=4.0, duration_s=12.0, fade_s=2.0), rig_file("axis"))
    segment = result.description.segments[0]
    t, x = result.trajectory.t_s, result.trajectory.poses[:, 0]
    x = x[(t >= segment.start_s) & (t <= segment.end_s)]
    peaks = x[1:-1][(x[1:-1] > x[:-2]) & (x[1:-1] > x[2:])]
    assert peaks == pytest.approx(np.full(len(peaks), result.description.amplitude[0]), rel=0.01)


def test_a_custom_motion_is_scaled_down_and_says_by_how_much():
    t = np.linspace(0.0, 4.0, 401)
    motion = CueTrajectory(("pitch",), t, 0.5 * np.sin(np.pi * t / 4.0)[:, None] ** 4)
    result = design(Custom(file="ride.csv"), rig_file("motorcycle"), motion)
    assert_playable(result, "motorcycle")
    assert 0.1 < result.description.scale < 0.6
    assert "pitch" in result.description.scaled_because
    small = design(Custom(file="ride.csv"), rig_file("motorcycle"), motion.scaled(np.array([0.05])))
    with pytest.raises(LimitViolation, match=r"shrink to 0\.0.* in m and rad"):
        design(Custom(file="ride.csv"), rig_file("motorcycle"), motion.scaled(np.array([57.3])))
    assert (small.description.scale, small.description.scaled_because) == (1.0, "")


def test_a_custom_motion_that_starts_at_a_speed_is_refused():
    t = np.linspace(0.0, 4.0, 401)
    motion = CueTrajectory(("pitch",), t, 0.1 * np.sin(np.pi * t)[:, None])
    with pytest.raises(ConfigError, match=r"ride.csv: begins with pitch at 0\.\d+/s; .*at rest"):
        design(Custom(file="ride.csv"), rig_file("motorcycle"), motion)


@pytest.mark.parametrize(
    ("kind", "options", "says"),
    [
        ("step", {"hold_s": 0.01}, r"test: hold_s: .*0\.1 \(got 0\.01\)"),
        ("chirp", {"f_max": 80.0}, r"test: f_max: .*50 \(got 80"),
        ("sweep", {"f_min": 4.0, "f_max": 2.0}, r"f_max 2 Hz lies below f_min 4 Hz"),
        ("sweep", {"amplitude": [-1.0]}, r"amplitude\[0\]: .*greater than 0 \(got -1"),
        ("multisine", {"group": 1}, r"group: .*2 \(got 1"),
        ("multisine", {"lines": "even"}, r"lines: .*'full', 'odd' or 'odd_random'"),
        ("circle", {"period": 3.0}, r"period is not a key that hil knows"),
        ("heave", {"share": 1.5}, r"share: .*0\.95 \(got 1\.5"),
        ("custom", {}, r"file is missing"),
    ],
)
def test_bad_options_get_a_sentence_with_the_bound(kind, options, says):
    with pytest.raises(ConfigError, match=says):
        parse_settings(options, PLANS[kind], "test")


@pytest.mark.parametrize(
    ("plan", "says"),
    [
        (Sweep(coordinates=("heave",)), "motorcycle has no coordinate 'heave'; it has yaw, pitch, roll"),
        (Sweep(coordinates=("yaw", "yaw")), "names one twice"),
        (Step(actuators=("leg9",)), "no actuator 'leg9'; it has leg1, leg2, slide"),
        (Step(actuators=("leg1",), coordinates=("yaw",)), "coordinates or actuators, not both"),
        (Chirp(amplitude=(1.0, 2.0)), "2 values for 1 that move"),
        (Chirp(duration_s=5.0, fade_s=3.0), "3 s in and out do not fit into 5 s"),
        (Circle(coordinates=("yaw", "pitch", "roll")), "needs two coordinates"),
        (Circle(amplitude=(0.1, 0.2)), "its radius, one value"),
        (Multisine(f_min=0.1, f_max=0.3, coordinates=("yaw", "pitch", "roll")), "lines between 0.1 and"),
        (Multisine(f_max=40.0, period_s=1.0), "40 Hz lies above 25 Hz|39 Hz lies above 25 Hz"),
    ],
)  # fmt: skip
def test_plans_that_do_not_fit_the_rig_are_refused_by_name(plan, says):
    with pytest.raises(ConfigError, match=says):
        design(plan, rig_file("motorcycle"))


def test_a_rig_with_a_lowered_gain_plays_no_experiment():
    tables = rig_file("axis").model_dump()
    tables["cue"]["gain"] = 0.8
    rig = parse_settings(tables, type(rig_file("axis")), "axis")
    with pytest.raises(ConfigError, match=r"gain is 0\.8"):
        design(Step(), rig)


def test_the_same_plan_gives_the_same_motion():
    again = design(PLANS["multisine"](**SHORT["multisine"]), rig_file("axis"))
    first = made("axis", "multisine")
    assert np.array_equal(again.trajectory.poses, first.trajectory.poses)
    assert again.description == first.description
