"""A struck bicycle's weave: fitted, held against the model, and what makes them differ."""

import gzip
import json

import numpy as np
import pytest

from hil.bicycle.weave import (
    Impulse,
    SteerControl,
    Window,
    fit_impulses,
    fit_weave,
    model_weave,
    read_matching,
    read_windows,
    speed_reading,
)
from hil.bicycle.weave_causes import diagnose_weave
from hil.configfile import load_bicycle
from hil.errors import IdentificationError, RunError
from hil.rigs.bicycle import canonical, pack
from tests.shared_data import shared

DELFT = load_bicycle("bicycle_delft")
STEERED = SteerControl(2.0, 6.5)


def struck(weave, speed, log_speed=0.0):
    return Impulse(Window("x.csv", speed, 0, 100, (), ""), weave, 0.99, log_speed or speed)


def impulses(seed=3, spread=0.05, **changed):
    """Four impulses at each of five speeds, of a bicycle that differs from its file by `changed`."""
    rng = np.random.default_rng(seed)
    linear = canonical(pack(DELFT))
    gain = changed.pop("gain", 1.0)
    out = []
    for v in (2.0, 2.75, 3.5, 4.25, 5.0):
        true = model_weave(linear, v, STEERED, near=-2.3 + 8.5j, read_speed=gain * v, **changed)
        for _ in range(4):
            off = spread * complex(rng.standard_normal(), rng.standard_normal())
            out.append(struck(true + off, v, 1.066 * v - 0.1276))
    return out


def test_a_damped_oscillation_is_fitted_with_its_offset():
    t = 0.01 * np.arange(120)
    rate = 0.02 + np.exp(-2.3 * t) * (0.4 * np.cos(8.4 * t) - 0.3 * np.sin(8.4 * t))
    weave, r2 = fit_weave(rate, 0.01, (-3.0, 7.0, 0.3, 1.0, 1.0))
    assert weave == pytest.approx(-2.3 + 8.4j, abs=1e-6)
    assert r2 == pytest.approx(1.0)


def test_without_control_it_is_the_published_weave():
    """Table 2 of Meijaard, Papadopoulos, Ruina and Schwab 2007, at 5 m/s."""
    linear = canonical(pack(load_bicycle("bicycle_benchmark")))
    found = model_weave(linear, 5.0, SteerControl(), near=-0.7 + 4.4j)
    assert found.real == pytest.approx(-0.775341882195845, abs=1e-12)
    assert found.imag == pytest.approx(4.46486771378823, abs=1e-11)


@pytest.mark.parametrize(
    ("cause", "parameter", "true"),
    [
        ("motor gain", "motor", 0.75),
        ("speed sensor", "gain", 1.15),
        ("steer friction", "steer_friction", 0.3),
    ],
)
def test_the_cause_that_was_put_in_takes_most_off_unseen_impulses(cause, parameter, true):
    found = diagnose_weave(impulses(**{parameter: true}), DELFT, STEERED)
    by_name = {c.name: c for c in found.causes}
    assert by_name[cause].values[parameter] == pytest.approx(true, rel=0.06)
    assert by_name[cause].shrink > 0.85
    assert by_name["steer encoder gain"].shrink is None, "the control uses the lean rate alone"
    others = [c.shrink for c in found.causes if c.shrink is not None and len(c.values) == 1]
    assert by_name[cause].shrink == max(others)


def test_the_speed_sensor_is_read_against_the_treadmill():
    assert speed_reading(impulses()) == pytest.approx((1.066, -0.1276), abs=1e-9)
    with pytest.raises(IdentificationError, match="three speeds"):
        speed_reading(impulses()[:4])


def test_one_impulse_a_speed_is_too_few():
    with pytest.raises(IdentificationError, match="two impulses or more"):
        diagnose_weave(impulses()[::4], DELFT, STEERED)


def test_windows_and_logs_that_cannot_be_read_are_named(tmp_path):
    (tmp_path / "w.json").write_text('[{"file": "a.csv"}]')
    with pytest.raises(RunError, match="is no list of windows"):
        read_windows(tmp_path / "w.json")
    window = {"file": "a.csv.gz", "speed_mps": 3, "start": 0, "stop": 50, "p0": [-2, 8, 0, 1, 1]}
    (tmp_path / "w.json").write_text(json.dumps([window]))
    windows = read_windows(tmp_path / "w.json")
    with pytest.raises(RunError, match="cannot be read"):
        fit_impulses(windows, tmp_path)
    with gzip.open(tmp_path / "a.csv.gz", "wt") as log:
        log.write("lean_rate,speed\n" + "0.1,3.0\n" * 20)
    with pytest.raises(RunError, match="has 20 rows"):
        fit_impulses(windows, tmp_path)
    with gzip.open(tmp_path / "a.csv.gz", "wt") as log:
        log.write("lean_angle\n" + "0.1\n" * 60)
    with pytest.raises(RunError, match="no column lean_rate, speed"):
        fit_impulses(windows, tmp_path)


