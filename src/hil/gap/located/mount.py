"""The mount of an IMU: where its accelerometers swing, as far as a record tells.

A twin's IMU is bolted to a rigid platform. A real one sits on a bracket or a plate that gives, and reads what
that makes of the platform's motion: all that is fast is louder about one frequency, and a little late below
it. No effect of the catalogue does that to an IMU alone; to a twin whose IMU does not swing it looks like
a latency, a scale or something unknown. What it makes of the twin's own answers tells whether a record has
it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import bilinear, lfilter

from hil.config import ImuMount, RigFile
from hil.gap.located.habit import Habit
from hil.gap.located.residual import counted
from hil.gap.located.result import Located

Array = NDArray[np.float64]

AXES: Final = ("imu.accel_x", "imu.accel_y", "imu.accel_z")
SWINGS_HZ: Final = tuple(np.geomspace(30.0, 140.0, 36).tolist())
"""Frequencies that are tried: what is softer is no mount but a loose one, what is stiffer the IMU's own
filter hides [R]."""
DAMPED: Final = (0.03, 0.06, 0.12)
STEP_S: Final = 5e-4
"""Of the grid on which the twin's acceleration is filtered."""
TAKES: Final = 0.3
"""Of the energy that calibration leaves of one, what its mount must take off."""


def mount_of(located: Located) -> Habit | None:
    """The mount that a record shows, as a habit of the rig; None where its IMU does not swing."""
    problem = located.evidence.problem
    rig = problem.rig
    if rig.imu is None or any(rig.imu.mount.frequency):
        return None
    told = {x.signal for x in problem.series if problem.kept[x.part].any()}
    judged = [s for s in AXES if s in told]
    if not judged:
        return None
    vector = _bolted(located)
    rest, traced = problem.residual(vector), problem.traced(vector, judged, STEP_S)
    left = {s: _left(located, s, rest, [(x["t"], x[s]) for x in traced]) for s in judged}
    damping = min(
        range(len(DAMPED)), key=lambda d: sum(float(x[:, d].min()) for x in left.values())
    )
    found = {
        s: SWINGS_HZ[int(np.argmin(x[:, damping]))]
        for s, x in left.items()
        if float(x[:, damping].min()) < 1.0 - TAKES
    }
    if not found:
        return None
    along = [found.get(s, 0.0) for s in AXES]
    return _habit(ImuMount(frequency=(along[0], along[1], along[2]), damping=DAMPED[damping]))


def _bolted(located: Located) -> Array:
    """(P,) what was located, with the IMU's own nuisances where the rig file has them: those stand for some
    of a mount first."""
    e = located.evidence
    table, out = e.problem.table, np.array(e.vector)
    for f in located.nuisances:
        if f.name.startswith("imu."):
            out[table.index(f.name)] = e.problem.base[table.index(f.name)]
    return out


def _left(
    located: Located, signal: str, rest: Array, traced: Sequence[tuple[Array, Array]]
) -> Array:
    """(SWINGS_HZ, DAMPED) of the energy of what calibration leaves of an accelerometer, the share that is
    left with such a mount, nuisances free; `rest` (N,): what an IMU leaves whose own nuisances are none,
    `traced`: of each stretch, instants and the twin's answers there."""
    e = located.evidence
    problem, series = e.problem, [x for x in e.problem.series if x.signal == signal]
    rows = np.concatenate(
        [np.arange(x.part.start, x.part.stop)[problem.kept[x.part]] for x in series]
    )
    sigma = e.noise.sigma[rows]
    columns = e.jacobian[rows] * np.array([f.prior_sd for f in located.nuisances])
    white = e.residual[rows] / sigma
    weight = np.sqrt(counted(white / (1.4826 * float(np.median(np.abs(white))) + 1e-12))) / sigma
    J = columns[:, np.any(columns != 0.0, axis=0)] * weight[:, None]
    Q = np.linalg.qr(J)[0]

    def energy(r: Array) -> float:
        return float(np.sum((r - Q @ (Q.T @ r)) ** 2))

    def change(hz: float, damping: float) -> Array:
        b, a = _swing(hz, damping)
        out = np.zeros(problem.size)
        for x in series:
            t, v = traced[x.stretch]
            moved = lfilter(b, a, v - v[0]) - (v - v[0])
            out[x.part] = np.interp(problem.t_s[x.part], t, moved)
        return np.asarray(out[rows])

    before = max(energy(e.residual[rows] * weight), 1e-300)
    return np.array(
        [
            [energy((rest[rows] - change(hz, d)) * weight) / before for d in DAMPED]
            for hz in SWINGS_HZ
        ]
    )


@cache
def _swing(hz: float, damping: float) -> tuple[Array, Array]:
    """Numerator and denominator, at STEP_S, of what a mount makes of the platform's acceleration."""
    w = 2.0 * np.pi * hz
    b, a = bilinear([2.0 * damping * w, w * w], [1.0, 2.0 * damping * w, w * w], 1.0 / STEP_S)
    return np.asarray(b), np.asarray(a)


def _habit(mount: ImuMount) -> Habit:
    def swinging(rig: RigFile, _: float) -> RigFile:
        assert rig.imu is not None
        return rig.model_copy(update={"imu": rig.imu.model_copy(update={"mount": mount})})

    text = ", ".join(
        f"{hz:.0f} Hz along {axis}" for hz, axis in zip(mount.frequency, "xyz", strict=True) if hz
    )
    return Habit(
        "imu.mount", "an IMU that swings on its mount", lambda rig: rig.imu is not None, swinging,
        lambda _: (
            f"the IMU seems to swing on its mount, at {text}, {100.0 * mount.damping:.0f} % damped: that of "
            "the twin does so; imu.mount belongs into the rig file"
        ),
        asked=lambda _: 1.0,
    )  # fmt: skip
