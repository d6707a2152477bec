"""The drives' loops against a linear model in continuous time, and how setpoints become a reference."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from hil.config import RigFile
from hil.configfile import load_rig
from hil.rigs import build_rig
from hil.sim import Twin
from hil.sim.drive_loops import limited
from hil.sim.plant import Plant
from tests.sim.rigs import changed, effect, frictionless, with_effects

STEWART_STATIC = [630.3532, 912.2546, 860.5036, 864.9142, 940.4133, 654.2859]
"""N, leg forces at neutral of the reference set [V]: closed-chain oracles in the rigs' own tests."""


def quick(rig: RigFile, **bus: object) -> RigFile:
    """Loops so fast that they are nearly continuous, setpoints that jump."""
    table = {
        "speed_loop": 1e-5,
        "position_loop": 1e-5,
        "setpoint_delay": 0.0,
        "interpolation": "hold",
    }
    return changed(rig, bus={**table, **bus})


def test_a_step_of_the_cascade_follows_the_linear_closed_loop() -> None:
    rig = quick(changed(load_rig("axis"), {"coulomb": 0.0}))
    a = rig.actuators[0]
    m = a.reflected_mass + rig.mass.m

    def slope(_: float, y: np.ndarray) -> list[float]:
        x, v, integral, force = y
        error = a.position_gain * (0.0005 - x) - v
        wanted = a.speed_gain * error + integral
        return [
            v,
            (force - a.viscous * v) / m,
            a.integral_gain * error,
            2 * np.pi * 1000 * (wanted - force),
        ]

    t = np.arange(1, 80) * 0.001
    exact = solve_ivp(
        slope, (0.0, 0.08), [0.0] * 4, t_eval=t, rtol=1e-10, atol=1e-14, method="Radau"
    )
    plant = Plant(rig)
    plant.reset(mode="position")
    plant.set_setpoint(0, 0.0005, 0.0)
    x, f = [], []
    for instant in t:
        plant.advance(instant)
        x.append(plant.position(0))
        f.append(plant.force(0))
    np.testing.assert_allclose(x, exact.y[0], atol=1.5e-6)
    np.testing.assert_allclose(f, exact.y[3], atol=0.004 * np.max(np.abs(exact.y[3])))


def test_force_and_displacement_law_follows_its_linear_closed_loop() -> None:
    rig = quick(
        changed(
            load_rig("axis"),
            {
                "coulomb": 0.0,
                "law": "pd",
                "position_gain": 1e5,
                "speed_gain": 4e3,
                "velocity_ff": 1.0,
            },
        )
    )
    m = 135.0
    damping = 4e3 + 120.0
    plant = Plant(rig)
    plant.reset(mode="position")
    plant.set_setpoint(0, 0.001, 0.0)
    w, decay = np.sqrt(1e5 / m - (damping / 2 / m) ** 2), damping / 2 / m
    for t in np.arange(1, 40) * 0.005:
        plant.advance(t)
        exact = 0.001 * (1 - np.exp(-decay * t) * (np.cos(w * t) + decay / w * np.sin(w * t)))
        assert plant.position(0) == pytest.approx(exact, abs=6e-6)  # the current's lag is 0.16 ms


def test_drives_hold_the_platforms_at_home_with_the_static_leg_forces() -> None:
    plant = Plant(load_rig("motorcycle"))
    plant.reset(mode="position")
    plant.advance(1.0)
    np.testing.assert_allclose([plant.force(i) for i in range(3)], [588.6, 588.6, 0.0], atol=1e-9)
    for name in ("stewart", "stewart_pd"):
        plant = Plant(load_rig(name))
        plant.reset(mode="position")
        plant.advance(1.0)
        # K_s = 0.997 lets law "pd" sag by some 10 um
        np.testing.assert_allclose([plant.force(i) for i in range(6)], STEWART_STATIC, atol=0.03)


