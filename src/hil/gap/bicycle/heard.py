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
below, even half the scale is off by less than a floor [set on rides of tuning seed 1959: of three the
accelerometer across has 1.0 to 1.2 and 3.6, other channels that were asked 18 and more]."""


def is_heard(c: Calibrated, f: Fit) -> bool:
    """Whether every signal whose scale a fit has stands above its noise."""
    p = c.problem
    parts = {
        f"{leaf.name}.scale": [x.part for x in p.series if x.signal == leaf.location]
        for leaf in f.leaves
        if leaf.effect == EFFECT
    }
    names = [name for name, mine in parts.items() if mine]
    columns = sensitivities(c, f.vector, p.measured - f.residual, names)
    for name, column in zip(names, columns.T, strict=True):
        seen = np.concatenate([column[x][c.train[x]] for x in parts[name]])
        if np.sqrt(np.mean(seen**2)) < HEARD:
            return False
    return True
