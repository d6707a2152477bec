"""What drives may do unlike the rig file: whether a record may be one of theirs."""

import numpy as np
import pytest

from hil.configfile import load_rig
from hil.gap.located.habit import share_of
from hil.gap.located.habits import BENDS, FEEDS, LOADS, RESTS, TAKES_TIME, TOGETHER, WEIGHS
from hil.gap.located.locate import locate
from hil.sim import Twin
from tests.gap.twin_runs import AXIS, effect, record
from tests.sim.rigs import changed

RESTING = RESTS.twin(AXIS, 1.0)
SWINGING = changed(
    AXIS,
    {"static_ff": 0.997, "integral_gain": 2e4},
    geometry={"load": "pendulum"},
    mass={"m": 95.0, "cog": (0.0, 0.0, -1.0)},
)
"""A load whose static force goes with the pose, on a drive whose integrator is slow."""


def test_the_reference_falls_behind_by_what_the_bus_says():
    sent = np.arange(0.0, 3.0, AXIS.bus.cycle)
    told = 0.02 * sent
    at = np.arange(1.5, 2.5, 0.00025)
    plain, resting = (
        Twin(rig).replay({"axis": (sent, told)}, {"axis.position": at})["axis.position"]
        for rig in (AXIS, RESTING)
    )
    behind_s = float(np.mean(plain - resting)) / 0.02
    assert behind_s == pytest.approx(RESTING.bus.reach_s - AXIS.bus.reach_s, rel=0.02)


def test_a_record_of_drives_that_rest_share_of_be_one():
    assert share_of(RESTS, locate(record(rig=RESTING, asked_s=0.004), AXIS))


@pytest.mark.parametrize(
    "what",
    [effect("transport_delay", delay=0.0011), effect("loop_gain", position=0.92)],
    ids=lambda e: e.effect,
)
def test_what_is_late_as_a_drive_that_rests_does_not_seem_to(what):
    assert not share_of(RESTS, locate(record(what), AXIS))


def test_only_drives_that_draw_lines_on_arrival_are_asked():
    assert RESTS.may(AXIS)
    assert not RESTS.may(RESTING)
    held = AXIS.bus.model_copy(update={"interpolation": "hold"})
    own_clock = AXIS.bus.model_copy(update={"retimed": True})
    assert not any(RESTS.may(AXIS.model_copy(update={"bus": b})) for b in (held, own_clock))


def test_only_drives_in_slots_with_clocks_of_their_own_are_asked_for_a_common_one():
    own_clock = AXIS.bus.model_copy(update={"retimed": True})
    assert TOGETHER.may(load_rig("stewart_pd"))
    assert not TOGETHER.may(load_rig("stewart"))
    assert not TOGETHER.may(AXIS.model_copy(update={"bus": own_clock}))


def test_a_record_of_drives_that_feed_static_force_forward_share_of_be_one():
    assert share_of(FEEDS, locate(record(rig=FEEDS.twin(SWINGING, 1.0)), SWINGING))
    assert not share_of(FEEDS, locate(record(rig=SWINGING), SWINGING))


@pytest.mark.parametrize(
    "what",
    [effect("loop_gain", integral=1.3), effect("payload_mass", "platform", mass=6.0)],
    ids=lambda e: e.effect,
)
def test_what_the_integrator_does_not_do_is_not_fed_forward(what):
    assert not share_of(FEEDS, locate(record(what, rig=SWINGING), SWINGING))


def test_only_cascades_with_a_share_to_feed_are_asked_for_it():
    assert FEEDS.may(SWINGING)
    assert not FEEDS.may(AXIS)
    assert not FEEDS.may(FEEDS.twin(SWINGING, 1.0))
    assert not FEEDS.may(load_rig("stewart_pd"))


def test_what_drives_know_of_legs_is_asked_where_they_feed_static_force_forward():
    assert LOADS.may(load_rig("stewart_pd"))
    assert WEIGHS.may(load_rig("stewart"))
    assert not LOADS.may(load_rig("stewart"))
    assert not WEIGHS.may(AXIS)


FAST = load_rig("axis_canopen")


def test_friction_that_builds_up_within_micrometres_is_seen_on_a_fast_bus():
    found = locate(record(rig=BENDS.twin(FAST, 1.0)), FAST)
    assert 0.7 <= share_of(BENDS, found) <= 1.4
    assert not share_of(BENDS, locate(record(rig=FAST), FAST))


def test_friction_that_builds_up_within_micrometres_is_seen_in_slots_where_a_drive_hardly_moves():
    rubbing = BENDS.twin(AXIS, 1.4)
    assert share_of(BENDS, locate(record(rig=rubbing, share=0.01), AXIS)) >= 1.0
    assert not share_of(BENDS, locate(record(rig=AXIS, share=0.01), AXIS))


def test_only_friction_that_acts_at_once_is_asked_whether_it_bends():
    assert BENDS.may(FAST)
    assert BENDS.may(AXIS)
    assert not BENDS.may(BENDS.twin(FAST, 1.0))


@pytest.mark.parametrize(("rig", "jitter_s"), [(AXIS, 9e-4), (FAST, 0.0)], ids=["slots", "fast"])
def test_loops_that_take_their_time_are_seen_and_so_are_those_that_do_not(rig, jitter_s):
    """In slots where setpoints jitter against the drive's ticks: else as much may be the place of those."""
    asked = {"jitter_s": jitter_s, "duration_s": 28.0 if jitter_s else 14.0}
    late = record(rig=TAKES_TIME.twin(rig, 1.2), **asked)
    assert share_of(TAKES_TIME, locate(late, rig)) == 1.2
    assert not share_of(TAKES_TIME, locate(record(rig=rig, **asked), rig))


@pytest.mark.parametrize(
    "what",
    [effect("transport_delay", delay=0.0012), effect("loop_gain", position=1.15)],
    ids=lambda e: e.effect,
)
def test_what_is_another_lag_or_gain_is_no_loop_that_takes_its_time(what):
    for rig in (AXIS, FAST):
        assert not share_of(TAKES_TIME, locate(record(what, rig=rig), rig))
