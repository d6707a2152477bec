"""The gap of a ride: nothing where there is nothing, the text's own two gaps where they are put in."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hil.bicycle.path import slalom, u_turns
from hil.bicycle.recorded import prepare
from hil.bicycle.simulated import simulate_ride
from hil.config import BicycleFile
from hil.configfile import load_bicycle
from hil.errors import IdentificationError
from hil.gap.bicycle import RideProblem, diagnose_rides, locate_rides
from hil.gap.bicycle.either import diagnose_any
from hil.gap.bicycle.growing import growth
from hil.gap.bicycle.heard import is_heard
from hil.gap.bicycle.intervals import furthest
from hil.gap.bicycle.noise import ride_noise
from hil.gap.bicycle.nuisances import ride_nuisances
from hil.gap.bicycle.strained import exceeds_calibration, held_still, names_more
from hil.gap.bicycle.twin import LEAN_TORQUE
from hil.gap.bicycle.verdict import leaves_as_much
from hil.gap.bicycle.wheels import TYRES
from hil.gap.catalogue.nuisances import Nuisance
from hil.gap.fits.fit import fit
from hil.gap.fits.heldout import Score, split
from hil.gap.fits.training import begin, candidates_of
from hil.gap.located.events import jumps
from tests.bicycle.rides import run_of

NOMINAL = load_bicycle("bicycle")


def ridden(path, seed, *effects, quiet=False):
    """A run of the bicycle with effects, (effect, location, parameters) each."""
    rig = NOMINAL.model_dump()
    rig["effects"] = [{"effect": e, "location": at, "parameters": p} for e, at, p in effects]
    if quiet:
        rig["noise"] = dict.fromkeys(rig["noise"], 0.0)
        rig["bus"]["jitter"] = 0.0
    ride = simulate_ride(BicycleFile.model_validate(rig), path, seed)
    return replace(run_of(ride), path=Path(f"ride{seed}"))


ROLLS = (
    ("sensor_scale", "steer", {"scale": 1.0 - TYRES.turns_by[0]}),
    ("sensor_latency", "steer", {"delay": -TYRES.turns_late_s[0]}),
    ("drive_slip", "rear_wheel", {"per_accel": TYRES.creeps[0]}),
)
"""What tyres do to any bicycle, and the simulated one's thin wheels do not."""


def short():
    return slalom(60.0)


@pytest.fixture(scope="module")
def healthy():
    return ridden(short(), 21)


def test_a_healthy_ride_has_no_gap(healthy):
    """Its rider sits stiller than the floor allows riders to."""
    found = diagnose_rides([healthy], NOMINAL)
    assert found.verdict == "no_gap"
    for s in found.located.signals:
        assert (0.5 if s.signal == LEAN_TORQUE else 0.7) < s.ratio < 1.4, s


def test_an_accelerometer_that_is_struck_is_an_event_though_no_drive_s_frame_strikes_it(healthy):
    located = diagnose_rides([healthy], NOMINAL).located
    struck = np.array(located.evidence.residual)
    for x in located.evidence.problem.series:
        if x.signal == "imu.accel_z":
            struck[x.part][50::100] += 100.0 * located.evidence.noise.sigma[x.part][50::100]
    signal, times = jumps(replace(located, evidence=replace(located.evidence, residual=struck)))
    assert signal == "imu.accel_z"
    assert times > 1.0


@pytest.mark.parametrize(
    ("signal", "step"), [("imu.gyro_x", 0.1), ("steer", 0.016), ("rear_wheel", 0.075)]
)
def test_coarse_steps_of_a_signal_are_read_from_its_values(signal, step):
    """The steer's are brought to the encoder's own steps besides, which are a sixth of those; a wheel that
    rolls stands nowhere twice."""
    run = ridden(short(), 23, ("sensor_quantisation", signal, {"step": step}))
    found = diagnose_rides([run], NOMINAL)
    assert found.verdict == "identified"
    (cause,) = found.effects
    assert (cause.effect, cause.location) == ("sensor_quantisation", signal)
    assert cause.parameters["step"].value == pytest.approx(step, rel=0.02)
    if signal == "steer":
        hidden = diagnose_rides([run], NOMINAL, without=["sensor_quantisation"])
        assert all(x.effect != "sensor_quantisation" for x in hidden.causes)


