"""Every effect of the catalogue: gone at its neutral values, seen where it should be seen, and as large."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hil.config import RigFile
from hil.configfile import load_rig
from hil.sim import catalogue
from hil.sim.plant import Plant
from hil.sim.twin import Replay, Twin
from tests.sim.rigs import changed, effect, frictionless, with_effects

RIGS = ("axis", "motorcycle", "stewart")
FLOOR = {
    "position": 2e-5,
    "velocity": 2e-3,
    "force": 5.0,
    "gyro": 0.002,
    "accel": 0.03,
    "pose": 2e-5,
}
"""Standard deviation of the rig files' sensor noise: an effect that stays below it cannot be seen."""

ON_ACTUATOR = {
    "coulomb_friction": ({"force": 20.0}, "force"),
    "viscous_friction": ({"coefficient": 300.0}, "force"),
    "stribeck_friction": ({"coulomb": 10.0, "static": 40.0, "velocity": 0.02}, "force"),
    "asymmetric_friction": ({"positive": 30.0, "negative": 5.0}, "force"),
    "asymmetric_viscous_friction": ({"positive": 300.0, "negative": -30.0}, "force"),
    "backlash": ({"gap": 5e-4}, "pose"),
    "hysteresis": ({"force": 40.0, "displacement": 2e-3}, "force"),
    "compliance": ({"stiffness": 4e5, "damping": 200.0}, "force"),
    "actuator_inertia": ({"mass": 25.0}, "force"),
    "velocity_saturation": ({"limit": 0.06}, "position"),
    "force_ripple": ({"amplitude": 30.0, "period": 0.01}, "force"),
    "force_constant": ({"scale": 0.8}, "force"),
    "loop_gain": ({"position": 0.8}, "position"),
    "transport_delay": ({"delay": 0.004}, "position"),
    "position_offset": ({"offset": 5e-3}, "pose"),
    "lead_error": ({"scale": 1.02}, "pose"),
}
ON_LOAD = {
    "load_friction": ({"coefficient": 0.1}, "force"),
    "force_saturation": ({"limit": 700.0}, "force"),
}
"""Need a load that is carried: everywhere but on the horizontal axis."""
ON_PLATFORM = {
    "payload_mass": ({"mass": 30.0}, "force"),
    "payload_cog": ({"x": 0.1}, "force"),
    "payload_inertia": ({"xx": 60.0, "yy": 60.0, "zz": 60.0}, "force"),
    "base_tilt": ({"roll": 0.05, "pitch": 0.05}, "accel"),
}
NEUTRAL_ANYWHERE = [
    (e, specs) for group in (catalogue.ACTUATOR, catalogue.PLATFORM) for e, specs in group.items()
]


@functools.cache
def record(name: str) -> Replay:
    """A few seconds of motion of all actuators, every signal sampled as the parameter channel does."""
    return record_of(load_rig(name))


def record_of(rig: RigFile) -> Replay:
    twin = Twin(rig)
    t = np.arange(0.0, 3.0, 0.01)
    ramp = np.minimum(t, 0.5) / 0.5
    setpoints, stamps = {}, {}
    for i, a in enumerate(rig.actuators):
        motion = 0.02 * np.sin(2 * np.pi * 0.6 * t + i) + 0.006 * np.sin(
            2 * np.pi * 2.1 * t + 2 * i
        )
        setpoints[a.name] = (t + 0.0011 * i, a.home + ramp * motion)
    for signal in twin.signals:
        if not signal.endswith(".current"):
            stamps[signal] = np.arange(0.03, 3.0, 0.02)
    return twin.record(setpoints, stamps)


@functools.cache
def healthy(name: str) -> dict[str, np.ndarray]:
    job = record(name)
    return job.by_signal(job.run())


def run(
    name: str, effect_name: str, location: str, values: dict[str, float]
) -> dict[str, np.ndarray]:
    job = record(name)
    named = {f"{location}.{effect_name}.{k}": v for k, v in values.items()}
    return job.by_signal(job.run(job.twin.table.vector(named)))


def trace(name: str, seen: dict[str, np.ndarray]) -> dict[str, float]:
    """Root mean square change of each signal against the healthy record, over its noise."""
    out = {}
    for signal, values in seen.items():
        change = float(np.sqrt(np.mean((values - healthy(name)[signal]) ** 2)))
        out[signal] = change / next(f for key, f in FLOOR.items() if key in signal)
    return out