@pytest.mark.parametrize("name", ["motorcycle", "stewart", "stewart_pd"])
def test_forces_along_a_motion_are_the_inverse_dynamics_of_that_motion(name: str) -> None:
    rig = changed(frictionless(name), bus={"interpolation": "linear"})
    model = build_rig(rig)
    plant = Plant(rig)
    plant.reset(mode="position")
    t = np.arange(0.0, 1.2, 0.00025)
    poses, forces = [], []
    for k, now in enumerate(t):
        if k % 40 == 0:
            phase = np.arange(model.n)
            amplitude = np.array(rig.limits) * 0.15
            pose = amplitude * (np.cos(2 * np.pi * 1.0 * now + phase) - np.cos(phase))
            for i, x in enumerate(model.inverse(pose)):
                plant.set_setpoint(i, float(x), now)
        plant.advance(now)
        poses.append(plant.pose())
        forces.append([plant.force(i) for i in range(model.n)])
    q, f = np.array(poses), np.array(forces)
    dt = t[1]
    errors = []
    for k in range(1200, len(t) - 40, 7):
        qd = (q[k + 1] - q[k - 1]) / (2 * dt)
        qdd = (q[k + 1] - 2 * q[k] + q[k - 1]) / dt**2
        # Over k-1/2 .. k+1/2 acts half of each neighbouring step's mean force.
        inverse = model.inverse_dynamics(q[k], qd, qdd)
        errors.append(inverse - mean_force_around(f, k, rig))
    moving = np.max(np.abs(f[1200:] - f[1200:].mean(axis=0)))
    assert moving > 40.0
    assert np.max(np.abs(errors)) < 0.01 * moving


def mean_force_around(f: np.ndarray, k: int, rig: RigFile) -> np.ndarray:
    """Mean of the current's force over the steps before and after tick k: it decays towards a constant
    reference within each, so its mean follows from the values at the step's ends."""
    a = 2 * np.pi * rig.actuators[0].current_hz * rig.bus.speed_loop
    decay = np.exp(-a)

    def mean(start: np.ndarray, end: np.ndarray) -> np.ndarray:
        reference = (end - start * decay) / (1.0 - decay)
        return reference + (start - reference) * (1.0 - decay) / a

    return 0.5 * (mean(f[k - 1], f[k]) + mean(f[k], f[k + 1]))


def test_a_drive_never_runs_faster_than_its_speed_limit() -> None:
    rig = load_rig("axis")
    plant = Plant(rig)
    plant.reset((-0.2,), mode="position")
    fastest = 0.0
    for k in range(40):
        plant.set_setpoint(0, 0.2, 0.01 * k)
        plant.advance(0.01 * (k + 1))
        fastest = max(fastest, plant.velocity(0))
    assert fastest == pytest.approx(0.375, rel=0.03)  # its speed loop overshoots


@pytest.mark.parametrize("knee", [0.0, 0.1])
def test_a_saturated_drive_does_not_wind_up(knee: float) -> None:
    limit = effect("force_saturation", "axis", limit=200.0, knee=knee)
    rig = with_effects(load_rig("axis"), limit)
    plant = Plant(rig)
    plant.reset((-0.1,), mode="position")
    highest = -1.0
    for k in range(300):
        plant.set_setpoint(0, 0.1, 0.01 * k)
        plant.advance(0.01 * (k + 1))
        highest = max(highest, plant.position(0))
        assert abs(plant.force(0)) <= 200.0 + 1e-9
    assert plant.position(0) == pytest.approx(0.1, abs=1e-4)
    assert highest < 0.15


def test_a_soft_limit_bends_over_to_the_hard_one() -> None:
    asked = np.array([-900.0, -200.0, -20.0, 0.0, 20.0, 150.0, 200.0, 250.0, 900.0, 1e9])
    hard = np.array([limited(x, 200.0, 0.0) for x in asked])
    np.testing.assert_array_equal(hard, np.clip(asked, -200.0, 200.0))
    soft = np.array([limited(x, 200.0, 0.5) for x in asked])
    np.testing.assert_array_equal(soft[[2, 3, 4]], asked[[2, 3, 4]])
    np.testing.assert_array_equal(soft[[0, 8, 9]], hard[[0, 8, 9]])
    assert soft[6] == -soft[1] == pytest.approx(200.0 * (1.0 - 0.5 / 4.0))
    assert hard[7] > soft[7] > soft[6] > soft[5] > 0.0
    fine = np.linspace(-400.0, 400.0, 4001)
    slope = np.diff([limited(x, 200.0, 0.5) for x in fine]) / np.diff(fine)
    assert slope.min() >= 0.0
    assert slope.max() <= 1.0 + 1e-9
    assert np.abs(np.diff(slope)).max() < 0.01  # no corner


