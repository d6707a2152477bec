"""Setpoints act at the ticks of their drive's own clock."""

import numpy as np
import pytest

from hil.bus.load import RECKONED_BITS
from hil.configfile import load_rig
from hil.gap.catalogue.nuisances import default_nuisances
from hil.gap.floor.noise import find_noise
from hil.gap.located.phase import begun
from hil.gap.located.residual import refit
from hil.gap.record.arrivals import find_clocks
from hil.gap.record.fineness import fineness, quiet
from hil.gap.record.latecomers import APART, told_late
from hil.gap.record.problem import Problem
from hil.gap.record.ticks import AtSync, Ticks, acting
from hil.identify.replay import Stretch
from hil.sim import Twin
from tests.gap.twin_runs import AXIS

SENT = np.arange(0.0, 1.0, 0.0101)
TICK = AXIS.bus.position_loop


def acts_s(ticks):
    """When setpoints take effect: the smooth twin adds the delay and half a tick."""
    return acting(AXIS, SENT, ticks) + AXIS.bus.setpoint_delay + 0.5 * TICK


def test_without_a_known_clock_setpoints_stay_where_they_were_sent():
    np.testing.assert_array_equal(acting(AXIS, SENT, None), SENT)


def test_each_acts_at_the_first_tick_after_its_arrival():
    phase_s = 0.0003
    acts = acts_s(Ticks(phase_s, 0.0, 0.0))
    beside = (acts - phase_s) / TICK
    np.testing.assert_allclose(beside, np.round(beside), atol=1e-6)
    wait = acts - (SENT + AXIS.bus.setpoint_delay)
    assert np.all(wait > -1e-9)
    assert np.all(wait < TICK + 1e-9)


def test_a_clock_that_runs_off_takes_its_ticks_along():
    slow = Ticks(0.0, 2e-4, 0.0)
    acts = acts_s(slow)
    beside = (acts - slow.place(SENT)) / TICK
    np.testing.assert_allclose(beside, np.round(beside), atol=2e-3)


@pytest.mark.parametrize("frames", [0, 1, 2])
def test_how_late_a_drives_own_clock_was_started_is_read_from_the_record(frames):
    rig = AXIS.model_copy(update={"bus": AXIS.bus.model_copy(update={"retimed": True})})
    sent = np.arange(0.0, 6.0, rig.bus.cycle)
    told = 0.05 * np.sin(2.0 * np.pi * 0.8 * sent) * np.clip(sent, 0.0, 1.0)
    late_s = frames * RECKONED_BITS / rig.can.bitrate
    answered = sent + rig.bus.answer_delay + 0.0012
    stamps = {"axis.position": answered[::2], "axis.force": answered[1::2]}
    answers = Twin(rig, smooth=True).replay({"axis": (sent + late_s, told)}, stamps)
    samples = {s: (t, answers[s]) for s, t in stamps.items()}
    problem = Problem(rig, [Stretch("late", {"axis": (sent, told)}, samples)])
    clocks = find_clocks(problem)
    assert clocks[0, "axis"].late_s == pytest.approx(late_s)
    left = problem.with_clocks(clocks).residual(problem.base)
    np.testing.assert_allclose(left, 0.0, atol=1e-6)


FAST = load_rig("axis_canopen")


@pytest.mark.parametrize(
    ("late_s", "told_s"),
    [((0.0, 9e-5), (0.0, 9e-5)), ((6e-5, 0.0), (6e-5, 0.0)), ((9e-5, 9e-5), (0.0, 0.0))],
    ids=["second", "first", "both"],
)
def test_starts_that_lie_apart_from_run_to_run_are_told_by_positions(late_s, told_s):
    """What both lag by is a delay of the drive, and no start of its clock."""
    rig = FAST.model_copy(update={"bus": FAST.bus.model_copy(update={"retimed": True})})
    sent = np.arange(0.0, 6.0, rig.bus.cycle)
    rng = np.random.default_rng(4)
    pieces = []
    for k, by_s in enumerate(late_s):
        told = 0.05 * np.sin(2.0 * np.pi * (0.5 + 0.3 * k) * sent) * np.clip(sent, 0.0, 1.0)
        stamps = dict.fromkeys(("axis.position", "axis.force"), sent + rig.bus.answer_delay)
        answers = Twin(rig, smooth=True).replay({"axis": (sent + by_s, told)}, stamps)
        noise = {"axis.position": rig.noise.position, "axis.force": rig.noise.force}
        samples = {
            s: (t, answers[s] + noise[s] * rng.standard_normal(len(t))) for s, t in stamps.items()
        }
        pieces.append(Stretch(f"run{k}", {"axis": (sent, told)}, samples))
    clocks = find_clocks(Problem(rig, pieces))
    found = [clocks[k, "axis"].late_s for k in range(2)]
    np.testing.assert_allclose(found, told_s, atol=1e-5)