@pytest.mark.parametrize("name", RIGS)
def test_the_twin_moves_and_settles_on_numbers(name: str) -> None:
    values = healthy(name)
    assert all(np.all(np.isfinite(v)) for v in values.values())
    first = load_rig(name).actuator_names[0]
    assert np.ptp(values[f"{first}.position"]) > 0.03


@pytest.mark.parametrize("name", RIGS)
@pytest.mark.parametrize("effect_name", ON_ACTUATOR)
def test_an_effect_of_an_actuator_shows_on_it(name: str, effect_name: str) -> None:
    actuator = load_rig(name).actuator_names[0]
    values, quantity = ON_ACTUATOR[effect_name]
    traces = trace(name, run(name, effect_name, actuator, values))
    signal = f"{actuator}.{quantity}"
    seen = max(v for s, v in traces.items() if s == signal or s.startswith(quantity + "."))
    assert seen > 1.0


@pytest.mark.parametrize("name", ["motorcycle", "stewart"])
@pytest.mark.parametrize("effect_name", ON_LOAD)
def test_an_effect_of_the_load_carried_shows(name: str, effect_name: str) -> None:
    values, quantity = ON_LOAD[effect_name]
    actuator = load_rig(name).actuator_names[1]
    assert trace(name, run(name, effect_name, actuator, values))[f"{actuator}.{quantity}"] > 1.0


@pytest.mark.parametrize("name", ["motorcycle", "stewart"])
@pytest.mark.parametrize("effect_name", ON_PLATFORM)
def test_an_effect_of_the_platform_shows(name: str, effect_name: str) -> None:
    values, quantity = ON_PLATFORM[effect_name]
    traces = trace(name, run(name, effect_name, "platform", values))
    assert max(v for s, v in traces.items() if quantity in s) > 1.0


@pytest.mark.parametrize("joint", ["leg1.platform", "leg2.base", "slide.base"])
def test_a_joint_out_of_place_shifts_the_pose_under_the_same_leg_lengths(joint: str) -> None:
    traces = trace(
        "motorcycle", run("motorcycle", "geometry_error", joint, {"x": 0.005, "z": 0.005})
    )
    assert max(v for s, v in traces.items() if s.startswith("pose.")) > 10.0
    assert traces["leg1.position"] < 2.0  # the drives see nothing of it


def test_static_force_feedback_shows_where_the_drive_law_has_one() -> None:
    job = record_of(load_rig("stewart_pd"))
    vector = job.twin.table.vector({"platform.static_force_feedback.scale": 0.8})
    change = job.by_signal(job.run(vector) - job.run())
    sag = np.mean(change["pose.heave"])
    share = 0.997 * 0.2 * 450.0 * 9.81 / (6 * 250e3)
    upright = 0.953 / 1.05  # of the legs: once for the force along them, once for the way
    assert sag == pytest.approx(-share / upright**2, rel=0.1)
    hidden = trace("stewart", run("stewart", "static_force_feedback", "platform", {"scale": 0.8}))
    assert max(hidden.values()) == 0.0


@pytest.mark.parametrize("name", RIGS)
def test_at_neutral_values_every_effect_is_gone_to_the_bit(name: str) -> None:
    job = record(name)
    table = job.twin.table
    every = table.vector({p.name: p.neutral for p in table.entries})
    assert np.array_equal(job.run(every), job.run())


@pytest.mark.parametrize("effect_name", [e for e in ON_ACTUATOR if e != "velocity_saturation"])
def test_an_effect_fades_smoothly_towards_its_neutral_values(effect_name: str) -> None:
    job = record("motorcycle")
    table, values = job.twin.table, ON_ACTUATOR[effect_name][0]
    changes = []
    for share in (1.0, 0.1, 0.01):
        vector = {}
        for parameter, value in values.items():
            entry = table[f"leg1.{effect_name}.{parameter}"]
            if entry.parameter in ("period", "displacement") or entry.name.endswith("n.velocity"):
                vector[entry.name] = value
                continue
            z0, z1 = entry.to_search(entry.neutral), entry.to_search(value)
            vector[entry.name] = entry.from_search(z0 + share * (z1 - z0))
        force = job.by_signal(job.run(table.vector(vector)) - job.run())["leg1.force"]
        changes.append(np.sqrt(np.mean(force**2)))
    # Some effects do not touch the force at all while the drive keeps the position.
    assert changes[1] < 0.45 * changes[0] + 1e-3
    assert changes[2] < 0.45 * changes[1] + 1e-3