def slipping(table, per_accel):
    """What a steer tells where tyres slip by so many rad for each m/s² across."""
    rolled = table["rear_wheel"].dropna()
    stamps = table["t"][rolled.index]
    speed = NOMINAL.geometry.R * np.gradient(rolled.to_numpy(), stamps.to_numpy())
    speed = np.interp(table["t"], stamps, np.convolve(speed, np.ones(50) / 50.0, "same"))
    return table.assign(
        steer=table["steer"] + per_accel * speed * table["imu.gyro_z"].interpolate().bfill()
    )


def test_tyres_that_give_way_in_curves_as_hard_ones_do_are_no_gap():
    """Half a milliradian for each m/s² across: a steer angle that is told so much too large."""
    ride = simulate_ride(NOMINAL, short(), 24)
    found = diagnose_rides([run_of(ride, lambda table: slipping(table, 5e-4))], NOMINAL)
    assert found.verdict == "no_gap", found.sentence


@pytest.mark.parametrize(("stiffness", "effects"), [(1.25e5, []), (7e4, ["tyre_compliance"])])
def test_hard_tyres_are_healthy_and_soft_ones_a_finding(stiffness, effects):
    tyres = ("tyre_compliance", "bicycle", {"stiffness": stiffness, "damping": 250.0})
    found = diagnose_rides([ridden(short(), 22, tyres)], NOMINAL)
    assert [x.effect for x in found.effects] == effects
    assert found.verdict == ("identified" if effects else "no_gap")


def test_a_tyre_that_creeps_as_it_drives_is_no_late_accelerometer():
    """As tyres do that slip by a thirtieth under as much force as they bear: the bicycle follows by some
    15 ms."""
    creeps = ("drive_slip", "rear_wheel", {"per_accel": 3.5e-3})
    found = diagnose_rides([ridden(short(), 24, creeps)], NOMINAL)
    assert found.verdict == "no_gap", found.sentence
    fitted = {n.name: n.change for n in found.located.nuisances}
    assert fitted["rear_wheel.drive_slip.per_accel"] == pytest.approx(3.5e-3, abs=1e-3)
    accel = next(s for s in found.located.signals if s.signal == "imu.accel_x")
    assert accel.ratio < 1.3


def test_tyres_that_turn_a_bicycle_more_than_its_steer_says_are_no_gap():
    """By 3 %, as those do whose side force of camber is large: a steer that is told so much too small. What
    is told 7 % too small is a scale."""
    for scale, effects in ((0.97, []), (0.93, [("sensor_scale", "steer")])):
        turned = ("sensor_scale", "steer", {"scale": scale})
        found = diagnose_rides([ridden(short(), 23, turned, *ROLLS[1:])], NOMINAL)
        assert [(x.effect, x.location) for x in found.effects] == effects, found.sentence
    told = found.effects[0].parameters["scale"]
    beyond = 0.93 / (1.0 - TYRES.turns_by[0])  # what tyres do on average is not the sensor's
    assert told.value == pytest.approx(beyond, abs=0.006)
    assert told.ci[0] < beyond < told.ci[1]


@pytest.mark.parametrize(
    "effect",
    [
        ("sensor_misalignment", "imu", {"x": 0.006, "y": 0.02, "z": 0.008}),
        ("wheel_radius", "front_wheel", {"scale": 0.93}),
    ],
)
def test_an_imu_that_is_turned_is_no_front_wheel(effect):
    """Both pitch what the IMU feels, and stand in one class; a wheel turns it about no other axis."""
    found = diagnose_rides([ridden(short(), 26, effect)], NOMINAL)
    first, second = found.causes[:2]
    assert (first.effect, first.location) == effect[:2]
    assert {first.effect, second.effect} == {"sensor_misalignment", "wheel_radius"}
    assert second.probability > 0.02


