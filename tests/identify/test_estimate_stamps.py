"""Samples stand where their requests arrived, where frames on a busy bus waited for each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hil.config import RigFile
from hil.configfile import load_rig
from hil.identify.estimate.stamps import placed, redrawn
from hil.identify.estimate.traffic import frame_s, played_again
from hil.identify.replay import Stretch
from tests.identify.estimate_data import multisine, play, play_on_bus

FRAME_S = frame_s(500_000)
DELAY_S = 1e-3


def test_a_slot_alone_waits_for_nobody() -> None:
    sent = np.array([0.0, 0.01])
    traffic = played_again(
        [sent], np.empty(0), 500_000, [np.full((2, 2), DELAY_S)], one_queue=False
    )
    assert traffic.controls[0] == pytest.approx(sent + FRAME_S)
    assert traffic.requests[0] == pytest.approx(sent + 2 * FRAME_S)
    assert traffic.answers[0] == pytest.approx(sent + 2 * FRAME_S + DELAY_S)


def test_the_imu_goes_first_and_a_frame_on_the_bus_is_not_interrupted() -> None:
    imu = np.array([0.5 * FRAME_S])  # while the control frame is on the bus
    traffic = played_again([np.zeros(1)], imu, 500_000, [np.full((2, 1), DELAY_S)], one_queue=False)
    assert traffic.controls[0][0] == pytest.approx(FRAME_S)
    assert traffic.requests[0][0] == pytest.approx(4 * FRAME_S)


@pytest.fixture(scope="module")
def rig() -> RigFile:
    return load_rig("motorcycle")


@pytest.fixture(scope="module")
def quiet(rig: RigFile) -> Stretch:
    return play(rig, multisine(rig, 4.0, 0, 3.0), seed=1)


@pytest.mark.parametrize("one_queue", [False, True])
def test_samples_of_a_busy_bus_come_back_to_their_requests(
    rig: RigFile, quiet: Stretch, one_queue: bool
) -> None:
    sent = [quiet.setpoints[a][0] for a in rig.actuator_names]
    rng = np.random.default_rng(2)
    replies = [
        rig.bus.answer_delay + rig.bus.answer_jitter * rng.standard_normal((2, len(t)))
        for t in sent
    ]
    imu = np.arange(sent[0][0], sent[0][-1], 1.0 / 225.0)
    true = played_again(sent, imu, rig.can.bitrate, replies, one_queue=one_queue)
    samples = {}
    for i, a in enumerate(rig.actuator_names):
        for turn, quantity in enumerate(rig.bus.pattern):
            received = true.answers[i][turn :: len(rig.bus.pattern)]
            samples[f"{a}.{quantity}"] = (received, np.zeros(len(received)))
    assert rig.imu is not None
    seen = imu + FRAME_S - rig.imu.group_delay_s
    samples["imu.gyro_x"] = (seen, np.zeros(len(seen)))
    known = rig.model_copy(update={"imu": rig.imu.model_copy(update={"rate": 225.0})})
    piece = replace(quiet, samples=samples)
    (found,) = placed(known, [piece])
    assert found.stamped is piece
    before, after = [], []
    for i, a in enumerate(rig.actuator_names):
        for turn, quantity in enumerate(rig.bus.pattern):
            at = true.requests[i][turn :: len(rig.bus.pattern)] + rig.bus.answer_delay
            before.append(samples[f"{a}.{quantity}"][0] - at)
            after.append(found.samples[f"{a}.{quantity}"][0] - at)
    assert np.abs(np.concatenate(after)).mean() < 0.3 * np.abs(np.concatenate(before)).mean()
    again = redrawn(known, found, np.random.default_rng(3))
    assert again is not None
    assert again.samples.keys() == samples.keys()


def test_stamps_of_a_quiet_bus_are_left_alone(rig: RigFile, quiet: Stretch) -> None:
    (found,) = placed(rig, [quiet])
    assert found is quiet
    assert redrawn(rig, found, np.random.default_rng(0)) is None


def test_setpoints_act_when_the_jumps_of_force_say_and_samples_stand_at_their_requests() -> None:
    axis = load_rig("axis")
    late_s = 2e-5
    piece = play_on_bus(axis, multisine(axis, 10.0, 1, 3.0), late_s=late_s, seed=4)
    sent, _ = piece.setpoints["axis"]
    stamps = piece.samples["axis.force"][0]
    (found,) = placed(axis, [piece])
    assert found.late_s["axis"] == pytest.approx(late_s, abs=4e-6)
    assert found.setpoints["axis"][0] == pytest.approx(sent + found.late_s["axis"], abs=1e-9)
    requests = sent[1::2] + 2 * FRAME_S + axis.bus.answer_delay
    assert found.samples["axis.force"][0] == pytest.approx(requests, abs=1e-9)
    assert np.mean(stamps - requests) > 2e-5
    # the same frames nearly as late again, and samples anywhere between stamps and requests
    again = redrawn(axis, found, np.random.default_rng(0))
    assert again is not None
    assert again.setpoints["axis"][0] == pytest.approx(found.setpoints["axis"][0], abs=1e-9)
    moved = again.samples["axis.force"][0] - requests
    assert 0.0 < np.abs(moved).max() < 6e-5


def test_setpoints_whose_jumps_say_nothing_else_are_taken_as_stamped() -> None:
    axis = load_rig("axis")
    piece = play_on_bus(axis, multisine(axis, 10.0, 1, 3.0), late_s=0.0, seed=5)
    (found,) = placed(axis, [piece])
    assert not found.late_s
