"""What makes a measured weave differ from the model's: five causes, each fitted, judged on unseen impulses.

Every second impulse at a speed is kept from the fits. A cause's own parameters are fitted to the others, each
within a prior where a calibration or a handbook says how far it may go, and what it takes off the unseen
ones is its shrink: as everywhere, against the floor, here what impulses at one speed differ by.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from hil.bicycle.weave import (
    Impulse,
    SteerControl,
    by_speed,
    distance,
    model_weave,
    speed_reading,
    table_of,
)
from hil.config import BicycleFile
from hil.errors import IdentificationError
from hil.rigs.bicycle import canonical, pack

Array = NDArray[np.float64]

ESTIMATED: Final = 0.25
"""Prior standard deviation, as a share, of inertias and centres of gravity taken from other bicycles [R]."""
BODIES: Final = ("I3.xx", "I3.zz", "I3.xz", "G3.x", "G3.z", "I4", "G4.x")
"""What nobody measured of frame and fork, each as a factor."""
PRIORS: Final[dict[str, dict[str, tuple[float, float]]]] = {
    "steer friction": {"steer_friction": (0.0, 1.0)},
    "parameters": dict.fromkeys(BODIES, (1.0, ESTIMATED)),
    "speed sensor": {"gain": (1.0, 0.3)},
    "motor gain": {"motor": (1.0, 0.3)},
    "steer encoder gain": {"encoder": (1.0, 0.3)},
}
"""By cause, its parameters with where they begin and how far they may go."""
SIGMA: Final = 0.3
"""1/s: what impulses at one speed differ by."""
FELT: Final = 1e-3
"""1/s that a cause must move some eigenvalue by to be judged."""


@dataclass(frozen=True, slots=True)
class WeaveCause:
    """A cause with what it takes away."""

    name: str
    values: dict[str, float]
    train: float
    """Mean distance of the impulses it was fitted to, 1/s."""
    after: float
    """Of those it has not seen."""
    shrink: float | None
    """Part of what could be explained that is gone; None where the cause changes nothing here."""


@dataclass(frozen=True, slots=True)
class WeaveGap:
    """The answer."""

    group: str
    impulses: int
    whole: float
    """Mean distance of all impulses from the nominal model, 1/s; speeds count alike."""
    before: float
    """Of the unseen ones."""
    floor: float
    """What unseen impulses are from the mean of the seen ones at their speed."""
    causes: tuple[WeaveCause, ...]
    """Best first; those that change nothing last."""
    speed_gain: tuple[float, float] | None
    """Gain and offset (m/s) of the speed sensor against the treadmill, where the logs tell."""
    rows: list[dict[str, Any]]
    """By speed, as `table_of`."""

    @property
    def sentence(self) -> str:
        """The answer in words."""
        best, *others = self.causes
        if best.shrink is None or best.shrink < 0.1:
            return "None of the causes takes a tenth of the gap off impulses that it has not seen."
        text = (
            f"Best explained by {best.name}: {self.before:.3f} to {best.after:.3f} 1/s on impulses not seen "
            f"(floor {self.floor:.3f}), {100.0 * best.shrink:.0f} % of what can be explained."
        )
        near = [c.name for c in others if c.shrink is not None and c.shrink > 0.8 * best.shrink]
        if near:
            text += (
                f" {', '.join(near)} come within a fifth of it: the weave alone does not decide."
            )
        dull = [c.name for c in self.causes if c.shrink is None]
        return f"{text} Not excited: {', '.join(dull)}." if dull else text

    def table(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "group": self.group, "impulses": self.impulses, "whole": self.whole, "before": self.before,
            "floor": self.floor, "sentence": self.sentence, "speed_gain": self.speed_gain,
            "causes": [
                {"cause": c.name, "values": c.values, "train": c.train, "after": c.after, "shrink": c.shrink}
                for c in self.causes
            ],
            "rows": self.rows,
        }  # fmt: skip


def diagnose_weave(
    impulses: Sequence[Impulse], rig: BicycleFile, control: SteerControl, group: str = ""
) -> WeaveGap:
    """Rank the causes for impulses of one group; IdentificationError where a speed has but one."""
    kept: dict[float, int] = {}
    seen: list[Impulse] = []
    unseen: list[Impulse] = []
    for i in impulses:
        count = kept.get(i.window.speed, 0)
        kept[i.window.speed] = count + 1
        (unseen if count % 2 else seen).append(i)
    if not unseen or min(kept.values()) < 2:
        raise IdentificationError(
            "every speed needs two impulses or more: one to fit, one to judge by"
        )
    world = _World(rig, control)
    before = world.off(unseen, {})
    floor = _floor(seen, unseen)
    causes = [_weigh(name, world, seen, unseen, before, floor) for name in PRIORS]
    causes.sort(key=lambda c: -np.inf if c.shrink is None else c.shrink, reverse=True)
    try:
        reading = speed_reading(impulses)
    except IdentificationError:
        reading = None
    model = [world.weave(i, {}) for i in impulses]
    return WeaveGap(
        group, len(impulses), world.off(impulses, {}), before, floor, tuple(causes), reading,
        table_of(impulses, model),
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _World:
    """The model with whatever a cause changes."""

    rig: BicycleFile
    control: SteerControl

    def weave(self, i: Impulse, told: Mapping[str, float]) -> complex:
        return self.weaves([i], told)[0]

    def weaves(self, impulses: Sequence[Impulse], told: Mapping[str, float]) -> list[complex]:
        linear = canonical(pack(_rebuilt(self.rig, told)))
        rest = {k: told[k] for k in ("steer_friction", "motor", "encoder") if k in told}
        out = []
        for i in impulses:
            v = i.window.speed
            read = v * told["gain"] if "gain" in told else None
            out.append(model_weave(linear, v, self.control, near=i.weave, read_speed=read, **rest))
        return out

    def off(self, impulses: Sequence[Impulse], told: Mapping[str, float]) -> float:
        model = self.weaves(impulses, told)
        return by_speed(
            [i.window.speed for i in impulses],
            [distance(i.weave, m) for i, m in zip(impulses, model, strict=True)],
        )


def _rebuilt(rig: BicycleFile, told: Mapping[str, float]) -> BicycleFile:
    """The bicycle with frame and fork of other inertia; `told` holds factors of BODIES."""
    m = rig.mass
    share = {name: told.get(name, 1.0) for name in BODIES}
    xx, yy, zz, xz = m.I3
    mass = m.model_copy(
        update={
            "I3": (xx * share["I3.xx"], yy, zz * share["I3.zz"], xz * share["I3.xz"]),
            "G3": (m.G3[0] * share["G3.x"], m.G3[1], m.G3[2] * share["G3.z"]),
            "I4": tuple(x * share["I4"] for x in m.I4),
            "G4": (m.G4[0] * share["G4.x"], m.G4[1], m.G4[2]),
        }
    )
    return rig.model_copy(update={"mass": mass})


def _floor(seen: Sequence[Impulse], unseen: Sequence[Impulse]) -> float:
    """What the mean of the seen impulses at a speed leaves of the unseen ones: no model is nearer."""
    mean = {
        v: complex(np.mean([i.weave for i in seen if i.window.speed == v]))
        for v in {i.window.speed for i in seen}
    }
    return by_speed(
        [i.window.speed for i in unseen], [distance(i.weave, mean[i.window.speed]) for i in unseen]
    )


def _weigh(
    name: str,
    world: _World,
    seen: Sequence[Impulse],
    unseen: Sequence[Impulse],
    before: float,
    floor: float,
) -> WeaveCause:
    prior = PRIORS[name]
    names = list(prior)
    start = np.array([prior[n][0] for n in names])
    spread = np.array([prior[n][1] for n in names])
    weight = np.array(
        [1.0 / np.sqrt(sum(j.window.speed == i.window.speed for j in seen)) for i in seen]
    )
    measured = np.array([i.weave for i in seen])

    def off(x: Array) -> Array:
        model = np.array(world.weaves(seen, dict(zip(names, x.tolist(), strict=True))))
        left = (measured - model) * weight / SIGMA
        return np.concatenate([left.real, left.imag, (x - start) / spread])

    nominal = np.array(world.weaves(seen, {}))
    moved = np.array(
        world.weaves(seen, dict(zip(names, (start + 0.1 * spread).tolist(), strict=True)))
    )
    if np.abs(moved - nominal).max() < FELT:
        values = dict(zip(names, start.tolist(), strict=True))
        return WeaveCause(name, values, world.off(seen, {}), before, None)
    found = least_squares(off, start, x_scale=spread, loss="soft_l1", diff_step=[1e-4])
    values = dict(zip(names, found.x.tolist(), strict=True))
    after = world.off(unseen, values)
    shrink = (before - after) / max(before - floor, 1e-9)
    return WeaveCause(name, values, world.off(seen, values), after, shrink)