@pytest.mark.parametrize("at_sync", [True, False], ids=["sync", "ticks"])
def test_ticks_that_lie_apart_from_run_to_run_are_told_by_positions(at_sync):
    """A drive that was switched off between two runs: its clock stands elsewhere in the bus's cycle."""
    rng = np.random.default_rng(5)
    wait_s = (-1e-4, 1e-4)
    pieces = []
    for k, by_s in enumerate(wait_s):
        due = np.arange(0.0, 8.0, FAST.bus.cycle)
        told = 0.1 * np.sin(2.0 * np.pi * (0.6 + 0.3 * k) * due) * np.clip(due, 0.0, 1.0)
        stamps = dict.fromkeys(("axis.position", "axis.force"), due + FAST.bus.answer_delay)
        sent = due + 5e-5 * rng.standard_normal(len(due))
        acts = due if at_sync else acting(FAST, sent, Ticks(2e-4, 0.0, 0.0))
        own = () if at_sync else ("axis",)
        answers = Twin(FAST, smooth=True).replay({"axis": (acts + by_s, told)}, stamps, ticked=own)
        noise = {"axis.position": 1e-6, "axis.force": 4.0}
        samples = {
            s: (t, answers[s] + noise[s] * rng.standard_normal(len(t))) for s, t in stamps.items()
        }
        pieces.append(Stretch(f"run{k}", {"axis": (sent, told)}, samples))
    problem = Problem(FAST, pieces)
    left = problem.with_clocks(find_clocks(problem)).residual(problem.base)
    lags = []
    for x in problem.series:
        if x.quantity == "position":
            speed = np.gradient(problem.measured[x.part], problem.t_s[x.part])
            lags.append(-float(left[x.part] @ speed) / float(speed @ speed))
    assert abs(lags[1] - lags[0]) < 1e-5


def test_frames_that_are_late_alone_are_counted_once_and_skipped_cycles_are_skipped():
    """One half a cycle late and the next a little: rounded one by one they are a cycle too many."""
    rng = np.random.default_rng(5)
    cycle_s = FAST.bus.cycle
    cycles = np.delete(np.arange(20000), [4000, 12000, 12001])
    sent = cycle_s * (cycles + 0.05 * rng.standard_normal(len(cycles)))
    for k in range(100, 19000, 370):
        sent[k] += 0.6 * cycle_s
        sent[k + 1] += 0.15 * cycle_s
    sent = np.maximum.accumulate(sent)
    regular = AtSync(cycle_s).regular(sent)
    np.testing.assert_allclose(regular, cycle_s * cycles, atol=0.02 * cycle_s)


def at_sync_record(ticks=None, seed=3, late=()):
    """A fast axis whose frames are sent with jitter and act at SYNC, at `ticks` of its drive's own clock; the
    frames numbered `late` act a tick after that."""
    rng = np.random.default_rng(seed)
    due = np.arange(0.0, 12.0, FAST.bus.cycle)
    told = 0.1 * np.sin(2.0 * np.pi * 0.6 * due) * np.clip(due, 0.0, 1.0)
    stamps = dict.fromkeys(("axis.position", "axis.force"), due + FAST.bus.answer_delay)
    acts = np.array(acting(FAST, due, ticks))
    acts[list(late)] += FAST.bus.position_loop
    samples = {}
    own = () if ticks is None else ("axis",)
    made = Twin(FAST, smooth=True).replay({"axis": (acts, told)}, stamps, ticked=own)
    for s, v in made.items():
        noise = 4.0 if s.endswith("force") else 1e-6
        samples[s] = (stamps[s], v + noise * rng.standard_normal(len(v)))
    sent = due + 5e-5 * rng.standard_normal(len(due))
    return Problem(FAST, [Stretch("fast", {"axis": (sent, told)}, samples)])


def worst_n(problem, clocks):
    left = problem.with_clocks(clocks).residual(problem.base)
    part = next(x.part for x in problem.series if x.signal == "axis.force")
    return float(np.std(left[part]))


def test_targets_that_act_at_sync_are_taken_for_regular_however_their_frames_jitter():
    problem = at_sync_record()
    clocks = find_clocks(problem)
    assert clocks == {(0, "axis"): AtSync(FAST.bus.cycle)}
    assert worst_n(problem, clocks) < 4.2 < 0.7 * worst_n(problem, {})


