"""Drives that rest for a tick at each setpoint: whether a record may be one of theirs."""

import numpy as np
import pytest

from hil.gap.located.locate import locate
from hil.gap.located.rests import may_rest, resting_twin, seems_to_rest
from hil.sim import Twin
from tests.gap.twin_runs import AXIS, effect, record

RESTING = resting_twin(AXIS)


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


def test_a_record_of_drives_that_rest_seems_to_be_one():
    assert seems_to_rest(locate(record(rig=RESTING, asked_s=0.004), AXIS))


@pytest.mark.parametrize(
    "what",
    [effect("transport_delay", delay=0.0011), effect("loop_gain", position=0.92)],
    ids=lambda e: e.effect,
)
def test_what_is_late_as_a_drive_that_rests_does_not_seem_to(what):
    assert not seems_to_rest(locate(record(what), AXIS))


def test_only_drives_that_draw_lines_on_arrival_are_asked():
    assert may_rest(AXIS)
    assert not may_rest(RESTING)
    held = AXIS.bus.model_copy(update={"interpolation": "hold"})
    own_clock = AXIS.bus.model_copy(update={"retimed": True})
    assert not any(may_rest(AXIS.model_copy(update={"bus": b})) for b in (held, own_clock))
