"""The platform's filter inside the whole daemon, in simulated time."""

from __future__ import annotations

import numpy as np
import pytest

from hil.daemon.records import StateRecord
from tests.daemon.simulated_rig import Session, rig_file


def test_with_its_filter_the_platform_rides_and_parks_without_a_word_from_the_gate():
    session = Session(rig_file("stewart_pd"))
    session.arm()
    session.command("engage")
    session.ride(
        3.0, lambda t: (0.0, 0.0, 0.04 * np.sin(3.0 * t), 0.0, 0.05 * np.sin(5.0 * t), 0.0)
    )
    assert session.core.state in ("ready", "engaged")
    moving = np.array(
        [s.setpoint for s in session.of(StateRecord) if s.setpoint[2] == s.setpoint[2]]
    )
    assert np.ptp(moving[:, 2]) > 0.03
    session.leave()
    assert session.core.state == "parked"
    assert not [name for name in session.events() if name.startswith(("gate", "fault"))]


def test_parking_ends_only_when_the_filters_tail_has_come_out():
    """`parked` means that the setpoints stand still, not that the motion before the filter does."""
    session = Session(rig_file("stewart_pd"))
    session.arm()
    session.ride(2.0, lambda t: (0.0, 0.0, 0.05, 0.0, 0.0, 0.0))
    session.command("park")
    session.wait_for("parked")
    states = session.of(StateRecord)
    first = next(
        i
        for i in range(1, len(states))
        if states[i].state == "parked" and states[i - 1].state == "parking"
    )
    asked = np.array([s.setpoint for s in states[first - 1 : first + 20]])
    asked = asked[~np.isnan(asked).any(axis=1)]
    assert len(asked)
    assert np.abs(asked).max() == pytest.approx(0.0, abs=2.5e-5)