def reference_of(rig: RigFile, sent: np.ndarray, value: np.ndarray, t: np.ndarray) -> np.ndarray:
    """What the drive asks for: a stiff loop without inertia to speak of follows it within a millisecond."""
    stiff = {
        "law": "pd",
        "position_gain": 4e6,
        "speed_gain": 3e4,
        "velocity_ff": 1.0,
        "force_max": 1e6,
    }
    rig = changed(rig, {"coulomb": 0.0, "viscous": 0.0, **stiff})
    plant = Plant(rig)
    plant.reset((float(value[0]),), mode="position")
    out, k = [], 0
    for now in t:
        while k < len(sent) and sent[k] <= now:
            plant.advance(sent[k])
            plant.set_setpoint(0, float(value[k]), float(sent[k]))
            k += 1
        plant.advance(now)
        out.append(plant.position(0))
    return np.array(out)


def test_linear_interpolation_is_one_cycle_and_a_delay_late() -> None:
    rig = load_rig("axis")
    sent = np.arange(0.0, 1.0, 0.01)
    t = np.arange(0.5, 0.9, 0.0033)
    seen = reference_of(rig, sent, 0.1 * sent, t)
    # 0.6 ms to the drive, 0.4 ms to its next position tick, 10 ms interpolation
    np.testing.assert_allclose(seen, 0.1 * (t - 0.011), atol=2e-6)


@pytest.mark.parametrize("is_smooth", [False, True])
def test_drives_that_lead_are_a_tick_early_in_all(is_smooth: bool) -> None:
    rig = load_rig("axis")
    sent = np.arange(0.0, 1.0, 0.01)
    told = 0.05 * np.sin(2.0 * np.pi * 0.7 * sent)
    stamps = {f"axis.{s}": np.arange(0.05, 0.95, 0.0013) for s in ("position", "force")}
    leads = changed(rig, bus={"interpolation": "linear_leads"})
    earlier = sent - rig.bus.position_loop
    lead = Twin(leads, smooth=is_smooth).replay({"axis": (sent, told)}, stamps)
    early = Twin(rig, smooth=is_smooth).replay({"axis": (earlier, told)}, stamps)
    np.testing.assert_allclose(lead["axis.position"], early["axis.position"], atol=1e-12)
    np.testing.assert_allclose(lead["axis.force"], early["axis.force"], atol=1e-6)


def test_forces_are_taken_at_once_or_drawn_out_over_a_cycle() -> None:
    sent = np.arange(0.0, 0.5, 0.01)
    t = np.arange(0.2, 0.45, 0.0033)
    seen = {}
    for how in ("hold", "linear"):
        rig = changed(load_rig("axis"), {"coulomb": 0.0}, bus={"force_interpolation": how})
        told = {"axis": (sent, 100.0 * sent)}
        seen[how] = Twin(rig).replay(told, {"axis.force": t}, mode="force")["axis.force"]
    # answers, a tick and a half of the speed loop, the current loop's lag
    late = t - rig.bus.setpoint_delay - rig.bus.answer_delay
    lag_s = 1.0 / (2.0 * np.pi * rig.actuators[0].current_hz) + 0.5 * rig.bus.speed_loop
    held = 100.0 * 0.01 * np.floor(late / 0.01)
    settled = late % 0.01 > 0.002
    np.testing.assert_allclose(seen["hold"][settled], held[settled], atol=0.1)
    np.testing.assert_allclose(seen["linear"], 100.0 * (late - 0.01 - lag_s), atol=0.01)


