"""Replay of records: the same as the plant, the same each time, alone or in a batch."""

from __future__ import annotations

import numpy as np
import pytest

from hil.config import RigFile
from hil.configfile import load_rig
from hil.errors import ConfigError, RunError
from hil.rigs import build_rig
from hil.sim.imu import group_delay_s
from hil.sim.parameters import ParameterTable
from hil.sim.plant import Plant
from hil.sim.twin import Payload, Replay, Twin
from tests.sim.rigs import changed, effect, with_effects


def motion(rig: RigFile, seconds: float = 2.0) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(5)
    t = np.arange(0.0, seconds, rig.bus.cycle)
    out = {}
    for i, a in enumerate(rig.actuators):
        sent = t + rig.bus.stagger * i + np.abs(rng.normal(0.0, rig.bus.jitter, len(t)))
        out[a.name] = (sent, a.home + 0.02 * np.sin(2 * np.pi * 0.7 * t + i) * np.minimum(t, 1.0))
    return out


def job(name: str, rig: RigFile | None = None, **options: object) -> Replay:
    rig = rig or load_rig(name)
    stamps = np.arange(0.005, 2.0, 0.02)
    twin = Twin(rig)
    samples = {s: stamps for s in twin.signals if not s.endswith(".current")}
    return twin.record(motion(rig), samples, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["axis", "motorcycle", "stewart", "stewart_pd"])
def test_a_replay_is_what_the_plant_did_to_the_last_digit(name: str) -> None:
    lines = [effect("backlash", load_rig(name).actuator_names[0], gap=3e-4)]
    lines.append(effect("transport_delay", load_rig(name).actuator_names[-1], delay=0.0007))
    rig = with_effects(load_rig(name), *lines)
    setpoints = motion(rig)
    plant = Plant(rig)
    plant.reset(pose=None, mode="position")
    start = build_rig(rig).inverse(rig.parked_pose)
    events = sorted(
        (t, i, v)
        for i, (ts, vs) in enumerate(setpoints.values())
        for t, v in zip(ts, vs, strict=True)
    )
    stamps = np.arange(0.0307, 2.0, 0.0203)
    seen: dict[str, list[float]] = {"position": [], "force": [], "imu": [], "pose": []}
    k = 0
    assert rig.imu is not None
    filtered = group_delay_s(rig.imu.bandwidth)
    for stamp in stamps:
        at = {"position": stamp - rig.bus.answer_delay, "imu": stamp + filtered, "pose": stamp}
        for what, instant in sorted(at.items(), key=lambda x: x[1]):
            while k < len(events) and events[k][0] <= instant:
                plant.advance(events[k][0])
                plant.set_setpoint(events[k][1], float(events[k][2]), events[k][0])
                k += 1
            plant.advance(instant)
            if what == "position":
                seen["position"].append(plant.position(0))
                seen["force"].append(plant.force(plant.n - 1))
            else:
                value = plant.imu()[3] if what == "imu" else plant.pose()[0]
                seen[what].append(float(value))
    first, last = rig.actuator_names[0], rig.actuator_names[-1]
    names = {
        "position": f"{first}.position",
        "force": f"{last}.force",
        "imu": "imu.accel_x",
        "pose": f"pose.{rig.coordinates[0]}",
    }
    again = Twin(rig).replay(setpoints, dict.fromkeys(names.values(), stamps), start=start)
    for what, name_ in names.items():
        np.testing.assert_allclose(again[name_], seen[what], atol=1e-8, err_msg=what)


def test_the_same_run_twice_is_the_same_to_the_bit() -> None:
    record = job("stewart")
    first = record.run()
    assert np.array_equal(first, record.run())
    assert np.array_equal(first, job("stewart").run())
    assert np.all(np.isfinite(first))


def test_a_batch_is_its_single_runs_whatever_the_number_of_workers() -> None:
    record = job("motorcycle")
    table = record.twin.table
    rows = np.array(
        [
            table.vector({"leg1.coulomb_friction.force": f, "leg2.backlash.gap": g})
            for f, g in ((0.0, 0.0), (10.0, 2e-4), (25.0, 1e-3), (-5.0, 5e-5), (3.0, 1e-6))
        ]
    )
    single = np.array([record.run(row) for row in rows])
    for workers in (1, 2, 5):
        assert np.array_equal(record.run_many(rows, workers), single)


