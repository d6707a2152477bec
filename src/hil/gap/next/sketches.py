"""Motions that might tell candidates apart: drawn from several families, in several bands and sizes.

What splits two effects is not one motion for all: reversals at crawling speed show a lost motion,
accelerations a mass, holds at poses an offset, a known load a scale. So families differ in what they dwell
on, and half of them are joined from two.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.control.trajectory import CueTrajectory
from hil.errors import ConfigError, HilError
from hil.identify.experiments.limits import fitted_scale, trajectory_of
from hil.identify.experiments.multisines import multisine_shape
from hil.identify.experiments.plans import Chirp, Multisine
from hil.identify.experiments.shapes import Grid, Shape, placed, sized, tone_shape
from hil.rigs import Manipulator

Array = NDArray[np.float64]
Rng = np.random.Generator

FADE_S: Final = 1.0
BANDS_HZ: Final = ((0.1, 1.0), (0.3, 2.5), (0.8, 4.0), (2.0, 6.0))
SHARES: Final = (0.25, 0.55, 0.9)
"""Of the limit that is reached first."""
HEIGHTS: Final = (0.03, 0.12, 0.4, 0.85)
"""Of the workspace, for motions whose size is not set by speed."""
SHORTEST_S: Final = 8.0
WAY_BACK_S: Final = 1.0
"""Left at the end for the way to neutral."""


@dataclass(frozen=True, slots=True)
class Sketch:
    """A motion with what it is."""

    kind: str
    text: str
    trajectory: CueTrajectory
    payload_kg: float = 0.0
    """Of what is weighed and bolted on for a second play; 0: it is played once."""

    @property
    def duration_s(self) -> float:
        """Of all plays together."""
        return self.trajectory.duration_s * (2 if self.payload_kg else 1)


def generic_multisine(rig: RigFile, seconds: float, seed: int = 0) -> Sketch:
    """The motion that one takes who asks nothing in particular: all of 0.1 to 3 Hz, half the limits."""
    plan = Multisine(coordinates=tuple(rig.coordinates), f_min=0.1, f_max=3.0, phase_seed=seed,
                     **_one_period(seconds))  # fmt: skip
    return _made(rig, "multisine", "0.1 to 3 Hz", multisine_shape(plan, rig), 0.5)


def draw_sketches(rig: RigFile, seconds: float, count: int, rng: Rng) -> list[Sketch]:
    """`count` motions of about `seconds`, families in turn; those that the rig cannot make are left out."""
    out: list[Sketch] = []
    half = max(0.5 * seconds, SHORTEST_S)
    for k in range(count):
        family = _FAMILIES[k % len(_FAMILIES)]
        try:
            if k % 2 or seconds < 2.0 * SHORTEST_S:
                out.append(family(rig, seconds, rng))
            else:
                other = _FAMILIES[int(rng.integers(len(_FAMILIES)))]
                out.append(_joined(family(rig, half, rng), other(rig, half, rng)))
        except HilError:  # this size of it does not fit the rig
            continue
    return out


def _multisine(rig: RigFile, seconds: float, rng: Rng) -> Sketch:
    low, high = BANDS_HZ[int(rng.integers(len(BANDS_HZ)))]
    share = float(rng.choice(SHARES))
    plan = Multisine(
        coordinates=_some(rig, rng), f_min=low, f_max=high, phase_seed=int(rng.integers(1 << 30)),
        spectrum=str(rng.choice(["position", "velocity", "acceleration"])),
        **_one_period(seconds),
    )  # fmt: skip
    text = f"{low:g} to {high:g} Hz in {', '.join(plan.coordinates)}"
    return _made(rig, "multisine", text, multisine_shape(plan, rig), share)


def _chirp(rig: RigFile, seconds: float, rng: Rng) -> Sketch:
    low, high = BANDS_HZ[int(rng.integers(len(BANDS_HZ)))]
    share = float(rng.choice(SHARES))
    plan = Chirp(
        coordinates=_some(rig, rng, at_once=1), f_min=low, f_max=high, law="log", fade_s=FADE_S,
        duration_s=seconds - 1.0,
    )  # fmt: skip
    text = f"{low:g} to {high:g} Hz in {', '.join(plan.coordinates)}"
    return _made(rig, "chirp", text, tone_shape(plan, rig), share)


def _reversals(rig: RigFile, seconds: float, rng: Rng) -> Sketch:
    """Ramps of constant speed with quick reversals, some after a rest, at places that move."""
    height = float(rng.choice(HEIGHTS))
    ramp_s = float(rng.choice([0.6, 1.2, 2.5, 5.0]))
    rest_s = float(rng.choice([0.0, 0.0, 0.5]))

    def profile(t: Array) -> Array:
        marks, heights = [0.0], [0.0]
        middle = rng.uniform(-0.5, 0.5) * (1.0 - height)
        while marks[-1] < t[-1] - 2.0 * ramp_s:
            side = -1.0 if len(marks) // (2 if rest_s else 1) % 2 else 1.0
            marks.append(marks[-1] + ramp_s * rng.uniform(0.7, 1.3))
            heights.append(middle + height * side * rng.uniform(0.7, 1.0))
            if rest_s:
                marks.append(marks[-1] + rest_s)
                heights.append(heights[-1])
        return _rounded(t, marks, heights, 0.3)

    text = f"ramps of {ramp_s:g} s over {100.0 * height:.0f} % of the workspace"
    text += f", {rest_s:g} s of rest at each end" if rest_s else ""
    return _of_profiles(rig, "slow reversals", text, seconds, rng, profile)


def _holds(rig: RigFile, seconds: float, rng: Rng) -> Sketch:
    """Rest at poses all over the workspace, quick ways between."""
    hold_s = float(rng.choice([0.8, 1.5, 3.0]))
    height = float(rng.choice(HEIGHTS[1:]))
    way_s = float(rng.choice([0.35, 0.6, 1.0]))

    def profile(t: Array) -> Array:
        marks, heights = [0.0], [0.0]
        while marks[-1] < t[-1] - 2.0 * (hold_s + way_s):
            marks += [marks[-1] + hold_s, marks[-1] + hold_s + way_s]
            heights += [heights[-1], height * rng.uniform(-1.0, 1.0)]
        return _rounded(t, marks, heights, way_s)

    text = f"ways of {way_s:g} s, {hold_s:g} s of rest at poses over {100.0 * height:.0f} % of the workspace"
    return _of_profiles(rig, "steps and holds", text, seconds, rng, profile)


_FAMILIES: Final[tuple[Callable[[RigFile, float, Rng], Sketch], ...]] = (
    _reversals, _multisine, _holds, _chirp,
)  # fmt: skip


def _one_period(seconds: float) -> dict[str, object]:
    """A multisine without settling, of so many seconds with its fades and rests."""
    return {
        "period_s": seconds - 2.0 * FADE_S - 1.0, "fade_s": FADE_S, "periods": 1,
        "settle_periods": 0, "realisations": 1, "lines": "full", "draws": 5,
    }  # fmt: skip


def _some(rig: RigFile, rng: Rng, at_once: int | None = None) -> tuple[str, ...]:
    """One coordinate, or several."""
    names = list(rig.coordinates)
    many = at_once or (1 if rng.random() < 0.5 else len(names))
    return tuple(str(n) for n in rng.permutation(names)[:many])


def _of_profiles(
    rig: RigFile, kind: str, text: str, seconds: float, rng: Rng, profile: Callable[[Array], Array]
) -> Sketch:
    """Each chosen coordinate with its own draw of `profile`, in shares of its workspace."""
    grid = Grid(rig)
    moving = _some(rig, rng)
    t = np.arange(round(grid.seconds(seconds - 1.0) * grid.rate_hz)) / grid.rate_hz
    units = np.column_stack([profile(t) for _ in moving])
    if not np.all(np.any(units, axis=0)):
        raise ConfigError(f"{kind}: {seconds:g} s are too short for {text}")
    units = np.concatenate([grid.rest(units[:1]), units, grid.rest(units[-1:])])
    sizes = [rig.limits[rig.coordinates.index(c)] / np.sqrt(len(moving)) for c in moving]
    own = sized(rig, moving, (), units, grid.rate_hz)
    sizes = [min(a, 0.9 * b) for a, b in zip(sizes, own, strict=True)]
    full = placed(rig, moving, units, sizes)
    shape = Shape(moving, tuple(sizes), lambda s: s * full, ())
    return _made(rig, kind, f"{text} in {', '.join(moving)}", shape, 0.9)


def _rounded(t: Array, marks: list[float], heights: list[float], round_s: float) -> Array:
    """Straight lines through marks, back to 0 at the end, corners rounded over `round_s`."""
    end = t[-1] - 2.0 * round_s
    kept = [k for k, mark in enumerate(marks) if mark < end - WAY_BACK_S]
    line = np.interp(
        t - round_s, [*(marks[k] for k in kept), end], [*(heights[k] for k in kept), 0.0]
    )
    n = max(round(round_s * (len(t) - 1) / t[-1]), 3)
    window = np.hanning(n + 2)[1:-1] ** 2
    padded = np.concatenate([np.full(n, line[0]), line, np.full(n, line[-1])])
    return np.convolve(padded, window / window.sum(), "same")[n:-n]


def _made(rig: RigFile, kind: str, text: str, shape: Shape, share: float) -> Sketch:
    scale, _ = fitted_scale(shape, rig, Manipulator(rig), share)
    trajectory = trajectory_of(shape, rig, scale)
    if shape.is_relative:
        text += f" at {100.0 * share:.0f} % of the limits"
    return Sketch(kind, text, trajectory)


def _joined(a: Sketch, b: Sketch) -> Sketch:
    """One after the other: both rest at neutral where they meet."""
    step_s = a.trajectory.step_s
    t = np.concatenate([a.trajectory.t_s, a.trajectory.t_s[-1] + step_s + b.trajectory.t_s])
    poses = np.concatenate([a.trajectory.poses, b.trajectory.poses])
    both = CueTrajectory(a.trajectory.coordinates, t, poses)
    kind = a.kind if a.kind == b.kind else f"{a.kind}, then {b.kind}"
    return Sketch(kind, f"{a.text}; {b.text}", both)
