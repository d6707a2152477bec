"""Exam cases that are ridden: a world that is no twin, sensors that err as told, answers that stay sealed."""

from __future__ import annotations

import json

import numpy as np
import pytest

from hil.bicycle.manoeuvres import Manoeuvre
from hil.bicycle.path import slalom
from hil.config import BicycleFile, Effect
from hil.configfile import load_bicycle
from hil.errors import ConfigError
from hil.exam import Order, load_case, make_exam, seal
from hil.exam.case import seals_of
from hil.exam.rides import RIDE_EFFECTS, RIDE_OUTSIDE
from hil.exam.rides.bench import RideBench
from hil.exam.rides.forward import fork_force, tyre_force
from hil.exam.rides.menu import draw_effect
from hil.exam.rides.outside import draw_outside
from hil.exam.rides.record import Off, record
from hil.exam.rides.world import MOVES, STEP_S, Bicycle, Ridden, _scattered
from hil.exam.severity import effect_of
from hil.exam.world import Outside, Scatter
from hil.rigs.bicycle.parameters import pack
from hil.sim.parameters import ParameterTable

NOMINAL = load_bicycle("bicycle")
SHORT = Manoeuvre("short", "a short slalom", lambda: slalom(45.0, 15.0), 4.5, 4.0)


# --- springs and tyres --------------------------------------------------------------------------------


@pytest.mark.parametrize("load", [300.0, -300.0])
def test_a_fork_holds_its_load_at_rest_and_stiffens_as_it_goes_in(load):
    law = np.array([9e3, 0.07, 300.0, 500.0, 0.0])
    side = np.sign(load)
    assert fork_force(law, load, 0.0, 0.0) == pytest.approx(load)
    slope = (fork_force(law, load, 1e-6, 0.0) - fork_force(law, load, -1e-6, 0.0)) / 2e-6
    assert slope == pytest.approx(9e3, rel=1e-6)
    further = abs(fork_force(law, load, side * 0.03, 0.0)) - abs(load)
    assert further == pytest.approx(9e3 * 0.03 * (1.0 + 0.03 / 0.07))
    assert (
        abs(fork_force(law, load, 0.0, -side * 0.1))
        < abs(load)
        < abs(fork_force(law, load, 0.0, side * 0.1))
    )


def test_the_rebound_is_held_harder_and_a_seal_grips():
    law = np.array([9e3, 0.07, 300.0, 500.0, 6.0])
    into, out = (fork_force(law, 300.0, 0.0, v) - 300.0 for v in (0.1, -0.1))
    assert into == pytest.approx(30.0 + 6.0, abs=1e-6)
    assert out == pytest.approx(-50.0 - 6.0, abs=1e-6)


def test_a_tyre_follows_a_power_of_its_deflection_and_lets_go_of_the_road():
    law = np.array([8e4, 1.25, 0.0])
    assert tyre_force(law, 400.0, 0.0, 0.0) == pytest.approx(400.0)
    slope = (tyre_force(law, 400.0, 1e-7, 0.0) - tyre_force(law, 400.0, -1e-7, 0.0)) / 2e-7
    assert slope == pytest.approx(8e4, rel=1e-5)
    whole = 1.25 * 400.0 / 8e4
    assert tyre_force(law, 400.0, -whole, 0.0) == 0.0
    assert tyre_force(law, 400.0, -2.0 * whole, 0.0) == 0.0
    assert tyre_force(law, 400.0, whole, 0.0) == pytest.approx(400.0 * 2.0**1.25)


# --- sensors ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def swung():
    """A ride that is made up: lean and steer swing, the wheel rolls, the IMU feels waves."""
    t = STEP_S * np.arange(8000)
    q, qd = np.zeros((8000, 12)), np.zeros((8000, 12))
    q[:, 3], q[:, 6] = 0.2 * np.sin(2.0 * t), 0.1 * np.cos(2.0 * t)
    q[:, 4] = 14.0 * t
    qd[:, 0], qd[:, 4], qd[:, 2] = 5.0, 14.0, 0.4 * np.cos(2.0 * t)
    imu = np.column_stack([np.sin(2.0 * t + k) for k in range(6)])
    imu[:, 5] += 9.81
    return Ridden(t, q, qd, imu)