def test_sensitivities_tell_what_a_small_change_does() -> None:
    record = job("motorcycle")
    names = [
        "leg1.viscous_friction.coefficient",
        "platform.payload_mass.mass",
        "leg1.compliance.stiffness",
    ]
    slopes = record.sensitivities(names)
    assert slopes.shape == (record.size, 3)
    by = {n: record.by_signal(slopes[:, k]) for k, n in enumerate(names)}
    # Viscous friction asks for one newton more per N s/m and m/s.
    speed = record.by_signal(record.run())["leg1.velocity"]
    np.testing.assert_allclose(by[names[0]]["leg1.force"][10:], speed[10:], atol=0.02)
    # A kilogram at the centre of gravity hangs on both legs: 588.6 N of the 200 kg each at home.
    static = np.median(by[names[1]]["leg1.force"])
    assert static == pytest.approx(588.6 / 200.0, rel=0.1)
    assert np.max(np.abs(by[names[2]]["pose.pitch"])) > 0.0
    inert = record.sensitivities(["leg1.stribeck_friction.velocity"])
    assert not np.any(inert)


def test_smooth_arrivals_make_answers_smooth_in_a_delay() -> None:
    rig = load_rig("axis")
    stamps = np.arange(0.5, 2.0, 0.02)
    delays = 0.002 + 1e-4 * np.arange(21)

    def bend(smooth: bool) -> float:
        record = Twin(rig, smooth=smooth).record(motion(rig), {"axis.position": stamps})
        table = record.twin.table
        rows = [table.vector({"axis.transport_delay.delay": d}) for d in delays]
        first = np.diff(record.run_many(np.array(rows)), axis=0)
        return float(np.abs(np.diff(first, axis=0)).max() / np.abs(first).mean())

    assert bend(smooth=True) < 0.5
    assert bend(smooth=False) > 2.0  # the drive waits for its next tick


@pytest.mark.parametrize("interpolation", ["linear", "linear_leads", "hold"])
def test_where_each_setpoint_is_taken_at_a_tick_of_its_own_they_may_come_as_often_as_ticks(
    interpolation: str,
) -> None:
    """As on a bus with SYNC: a motion that is told later by less than a tick comes later by just that."""
    rig = load_rig("axis_canopen")
    bus = rig.bus.model_copy(update={"position_loop": 1e-3, "interpolation": interpolation})
    twin = Twin(rig.model_copy(update={"bus": bus}), smooth=True)
    sent = np.arange(0.0, 2.0, bus.cycle)
    told, stamps = 0.1 * np.clip(sent - 0.2, 0.0, None), np.arange(1.0, 1.5, bus.cycle)

    def reached(late_s: float) -> float:
        setpoints = {"axis": (sent + late_s, told)}
        answers = twin.replay(setpoints, {"axis.position": stamps}, ticked=["axis"])
        return float(np.mean(answers["axis.position"]))

    for late_s in 5e-5 * np.arange(1, 20):
        assert (reached(0.0) - reached(late_s)) / 0.1 == pytest.approx(late_s, abs=1e-6)


def test_a_finer_plant_agrees_with_the_usual_one() -> None:
    stamps = np.arange(0.5, 2.0, 0.02)
    rig = load_rig("motorcycle")
    samples = {"leg1.force": stamps, "leg1.position": stamps}
    coarse, fine = (Twin(rig, substeps=n).replay(motion(rig), samples) for n in (1, 8))
    np.testing.assert_allclose(coarse["leg1.position"], fine["leg1.position"], atol=2e-7)
    np.testing.assert_allclose(coarse["leg1.force"], fine["leg1.force"], atol=1.0)


def test_mode_force_replays_forces() -> None:
    rig = load_rig("motorcycle")
    twin = Twin(rig)
    t = np.arange(0.0, 1.0, 0.01)
    setpoints = {"leg1": (t, 588.6 + 100.0 * np.sin(2 * np.pi * 2 * t)), "leg2": (t, 588.6 + 0 * t)}
    stamps = np.arange(0.01, 1.0, 0.01)
    seen = twin.replay(setpoints, {"leg1.force": stamps, "leg1.position": stamps}, mode="force")
    assert seen["leg1.force"].max() == pytest.approx(688.6, abs=1.0)
    assert np.ptp(seen["leg1.position"]) > 1e-3