def test_send_jitter_shows_unless_the_drive_plays_setpoints_on_its_own_clock() -> None:
    rig = load_rig("axis")
    rng = np.random.default_rng(1)
    nominal = np.arange(0.0, 2.0, 0.01)
    sent = nominal + 0.002 * rng.uniform(0.0, 1.0, len(nominal))
    t = np.arange(0.5, 1.9, 0.0033)
    shaken = reference_of(rig, sent, 0.1 * nominal, t)
    played = reference_of(changed(rig, bus={"retimed": True}), sent, 0.1 * nominal, t)

    def roughness(x: np.ndarray) -> float:
        return float(np.std(x - np.polyval(np.polyfit(t, x, 1), t)))

    assert roughness(played) < 1e-6
    assert roughness(shaken) > 1e-5
    late = t - played / 0.1  # first arrival, a cycle in the queue, a cycle of interpolation
    assert np.mean(late) == pytest.approx(sent[0] + 0.0006 + 0.02, abs=2e-4)


def test_a_lost_setpoint_costs_the_retimed_drive_one_pause_and_no_more() -> None:
    rig = changed(load_rig("axis"), bus={"retimed": True})
    sent = np.arange(0.0, 1.0, 0.01)
    keep = np.delete(np.arange(len(sent)), 50)
    t = np.arange(0.7, 0.95, 0.0033)
    seen = reference_of(rig, sent[keep], 0.1 * sent[keep], t)
    np.testing.assert_allclose(seen, 0.1 * (t - 0.0206), atol=3e-5)


@pytest.mark.parametrize(("late_s", "is_in_time"), [(0.007, True), (0.009, False)])
def test_a_late_setpoint_is_played_in_its_turn_or_passed_over_once(
    late_s: float, is_in_time: bool
) -> None:
    rig = changed(load_rig("axis"), bus={"retimed": True})
    sent = np.arange(0.0, 1.0, 0.01)
    came = sent + late_s * (np.arange(len(sent)) == 50)
    t = np.arange(0.45, 0.95, 0.0033)
    off = np.abs(reference_of(rig, came, 0.1 * sent, t) - 0.1 * (t - 0.0206))
    assert np.max(off[t > 0.6]) < 3e-5, "those after it are in time"
    assert bool(np.max(off) < 3e-5) is is_in_time


@pytest.mark.parametrize("gain", ["velocity_ff", "acceleration_ff", "friction_ff"])
def test_each_precontrol_lowers_the_tracking_error(gain: str) -> None:
    def error(**gains: float) -> float:
        plant = Plant(load_rig("axis"))
        plant.set_gains(0, **gains)
        plant.reset(mode="position")
        worst = 0.0
        for k in range(200):
            t = 0.01 * k
            plant.set_setpoint(0, 0.02 * (1 - np.cos(2 * np.pi * t)), t)
            plant.advance(t + 0.01)
            due = 0.02 * (1 - np.cos(2 * np.pi * (t - 0.001)))
            worst = max(worst, abs(due - plant.position(0)))
        return worst

    base = {} if gain == "velocity_ff" else {"velocity_ff": 1.0}
    assert error(**base, **{gain: 1.0}) < 0.97 * error(**base)


def test_a_drive_that_is_switched_on_holds_where_it_stands() -> None:
    plant = Plant(load_rig("motorcycle"))
    start = plant.pose()
    plant.advance(0.1)
    for i in range(3):
        plant.set_mode(i, "position")
    plant.advance(0.3)
    assert (
        np.max(np.abs(plant.pose() - start)) < 2e-3
    )  # it sags until the integrators carry the load
    plant.advance(1.0)
    np.testing.assert_allclose(plant.pose(), start, atol=1e-5)


def test_in_mode_force_the_brake_opens_at_the_first_setpoint() -> None:
    plant = Plant(load_rig("motorcycle"))
    for i in range(3):
        plant.set_mode(i, "force")
    plant.advance(0.5)
    assert plant.position(0) == pytest.approx(0.6, abs=1e-12)
    for i in range(3):
        plant.set_setpoint(i, 0.0, 0.5)
    plant.advance(0.7)
    assert plant.position(0) < 0.55