SENSORS = [
    ("leg1.position", "sensor_bias", {"offset": 1e-3}),
    ("leg1.position", "sensor_scale", {"scale": 1.05}),
    ("leg1.force", "sensor_scale", {"scale": 1.05}),
    ("leg1.force", "sensor_latency", {"delay": 0.01}),
    ("leg1.velocity", "sensor_quantisation", {"step": 0.02}),
    ("imu.gyro_x", "sensor_bias", {"offset": 0.02}),
    ("imu.accel_z", "sensor_scale", {"scale": 1.03}),
    ("imu.accel_x", "sensor_latency", {"delay": 0.02}),
]


@pytest.mark.parametrize(("signal", "effect_name", "values"), SENSORS)
def test_an_effect_of_a_sensor_shows_on_its_signal_alone(
    signal: str, effect_name: str, values: dict[str, float]
) -> None:
    traces = trace("motorcycle", run("motorcycle", effect_name, signal, values))
    assert traces.pop(signal) > 1.0
    assert max(traces.values()) == 0.0


def test_scale_acts_about_home_and_latency_shows_the_past() -> None:
    seen = run("motorcycle", "sensor_scale", "leg1.position", {"scale": 1.05})["leg1.position"]
    expected = 0.6 + 1.05 * (healthy("motorcycle")["leg1.position"] - 0.6)
    np.testing.assert_allclose(seen, expected, atol=1e-12)
    late = run("motorcycle", "sensor_latency", "leg1.position", {"delay": 0.02})["leg1.position"]
    np.testing.assert_allclose(late[1:], healthy("motorcycle")["leg1.position"][:-1], atol=1e-9)


def test_effects_of_the_whole_imu_show_on_its_channels() -> None:
    turned = run("motorcycle", "sensor_misalignment", "imu", {"x": 0.0, "y": 0.05, "z": 0.0})
    before = healthy("motorcycle")
    c, s = np.cos(0.05), np.sin(0.05)
    expected = c * before["imu.accel_x"] - s * before["imu.accel_z"]
    np.testing.assert_allclose(turned["imu.accel_x"], expected, atol=1e-9)
    np.testing.assert_allclose(turned["imu.accel_y"], before["imu.accel_y"], atol=1e-9)


def test_a_clock_that_runs_fast_stamps_later_and_later() -> None:
    drift = 2e-3
    seen = run("motorcycle", "clock_drift", "drives", {"rate": drift})
    rig = load_rig("motorcycle")
    t = np.arange(0.03, 3.0, 0.02) - rig.bus.answer_delay
    now = healthy("motorcycle")["leg1.velocity"]
    expected = healthy("motorcycle")["leg1.position"] - now * t * drift
    np.testing.assert_allclose(seen["leg1.position"], expected, atol=2e-5)
    assert np.array_equal(seen["imu.gyro_x"], healthy("motorcycle")["imu.gyro_x"])


def test_lost_setpoints_roughen_the_motion_by_their_share() -> None:
    few = trace("motorcycle", run("motorcycle", "lost_frames", "bus", {"setpoints": 0.03}))
    many = trace("motorcycle", run("motorcycle", "lost_frames", "bus", {"setpoints": 0.2}))
    assert 1.0 < few["leg1.position"] < many["leg1.position"]


def test_the_plant_loses_its_share_of_setpoints_and_answers() -> None:
    line = effect("lost_frames", "bus", setpoints=0.5, answers=0.1)
    plant = Plant(with_effects(load_rig("axis"), line), seed=3)
    plant.reset(mode="position")
    answers = [plant.answer(0, "position", 0.0) for _ in range(4000)]
    assert answers.count(None) == pytest.approx(400, abs=60)
    assert plant.answer(0, "force", 0.0) in (None, 0.0)


