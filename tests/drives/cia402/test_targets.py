"""What a drive is told in mode csv, where the position loop runs in the daemon."""

from __future__ import annotations

import numpy as np
import pytest

from hil.drives.cia402.mapping import Units
from hil.drives.cia402.targets import Targets
from tests.drives.cia402.exchange import rig_of


def test_after_missed_cycles_speed_changes_no_faster_than_the_drive_may():
    rig = rig_of()
    actuator, cycle_s = rig.actuators[0], rig.bus.cycle
    units, targets = Units(actuator), Targets(rig, 0, "velocity")
    begin = units.raw("position", actuator.home)
    targets.idle(round(begin))
    steady = 0.9 * actuator.velocity_max
    told, position, wanted = [], actuator.home, actuator.home
    for cycle in range(400):
        missed = 20 if cycle == 200 else 0  # the drive goes on at its speed meanwhile
        wanted += min(0.5 * actuator.acceleration_max * cycle * cycle_s, steady) * cycle_s
        told.append(
            units.si("velocity", targets.of(wanted, round(units.raw("position", position))))
        )
        position += told[-1] * cycle_s * (1 + missed)
    changes = np.abs(np.diff([0.0, *told]))
    assert changes.max() <= actuator.acceleration_max * cycle_s * 1.0001
    assert changes[200:].max() == pytest.approx(actuator.acceleration_max * cycle_s, rel=1e-3)
    assert told[-1] == pytest.approx(steady, rel=0.02)
    assert wanted - position == pytest.approx(
        steady * (1 - actuator.velocity_ff) / actuator.position_gain, abs=1e-3
    )
