"""What an accelerometer at rest says about itself: bias, scale, axes that are not square; no twin is needed.

At rest it feels g in whatever pose, so that many poses tell its errors apart though none of them is known.
Every set of the three effects is fitted on every second rest and scored on the others; the answer is the
smallest set that comes as near to g there as any. Model: "A Robust and Easy to Implement Method for IMU
Calibration without External Equipments" (Tedaldi, Pretto, Menegatti, 2014) [F].
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from hil.bicycle.calibration import straightened
from hil.errors import IdentificationError
from hil.runs import Run

Array = NDArray[np.float64]

WINDOW_S: Final = 1.0
STILL: Final = 2.5
"""Times the spread of the quietest tenth of the windows: a window that spreads by less is at rest."""
APART_RAD: Final = 0.1
"""Between directions of gravity from which on it is another rest."""
FEWEST: Final = 18
"""Rests: half of them must hold nine parameters."""
AS_NEAR: Final = 1.1
"""Ratio of held-out residuals within which the smaller set is taken."""
EFFECTS: Final = {
    "sensor_bias": slice(0, 3), "sensor_scale": slice(3, 6), "sensor_misalignment": slice(6, 9),
}  # fmt: skip
"""With their places in the parameters: m/s² x y z, 1 x y z, rad xy xz yz."""


@dataclass(frozen=True, slots=True)
class Resting:
    """The answer: root mean squares of | |a| - g | on rests that no fit has seen, m/s²."""

    effects: tuple[str, ...]
    parameters: dict[str, Array]
    """(3,) of each of `effects`."""
    before: float
    after: float
    by_set: dict[tuple[str, ...], float]
    """Of every set of effects."""
    rests: int

    @property
    def sentence(self) -> str:
        """What it is, and what it is not."""
        if not self.effects:
            return f"At rest nothing is wrong with it beyond {self.before:.2g} m/s²."
        names = " and ".join(e.removeprefix("sensor_") for e in self.effects)
        alone = {e: self.by_set[(e,)] for e in EFFECTS}
        rest = ", ".join(f"{e.removeprefix('sensor_')} {v:.2g}" for e, v in alone.items())
        return (
            f"{names} bring |a| from {self.before:.2g} to {self.after:.2g} m/s² of g on {self.rests // 2} "
            f"rests that no fit has seen; each alone leaves: {rest}."
        )

    def table(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "effects": list(self.effects), "before": self.before, "after": self.after,
            "parameters": {k: v.tolist() for k, v in self.parameters.items()},
            "by_set": {" + ".join(k): v for k, v in self.by_set.items()}, "rests": self.rests,
        }  # fmt: skip


def diagnose_at_rest(run: Run, gravity: float = 9.80665) -> Resting:
    """Which of EFFECTS the accelerometer of `run` has, from its rests; `gravity` of the place, m/s².

    IdentificationError where there are no three channels or too few different rests.
    """
    names = [f"imu.accel_{a}" for a in "xyz"]
    missing = [n for n in names if n not in run.table.columns]
    if missing:
        raise IdentificationError(f"{run.path.name}: has no {', '.join(missing)}")
    table = run.table[["t", *names]].dropna()
    rests = _rests(table["t"].to_numpy(), table[names].to_numpy())
    if len(rests) < FEWEST:
        raise IdentificationError(
            f"{run.path.name}: holds {len(rests)} different rests, {FEWEST} are needed: "
            "let it lie on more sides"
        )
    seen, unseen = np.vstack(rests[::2]), np.vstack(rests[1::2])
    neutral = np.repeat([0.0, 1.0, 0.0], 3)
    by_set, fitted = {}, {}
    for size in range(len(EFFECTS) + 1):
        for some in itertools.combinations(EFFECTS, size):
            z = _fitted(seen, some, neutral, gravity)
            fitted[some] = z
            by_set[some] = float(np.sqrt(np.mean(_off(unseen, z, gravity) ** 2)))
    best = min(by_set.values())
    chosen = next(s for s in by_set if by_set[s] <= AS_NEAR * best)  # smaller sets come first
    return Resting(
        chosen, {e: fitted[chosen][EFFECTS[e]] for e in chosen}, by_set[()], by_set[chosen], by_set,
        len(rests),
    )  # fmt: skip


def _off(accel: Array, z: Array, g: float) -> Array:
    return np.asarray(np.linalg.norm(straightened(accel, z), axis=1) - g)


def _fitted(accel: Array, some: tuple[str, ...], neutral: Array, g: float) -> Array:
    free = np.concatenate([np.arange(9)[EFFECTS[e]] for e in some] or [np.empty(0, dtype=int)])
    z = np.array(neutral)
    if not len(free):
        return z

    def off(x: Array) -> Array:
        z[free] = x
        return _off(accel, z, g)

    z[free] = least_squares(off, neutral[free], x_scale=np.repeat([0.3, 0.03, 0.02], 3)[free]).x
    return z


def _rests(t: Array, accel: Array) -> list[Array]:
    """Means over still windows (k, 3), those of one rest together, in order of time."""
    width = max(round(WINDOW_S / float(np.median(np.diff(t)))), 2)
    count = len(t) // width
    windows = accel[: count * width].reshape(count, width, 3)
    spread = windows.std(axis=1).max(axis=1)
    if not count:
        return []
    still = spread < STILL * np.quantile(spread, 0.1)
    out: list[list[Array]] = []
    for mean in windows.mean(axis=1)[still]:
        if out and _angle(out[-1][0], mean) < APART_RAD:
            out[-1].append(mean)
        else:
            out.append([mean])
    return [np.array(group) for group in out]


def _angle(a: Array, b: Array) -> float:
    cosine = float(a @ b) / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-12)
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))