@pytest.mark.parametrize(
    "beside",
    [
        ("sensor_misalignment", "imu", {"x": 0.005, "y": 0.002, "z": -0.05}),
        ("wheel_slip", "rear_wheel", {"coefficient": 0.08}),
    ],
)
def test_what_acts_beside_a_clock_that_drifts_is_found(beside):
    """Tolerances of a healthy bicycle make the floor so wide that either alone seems to leave nothing."""
    drifts = ("clock_drift", "imu", {"rate": 0.0035})
    found = diagnose_rides([ridden(short(), 31, drifts, beside)], NOMINAL)
    assert {(x.effect, x.location) for x in found.effects} == {drifts[:2], beside[:2]}


def test_what_a_calibrated_scale_is_off_by_is_left_of_gravity(healthy):
    problem = RideProblem(NOMINAL, [prepare(healthy, NOMINAL)])
    sd = {n.name: n.sd for n in ride_nuisances(NOMINAL, problem)}
    across, down = (sd[f"imu.accel_{c}.sensor_bias.offset"] for c in "yz")
    assert across == pytest.approx(0.04, rel=0.01)
    assert down == pytest.approx(np.hypot(0.04, 0.002 * 9.81), rel=0.01)


def test_a_scale_far_from_one_is_fitted_though_a_usual_one_would_not_be_felt():
    """Two per cent of an acceleration of 0.3 m/s² drown in its noise, forty do not."""
    rough = ("sensor_scale", "imu.accel_x", {"scale": 1.4})
    found = diagnose_rides([ridden(short(), 25, rough)], NOMINAL)
    assert (found.causes[0].effect, found.causes[0].location) == rough[:2], found.sentence
    assert found.causes[0].parameters["scale"].value == pytest.approx(1.4, abs=0.1)


def test_a_rider_who_sits_to_one_side_turns_no_sensor(healthy):
    """A centimetre of an upper body: 5 N m of lean torque all the way, of which lean's zero and the IMU's
    mounting need to take no more than healthy ones have."""
    rig = NOMINAL.model_dump()
    off = {"effect": "sensor_bias", "location": LEAN_TORQUE, "parameters": {"offset": 5.0}}
    rig["effects"] = [off]
    found = diagnose_rides([healthy], BicycleFile.model_validate(rig))
    assert found.verdict == "no_gap"
    far = {n.name: n.change / n.prior_sd for n in found.located.nuisances}
    assert far[f"{LEAN_TORQUE}.sensor_bias.offset"] < -0.5
    assert max(map(abs, far.values())) < 2.0


def test_a_steer_that_is_told_too_large_may_be_tyres_and_one_too_small_is_its_scale():
    ride = simulate_ride(NOMINAL, short(), 24)

    def told(scale):
        return run_of(ride, lambda table: table.assign(steer=table["steer"] * scale))

    found = diagnose_rides([told(1.1)], NOMINAL)
    assert found.verdict == "identified"
    assert "tyres that slip sideways" in found.sentence
    assert (found.causes[0].effect, found.causes[0].location) == ("sensor_scale", "steer")
    assert 0.45 < found.causes[0].probability < 0.6
    found = diagnose_rides([told(0.9)], NOMINAL)
    assert found.verdict == "identified"
    assert (found.causes[0].effect, found.causes[0].location) == ("sensor_scale", "steer")


@pytest.fixture(scope="module")
def slow_and_fast():
    return [
        simulate_ride(NOMINAL, slalom(40.0, 14.0, 6.0), 24, cruise=2.5, turning=2.5),
        simulate_ride(NOMINAL, slalom(90.0, 30.0, 20.0), 25, cruise=7.0, turning=7.0),
        simulate_ride(NOMINAL, u_turns(25.0), 26),
    ]


def test_rides_of_several_speeds_tell_a_steer_s_scale_from_tyres(slow_and_fast):
    def diagnosed(spoil):
        rides = [run_of(ride, spoil) for ride in slow_and_fast]
        return diagnose_rides([replace(r, path=Path(f"{k}")) for k, r in enumerate(rides)], NOMINAL)

    found = diagnosed(lambda table: table.assign(steer=table["steer"] * 1.2))
    assert found.verdict == "identified", found.sentence
    assert [(x.effect, x.location) for x in found.effects] == [("sensor_scale", "steer")]
    found = diagnosed(lambda table: slipping(table, 0.012))
    assert found.verdict == "unknown", found.sentence