def seen(swung, *effects, outside=()):
    own = tuple(Effect(effect=e, location=at, parameters=p) for e, at, p in effects)
    return record(Bicycle(NOMINAL, Scatter(5), own, tuple(outside)), swung, None)


def of(table, signal):
    rows = table[["t", signal]].dropna().to_numpy()
    return rows[:, 0], rows[:, 1]


@pytest.mark.parametrize("signal", ["lean", "steer", "imu.gyro_z", "imu.accel_x"])
def test_bias_and_scale_do_what_they_say(swung, signal):
    _, plain = of(seen(swung), signal)
    _, biased = of(seen(swung, ("sensor_bias", signal, {"offset": 0.03})), signal)
    np.testing.assert_allclose(biased - plain, 0.03, atol=1e-12)
    _, scaled = of(seen(swung, ("sensor_scale", signal, {"scale": 1.1})), signal)
    own = plain.mean()  # a healthy sensor's own zero is not scaled
    np.testing.assert_allclose(scaled - scaled.mean(), 1.1 * (plain - own), atol=1e-12)


def test_a_latency_is_half_a_delay_and_half_a_lag(swung):
    t, plain = of(seen(swung), "lean")
    _, late = of(seen(swung, ("sensor_latency", "lean", {"delay": 0.06})), "lean")
    inside = (t > 1.0) & (t < 7.0)
    shifted = np.interp(t[inside] - 0.06, t, plain)
    assert np.abs(late[inside] - shifted).max() < 1e-3
    assert np.abs(late[inside] - plain[inside]).max() > 0.02


def test_a_clock_that_runs_fast_stamps_later(swung):
    t, plain = of(seen(swung), "imu.gyro_x")
    fast, same = of(seen(swung, ("clock_drift", "imu", {"rate": 1e-3})), "imu.gyro_x")
    np.testing.assert_allclose(fast, 1.001 * t, atol=2e-6)
    np.testing.assert_array_equal(plain, same)


def test_a_turned_imu_keeps_what_it_feels(swung):
    turned = seen(swung, ("sensor_misalignment", "imu", {"x": 0.1, "y": -0.2, "z": 0.05}))
    a, b = (
        np.column_stack([of(table, f"imu.accel_{c}")[1] for c in "xyz"])
        for table in (seen(swung), turned)
    )
    assert np.abs(a - b).max() > 0.5
    # scales of axes differ by 0.3 % and biases by half the noise: lengths agree as well as that
    np.testing.assert_allclose(np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1), rtol=0.01)


@pytest.mark.parametrize("kind", [k for k in RIDE_OUTSIDE if k != "side_wind"])
def test_what_no_catalogue_names_shows_in_the_record(swung, kind):
    recipe = draw_outside(kind, np.random.default_rng(3))
    assert recipe.is_outside
    odd = Outside(kind, "bicycle", recipe.parameters(recipe.guess))
    plain, strange = seen(swung), seen(swung, outside=[odd])
    changed = {
        c
        for c in plain.columns
        if c != "t" and not np.array_equal(of(plain, c)[1], of(strange, c)[1])
    }
    assert changed, kind
    if kind == "loose_headset":
        play = odd.parameters["play"]
        assert np.abs(of(plain, "steer")[1] - of(strange, "steer")[1]).max() <= 0.51 * play
    if kind == "missed_counts":
        assert of(strange, "rear_wheel")[1][-1] < of(plain, "rear_wheel")[1][-1]


