"""From runs to responses: channels at their true instants, and a sentence for every run that will not do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hil.configfile import load_rig
from hil.errors import IdentificationError
from hil.identify.frequency.channels import Posed, Sampled, channel
from hil.identify.frequency.frf import analyse
from hil.identify.frequency.in_step import in_step
from hil.identify.frequency.known import command_response, drives_response
from hil.rigs import build_rig
from tests.identify.frequency_data import AXIS, Multisine, analytic, axis_run, irregular, sampled

LINES = np.array([1, 3, 5, 9, 13, 17])
ACTUATOR = AXIS.actuator_names[0]


def multisine(rng, size=0.01, period_s=2.0, lines=LINES):
    return Multisine(lines, size / np.sqrt(lines), period_s, rng)


def run(name="run1", seed=1, noise=1e-6, system=analytic, seconds=20.2, wave=None):
    rng = np.random.default_rng(seed)
    wave = wave or multisine(rng)
    return axis_run(name, wave.at, lambda t: wave.at(t, system), rng, seconds, noise)


def test_a_runs_period_and_lines_need_not_be_told():
    a = analyse([run()], AXIS)
    assert a.period_s == pytest.approx(2.0)
    assert a.periods == (8,)  # ten, less two of settling
    assert a.response.input_name, a.response.output_name == ("cue.position", "position")
    assert a.response.value == pytest.approx(analytic(a.response.hz), abs=3e-4)
    assert a.fits["whole"].parameters["delay"].value == pytest.approx(0.035, abs=2e-4)


def test_answer_delays_are_taken_off():
    """A rig without any lag must show none, though its answers are stamped when received."""
    a = analyse([run(system=lambda hz: np.ones(len(hz)))], AXIS, output_name=f"{ACTUATOR}.position")
    assert np.abs(a.response.phase_deg).max() < 0.05


def test_realisations_come_from_several_runs():
    a = analyse([run("run1", 1), run("run2", 2), run("run3", 3)], AXIS)
    assert a.periods == (8, 8, 8)
    assert a.response.method == "realisations"


def test_a_motion_that_does_not_repeat_is_taken_by_the_local_polynomial_method():
    def chirp(t):
        return 0.02 * np.sin(2 * np.pi * (0.3 + 0.05 * t) * t)

    sweep = axis_run(
        "sweep", chirp, lambda t: chirp(t - 0.01), np.random.default_rng(2), 40.0, 1e-6
    )
    a = analyse([sweep], AXIS)
    assert a.period_s is None
    assert a.response.method == "local polynomial"
    inner = (a.response.hz > 0.8) & (a.response.hz < 3.5)
    assert a.response.value[inner] == pytest.approx(
        np.exp(-2j * np.pi * 0.01 * a.response.hz[inner]), abs=0.02
    )
    with pytest.raises(
        IdentificationError, match=r"sweep: cue.position is not periodic.*multisine"
    ):
        analyse([sweep], AXIS, method="periodic")


@pytest.mark.parametrize(
    ("make", "options", "sentence"),
    [
        (lambda: [run(seconds=6.2)], {}, "1 whole periods are left after settling; noise needs 2"),
        (lambda: [run(noise=0.05)], {}, "not seen above the noise: use a larger amplitude"),
        (lambda: [run()], {"period_s": 1.7}, "does not repeat after 1.7 s"),
        (lambda: [run()], {"highest_hz": 30.0}, "channels tell lines up to 20.0 Hz"),
        (lambda: [run()], {"output_name": "imu.accel_z"}, "has no signal 'imu.accel_z'; there are"),
        (
            lambda: [run(), run("run2", 2, wave=multisine(np.random.default_rng(3), 0.01, 2.5))],
            {},
            "run2: its period is 2.5 s, that of run1 2 s",
        ),
        (
            lambda: [run(wave=multisine(np.random.default_rng(3), 1e-9))],
            {},
            "no cue moved; there is nothing to respond to",
        ),
        (list, {}, "no run is given"),
    ],
    ids=["few periods", "noise", "period", "band", "signal", "mismatch", "still", "none"],
)
def test_what_will_not_do_is_said(make, options, sentence):
    with pytest.raises(IdentificationError, match=sentence):
        analyse(make(), AXIS, **options)


def test_lines_that_the_cue_does_not_hold_are_not_reported():
    a = analyse([run()], AXIS, highest_hz=5.0)
    assert a.response.hz == pytest.approx(LINES[LINES <= 10] / 2.0)


def test_a_run_without_cue_answers_from_its_setpoints_to_its_positions():
    r = run()
    column = {"cue.position": f"{ACTUATOR}.setpoint"}
    bare = replace(r, table=r.table.rename(columns=column))
    with pytest.raises(IdentificationError, match=r"holds no cue; name input and output"):
        analyse([bare], AXIS)


def test_poses_of_staggered_legs_are_exact_for_periodic_motion():
    """Six legs, none sampled together, of a platform that heaves and pitches by centimetres."""
    rig = load_rig("stewart_pd")
    m, rng = build_rig(rig), np.random.default_rng(5)
    heave, pitch = multisine(rng, 0.03), multisine(rng, 0.05, lines=np.array([2, 4, 7]))

    def legs(t):
        q = np.zeros((len(t), 6))
        q[:, 2], q[:, 4] = heave.at(t), pitch.at(t)
        return np.array([m.inverse(row) for row in q])

    parts = []
    for i, name in enumerate(rig.actuator_names):
        t = irregular(0.0033 * i, 4.5, 0.01, rng, 0.02)
        parts.append(Sampled(name, "m", t, legs(t)[:, i]))
    found = Posed("heave", "m", tuple(parts), m, 2).amplitudes(0.1, 2.0, 39)
    turned = heave.phasors * np.exp(2j * np.pi * LINES * 0.1 / 2.0)
    assert found[LINES] == pytest.approx(turned, abs=2e-6)
    assert np.abs(found[[2, 4, 7]]).max() < 1e-5  # nothing of the pitch


def test_setpoints_stand_on_the_schedule_and_not_where_jitter_put_them():
    rng = np.random.default_rng(6)
    schedule = 0.5 + AXIS.bus.cycle * np.arange(2000)
    late = np.abs(rng.normal(0.0, 3e-4, 2000))
    r = run()
    table = r.table.head(0).reindex(range(2000)).drop(columns=["cue.position"])
    table["t"] = schedule + late
    table[f"{ACTUATOR}.setpoint"] = 0.0
    found = channel(replace(r, table=table), AXIS, f"{ACTUATOR}.setpoint")
    bus = AXIS.bus
    expected = schedule + bus.setpoint_delay + bus.cycle * (1 + bus.retimed)
    assert found.t_s == pytest.approx(expected, abs=2e-5)


def test_the_drives_of_a_rig_follow_slow_motion_and_no_fast_one():
    for name in ("axis", "motorcycle", "stewart", "stewart_pd"):
        rig = load_rig(name)
        for coordinate in rig.coordinates:
            g = np.abs(drives_response(rig, coordinate, np.array([0.01, 1.0, 300.0])))
            assert g[0] == pytest.approx(1.0, abs=2e-3), (name, coordinate)
            assert 0.7 < g[1] < 1.2, (name, coordinate)
            assert g[2] < 0.2, (name, coordinate)


def test_slow_cues_pass_the_daemon_unchanged():
    rig = load_rig("stewart_pd")
    grid = 0.01 * np.arange(500)
    g = command_response(rig, "heave", np.array([0.05, 0.5]), grid, grid + 0.003)
    assert g == pytest.approx(np.ones(2), abs=2e-3)


@pytest.mark.parametrize(
    ("rate_hz", "setpoints_hz", "is_in_step"),
    [
        (200.0, 100.0, True),
        (100.0, 100.0, True),
        (150.0, 100.0, True),  # every third push of one is every second of the other
        (200.0, 1000.0, True),
        (225.0, 100.0, False),
        (190.0, 100.0, False),
        (1000.0, 100.0, False),  # what pushes there are at 1 kHz is little
    ],
)
def test_an_imu_in_step_with_the_setpoints_is_warned_of(rate_hz, setpoints_hz, is_in_step):
    bus = AXIS.bus.model_copy(update={"cycle": 1.0 / setpoints_hz})
    t = np.arange(0.0, 2.0, 1.0 / rate_hz)
    notes = in_step(AXIS.model_copy(update={"bus": bus}), sampled("imu.accel_x", t, 0.0 * t))
    assert bool(notes) is is_in_step
    assert in_step(AXIS, sampled("axis.position", t, 0.0 * t)) == ()