def test_a_wheel_that_the_file_has_wrong_is_the_first_of_those_that_shorten_the_way():
    """Its frame stands as it was measured: a slip and a scale of its encoder answer alike."""
    wrong = ("wheel_radius", "rear_wheel", {"scale": 1.05, "frame": 0.0})
    found = diagnose_rides([ridden(short(), 22, wrong, *ROLLS)], NOMINAL)
    first, second = found.causes[:2]
    assert (first.effect, second.effect) == ("wheel_radius", "sensor_scale")
    assert second.group == first.group
    assert first.parameters["scale"].value == pytest.approx(1.05, abs=0.006)
    assert first.parameters["frame"].value == 0.0


@pytest.mark.parametrize(("scale", "seeds"), [(1.03, (22, 23, 24)), (1.04, (22,))])
def test_a_larger_wheel_that_pitches_the_frame_is_no_scale(scale, seeds):
    """One ride of 14 s takes 3 % for what round tyres do, three rides do not."""
    grown = ("wheel_radius", "rear_wheel", {"scale": scale})
    found = diagnose_rides([ridden(short(), seed, grown) for seed in seeds], NOMINAL)
    assert [x.effect for x in found.effects] == ["wheel_radius"]
    assert "frame" not in found.effects[0].parameters
    assert found.effects[0].parameters["scale"].value == pytest.approx(scale, abs=0.004)


def test_no_filter_looks_like_an_effect_however_lively_the_ride():
    """Pitch and its rate are products of lean and steer: what a filter leaves of those is not what it leaves
    of the products. A tight slalom at 4.5 m/s, leaning 0.2 rad to either side, without noise."""
    rig = NOMINAL.model_dump()
    rig["noise"] = dict.fromkeys(rig["noise"], 0.0)
    rig["bus"]["jitter"] = 0.0
    path = slalom(80.0, 10.0, 8.0)
    ride = simulate_ride(BicycleFile.model_validate(rig), path, 22, cruise=4.5, turning=4.5)
    assert ride.table["lean"].abs().max() > 0.2
    problem = RideProblem(NOMINAL, [prepare(run_of(ride), NOMINAL)])
    floors = ride_noise(problem, problem.base, np.random.default_rng(0)).floor(problem)
    residual = problem.residual(problem.base)
    for x in problem.series:
        left = residual[x.part][problem.kept[x.part]]
        assert np.sqrt(np.mean(left**2)) < 0.3 * floors[x.signal], x.signal


FORK = ("front_suspension", "bicycle", {"stiffness": 9e3, "damping": 400.0})
SOFT = ("tyre_compliance", "bicycle", {"stiffness": 8e4, "damping": 200.0})
RIDER = ("rider_motion", "bicycle", {"gain": 0.4})
"""Three tenths are what tyres of a round section make of the lean torque."""


@pytest.mark.parametrize(
    ("effect", "shows"), [(FORK, "imu.gyro_y"), (SOFT, "imu.gyro_y"), (RIDER, LEAN_TORQUE)]
)
def test_the_twin_with_the_true_effect_is_the_noiseless_ride(effect, shows, healthy):
    """The world is stepped at 1 kHz by forward dynamics, the twin at 100 Hz from measured angles.

    Counted in floors of a ride with noise: of one without, the floor is as low as sensors are believed to be.
    """
    name, location, parameters = effect
    run = ridden(short(), 22, effect, quiet=True)
    problem = RideProblem(NOMINAL, [prepare(run, NOMINAL)])
    noisy = RideProblem(NOMINAL, [prepare(healthy, NOMINAL)])
    floors = ride_noise(noisy, noisy.base, np.random.default_rng(0)).floor(noisy)
    values = {f"{location}.{name}.{k}": v for k, v in parameters.items()}
    true = problem.table.vector(values)

    def off(vector):
        residual = problem.residual(vector)
        return {
            x.signal: float(np.sqrt(np.mean((residual[x.part] ** 2)[problem.kept[x.part]])))
            / floors[x.signal]
            for x in problem.series
        }

    without, with_effect = off(problem.base), off(true)
    assert without[shows] > 0.35
    assert with_effect[shows] < 0.3 * without[shows]
    assert max(with_effect.values()) < 0.45
    assert without["imu.gyro_z"] < max(0.6, 0.1 * without[shows]), "yaw knows next to nothing of it"


