"""What no number says is over every limit: nothing may pass because it cannot be compared."""

import numpy as np
import pytest

from hil.configfile import load_rig
from hil.control.actuator_limits import ActuatorLimits
from hil.rigs import build_rig


@pytest.mark.parametrize("name", ["axis", "motorcycle", "stewart"])
@pytest.mark.filterwarnings("ignore:invalid value", "ignore:overflow", "ignore:divide by zero")
def test_a_state_that_is_no_number_is_over_the_limits(name):
    rig = load_rig(name)
    limits = ActuatorLimits(rig, build_rig(rig))
    still = np.zeros(len(rig.coordinates))
    assert limits.demand(still, still, still).use <= 1.0
    assert limits.stroke_demand(still).use <= 1.0
    for number in (np.nan, np.inf, -np.inf, 1e300):
        for k in range(len(still)):
            wrong = still.copy()
            wrong[k] = number
            assert limits.demand(still, wrong, still).use > 1.0
            assert limits.demand(still, still, wrong).use > 1.0
            if np.isnan(number):
                assert limits.stroke_demand(wrong).use > 1.0
