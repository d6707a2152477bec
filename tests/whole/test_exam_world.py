"""The exam's world is a rig: mechanics against independent solutions, near the twin where all is well."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hil.config import Effect, RigFile
from hil.configfile import load_rig
from hil.control.trajectory import CueTrajectory
from hil.exam.world import OUTSIDE, Outside, Scatter, build_world, play
from hil.exam.world import layout as lay
from hil.gap.record.led import replay_led
from hil.identify.replay import Stretch
from hil.sim import Twin
from tests.exam.worlds import smooth_axis, sway

NONE = Scatter(0, 0.0)
Bench = tuple[RigFile, CueTrajectory, dict[str, np.ndarray]]


def _pendulum() -> RigFile:
    rig = smooth_axis(reflected_mass=1.5, effective_mass=6.5, stroke=(-1.2, 1.2), force_max=400.0)
    body = rig.mass.model_copy(update={"m": 20.0, "cog": (0.0, 0.0, -0.4)})
    load = rig.geometry.model_copy(update={"load": "pendulum"})
    return rig.model_copy(update={"mass": body, "geometry": load, "limits": (1.0,)})


def test_a_pendulum_that_is_let_go_swings_as_its_equation_says() -> None:
    rig = _pendulum()
    world = build_world(rig, NONE)
    world.act[lay.A_FORCE_SCALE] = 1e-12  # currents move nothing
    world.head[lay.H_SETTLE] = 0.0
    world.act[lay.A_DAMPING] *= 0.01
    t = np.arange(0.0, 6.0, 0.005)
    held = play(
        world,
        CueTrajectory(rig.coordinates, t, np.full((len(t), 1), 0.6)),
        seen=0,
        hidden=0,
        with_imu=False,
    )
    inertia = 1.5 + 20.0 * 0.4**2 + rig.mass.inertia[1][1]
    weight = 20.0 * 9.81 * 0.4
    exact = solve_ivp(
        lambda _, y: [y[1], -weight * np.sin(y[0]) / inertia], (0.0, 6.0), [0.6, 0.0],
        dense_output=True, rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    taken = held.stamps["axis.position"] - rig.bus.answer_delay
    assert np.max(np.abs(held.clean["axis.position"] - exact.sol(taken)[0])) < 2e-3


def test_steady_motion_takes_coulomb_and_viscous_friction() -> None:
    rig = load_rig("axis")
    punctual = rig.bus.model_copy(
        update={"jitter": 0.0}
    )  # late frames kick, always at the same phase
    rig = rig.model_copy(update={"bus": punctual})
    t = np.arange(0.0, 6.0, 0.005)
    ramp = np.clip(0.04 * (t - 1.0), 0.0, 0.18)[:, None] - 0.1
    played = play(
        build_world(rig, NONE),
        CueTrajectory(rig.coordinates, t, ramp),
        seen=1,
        hidden=2,
        with_imu=False,
    )
    stamps, force = played.stamps["axis.force"], played.clean["axis.force"]
    steady = force[(stamps > 2.5) & (stamps < 5.0)].mean()
    a = rig.actuators[0]
    assert steady == pytest.approx(a.coulomb + a.viscous * 0.04, rel=0.03)


def test_a_vertical_axis_at_rest_carries_its_load() -> None:
    rig = load_rig("axis")
    load = rig.geometry.model_copy(update={"load": "vertical"})
    rig = rig.model_copy(update={"geometry": load})
    t = np.arange(0.0, 2.0, 0.005)
    still = CueTrajectory(rig.coordinates, t, np.zeros((len(t), 1)))
    played = play(build_world(rig, NONE), still, seen=1, hidden=2, with_imu=True)
    weight = rig.mass.m * rig.mass.gravity
    assert played.clean["axis.force"].mean() == pytest.approx(weight, abs=rig.actuators[0].coulomb)
    assert played.clean["imu.accel_z"].mean() == pytest.approx(9.81, abs=1e-3)


@pytest.mark.parametrize("name", ["axis", "motorcycle", "stewart"])
def test_a_healthy_rig_is_near_its_twin_yet_not_it(name: str) -> None:
    rig = load_rig(name)
    played = play(build_world(rig, NONE), sway(rig), seen=1, hidden=2, with_imu=False)
    twin = Twin(rig, smooth=True)
    told = {a: played.setpoints[f"{a}.setpoint"] for a in rig.actuator_names}
    said = twin.replay(told, played.stamps)
    for a in rig.actuators:
        late = played.stamps[f"{a.name}.position"] > 2.0
        away = (played.clean[f"{a.name}.position"] - said[f"{a.name}.position"])[late]
        assert np.sqrt(np.mean(away**2)) < 1e-4  # half a millisecond at most, at 0.2 m/s
        stamps = played.stamps[f"{a.name}.force"]
        off = (played.clean[f"{a.name}.force"] - said[f"{a.name}.force"])[stamps > 2.0]
        slow = np.convolve(
            off, np.ones(25) / 25.0, "valid"
        )  # kicks of timing average out over half a second
        assert 1e-3 < np.sqrt(np.mean(slow**2)) < 4.0 * rig.noise.force


def test_a_record_tells_send_times_and_repeats_with_its_seeds() -> None:
    rig = load_rig("axis")
    world = build_world(rig, Scatter(3))
    first = play(world, sway(rig, 3.0), seen=1, hidden=2, with_imu=True)
    again = play(world, sway(rig, 3.0), seen=1, hidden=2, with_imu=True)
    other = play(world, sway(rig, 3.0), seen=1, hidden=3, with_imu=True)
    assert all(np.array_equal(first.values[s], again.values[s]) for s in first.values)
    assert np.array_equal(first.setpoints["axis.setpoint"][0], other.setpoints["axis.setpoint"][0])
    assert not np.array_equal(first.values["axis.force"], other.values["axis.force"])
    table = first.table(world)
    assert {
        "t",
        "cue.position",
        "axis.setpoint",
        "axis.position",
        "axis.force",
        "imu.accel_x",
    } <= set(table)
    assert np.all(np.diff(table["t"]) > 0.0)


EFFECTS = {
    "coulomb_friction": {"force": 40.0},
    "viscous_friction": {"coefficient": 400.0},
    "stribeck_friction": {"coulomb": 20.0, "static": 60.0, "velocity": 0.02},
    "asymmetric_friction": {"positive": 60.0, "negative": 10.0},
    "load_friction": {"coefficient": 0.2},
    "backlash": {"gap": 5e-4},
    "hysteresis": {"force": 60.0, "displacement": 2e-3},
    "compliance": {"stiffness": 5e4, "damping": 100.0},
    "actuator_inertia": {"mass": 60.0},
    "force_saturation": {"limit": 90.0},
    "velocity_saturation": {"limit": 0.1},
    "force_ripple": {"amplitude": 40.0, "period": 0.005, "phase": 1.0},
    "force_constant": {"scale": 0.8},
    "loop_gain": {"position": 0.7},
    "transport_delay": {"delay": 0.005},
    "lead_error": {"scale": 1.06},
}


@pytest.fixture(scope="module")
def bench() -> Bench:
    return _bench(load_rig("axis"))


@pytest.fixture(scope="module")
def upright() -> Bench:
    rig = load_rig("axis")
    load = rig.geometry.model_copy(update={"load": "vertical"})
    return _bench(rig.model_copy(update={"geometry": load}))


def _bench(rig: RigFile) -> Bench:
    motion = sway(rig, 5.0, share=0.6, hz=0.45)
    healthy = play(build_world(rig, Scatter(5)), motion, seen=1, hidden=2, with_imu=False)
    return rig, motion, healthy.clean


@pytest.mark.parametrize("effect", EFFECTS)
def test_every_effect_shows_in_what_the_drive_answers(effect: str, bench: Bench) -> None:
    rig, motion, healthy = bench
    line = Effect(effect=effect, location="axis", parameters=EFFECTS[effect])
    played = play(build_world(rig, Scatter(5), (line,)), motion, seen=1, hidden=2, with_imu=False)
    traces = [
        np.sqrt(np.mean((played.clean[s] - healthy[s]) ** 2)) / noise
        for s, noise in (("axis.position", rig.noise.position), ("axis.force", rig.noise.force))
    ]
    assert max(traces) > 2.0
    assert np.max(np.abs(played.clean["axis.position"])) < 0.25


@pytest.mark.parametrize(
    ("effect", "location", "signal", "parameters"),
    [
        ("sensor_bias", "axis.force", "axis.force", {"offset": 30.0}),
        ("sensor_scale", "axis.position", "axis.position", {"scale": 1.02}),
        ("sensor_latency", "axis.position", "axis.position", {"delay": 0.005}),
        ("sensor_quantisation", "axis.force", "axis.force", {"step": 50.0}),
        ("payload_mass", "platform", "axis.force", {"mass": 20.0}),
        ("lost_frames", "bus", "axis.force", {"setpoints": 0.2}),
    ],
)
def test_sensors_platform_and_bus_show_where_they_are(
    effect: str, location: str, signal: str, parameters: dict[str, float], bench: Bench
) -> None:
    rig, motion, healthy = bench
    line = Effect(effect=effect, location=location, parameters=parameters)
    played = play(build_world(rig, Scatter(5), (line,)), motion, seen=1, hidden=2, with_imu=False)
    noise = rig.noise.position if signal == "axis.position" else rig.noise.force
    assert np.sqrt(np.mean((played.clean[signal] - healthy[signal]) ** 2)) > 2.0 * noise


def test_a_fast_clock_stamps_late() -> None:
    rig = load_rig("axis")
    line = Effect(effect="clock_drift", location="drives", parameters={"rate": 1e-3})
    plain = play(build_world(rig, NONE), sway(rig, 4.0), seen=1, hidden=2, with_imu=False)
    fast = play(build_world(rig, NONE, (line,)), sway(rig, 4.0), seen=1, hidden=2, with_imu=False)
    late = fast.stamps["axis.force"] - plain.stamps["axis.force"]
    assert late[-1] == pytest.approx(1e-3 * plain.stamps["axis.force"][-1], rel=1e-6)


def test_effects_of_platforms_show_on_platforms() -> None:
    rig = load_rig("motorcycle")
    motion = sway(rig, 3.0, share=0.5)
    healthy = play(build_world(rig, Scatter(5)), motion, seen=1, hidden=2, with_imu=True)
    for effect, location, signal, parameters in (
        ("geometry_error", "leg1.platform", "leg1.force", {"x": 0.04}),
        ("base_tilt", "platform", "imu.accel_x", {"pitch": 0.05}),
        ("payload_cog", "platform", "leg1.force", {"y": 0.05}),
        ("payload_inertia", "platform", "leg1.force", {"xx": 60.0}),
        ("position_offset", "leg2", "leg1.force", {"offset": 0.02}),
        ("sensor_misalignment", "imu", "imu.accel_x", {"y": 0.05}),
    ):
        line = Effect(effect=effect, location=location, parameters=parameters)
        played = play(
            build_world(rig, Scatter(5), (line,)), motion, seen=1, hidden=2, with_imu=True
        )
        noise = rig.noise.accel if signal.startswith("imu") else rig.noise.force
        away = np.sqrt(np.mean((played.clean[signal] - healthy.clean[signal]) ** 2))
        assert away > 1.0 * noise, effect


ODD = {
    "cable_drag": {"stiffness": 2000.0, "from": -0.05},
    "seal_stiction": {"force": 300.0, "time": 0.3},
    "thermal_drift": {"coefficient": 800.0, "time": 2.0},
    "bump": {"force": 300.0, "at": 0.01, "width": 0.01},
    "quadratic_drag": {"coefficient": 4000.0},
    "limit_cycle": {"force": 60.0, "rate": 80.0},
    "swelling_cogging": {"force": 80.0, "period": 0.02, "zero": 0.0, "length": 0.1},
    "setpoint_rounding": {"step": 1e-3},
    "encoder_slip": {"jump": 2e-3, "time": 2.0},
    "thermal_derating": {"share": 0.3, "time": 2.0},
    "slosh": {"mass": 25.0, "rate": 8.0, "damping": 0.05, "x": 0.0, "y": 0.0, "z": 0.2},
    "failing_counterbalance": {"force": 200.0, "period": 2.0, "second": 1.3, "phase": 0.4},
    "periodic_push": {"force": 60.0, "rate": 6.0, "phase": 0.0, "x": 0.0, "y": 0.0, "z": 1.0},
}


@pytest.mark.parametrize("kind", ODD)
def test_every_outside_effect_shows(kind: str, upright: Bench) -> None:
    rig, motion, healthy = upright
    odd = Outside(kind, "axis", ODD[kind])
    played = play(
        build_world(rig, Scatter(5), (), (odd,)), motion, seen=1, hidden=2, with_imu=False
    )
    away = played.clean["axis.force"] - healthy["axis.force"]
    assert np.sqrt(np.mean(away**2)) > 2.0 * rig.noise.force


def test_a_soft_base_swings_under_a_horizontal_axis() -> None:
    rig = load_rig("axis")
    motion = sway(rig, 5.0, share=0.5, hz=0.8)
    healthy = play(build_world(rig, NONE), motion, seen=1, hidden=2, with_imu=False)
    odd = Outside(
        "soft_base", "platform", {"ratio": 0.4, "rate": 2.0 * np.pi * 5.0, "damping": 0.03}
    )
    played = play(build_world(rig, NONE, (), (odd,)), motion, seen=1, hidden=2, with_imu=False)
    away = played.clean["axis.force"] - healthy.clean["axis.force"]
    assert np.sqrt(np.mean(away**2)) > rig.noise.force
    assert set(ODD) | {"soft_base"} == set(OUTSIDE)


def told_forces(name: str) -> RigFile:
    """A shipped rig whose drives are told forces by a loop outside them."""
    rig = load_rig(name)
    control = rig.control.model_copy(update={"mode": "computed_torque"})
    return rig.model_copy(update={"control": control})


@pytest.mark.parametrize("name", ["axis", "motorcycle", "stewart"])
def test_a_loop_outside_the_drives_keeps_a_rig_on_its_cue(name: str) -> None:
    """Friction that the host does not know is what its integral part is for."""
    rig = told_forces(name)
    a = rig.actuators[0]
    dry = Effect(
        effect="coulomb_friction", location=a.name, parameters={"force": 0.005 * a.force_max}
    )
    played = play(build_world(rig, Scatter(5), (dry,)), sway(rig), seen=1, hidden=2, with_imu=False)
    for x in rig.actuators:
        t, wanted = played.wanted[x.name]
        stamps = played.stamps[f"{x.name}.position"] - rig.bus.answer_delay
        away = played.clean[f"{x.name}.position"] - np.interp(stamps, t, wanted)
        assert np.sqrt(np.mean(away**2)) < 0.004 * (x.stroke[1] - x.stroke[0])


def test_where_forces_are_told_a_led_twin_answers_as_the_rig_does() -> None:
    rig = told_forces("axis")
    played = play(build_world(rig, NONE), sway(rig), seen=1, hidden=2, with_imu=False)
    assert set(played.setpoints) == {"axis.force_setpoint"}
    told = {"axis": played.setpoints["axis.force_setpoint"]}
    samples = {s: (t, played.clean[s]) for s, t in played.stamps.items()}
    led = replay_led(rig, Stretch("told", told, samples, "force"), played.stamps)
    said = led.by_signal(led.run())
    away = played.clean["axis.position"] - said["axis.position"]
    assert np.sqrt(np.mean(away[100:] ** 2)) < 5e-5


def test_a_host_hears_its_sensors_and_answers_noise() -> None:
    rig = told_forces("axis")
    forces = [
        play(build_world(rig, NONE), sway(rig, 3.0), seen=1, hidden=h, with_imu=False).setpoints[
            "axis.force_setpoint"
        ]
        for h in (2, 2, 3)
    ]
    assert np.array_equal(forces[0][1], forces[1][1])
    assert np.array_equal(forces[0][0], forces[2][0])  # sent at the same instants
    assert not np.array_equal(forces[0][1], forces[2][1])