# --- the menu -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", RIDE_EFFECTS)
def test_every_effect_of_the_menu_is_the_catalogues(name):
    rng = np.random.default_rng(7)
    for _ in range(6):
        recipe = draw_effect(name, rng)
        for size in (recipe.guess, recipe.largest):
            (line,), _ = effect_of(recipe, size)
            tables = {**NOMINAL.model_dump(), "effects": [line.model_dump()]}
            rig = BicycleFile.model_validate(tables)
            table = ParameterTable(rig)
            moved = table.from_effects(rig.effects) != table.neutral
            assert {table.entries[k].effect for k in np.flatnonzero(moved)} == {name}


def test_equal_bicycles_ride_once_for_all_effects_of_their_sensors():
    bias = Effect(effect="sensor_bias", location="lean", parameters={"offset": 0.1})
    fork = Effect(effect="front_suspension", location="bicycle", parameters={"stiffness": 9e3})
    b = Bicycle(
        NOMINAL,
        Scatter(1),
        (bias, fork),
        (Outside("hills", "road", {"slope": 0.1, "length": 9.0}),),
    )
    assert b.moving.effects == (fork,)
    assert b.moving.outside == ()
    assert {"sensor_bias", "clock_drift"}.isdisjoint(MOVES)


def test_a_bicycle_is_off_its_file_by_as_much_as_is_asked_for():
    nominal = pack(NOMINAL)

    def off(size):
        b = _scattered(NOMINAL, np.random.default_rng(7), size)
        return np.concatenate([b.p[:2] - nominal.p[:2], (b.body - nominal.body).ravel()])

    assert not np.any(off(0.0))
    assert off(2.0) == pytest.approx(2.0 * off(1.0))
    zeros = [Off.of(Bicycle(NOMINAL, Scatter(7, size))).zero for size in (0.0, 1.0, 2.0)]
    assert not np.any(zeros[0])
    assert zeros[2] == pytest.approx(2.0 * zeros[1])


# --- whole cases --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def bench():
    return RideBench.of(NOMINAL, Scatter(11), SHORT, 5)


def test_a_healthy_ride_is_off_the_twin_by_little_and_never_by_nothing(bench):
    for s, (_, residual) in bench.healthy.items():
        ratio = float(np.sqrt(np.mean((residual - residual.mean()) ** 2))) / bench.floor[s]
        assert 0.02 < ratio < 1.3, s


def test_an_effect_of_a_sensor_shows_in_its_own_signal_in_proportion(bench):
    def trace(offset):
        line = Effect(effect="sensor_bias", location="imu.gyro_y", parameters={"offset": offset})
        return bench.trace((line,))

    small, large = trace(0.01), trace(0.02)
    assert max(small, key=small.get) == "imu.gyro_y"
    assert large["imu.gyro_y"] == pytest.approx(2.0 * small["imu.gyro_y"], rel=1e-3)
    assert max(v for s, v in small.items() if s != "imu.gyro_y") < 0.01


def test_a_case_is_sealed_gives_nothing_away_and_is_the_same_again(tmp_path):
    order = Order(("bicycle",), 6001, kinds=("none",))
    for out in (tmp_path / "a", tmp_path / "b"):
        make_exam(order, 1, out, jobs=1)
    folder = tmp_path / "a/cases/bicycle-6001-0000"
    answer = json.loads((tmp_path / "a/answers/bicycle-6001-0000/answer.json").read_text())
    assert answer["verdict"] == "no_gap"
    assert answer["effects"] == []
    assert seals_of(folder) == {seal(answer)}
    case = load_case(folder)
    again = load_case(tmp_path / "b/cases/bicycle-6001-0000")
    assert isinstance(case.rig, BicycleFile)
    assert case.rig.effects == ()
    assert case.runs[0].meta.mode == "ride"
    for a, b in zip(case.runs, again.runs, strict=True):
        np.testing.assert_array_equal(a.table.to_numpy(), b.table.to_numpy())
    text = "".join(p.read_text() for p in folder.rglob("*.toml"))
    assert not any(word in text for word in ("verdict", "scatter", "severity", "none"))


def test_a_rig_that_no_exam_has_is_named():
    with pytest.raises(ConfigError, match="bicycle"):
        Order(("tricycle",))