def test_every_effect_vanishes_at_its_neutral_value(healthy):
    problem = RideProblem(NOMINAL, [prepare(healthy, NOMINAL)])
    at_neutral = problem.answers(problem.table.neutral)[0]
    np.testing.assert_array_equal(at_neutral, problem.answers(problem.base)[0])
    for p in problem.table.entries:
        if p.scale == 0.0 or p.parameter in ("damping", "step"):
            continue  # chosen, of springs that are rigid; steps change no filtered signal
        row = np.array(problem.base)
        row[problem.table.index(p.name)] = (
            p.scale if p.neutral in (0.0, np.inf) else p.neutral + p.scale
        )
        change = np.abs(problem.answers(row)[0] - at_neutral).max()

        assert change > 0.0, p.name


def test_a_wrong_steer_zero_is_named_on_held_out_data():
    effect = ("sensor_bias", "steer", {"offset": 0.015})
    runs = [ridden(short(), 23, effect), ridden(slalom(40.0, 24.0, 12.0), 24, effect)]
    found = diagnose_rides(runs, NOMINAL)
    assert found.verdict == "identified"
    (cause,) = found.effects
    assert (cause.effect, cause.location) == ("sensor_bias", "steer")
    assert cause.parameters["offset"].value == pytest.approx(0.015, abs=0.001)
    assert found.score is not None
    assert found.score.shrink > 0.9


def test_a_ride_whose_channels_lie_is_refused(healthy):
    table = healthy.table.copy()
    table["steer"] = -table["steer"]
    with pytest.raises(IdentificationError, match="to the LEFT is positive"):
        locate_rides([replace(healthy, table=table)], NOMINAL)


def without_imu(run):
    return replace(run, table=run.table[["t", "lean", "rear_wheel", "steer"]].dropna(how="all"))


def test_a_ride_without_imu_is_judged_by_its_lean_torque_and_says_so(healthy):
    found = locate_rides([without_imu(healthy)], NOMINAL)
    assert [s.signal for s in found.signals] == [LEAN_TORQUE]
    assert not found.is_gap
    assert any(f.subject == "imu" and "not recorded" in f.text for f in found.findings)
    leaning = without_imu(ridden(short(), 23, ("sensor_bias", "lean", {"offset": 0.05})))
    assert diagnose_rides([leaning], NOMINAL).verdict != "no_gap"


def test_a_ride_without_imu_and_rider_cannot_be_judged(healthy):
    alone = NOMINAL.model_copy(update={"rider": NOMINAL.rider.model_copy(update={"mass": 0.0})})
    with pytest.raises(IdentificationError, match="holds no IMU"):
        locate_rides([without_imu(healthy)], alone)


def test_a_rider_of_whom_the_file_says_nothing_is_asked_where_nothing_else_explains(healthy):
    """The lean torque of a ride without a rider is no equation to be judged by, and none that is found."""
    bare = BicycleFile.model_validate(NOMINAL.model_dump(exclude={"rider"}))
    told = diagnose_rides([healthy], bare)
    assert told.verdict == "no_gap"
    assert LEAN_TORQUE not in [s.signal for s in told.located.signals]
    found = diagnose_rides([ridden(short(), 24, RIDER), ridden(short(), 25, RIDER)], bare)
    assert [(x.effect, x.location) for x in found.effects] == [("rider_motion", "bicycle")]
    assert any(f.subject == "rider" and "is assumed" in f.text for f in found.located.findings)


