"""Whether what a twin leaves of a ride follows from how it was ridden, or comes as noise does.

Sensors may wander: noise that lasts for tenths of a second lies where riders move, and no quiet band tells
it. Its size is that of an effect; but it knows nothing of the ride. What an effect leaves does: lean, steer,
speed and what an IMU feels of them say it in advance, on a part of the ride that nothing was learnt from.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.bicycle.problem import RideProblem
from hil.gap.bicycle.twin import LEAN_TORQUE, RideTwin
from hil.gap.floor.noise import NoiseModel

Array = NDArray[np.float64]

PARTS: Final = 5
"""Of a record, each told from the others."""
APART_S: Final = 0.8
"""Between a part and what it is told from: longer than noise lasts."""
HELD: Final = (0.03, 0.3, 3.0)
"""Ridges of the regression, of a standardised feature's variance; the best is taken."""
SHARP: Final = 3.0
"""Of a rate's spread: how soon a sign has changed that play and friction go by."""
OUTLIER: Final = 8.0
"""Floors beyond which a sample counts no more."""
FOLLOWS: Final = 1.1
"""Floors that the motion must say of a signal [set on rides of another world, whose healthy ones have 1.05 at
most, and on used-up rides of seed 623, whose healthy ones have 0.6]."""
ROLL: Final = 1.28
"""The same of the roll rate, for the lean that says it errs just as the roll rate's twin does [healthy rides
of that world have 1.2 at most]."""
SHARE: Final = 0.3
"""Of what is left of a signal, that must be said as well: by chance up to a quarter is [the same rides]."""


def follows(problem: RideProblem, noise: NoiseModel, vector: Array, residual: Array) -> str | None:
    """The signal of which most follows from the ride, in floors of `noise`, if that is more than noise does.

    `residual` (N,) is what the twin left of `problem` at `vector`. The lean torque is not asked: it is
    computed from the motion alone, and follows that when lean and steer err.
    """
    told = [_features(twin, problem.values(vector)) for twin in problem.twins]
    floors = noise.floor(problem)
    best: tuple[float, str] = (1.0, "")
    for signal in problem.signals:
        if signal == LEAN_TORQUE:
            continue
        series = [x for x in problem.series if x.signal == signal]
        left = np.concatenate([residual[x.part] for x in series]) / floors[signal]
        step_s = float(np.median(np.diff(problem.t_s[series[0].part])))
        features = np.concatenate([told[x.stretch] for x in series])
        left = np.clip(left, -OUTLIER, OUTLIER)
        said = _said(features, left, step_s)
        if said**2 > SHARE * float(np.mean(left**2)):
            best = max(best, (said / (ROLL if signal == "imu.gyro_x" else FOLLOWS), signal))
    return best[1] or None


def _said(features: Array, left: Array, step_s: float) -> float:
    """Root mean square of the part of `left` (J,) that `features` (J, F) say in advance; all of it, where a
    ride is too short to learn from."""
    count, gap = len(left), round(APART_S / step_s)
    z = (features - features.mean(axis=0)) / (features.std(axis=0) + 1e-12)
    edges = np.linspace(0, count, PARTS + 1).astype(int)
    gains = np.zeros(len(HELD))
    for start, end in pairwise(edges.tolist()):
        others = np.ones(count, dtype=bool)
        others[max(start - gap, 0) : end + gap] = False
        seen = z[others]
        if len(seen) < z.shape[1]:
            return float(np.sqrt(np.mean(left**2)))
        alike, like = seen.T @ seen / len(seen), seen.T @ left[others] / len(seen)
        for k, held in enumerate(HELD):
            weights = np.linalg.solve(alike + held * np.eye(z.shape[1]), like)
            rest = left[start:end] - z[start:end] @ weights
            gains[k] += float(np.sum(left[start:end] ** 2) - np.sum(rest**2))
    return float(np.sqrt(max(gains.max(), 0.0) / count))


def _features(twin: RideTwin, values: dict[str, float]) -> Array:
    """(J, F) of a ride at its judged rows: lean, steer and speed, their slopes, what the IMU reads, and
    products and signs of them that effects go by."""
    dt_s = twin.recorded.dt_s
    motion = twin.motion(values)

    def slope(x: Array) -> Array:
        return np.asarray(np.gradient(x, dt_s))

    lean, steer = (twin.filtered(twin.recorded.angles[:, k]) for k in (0, 2))
    speed, imu = motion.speed, twin.filtered(motion.imu - motion.imu.mean(axis=0))
    leaning, steering, pulling = slope(lean), slope(steer), slope(speed)
    columns = [lean, leaning, slope(leaning), steer, steering, slope(steering), speed, pulling]
    columns += [*imu.T, *(slope(x) for x in imu.T)]
    columns += [lean**2, steer**2, lean * leaning, lean * steer, lean * pulling, lean * imu[:, 5]]
    columns += [speed * x for x in (lean, leaning, steer, steering)]
    columns += [np.tanh(SHARP * x / max(float(np.std(x)), 1e-12)) for x in (leaning, steering)]
    return np.stack(columns, axis=1)[twin.judged]