def test_a_window_that_holds_no_weave_is_refused_whatever_is_in_it(tmp_path):
    t = 0.01 * np.arange(60)
    wave = np.exp(-2.0 * t) * np.cos(8.0 * t)
    rows = [f"{rate:.6f},3.0" for rate in wave]
    (tmp_path / "good.csv").write_text("\n".join(["lean_rate,speed", *rows]))
    (tmp_path / "hole.csv").write_text(
        "\n".join(["lean_rate,speed", *rows[:30], ",3.0", *rows[31:]])
    )
    (tmp_path / "text.csv").write_text(
        "\n".join(["lean_rate,speed", *rows[:30], "x,3.0", *rows[31:]])
    )
    guess = (-2.0, 8.0, 0.0, 1.0, 1.0)

    def fit(file, stop=60, guess=guess):
        return fit_impulses([Window(file, 3.0, 0, stop, guess, "")], tmp_path)

    assert fit("good.csv")[0].weave == pytest.approx(-2.0 + 8.0j, abs=1e-3)
    with pytest.raises(IdentificationError, match=r"good.csv: rows 0 to 5: .* 5 of 5 rows"):
        fit("good.csv", stop=5)
    with pytest.raises(IdentificationError, match=r"hole.csv: rows 0 to 60: .* 59 of 60 rows"):
        fit("hole.csv")
    with pytest.raises(RunError, match=r"text.csv: column lean_rate or speed: could not convert"):
        fit("text.csv")
    with (
        pytest.raises(IdentificationError, match="no damped oscillation"),
        np.errstate(all="ignore"),
    ):
        fit("good.csv", guess=(500.0, 8.0, 0.0, 1.0, 1.0))


def test_a_guess_has_five_numbers(tmp_path):
    window = {"file": "a.csv", "speed_mps": 3, "start": 0, "stop": 50, "p0": [-2, 8]}
    (tmp_path / "w.json").write_text(json.dumps([window]))
    with pytest.raises(RunError, match="p0 must be 5 numbers"):
        read_windows(tmp_path / "w.json")


def test_gains_of_a_second_law_that_are_none_are_named(tmp_path):
    path = tmp_path / "law.npz"
    path.write_bytes(b"")
    with pytest.raises(RunError, match="holds no gains over speed"):
        read_matching(path)
    law = {"speeds_mps": np.arange(3.0), "mm_gains/F": np.zeros((4, 2, 4))}
    np.savez(path, **law, **{"mm_gains/G": np.zeros((3, 2, 2))})
    with pytest.raises(RunError, match=r"mm_gains/F is \(4, 2, 4\), not \(3, 2, 4\)"):
        read_matching(path)


@pytest.mark.shared
def test_the_measured_bicycle_against_its_authors_table():
    """107 impulses. Their own mean distance is 0.718 (OFF) and 0.963 (ON); friction, parameters, speed, motor
    leave 0.634, 0.423, 0.641, 0.648 and 0.771, 0.669, 0.895, 0.933. They take a log decrement at 1.5 m/s."""
    folder = shared("data/sbw_bicycle")
    windows = read_windows(folder / "impulse_windows.json")
    off = fit_impulses([w for w in windows if w.group.endswith("OFF")], folder / "logs")
    found = diagnose_weave(off, DELFT, STEERED)
    by_name = {c.name: c for c in found.causes}
    assert len(off) == 59
    assert found.whole == pytest.approx(0.718, abs=0.01)
    assert found.causes[0].name == "parameters"
    assert by_name["parameters"].after == pytest.approx(0.423, abs=0.03)
    assert by_name["steer friction"].values["steer_friction"] == pytest.approx(0.2, abs=0.03)
    assert by_name["speed sensor"].shrink > by_name["motor gain"].shrink
    assert by_name["steer encoder gain"].shrink is None
    assert found.speed_gain == pytest.approx((1.0662, -0.1276), abs=0.015)
    slow = [r for r in found.rows if r["speed"] >= 2.0]
    assert all(abs(r["decay"] - r["model_decay"]) < 0.25 for r in slow), "decay is met"
    assert all(r["frequency"] < r["model_frequency"] for r in slow), "frequency is not"

    matching = read_matching(folder / "whipple_state_space_on_speed_grid.npz")
    on = fit_impulses([w for w in windows if w.group.endswith("ON")], folder / "logs")
    matched = diagnose_weave(on, DELFT, SteerControl(2.0, 6.5, matching))
    assert len(on) == 48
    assert [c.name for c in matched.causes[:2]] == ["parameters", "steer friction"]
    assert matched.speed_gain == pytest.approx((1.0662, -0.1276), abs=0.005)
    by_name = {c.name: c for c in matched.causes}
    assert by_name["steer encoder gain"].shrink is not None, "matching feeds the steer angle back"