def test_backlash_lets_the_load_lag_by_the_gap_and_no_more() -> None:
    gap = 8e-4
    rig = with_effects(load_rig("axis"), effect("backlash", "axis", gap=gap))
    plant = Plant(rig)
    plant.reset(mode="position")
    motor, load = [], []
    for k in range(600):
        t = 0.01 * k
        plant.set_setpoint(0, 0.01 * float(np.sin(2 * np.pi * 0.25 * t)), t)
        plant.advance(t + 0.01)
        motor.append(plant.position(0))
        load.append(plant.pose()[0])
    play = np.array(motor[200:]) - np.array(load[200:])
    # A horizontal load without friction of its own drifts across the gap as the motor brakes.
    assert np.ptp(play) == pytest.approx(gap, rel=1e-3)
    loaded = changed(rig, geometry={"load": "vertical"})
    plant = Plant(loaded)
    plant.reset(mode="position")
    plant.advance(1.0)
    # Gravity keeps the load on one flank: the motor stands half a gap above it.
    assert plant.position(0) - plant.pose()[0] == pytest.approx(gap / 2, rel=1e-6)


@pytest.mark.parametrize("stiffness", [2e5, 2e6])
def test_motor_and_load_swing_against_each_other_at_the_resonance(stiffness: float) -> None:
    line = effect("compliance", "axis", stiffness=stiffness, damping=0.0)
    plant = Plant(with_effects(frictionless("axis"), line))
    plant.reset(mode="force")
    plant.set_setpoint(0, 100.0, 0.0)
    t = np.arange(0.01, 0.61, 0.00025)
    windup = []
    for now in t:
        plant.advance(now)
        windup.append(plant.position(0) - plant.pose()[0])
    swing = np.array(windup) - np.mean(windup)
    crossings = t[1:][(swing[1:] > 0) & (swing[:-1] <= 0)]
    seen = (len(crossings) - 1) / (crossings[-1] - crossings[0])
    exact = np.sqrt(stiffness * (1 / 40.0 + 1 / 95.0)) / (2 * np.pi)
    assert seen == pytest.approx(exact, rel=5e-3)
    static = 100.0 * 95.0 / 135.0 / stiffness
    assert np.mean(windup) == pytest.approx(static, rel=0.02)
    fade = np.max(np.abs(swing[-200:])) / np.max(np.abs(swing[:200]))
    assert fade > 0.97  # no damping but the one asked for


def test_a_transmission_that_stiffens_swings_as_an_integration_of_its_law_says() -> None:
    k, hardening, push = 2e5, 0.5, 800.0
    line = effect("compliance", "axis", stiffness=k, damping=0.0, hardening=hardening)
    rig = frictionless("axis")
    plant = Plant(with_effects(rig, line))
    plant.reset(mode="force")
    plant.set_setpoint(0, push, 0.0)
    t = np.arange(0.001, 0.151, 0.00025)
    windup, force = [], []
    for now in t:
        plant.advance(now)
        windup.append(plant.position(0) - plant.pose()[0])
        force.append(plant.force(0))
    width = 0.1 * rig.actuators[0].force_max / k

    def law(now: float, s: np.ndarray) -> list[float]:
        spring = k * s[0] * (1.0 + hardening * (s[0] / width) ** 2)
        motor = np.interp(now, t, force)
        return [s[1], (motor - spring) / 40.0 - spring / 95.0]

    start = [windup[0], (windup[1] - windup[0]) / 0.00025]
    exact = solve_ivp(law, (t[0], t[-1]), start, t_eval=t, rtol=1e-8, max_step=2e-4).y[0]
    assert np.max(exact) > 1.5 * width  # far into the stiff part
    assert np.max(np.abs(np.array(windup) - exact)) < 0.02 * np.max(exact)


@pytest.mark.parametrize("hardening", [0.0, 0.3, 5.0])
def test_a_transmission_at_rest_is_wound_up_as_far_as_its_law_says(hardening: float) -> None:
    plain = load_rig("motorcycle")
    line = effect("compliance", "leg1", stiffness=1e5, damping=100.0, hardening=hardening)
    plant = Plant(with_effects(plain, line))
    plant.reset(mode="position")
    load = plant.force(0)
    rigid = Plant(plain)
    rigid.reset(plant.pose(), mode="position")
    e = plant.position(0) - rigid.position(0)
    width = 0.1 * plain.actuators[0].force_max / 1e5
    assert 1e5 * e * (1.0 + hardening * (e / width) ** 2) == pytest.approx(load, rel=1e-6)