def test_a_payload_moves_mass_centre_and_inertia() -> None:
    rig = load_rig("motorcycle")
    place = (0.1, 0.3, 0.2)
    stamps = np.array([0.05])
    samples = {f"{a}.force": stamps for a in rig.actuator_names}
    seen = Twin(rig, payload=Payload(20.0, place)).replay({}, samples)
    cog = (200.0 * np.array(rig.mass.cog) + 20.0 * np.array(place)) / 220.0
    heavier = changed(rig, mass={"m": 220.0, "cog": tuple(cog)})
    exact = build_rig(heavier).inverse_dynamics(np.zeros(3), np.zeros(3), np.zeros(3))
    np.testing.assert_allclose([float(v[0]) for v in seen.values()], exact, atol=1e-9)


def test_an_impossible_rig_answers_nan_not_nonsense() -> None:
    record = job("stewart")
    vector = record.twin.table.vector({f"leg{i}.lead_error.scale": 0.8 for i in (1, 3, 5)})
    vector[record.twin.table.index("leg2.position_offset.offset")] = 5.0
    assert np.all(np.isnan(record.run(vector)))


def test_vectors_of_another_length_are_refused() -> None:
    record = job("axis")
    short = record.twin.parameters[:-1]
    with pytest.raises(RunError, match=rf"{len(short) + 1} parameters"):
        record.run(short)
    with pytest.raises(RunError, match=r"shape \(2, \d+\)"):
        record.run_many(np.array([short, short]))


def test_records_that_cannot_be_replayed_are_refused_by_name() -> None:
    twin = Twin(load_rig("axis"))
    t = np.array([0.0, 0.02, 0.01])
    with pytest.raises(RunError, match=r"axis.setpoint: time runs back after sample 1"):
        twin.record({"axis": (t, t)}, {})
    with pytest.raises(RunError, match=r"no signals \['leg1.position'\]"):
        twin.record({}, {"leg1.position": t})
    with pytest.raises(RunError, match="one finite value"):
        twin.record({"axis": (np.arange(2.0), np.array([0.0, np.nan]))}, {})
    with pytest.raises(RunError, match="no imu"):
        Twin(changed(load_rig("axis"), imu=None)).record({}, {"imu.gyro_x": np.zeros(1)})


def test_parameters_are_found_by_name_and_kept_within_bounds() -> None:
    table = ParameterTable(load_rig("motorcycle"))
    assert table["leg1.backlash.gap"].unit == "m"
    assert table["slide.velocity_saturation.limit"].neutral == 0.94
    assert table["leg2.base.geometry_error.z"].neutral == 0.0
    assert 0.0 > table["platform.payload_mass.mass"].lower > -load_rig("motorcycle").mass.m
    with pytest.raises(ConfigError, match=r"nearest: leg1\.backlash\.gap"):
        table.index("leg1.backlash.gapp")
    with pytest.raises(ConfigError, match=r"leg1\.backlash\.gap = -1 m lies outside 0\.\.0\.02"):
        table.vector({"leg1.backlash.gap": -1.0})
    rig = with_effects(
        load_rig("axis"), effect("backlash", "axis", gap=1e-4), effect("backlash", "axis", gap=2e-4)
    )
    with pytest.raises(ConfigError, match=r"axis\.backlash\.gap is given twice"):
        Plant(rig)


def test_loop_periods_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ConfigError, match="whole multiple"):
        Plant(changed(load_rig("axis"), bus={"speed_loop": 0.0003}))


def test_gains_change_by_name_while_the_rig_runs() -> None:
    plant = Plant(load_rig("axis"))
    plant.reset(mode="position")
    plant.set_gains(0, position_gain=40.0)
    plant.set_setpoint(0, 0.005, 0.0)
    plant.advance(0.08)
    slow = plant.position(0)
    plant = Plant(load_rig("axis"))
    plant.reset(mode="position")
    plant.set_setpoint(0, 0.005, 0.0)
    plant.advance(0.08)
    assert slow < plant.position(0)
    with pytest.raises(ConfigError, match="speedgain is no gain"):
        plant.set_gains(0, speedgain=1.0)


def test_current_needs_its_constants() -> None:
    rig = load_rig("axis")
    plant = Plant(rig)
    plant.set_mode(0, "force")
    plant.set_setpoint(0, 10.0, 0.0)
    plant.advance(0.1)
    constant = rig.actuators[0].force_per_ampere
    assert constant is not None
    assert plant.current(0) == pytest.approx(10.0 / constant)
    with pytest.raises(ConfigError, match="torque_constant"):
        Plant(changed(rig, {"torque_constant": None})).current(0)
