"""Whether rides say anything of a sensor's scale.

What the model predicts of a ride comes from measured signals, and has their noise. A prediction that is
mostly noise fits the better the less is taken of it, whatever the sensor's scale is [M: regression dilution]:
the accelerometer across, which feels nothing in a coordinated curve, wants a tenth of its scale on rides that
hold nothing of the kind.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from hil.gap.fits.fit import sensitivities
from hil.gap.fits.fitted import Calibrated, Fit

EFFECT: Final = "sensor_scale"
HEARD: Final = 2.0
"""Times its noise, what the model predicts of a signal at least (root mean square) for its scale to be asked:
below, even half the scale is off by less than a floor [of healthy rides of the exam's world the accelerometer
across has 1.0 to 1.2 and 3.6, all others 18 and more: tuning seed 1959]."""


def is_heard(c: Calibrated, f: Fit) -> bool:
    """Whether the signal whose scale a fit of one effect has stands above its noise; True of others."""
    (leaf,) = f.leaves
    p = c.problem
    mine = [x for x in p.series if x.signal == leaf.location]
    if leaf.effect != EFFECT or not mine:
        return True
    column = sensitivities(c, f.vector, p.measured - f.residual, f.names)[:, 0]
    rows = np.concatenate([np.flatnonzero(c.train[x.part]) + x.part.start for x in mine])
    return bool(np.sqrt(np.mean(column[rows] ** 2)) > HEARD)