def test_drives_at_sync_whose_jitter_nothing_shows_are_taken_to_keep_step_with_it():
    """Loops as slow as the bus: as they were sent, two would share a tick and the next have none."""
    slow = FAST.model_copy(
        update={"bus": FAST.bus.model_copy(update={"position_loop": 1e-3, "jitter": 5e-5})}
    )
    rng = np.random.default_rng(3)
    due = np.arange(0.0, 8.0, slow.bus.cycle)
    told = 0.05 * np.sin(2.0 * np.pi * 0.6 * due) * np.clip(due, 0.0, 1.0)
    stamps = dict.fromkeys(("axis.position", "axis.force"), due + slow.bus.answer_delay)
    acts_s = due - 0.5 * slow.bus.position_loop  # in step, they wait for no tick
    made = Twin(slow, smooth=True).replay({"axis": (acts_s, told)}, stamps, ticked=["axis"])
    noise = {"axis.position": slow.noise.position, "axis.force": 20.0}
    samples = {s: (t, made[s] + noise[s] * rng.standard_normal(len(t))) for s, t in stamps.items()}
    sent = due + slow.bus.jitter * rng.standard_normal(len(due))
    problem = Problem(slow, [Stretch("slow", {"axis": (sent, told)}, samples)])
    assert find_clocks(problem) == {(0, "axis"): AtSync(slow.bus.cycle)}
    asked = default_nuisances(slow, problem.signals)
    at = problem.with_clocks(find_clocks(problem))
    noise_of = find_noise(at, at.base, rng, count=2)
    best = refit(at, noise_of, asked, begun(at, noise_of, asked))
    delay = next(f for f in best.fitted if f.name == "axis.transport_delay.delay")
    late = next(f for f in best.fitted if f.name == "axis.position.sensor_latency.delay")
    assert delay.change + late.change == pytest.approx(-5e-4, abs=5e-5)


def test_what_sync_leaves_is_no_more_than_the_sensors_noise_has():
    problem = at_sync_record()
    answer = problem.with_clocks({(0, "axis"): AtSync(FAST.bus.cycle)}).predict(problem.base)[0]
    assert fineness(problem, 0, "axis", answer) == pytest.approx(
        quiet(problem, 0, "axis"), abs=0.05
    )


def test_a_drive_that_gets_late_and_is_early_again_has_a_clock_of_its_own():
    ticks = Ticks(1e-4, 3e-5, 0.0)
    problem = at_sync_record(ticks)
    clock = find_clocks(problem)[0, "axis"]
    assert clock.ticks.rate == pytest.approx(3e-5, abs=2e-6)
    assert worst_n(problem, {(0, "axis"): clock}) < 4.5


def test_frames_that_act_a_tick_after_their_fellows_are_told_by_their_kicks():
    late = np.random.default_rng(9).choice(np.arange(1500, 11000), 300, replace=False)
    problem = at_sync_record(late=late)
    (clock,) = find_clocks(problem).values()
    sent = problem.sent[0].setpoints["axis"][0]
    found = set(np.flatnonzero(np.isin(sent, clock.late)))
    assert len(found - set(late)) <= 3
    assert len(found & set(late)) > 250  # others move too slowly, or come one after the other
    assert worst_n(problem, {(0, "axis"): clock}) < 0.25 * worst_n(
        problem, {(0, "axis"): AtSync(FAST.bus.cycle)}
    )


@pytest.mark.parametrize(("late", "other_way", "is_told"), [(60, 0, True), (60, 50, False)])
def test_late_frames_must_outnumber_kicks_the_other_way(late, other_way, is_told):
    """What a frame that comes late never makes tells how often a twin at odds with the record looks so."""
    rng, cycle_s, count = np.random.default_rng(5), 0.002, 4000
    t, sent = (np.arange(4 * count) + 0.5) * cycle_s / 4, np.arange(count) * cycle_s
    kicks = [np.zeros(len(t)) for _ in range(APART)]
    for k in range(count - 1):
        kicks[k % APART][4 * k + 2 : 4 * k + 5] = (30.0, 20.0, 10.0)
    moved = rng.choice(np.arange(10, count - 10, 9), late + other_way, replace=False)
    left = rng.normal(0.0, 1.0, len(t))
    for n, k in enumerate(moved.tolist()):
        left[4 * k + 2 : 4 * k + 5] += np.array((30.0, 20.0, 10.0)) * (1 if n < late else -1)
    told = told_late(t, left, kicks, sent, cycle_s)
    assert (told is not None) == is_told
    if told is not None:
        assert set(np.flatnonzero(told[0])) == set(moved)