def test_static_force_fed_forward_spares_the_integrators_a_changing_load() -> None:
    """Slowly a cascade lags by F'/(k_i k_p) for the force that its integrator must build up."""
    model = build_rig(load_rig("stewart"))
    t = np.arange(0.0, 10.0, 0.01)
    roll = 0.15 * np.sin(2 * np.pi * 0.1 * t) ** 3
    poses = np.zeros((len(t), 6))
    poses[:, 3] = roll
    load = np.array([model.static_forces(q) for q in poses])

    def positions(law: str) -> np.ndarray:
        plant = Plant(frictionless("stewart", law=law))
        plant.reset(mode="position")
        out = []
        for now, pose in zip(t, poses, strict=True):
            for i, x in enumerate(model.inverse(pose)):
                plant.set_setpoint(i, float(x), now)
            plant.advance(now)
            out.append([plant.position(i) for i in range(6)])
        return np.array(out)

    a = load_rig("stewart").actuators[0]
    spared = positions("cascade_static") - positions("cascade")
    lag = a.static_ff * np.gradient(load, t, axis=0) / (a.integral_gain * a.position_gain)
    settles = a.speed_gain / a.integral_gain  # s
    smooth = lfilter([1.0], [1.0 + settles / t[1], -settles / t[1]], lag, axis=0)
    assert np.max(np.abs(lag)) > 5e-6
    np.testing.assert_allclose(spared[100:], smooth[100:], atol=0.1 * np.max(np.abs(lag)))


def test_a_drive_that_feeds_static_force_forward_takes_a_load_over_without_a_jump() -> None:
    plant = Plant(frictionless("stewart", law="cascade_static"))
    plant.reset(mode="force")
    for i, force in enumerate(STEWART_STATIC):
        plant.set_setpoint(i, force, 0.0)
    plant.advance(0.05)
    for i in range(6):
        plant.set_mode(i, "position")
    start = [plant.position(i) for i in range(6)]
    plant.advance(0.06)
    np.testing.assert_allclose([plant.position(i) for i in range(6)], start, atol=1e-5)
    plant.advance(1.0)
    np.testing.assert_allclose([plant.force(i) for i in range(6)], STEWART_STATIC, atol=0.5)


def test_drives_that_do_not_know_of_legs_sag_under_their_weight() -> None:
    leg = {"lower_mass": 1.5, "lower_cog": 0.35, "upper_mass": 1.0, "upper_cog": 0.3}
    heavy = changed(load_rig("stewart_pd"), {"leg": leg})
    blind = changed(load_rig("stewart_pd"), {"leg": {**leg, "is_fed": False}})
    weight = build_rig(heavy).static_forces(np.zeros(6)) - STEWART_STATIC
    a = heavy.actuators[0]
    held = []
    for rig in (heavy, blind):
        plant = Plant(rig)
        plant.reset(np.zeros(6), mode="position")
        held.append([plant.position(i) for i in range(6)])
    sag = np.array(held[0]) - np.array(held[1])
    np.testing.assert_allclose(sag, a.static_ff * weight / a.position_gain, rtol=0.01)
    assert np.all(sag > 1e-5)


def test_drives_with_a_common_clock_play_together_whatever_slot_their_setpoints_came_in() -> None:
    rig, speed = load_rig("stewart_pd"), 0.05
    together = changed(rig, bus={"clock_wait": 0.009})
    cycles = np.arange(0.0, 1.0, rig.bus.cycle)
    slots = enumerate(rig.actuators)
    sent = {a.name: (cycles + i * rig.bus.stagger, a.home + speed * cycles) for i, a in slots}
    at = {f"{a}.position": np.arange(0.5, 0.9, 0.0033) for a in rig.actuator_names}
    own, common = Twin(rig).replay(sent, at), Twin(together).replay(sent, at)
    earlier_s = [float(np.mean(common[s] - own[s])) / speed for s in at]
    np.testing.assert_allclose(earlier_s, 0.001 + rig.bus.stagger * np.arange(6), atol=3e-5)


def test_a_common_clock_that_no_setpoint_could_wait_for_is_refused() -> None:
    with pytest.raises(
        ValidationError, match=r"clock_wait: the last of 6 drives would wait 0\.5 ms"
    ):
        changed(load_rig("stewart_pd"), bus={"clock_wait": 0.006})
