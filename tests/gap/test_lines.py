"""Drives that draw out the forces that they are told, and drives that take them at once."""

import dataclasses

import numpy as np
import pytest

from hil.gap.located.habits import DRAWS
from hil.gap.located.locate import locate
from hil.gap.record.lines import CLEAR, for_lines
from hil.identify.replay import Stretch
from hil.sim import Twin
from tests.gap.test_led import ANSWERED, AXIS, SENT_S, as_frame, pushed
from tests.gap.twin_runs import effect

DRAWING = DRAWS.twin(AXIS, 1.0)
SWINGS = sum(
    a * np.sin(2 * np.pi * f * SENT_S + p)
    for a, f, p in [(60.0, 0.8, 0.0), (40.0, 1.9, 1.0), (30.0, 3.7, 2.0)]
) + 15.0 * np.random.default_rng(3).standard_normal(len(SENT_S))
"""As rough as a loop makes them that hears noise."""


def noisy(rig, *effects):
    """A stretch under forces that swing, answered with the noise of the rig file."""
    piece = pushed(
        rig.model_copy(update={"effects": effects}),
        SWINGS,
        AXIS.noise.position,
        jitter_s=AXIS.bus.jitter,
    )
    t, force = piece.samples["axis.force"]
    force = force + AXIS.noise.force * np.random.default_rng(4).standard_normal(len(t))
    return dataclasses.replace(piece, samples={**piece.samples, "axis.force": (t, force)})


@pytest.mark.parametrize(
    "what",
    [
        (),
        (effect("transport_delay", delay=0.004),),
        (effect("sensor_scale", "axis.force", scale=0.8),),
    ],
    ids=["healthy", "late", "scaled"],
)
def test_answers_say_whether_forces_are_drawn_out(what):
    assert for_lines(AXIS, [noisy(DRAWING, *what)]) > CLEAR
    assert for_lines(AXIS, [noisy(AXIS, *what)]) < 1.0


def test_no_answer_says_nothing():
    piece = noisy(DRAWING)
    silent = dataclasses.replace(piece, samples={"axis.position": ANSWERED["axis.position"]})
    assert for_lines(AXIS, [silent]) == 0.0


def test_a_twin_that_draws_forces_out_leaves_less_of_a_record_of_drives_that_do():
    frame = as_frame(noisy(DRAWING))
    held, drawn = (
        {x.signal: x.before for x in locate(frame, rig).signals} for rig in (AXIS, DRAWING)
    )
    assert drawn["axis.position"] < held["axis.position"]
    assert drawn["axis.force"] < held["axis.force"]


def test_forces_that_drives_take_at_their_ticks_are_not_drawn_out():
    """Answers just where those come are of one setpoint, of the next, or of some of both."""
    rng = np.random.default_rng(5)
    tick, delay = AXIS.bus.position_loop, AXIS.bus.setpoint_delay
    sent = SENT_S + AXIS.bus.jitter * np.abs(rng.standard_normal(len(SENT_S)))
    acts = tick * np.ceil((sent + delay) / tick)
    stamps = {"axis.force": sent[1::2] + 0.0011 + AXIS.bus.answer_delay}
    answers = Twin(AXIS).replay({"axis": (acts - delay, SWINGS)}, stamps, mode="force")
    force = answers["axis.force"] + AXIS.noise.force * rng.standard_normal(len(SENT_S[1::2]))
    samples = {"axis.force": (stamps["axis.force"], force)}
    piece = Stretch("ticks", {"axis": (sent, SWINGS)}, samples, "force")
    assert for_lines(AXIS, [piece]) < -CLEAR