def test_a_road_that_is_as_level_as_roads_are_is_no_gap(healthy):
    """A rise and fall of three in a thousand over some tens of metres."""
    told = healthy.table["imu.accel_x"]
    rise = 0.003 * np.sqrt(2.0) * np.sin(2 * np.pi * 0.09 * healthy.table["t"])
    hilly = replace(healthy, table=healthy.table.assign(**{"imu.accel_x": told + 9.81 * rise}))
    assert diagnose_rides([hilly], NOMINAL).verdict == "no_gap"


@pytest.mark.parametrize(
    ("effect", "location", "name", "value"),
    [
        ("sensor_bias", "imu.accel_x", "offset", -0.3),
        ("clock_drift", "imu", "rate", -0.002),
    ],
)
def test_what_no_calibration_sets_right_and_what_no_small_step_shows_is_named(
    effect, location, name, value
):
    """A bias of seven times what calibrations leave hides in a nuisance at its bound; a clock that drifts is
    late by more than any one column says."""
    found = diagnose_rides([ridden(short(), 25, (effect, location, {name: value}))], NOMINAL)
    assert [(x.effect, x.location) for x in found.effects] == [(effect, location)]
    low, high = found.effects[0].parameters[name].ci
    assert low < value < high
    assert found.effects[0].parameters[name].value == pytest.approx(value, rel=0.2)


@pytest.mark.parametrize("does", [(), ROLLS], ids=["thin", "tyres"])
def test_what_an_exact_effect_explains_is_counted_above_what_the_sensors_tell(does):
    """A healthy bicycle's tolerances reach as far as this wheel at moments; whatever stands above noise goes
    with it."""
    run = ridden(short(), 22, ("wheel_radius", "rear_wheel", {"scale": 0.97}), *does)
    found = diagnose_rides([run], NOMINAL)
    assert [(x.effect, x.location) for x in found.effects] == [("wheel_radius", "rear_wheel")]
    assert found.effects[0].parameters["scale"].value == pytest.approx(0.97, abs=0.003)


def test_clocks_that_part_are_not_claimed_to_be_a_latency_where_they_may_not_be_named():
    """A late IMU explains most of what grows from nothing to twice it, and a true one would not grow."""
    drifts = ("clock_drift", "imu", {"rate": 0.004})
    found = diagnose_rides([ridden(short(), 29, drifts)], NOMINAL, without=["clock_drift"])
    assert all(x.probability < 0.5 for x in found.causes), found.sentence
    share, nats = growth(found.calibrated, found.best, found.best.leaves)
    assert (share, nats) == (pytest.approx(0.8, abs=0.3), pytest.approx(30.0, abs=20.0))
    late = ("sensor_latency", "imu", {"delay": 0.03})
    for kept in (drifts, late):
        named = diagnose_rides([ridden(short(), 25, kept)], NOMINAL)
        assert [(x.effect, x.location) for x in named.effects] == [kept[:2]]
        assert named.causes[0].probability > 0.9
        assert abs(growth(named.calibrated, named.best, named.best.leaves)[0]) < 0.2
    slower = ("clock_drift", "imu", {"rate": -0.002})  # beside tyres, where it seems not to grow
    run = ridden(short(), 27, slower, *ROLLS)
    told = diagnose_any([run], NOMINAL, without=["clock_drift"])
    assert all(x.probability < 0.9 for x in told.causes), told.sentence


def test_no_sensor_is_early_and_no_wheel_goes_further_than_it_rolls(healthy):
    table = RideProblem(NOMINAL, [prepare(healthy, NOMINAL)]).table
    assert NOMINAL.imu is not None
    taken_off = NOMINAL.imu.delay + NOMINAL.imu.group_delay_s
    assert table["lean.sensor_latency.delay"].lower == pytest.approx(-0.005)
    assert table["imu.sensor_latency.delay"].lower == pytest.approx(-0.005 - taken_off)
    assert table["rear_wheel.wheel_slip.coefficient"].lower == 0.0


def test_an_interval_ends_where_another_damping_first_answers_otherwise():
    alike = [False, True, True, True, False, True]
    factors = (0.0, 0.1, 0.6, 1.3, 2.5, 4.0)
    assert furthest(factors, alike, 1.0) == 1.3
    assert furthest(factors[::-1], alike[::-1], -1.0) == 0.1
    assert furthest(factors, [False] * 6, 1.0) == 1.0