def test_a_very_stiff_transmission_behaves_as_a_rigid_one() -> None:
    stiff = run("motorcycle", "compliance", "leg1", {"stiffness": 1e11})
    change = stiff["leg1.force"] - healthy("motorcycle")["leg1.force"]
    assert np.max(np.abs(change)) < 0.05


def test_a_ripple_stands_still_in_space() -> None:
    line = effect("force_ripple", "axis", amplitude=40.0, period=0.01)
    plant = Plant(with_effects(load_rig("axis"), line))
    plant.reset((-0.1,), mode="position")
    x, f = [], []
    for k in range(1000):
        t = 0.01 * k
        plant.set_setpoint(0, -0.1 + 0.01 * t, t)
        plant.advance(t + 0.01)
        x.append(plant.position(0))
        f.append(plant.force(0))
    x, f = np.array(x[300:]), np.array(f[300:])
    wave = np.exp(-2j * np.pi * x / 0.01)
    amplitude = 2 * np.mean((f - f.mean()) * wave)
    # The drive pushes against the ripple, which is sin(2 pi x / period).
    assert abs(amplitude) == pytest.approx(40.0, rel=0.05)
    assert np.imag(amplitude) > 0.95 * abs(amplitude)


def test_a_wrong_force_constant_scales_what_the_drive_must_command() -> None:
    line = effect("force_constant", "leg1", scale=0.8)
    plant = Plant(with_effects(load_rig("motorcycle"), line))
    plant.reset(mode="position")
    plant.advance(0.5)
    assert plant.force(0) == pytest.approx(588.6 / 0.8, abs=1e-6)
    assert plant.force(1) == pytest.approx(588.6, abs=1e-6)


def test_a_homing_error_and_a_wrong_lead_put_the_load_elsewhere_under_the_same_reading() -> None:
    lines = (
        effect("position_offset", "axis", offset=2e-3),
        effect("lead_error", "axis", scale=1.01, amplitude=1e-4, period=0.02),
    )
    plant = Plant(with_effects(load_rig("axis"), *lines))
    plant.reset((0.1,), mode="position")
    assert plant.position(0) == pytest.approx(0.1, abs=1e-12)
    x = plant.pose()[0]
    reading = 2e-3 + x / 1.01 - 1e-4 * np.sin(2 * np.pi * x / 0.02)
    assert reading == pytest.approx(0.1, abs=1e-9)


@pytest.mark.parametrize("name", ["motorcycle", "stewart", "stewart_pd"])
def test_a_rig_with_any_effect_starts_at_rest(name: str) -> None:
    rig = load_rig(name)
    for effect_name, (values, _) in {**ON_ACTUATOR, **ON_LOAD}.items():
        if effect_name == "force_saturation":
            continue
        plant = Plant(with_effects(rig, effect(effect_name, "leg2", **values)))
        plant.reset(mode="position")
        start = plant.pose()
        plant.advance(0.3)
        assert np.max(np.abs(plant.pose() - start)) < 1e-7, effect_name


