"""How far a run may stand from its references."""

from types import SimpleNamespace

import numpy as np
import pytest

from hil.gap.bicycle.nuisances import wheel_nuisances
from hil.gap.bicycle.wheels import TYRES
from hil.gap.diagnose import as_found


def drifted(change: float, sd: float = 1e-6) -> dict[str, float]:
    """Deviation of each wheel nuisance after references that found all of them to be `change`."""
    priors = wheel_nuisances(TYRES)
    found = SimpleNamespace(
        nuisances=tuple(SimpleNamespace(name=n.name, change=change, sd=sd) for n in priors)
    )
    return {n.name: n.sd for n in as_found(found, priors)}


def test_a_tyre_that_creeps_much_on_one_ride_may_creep_half_as_much_on_the_next():
    name = "rear_wheel.drive_slip.per_accel"
    assert drifted(0.012)[name] == pytest.approx(0.006, rel=1e-3)
    assert drifted(-0.012)[name] == pytest.approx(0.006, rel=1e-3)
    assert drifted(0.0)[name] == pytest.approx(0.5 * TYRES.creeps[1], rel=1e-3)


def test_what_a_calibration_sets_right_stays_as_near_however_large_it_was():
    name = "steer.sensor_scale.scale"
    assert drifted(0.1)[name] == pytest.approx(drifted(0.0)[name])
    unsure = drifted(0.0, sd=0.03)[name]
    assert unsure == pytest.approx(np.hypot(0.03, 0.5 * TYRES.turns_by[1]))