def test_a_nuisance_that_went_no_further_than_calibrations_leave_it_is_no_effect():
    problem = SimpleNamespace(base=np.array([1.0]), table=SimpleNamespace(index=lambda name: 0))

    def named(scale):
        wheel = SimpleNamespace(
            effect="wheel_radius",
            location="rear_wheel",
            parameters={"scale": SimpleNamespace(value=scale)},
        )
        found = SimpleNamespace(problem=problem)
        return SimpleNamespace(effects=(wheel,), causes=(wheel,), calibrated=found)

    priors = [Nuisance("rear_wheel.wheel_radius.scale", 0.002, "1")]
    assert not exceeds_calibration(named(1.004), priors)
    assert exceeds_calibration(named(1.012), priors)


def causes(*groups):
    """Causes by number of class; the first of each class is an effect that was found."""
    every = [
        SimpleNamespace(effect=x, location="rear_wheel", group=k)
        for k, g in enumerate(groups)
        for x in g
    ]
    firsts = [next(x for x in every if x.group == k) for k in range(len(groups))]
    return SimpleNamespace(causes=every, effects=firsts)


def test_another_of_the_same_class_stands_for_what_was_found():
    slips = causes(("wheel_slip", "wheel_radius"), ("sensor_latency",))
    assert names_more(causes(("wheel_radius",), ("sensor_latency",), ("sensor_bias",)), slips)
    assert not names_more(causes(("wheel_radius",), ("sensor_bias",), ("sensor_scale",)), slips)
    assert not names_more(causes(("wheel_radius",), ("sensor_latency",)), slips)


def test_a_steer_s_zero_of_two_steps_is_named_beside_a_late_lean():
    zero = ("sensor_bias", "steer", {"offset": -0.006})
    late = ("sensor_latency", "lean", {"delay": 0.08})
    found = diagnose_rides([ridden(short(), 27, zero, late)], NOMINAL)
    assert {(x.effect, x.location) for x in found.effects} == {zero[:2], late[:2]}
    by_effect = {x.effect: x for x in found.effects}
    assert by_effect["sensor_bias"].parameters["offset"].value == pytest.approx(-0.006, abs=0.001)


@pytest.mark.parametrize(
    ("turned", "less", "is_effect"),
    [(0.0088, 7.0, False), (0.0088, 60.0, True), (0.012, 7.0, True)],
)
def test_what_a_nuisance_explains_nearly_as_well_is_no_effect(turned, less, is_effect):
    """A front wheel's radius pitches the frame, as an IMU does that is turned by 3 mrad, one deviation."""
    problem = SimpleNamespace(base=np.zeros(1), table=SimpleNamespace(index=lambda name: 0))
    wheel = SimpleNamespace(effect="wheel_radius", location="front_wheel", parameters={}, gain=47.0)
    mounted = SimpleNamespace(
        effect="sensor_misalignment", location="imu", gain=47.0 - less,
        parameters={"y": SimpleNamespace(value=turned)},
    )  # fmt: skip
    named = SimpleNamespace(
        effects=(wheel,), causes=(wheel, mounted), calibrated=SimpleNamespace(problem=problem)
    )
    assert (
        exceeds_calibration(named, [Nuisance("imu.sensor_misalignment.y", 0.003, "rad")])
        is is_effect
    )


@pytest.mark.parametrize(("signal", "is_asked"), [("imu.accel_y", False), ("imu.gyro_z", True)])
def test_a_signal_that_is_mostly_noise_has_no_scale_to_be_found(healthy, signal, is_asked):
    """In coordinated curves an accelerometer feels nothing across: what is predicted of it has the noise of
    the inclinometer, and fits better with less of it."""
    e = locate_rides([healthy], NOMINAL).evidence
    chosen = list(ride_nuisances(NOMINAL, e.problem))
    c, none = begin(e, split(e.problem, e.noise, e.residual), chosen, {}, 0)
    leaf = next(x for x in candidates_of(c, none, ()).leaves if x.name == f"{signal}.sensor_scale")
    f = fit(c, [leaf], {f"{leaf.name}.scale": 0.98})
    assert f is not None
    assert is_heard(c, f) is is_asked
    assert (float(f.values[0]) < 0.9) is not is_asked


