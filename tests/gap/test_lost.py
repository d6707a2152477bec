"""Lost frames, gathered into bursts: what reaches a drive for longer than a cycle."""

from types import SimpleNamespace

import numpy as np

from hil.gap.fits.lost import GATHER, Burst, at_once, bursts_of, count, replaced

SENT = np.arange(100.0), np.zeros(100)
PIECES = [SimpleNamespace(setpoints={"leg1": SENT, "leg2": SENT})] * 2


def numbers(*frames):
    return np.array(frames, dtype=np.int64)


def test_lost_frames_near_each_other_are_one_burst_and_others_are_not():
    far = 9 + GATHER + 1
    lost = [{"leg1": numbers(), "leg2": numbers(7, 9, far)}, {"leg1": numbers(3, 3 + GATHER)}]
    assert bursts_of(lost, PIECES) == [
        Burst(0, "leg2", 7, 9, 2, 100),
        Burst(0, "leg2", far, far, 1, 100),
        Burst(1, "leg1", 3, 3 + GATHER, 2, 100),
    ]


def test_runs_begin_about_the_first_frame_found_and_end_anywhere_behind_it():
    runs = [run.tolist() for run in Burst(0, "leg1", 50, 53, 2, 100).runs()]
    assert [50, 51, 52] in runs
    assert [49, 50, 51, 52, 53, 54] in runs
    assert all(np.all(np.diff(run) == 1) for run in runs)


def test_the_first_setpoint_always_arrives_and_none_behind_the_last_is_lost():
    assert min(min(run) for run in Burst(0, "leg1", 1, 1, 1, 100).runs() if len(run)) == 1
    assert max(max(run) for run in Burst(0, "leg1", 98, 98, 1, 100).runs() if len(run)) == 99


def test_a_run_takes_the_place_of_its_burst_and_of_nothing_else():
    lost = [{"leg1": numbers(7, 15, 40)}]
    burst = bursts_of(lost, PIECES)[0]
    run = replaced(lost, [(burst, numbers(7, 8, 9))])
    assert run[0]["leg1"].tolist() == [7, 8, 9, 40]
    assert (count(lost), count(run)) == (3, 4)


def test_frames_of_the_same_cycles_are_told_from_those_of_different_ones():
    sent = np.arange(100) * 0.01
    legs = {f"leg{k}": (sent + 0.0003 * k, sent) for k in range(3)}
    pieces = [SimpleNamespace(setpoints=legs)]
    stall = {a: np.array([10, 40, 70]) for a in legs}
    apart = {a: np.array([10 + k, 40 + 3 * k, 70 + 5 * k]) for k, a in enumerate(legs)}
    assert at_once(pieces, [stall], 0.01) == 1.0
    assert at_once(pieces, [apart], 0.01) == 0.0
    assert at_once(pieces, [{"leg0": np.array([3])}], 0.01) == 0.0