@pytest.mark.parametrize("name", RIGS)
def test_any_mixture_of_effects_moves_on_finite_numbers(name: str) -> None:
    job, rng = record(name), np.random.default_rng(11)
    entries = job.twin.table.entries
    rows = []
    for _ in range(12):
        row = job.twin.table.neutral.copy()
        for i in rng.choice(len(entries), len(entries) // 3, replace=False):
            p = entries[i]
            z = p.to_search(p.neutral) + abs(p.to_search(p.scale)) * rng.normal()
            row[i] = np.clip(p.from_search(z), p.lower, p.upper)
        for a in job.twin.rig.actuators:  # a screw never goes back while its motor goes on
            lead = f"{a.name}.lead_error"
            turn, wave = (job.twin.table.index(f"{lead}.{x}") for x in ("period", "amplitude"))
            row[turn] = max(row[turn], 4.0 * np.pi * row[wave])
        rows.append(row)
    values = job.run_many(np.array(rows))
    assert np.all(np.isfinite(values))
    assert np.max(np.abs(values)) < 2.0 * max(a.force_max for a in job.twin.rig.actuators)


def pushed(seconds: float, amplitude_m: float, **friction: float) -> tuple[np.ndarray, np.ndarray]:
    """Position and force of the axis with 100 N of friction, moved to and fro in `seconds`."""
    rig = frictionless("axis", effective_mass=135.0)
    plant = Plant(with_effects(rig, effect("coulomb_friction", "axis", force=100.0, **friction)))
    plant.reset(mode="position")
    rows = []
    for k in range(round(seconds / 0.002)):
        t = 0.002 * k
        plant.set_setpoint(0, amplitude_m * float(np.sin(2 * np.pi * t / seconds)), t)
        plant.advance(t + 0.002)
        rows.append((plant.position(0), plant.force(0)))
    return np.array(rows).T


def test_friction_builds_up_within_its_presliding() -> None:
    """From rest as 1 - exp(-way / presliding), from full slip backwards as 1 - 2 exp(-way / presliding)."""
    way = 3e-4
    x, force = pushed(20.0, 0.004, presliding=way)
    out = x > 2e-5
    first, turn = int(np.argmax(out)), int(np.argmax(x))
    there = slice(first, turn - 100)
    np.testing.assert_allclose(force[there], 100.0 * -np.expm1(-x[there] / way), atol=1.5)
    back = slice(turn + 100, len(x) // 2)
    gone = x.max() - x[back]
    np.testing.assert_allclose(force[back], 100.0 * (2.0 * np.exp(-gone / way) - 1.0), atol=2.0)


def test_friction_of_stiff_bristles_is_that_without() -> None:
    still, bent = (pushed(2.0, 0.01, **p)[1] for p in ({}, {"presliding": 1e-6}))
    assert np.sqrt(np.mean((still - bent) ** 2)) < 0.03 * np.sqrt(np.mean(still**2))


def test_a_load_that_rubs_in_its_guides_swings_less_by_four_f_over_k_a_cycle() -> None:
    """A textbook's decay by Coulomb friction, linear in time, of a load on a soft transmission."""
    friction, stiffness = 60.0, 1.5e5
    rig = frictionless("axis", effective_mass=135.0)
    rubbing = [
        a.model_copy(update={"coulomb": friction, "guide_share": 1.0}) for a in rig.actuators
    ]
    rig = rig.model_copy(update={"actuators": tuple(rubbing)})
    plant = Plant(with_effects(rig, effect("compliance", "axis", stiffness=stiffness, damping=0.0)))
    plant.reset(mode="position")
    plant.set_setpoint(0, 0.01, 0.0)
    plant.advance(0.06)
    plant.set_mode(0, "off")  # the brake holds the motor
    swing = []
    for k in range(2000):
        plant.advance(0.06 + 0.001 * (k + 1))
        swing.append(plant.pose()[0] - plant.position(0))
    late = np.array(swing[50:])
    peaks = [late[k] for k in range(1, len(late) - 1) if late[k - 1] < late[k] >= late[k + 1]]
    assert len(peaks) > 3
    np.testing.assert_allclose(-np.diff(peaks[:4]), 4.0 * friction / stiffness, rtol=0.03)


def test_where_a_load_rubs_does_not_tell_behind_a_stiff_transmission() -> None:
    def played(share: float) -> np.ndarray:
        rig = load_rig("axis")
        some = [a.model_copy(update={"guide_share": share}) for a in rig.actuators]
        plant = Plant(rig.model_copy(update={"actuators": tuple(some)}))
        plant.reset(mode="position")
        out = []
        for k in range(50):
            plant.set_setpoint(0, 0.01 * float(np.sin(0.2 * k)), 0.01 * k)
            plant.advance(0.01 * (k + 1))
            out.append(plant.force(0))
        return np.array(out)

    np.testing.assert_array_equal(played(0.0), played(0.7))


def test_dahl_hysteresis_does_not_ask_how_fast() -> None:
    def loop(seconds: float) -> np.ndarray:
        rig = frictionless("axis", effective_mass=135.0)
        plant = Plant(
            with_effects(rig, effect("hysteresis", "axis", force=50.0, displacement=2e-3))
        )
        plant.reset(mode="position")
        force = []
        for k in range(round(seconds / 0.01)):
            t = 0.01 * k
            plant.set_setpoint(0, 0.01 * float(np.sin(2 * np.pi * t / seconds)), t)
            plant.advance(t + 0.01)
            if k % round(seconds / 0.4) == 0:
                force.append(plant.force(0))
        return np.array(force)

    np.testing.assert_allclose(loop(16.0), loop(64.0), atol=0.5)
    assert np.max(loop(16.0)) == pytest.approx(50.0, rel=0.05)
