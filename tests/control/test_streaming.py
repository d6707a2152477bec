"""A motion known beforehand leaves as cues that look a little ahead."""

import numpy as np
import pytest

from hil.control.streaming import AHEAD_S, cues, motion_of
from hil.control.trajectory import CueTrajectory

LINE = CueTrajectory(("position",), np.linspace(2.0, 4.0, 21), np.linspace(0.0, 1.0, 21)[:, None])


def test_cues_count_from_zero_and_cover_the_motion():
    sent = list(cues(motion_of(LINE), 2.0, 4.0, "me", rate_hz=10.0))
    assert [c.seq for c in sent] == list(range(21))
    assert sent[-1].t_client_s == pytest.approx(2.0)
    assert sent[-1].poses[0].pose == pytest.approx((1.0,))


def test_each_cue_looks_ahead():
    cue = list(cues(motion_of(LINE), 2.0, 4.0, "me", rate_hz=10.0))[10]
    assert [p.dt_s for p in cue.poses] == list(AHEAD_S)
    assert [p.pose[0] for p in cue.poses] == pytest.approx([0.5 + 0.5 * dt for dt in AHEAD_S])


def test_beyond_its_ends_a_motion_stands_still():
    assert motion_of(LINE)(np.array([0.0, 9.0])).ravel() == pytest.approx([0.0, 1.0])
