"""Whether a further effect belongs to a set: by all that others leave, or by signals that are its own."""

from types import SimpleNamespace

import numpy as np
import pytest

from hil.gap.fits.fitted import Fit
from hil.gap.search.standing import goes_further

SIGNALS = ("slide.force", "leg2.force", "imu.gyro_x")
NOWHERE = np.zeros(0)


def fit(*left: float) -> Fit:
    """One that leaves so many floors of each of SIGNALS."""
    return Fit((), (), NOWHERE, NOWHERE, NOWHERE, np.array(left), NOWHERE, NOWHERE, ())


def calibrated(*left: float) -> SimpleNamespace:
    """A record that stands so many floors above its twin."""

    def size(problem, residual):
        del problem
        return dict(zip(SIGNALS, np.abs(residual), strict=True))

    noise = SimpleNamespace(weighted_rms=size, usual=size)
    floors = dict.fromkeys(SIGNALS, 1.0)
    return SimpleNamespace(
        problem=None, noise=noise, residual=np.array(left), floors=floors, usual_floors=floors
    )


@pytest.mark.parametrize(
    ("spring", "both", "goes"),
    [
        # a spring of another law leaves much: friction of the slide is seen in the force of that
        ((1.7, 1.2, 2.4), (0.6, 1.2, 2.4), True),
        ((1.7, 1.2, 2.4), (1.4, 1.2, 2.4), False),  # too little of it
        ((1.1, 1.2, 2.4), (0.6, 1.2, 2.4), False),  # it was the spring's
        ((2.6, 1.2, 3.4), (0.6, 1.2, 3.4), False),  # the spring had made it worse
        ((1.7, 1.2, 2.4), (1.7, 1.1, 1.4), True),  # of all that was left
    ],
)
def test_friction_beside_a_spring_is_judged_where_the_spring_explains_little(spring, both, goes):
    c = calibrated(2.0, 2.6, 8.4)
    assert goes_further(c, fit(*spring), fit(*both)) is goes
