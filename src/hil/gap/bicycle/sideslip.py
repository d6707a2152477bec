"""Tyres that slip sideways beside a steer that is told too large: both turn less than they say.

A scale takes the same share of every steer angle; tyres take what they bear across, which grows with the
square of speed. Rides at one speed do not tell the two apart, others do.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.bicycle.beside import beside
from hil.gap.bicycle.problem import RideProblem
from hil.gap.bicycle.twin import RideTwin
from hil.gap.fits.fit import sensitivities
from hil.gap.fits.fitted import Calibrated, Fit, loss, spread_of

Array = NDArray[np.float64]

SCALE: Final = "steer.sensor_scale.scale"
SMALL: Final = 1e-3
"""rad for each m/s² across, for differences: about what hard tyres have."""
LEFT: Final = 0.04
"""Of what the scale takes off, by which tyres must leave more: no form of theirs is known better [set on
rides of two worlds: of three with such tyres none leave more than with a scale, one with a scale 0.075]."""
NATS: Final = 20.0
"""By which they must explain less besides, of samples that count as TEMPER ones."""
TEMPER: Final = 4.0


def slipped(twin: RideTwin, values: Mapping[str, float], per_accel: float) -> Array:
    """(N, 3) the ride's angles as wheels roll that slip `per_accel` (rad per m/s²) of what is felt across."""
    motion, out = twin.motion(values), twin.recorded.angles.copy()
    out[:, 2] += per_accel * motion.speed * motion.qd[:, 2]
    return out


def is_no_slip(c: Calibrated, none: Fit, best: Fit) -> bool:
    """Whether tyres in place of the scale of the steer in `best` would leave much of what it explains.

    In the linear picture at the fit: the scale goes back to 1, and tyres and nuisances take what they can.
    """
    assert isinstance(c.problem, RideProblem)
    scale = dict(zip(best.names, best.values.tolist(), strict=True))[SCALE]
    answer = c.problem.measured - best.residual
    back = sensitivities(c, best.vector, answer, [SCALE])[:, 0]
    moved = c.problem.table[SCALE]
    back = back * (moved.to_search(1.0) - moved.to_search(scale))
    others = [n.name != SCALE for n in c.nuisances]
    rest = (best.white - back)[c.train]
    spread = spread_of(c, best.white)
    tyres, held = _column(c, best)[c.train, None], c.jacobian[:, others][c.train]
    left, _ = beside(rest, tyres, held, best.z[others], spread)
    told = float(np.sum(loss(best.white[c.train] / spread)))
    was = float(np.sum(loss(none.white[c.train] / spread)))
    return left - told > max(LEFT * (was - told), TEMPER * NATS)


def _column(c: Calibrated, best: Fit) -> Array:
    """(N,) whitened change of the answer where tyres slip, for SMALL of it."""
    problem = c.problem
    assert isinstance(problem, RideProblem)
    values = problem.values(best.vector)
    parts = []
    for twin in problem.twins:
        right, wrong = twin.answer(values), twin.answer(values, slipped(twin, values, SMALL))
        parts += [wrong[s] - right[s] for s in twin.signals]
    change = np.concatenate(parts)
    return np.asarray(c.noise.whiten(problem, np.where(np.isfinite(change), change, 0.0)))