def test_frames_of_which_nothing_tells_are_late_as_often_as_those_told():
    problem = at_sync_record(late=np.arange(3, 12000, 5))  # those that meet the frames of an IMU
    (clock,) = find_clocks(problem).values()
    sent = problem.sent[0].setpoints["axis"][0]
    untold = np.isin(sent, clock.untold)
    speed = np.abs(np.gradient(problem.sent[0].setpoints["axis"][1], FAST.bus.cycle))
    judged = (sent > 1.5) & (sent < 11.0)
    assert np.max(speed[untold & judged]) < 0.1 < np.max(speed[judged])
    assert clock.share == pytest.approx(0.2, abs=0.02)
    drawn = clock.drawn(np.random.default_rng(1))
    assert len(drawn.late) - len(clock.late) == pytest.approx(clock.share * untold.sum(), rel=0.1)
    assert set(drawn.late) - set(clock.late) <= set(clock.untold)


def test_a_piece_of_a_record_has_the_late_frames_that_were_sent_in_it():
    synced = AtSync(FAST.bus.cycle, late=(0.003, 0.007))
    sent = np.arange(0.0, 0.01, FAST.bus.cycle)
    whole = acting(FAST, np.round(sent, 6), synced)
    part = acting(FAST, np.round(sent[5:], 6), synced)
    np.testing.assert_allclose(part, whole[5:], atol=1e-12)
    assert np.count_nonzero(np.diff(whole) > 1.1 * FAST.bus.cycle) == 2


def test_targets_that_act_as_they_come_are_left_so():
    rng = np.random.default_rng(4)
    sent = np.arange(0.0, 6.0, FAST.bus.cycle)
    sent += 5e-5 * rng.standard_normal(len(sent))
    told = 0.1 * np.sin(2.0 * np.pi * 0.6 * sent) * np.clip(sent, 0.0, 1.0)
    stamps = dict.fromkeys(("axis.position", "axis.force"), sent + 0.0006)
    answers = Twin(FAST, smooth=True).replay({"axis": (sent, told)}, stamps)
    samples = {s: (stamps[s], v + rng.standard_normal(len(v))) for s, v in answers.items()}
    samples["axis.position"] = (stamps["axis.position"], answers["axis.position"])
    assert find_clocks(Problem(FAST, [Stretch("sent", {"axis": (sent, told)}, samples)])) == {}


@pytest.mark.parametrize(
    ("jitter", "place_s", "within_s"),
    [
        (lambda rng, count: rng.uniform(0.0, 6e-4, count), 3e-4, 5e-5),
        (lambda rng, count: 2e-5 * rng.standard_normal(count), 3e-5, 5e-6),
    ],
    ids=["half of them", "few of them, by microseconds"],
)
def test_frames_that_come_now_before_a_tick_now_after_it_are_none_that_miss_a_sync(
    jitter, place_s, within_s
):
    bus = FAST.bus.model_copy(update={"cycle": 0.004, "position_loop": 0.001})
    rig = FAST.model_copy(update={"bus": bus})
    rng = np.random.default_rng(4)
    sent = np.arange(0.0, 12.0, bus.cycle)
    sent += jitter(rng, len(sent))
    told = 0.1 * np.sin(2.0 * np.pi * 0.6 * sent) * np.clip(sent, 0.0, 1.0)
    stamps = dict.fromkeys(("axis.position", "axis.force"), sent + 0.0006)
    acts = acting(rig, sent, Ticks(bus.setpoint_delay + place_s, 0.0, 0.0))
    samples = {}
    for s, v in (
        Twin(rig, smooth=True).replay({"axis": (acts, told)}, stamps, ticked=("axis",)).items()
    ):
        noise = 4.0 if s.endswith("force") else 1e-6
        samples[s] = (stamps[s], v + noise * rng.standard_normal(len(v)))
    (clock,) = find_clocks(
        Problem(rig, [Stretch("own ticks", {"axis": (sent, told)}, samples)])
    ).values()
    assert isinstance(clock, Ticks)
    place = (clock.place(np.array([6.0]))[0] - bus.setpoint_delay) % bus.position_loop
    assert place == pytest.approx(place_s, abs=within_s)