def test_a_nuisance_that_is_to_explain_nothing_stays_where_a_reference_left_it(healthy):
    problem = RideProblem(NOMINAL, [prepare(healthy, NOMINAL)])
    known = [replace(n, mean=2.0 * n.sd) for n in ride_nuisances(NOMINAL, problem)]
    found = locate_rides([healthy], NOMINAL, nuisances=[held_still(n) for n in known])
    for n, f in zip(known, found.nuisances, strict=True):
        assert f.change == pytest.approx(n.mean, abs=0.01 * n.sd), n.name


def test_what_a_road_shakes_above_what_is_judged_is_no_floor(healthy):
    """A rattle of 7 Hz on one axis: the sensor is no louder where rides are judged."""
    table = healthy.table.copy()
    told = table["imu.accel_z"].notna()
    t = table.loc[told, "t"].to_numpy()
    rng = np.random.default_rng(5)
    rattle = sum(
        np.sin(2 * np.pi * f * t + rng.uniform(0.0, 6.3)) for f in np.arange(4.0, 12.0, 0.1)
    )
    table.loc[told, "imu.accel_z"] += 0.05 * rattle
    rough = replace(healthy, table=table)
    ratio = {
        name: {s.signal: s.ratio for s in locate_rides([run], NOMINAL).signals}["imu.accel_z"]
        for name, run in (("calm", healthy), ("rough", rough))
    }
    assert ratio["rough"] > 0.75 * ratio["calm"]


@pytest.mark.parametrize(
    "effect",
    [
        ("front_suspension", "bicycle", {"stiffness": 9e3, "damping": 400.0}),
        ("tyre_compliance", "bicycle", {"stiffness": 4e4, "damping": 200.0}),
    ],
)
def test_a_lively_ride_on_springs_is_the_twin_s(effect):
    """What loads a fork is a product, too: springs that felt softened angles left half of such a gap."""
    rig = NOMINAL.model_dump()
    rig["noise"] = dict.fromkeys(rig["noise"], 0.0)
    rig["bus"]["jitter"] = 0.0
    name, location, parameters = effect
    rig["effects"] = [{"effect": name, "location": location, "parameters": parameters}]
    path = slalom(80.0, 10.0, 8.0)
    ride = simulate_ride(BicycleFile.model_validate(rig), path, 22, cruise=4.5, turning=4.5)
    problem = RideProblem(NOMINAL, [prepare(run_of(ride), NOMINAL)])
    true = problem.table.vector({f"{location}.{name}.{k}": v for k, v in parameters.items()})

    def left(vector):
        residual = problem.residual(vector)
        (x,) = (x for x in problem.series if x.signal == "imu.gyro_y")
        return np.sqrt(np.mean((residual[x.part] ** 2)[problem.kept[x.part]]))

    assert left(true) < 0.1 * left(problem.base)


@pytest.mark.parametrize(("times", "is_as_much"), [(1.5, True), (2.0, False)])
def test_unseen_rides_that_are_left_as_the_seen_ones_are_contradict_nothing(
    healthy, times, is_as_much
):
    """The seen ride is left with 1.5 floors of each signal."""
    problem = RideProblem(NOMINAL, [prepare(healthy, NOMINAL)])
    c = SimpleNamespace(
        problem=problem,
        noise=SimpleNamespace(
            sigma=np.ones(problem.size),
            draws=np.ones((4, problem.size)),
            tamed=lambda _, residual: residual,
        ),
        train=np.ones(problem.size, dtype=bool),
    )
    best = SimpleNamespace(residual=np.full(problem.size, 1.5))
    unseen = Score(problem.signals, 2.0 * times, 2.0 * times, 2.0, 0.0, None)
    assert leaves_as_much(c, best, unseen) is is_as_much