def resting(duration_s, answers_s):
    """A rig whose drive rests at setpoints, what it is told, with jitter, and when it answers: so long after
    each setpoint came, between the two `answers_s`."""
    rig = AXIS.model_copy(
        update={"bus": AXIS.bus.model_copy(update={"interpolation": "linear_rests"})}
    )
    rng, bus = np.random.default_rng(8), rig.bus
    due = np.arange(0.0, duration_s, bus.cycle)
    sent = due + rng.uniform(0.0, 6e-4, len(due))
    told = 0.05 * np.sin(2.0 * np.pi * 0.8 * sent) * np.clip(sent, 0.0, 1.0)
    after_s = bus.setpoint_delay + bus.answer_delay + rng.uniform(*answers_s, len(due))
    return rig, sent, told, sent + after_s


@pytest.mark.parametrize("shift_s", [0.0, 0.00025, 0.0005, 0.00075])
def test_forces_read_soon_after_setpoints_have_seen_as_much_of_the_drives_tick(shift_s):
    """A drive that rests at each setpoint drops its force for that tick: which answers see it says the place
    of its ticks, wherever those lie."""
    rig, sent, told, answered = resting(6.0, (1e-4, 9e-4))
    made = Twin(rig).replay({"axis": (sent, told)}, {"axis.force": answered})["axis.force"]
    samples = {"axis.force": (answered + shift_s, made)}
    problem = Problem(rig, [Stretch("shifted", {"axis": (sent + shift_s, told)}, samples)])
    at = problem.with_clocks({(0, "axis"): Ticks(shift_s, 0.0, 0.0)})
    assert np.max(np.abs(at.residual(at.base))) < 0.05 * np.ptp(made)


def test_ticks_are_found_where_the_drive_answers_at_other_instants_than_the_rig_file_says():
    rig, sent, told, answered = resting(12.0, (1e-4, 4e-4))
    acts = acting(rig, sent, Ticks(3.6e-4, 0.0, 0.0))
    asked = {"axis.force": answered - 2e-4}
    made = Twin(rig, smooth=True).replay({"axis": (acts, told)}, asked, ticked=("axis",))
    noise = rig.noise.force * np.random.default_rng(9).standard_normal(len(sent))
    samples = {"axis.force": (answered, made["axis.force"] + noise)}
    problem = Problem(rig, [Stretch("late", {"axis": (sent, told)}, samples)])
    (clock,) = find_clocks(problem).values()
    assert clock.place(np.array([6.0]))[0] % TICK == pytest.approx(3.6e-4, abs=3e-5)


def test_kicks_of_one_drive_hide_no_other_drives_ticks():
    """They go through the platform: moved at once, the ticks of all had lain where the strongest has them."""
    rig = load_rig("motorcycle")
    bus = rig.bus.model_copy(update={"position_loop": 0.002})
    rig = rig.model_copy(update={"bus": bus})
    rng = np.random.default_rng(7)
    due = np.arange(0.0, 12.0, bus.cycle)
    shared = bus.jitter * rng.standard_normal(len(due))
    places = {"leg1": 8.5e-4, "leg2": 1.93e-3, "slide": 1.2e-3}
    rates = {"leg1": 1.5e-5, "leg2": -7e-6, "slide": 4e-5}
    sent, told, acts, stamps = {}, {}, {}, {}
    for k, a in enumerate(rig.actuators):
        sent[a.name] = due + k * bus.stagger + shared + 7e-5 * rng.standard_normal(len(due))
        sway = 0.03 * np.sin(2.0 * np.pi * (0.7 + 0.2 * k) * due) * np.clip(due, 0.0, 1.0)
        told[a.name] = a.home + sway
        acts[a.name] = acting(rig, sent[a.name], Ticks(places[a.name], rates[a.name], 0.0))
        stamps[f"{a.name}.force"] = sent[a.name] + bus.setpoint_delay + bus.answer_delay + 3e-4
    setpoints = {a: (acts[a], told[a]) for a in sent}
    made = Twin(rig, smooth=True).replay(setpoints, stamps, ticked=rig.actuator_names)
    noise = {s: rig.noise.force * rng.standard_normal(len(v)) for s, v in made.items()}
    samples = {s: (stamps[s], v + noise[s]) for s, v in made.items()}
    found = find_clocks(
        Problem(rig, [Stretch("coupled", {a: (sent[a], told[a]) for a in sent}, samples)])
    )
    assert set(found) == {(0, a) for a in rig.actuator_names}
    for (_, a), clock in found.items():
        off = clock.place(np.array([6.0]))[0] - places[a] - 6.0 * rates[a]
        off = (off + 0.5 * bus.position_loop) % bus.position_loop - 0.5 * bus.position_loop
        assert abs(off) < 1e-4, a
