"""From a plan to a shape: which coordinates move how, with an amplitude that can still be scaled.

All shapes begin and end at rest. Their times are multiples of the interval in which the bus asks each
quantity of each drive once, so that every period of a periodic one is sampled alike.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Final

import numpy as np

from hil.config import RigFile
from hil.config.rig import ROTATIONS
from hil.errors import ConfigError
from hil.identify.experiments.description import Lines, Segment
from hil.identify.experiments.plans import Chirp, Circle, Heave, Moving, Sweep
from hil.identify.experiments.signals import Array, Motion, chirp, faded, sweep

LONGEST_S: Final = 6.0 * 3600.0
"""Nobody plays a longer motion; a computer may not hold it either."""
REST_S: Final = 0.5
"""Standstill before, between and after motions, s."""
ROWS_HZ: Final = 200.0
FINE_HZ: Final = 1000.0
"""Trajectories have rows at the first rate or a little above; they are integrated at the second."""
CIRCLE_RADIUS_M: Final = 0.25
"""Published: "Towards Simulating a Mid-size Stewart Platform on a Large Hexapod Simulator", III.E [R]."""


@dataclass(frozen=True, slots=True)
class Shape:
    """A motion of which only the size is open."""

    moving: tuple[str, ...]
    amplitude: tuple[float, ...]
    """Of each moving coordinate (or actuator) at scale 1."""
    poses: Callable[[float], Array]
    """Rows (m, n) at a scale, in the rig's coordinates."""
    segments: tuple[Segment, ...]
    period_s: float = 0.0
    lines: tuple[Lines, ...] = ()
    detection: tuple[int, ...] = ()
    is_relative: bool = False
    """Whether scale 1 uses the whole of a coordinate's own limits: no amplitude was given."""


class Grid:
    """Instants of one rig: rows of the trajectory, finer steps between them, the bus's own interval."""

    def __init__(self, rig: RigFile) -> None:
        per_cycle = ceil(ROWS_HZ * rig.bus.cycle - 1.0e-9)
        self.rate_hz = per_cycle / rig.bus.cycle
        self.fine = ceil(FINE_HZ / self.rate_hz - 1.0e-9)
        self.step_s = 1.0 / (self.rate_hz * self.fine)
        self.tick_s = rig.bus.cycle * len(rig.bus.pattern)

    def seconds(self, duration_s: float) -> float:
        """The nearest multiple of the bus's interval, at least one, s; ConfigError beyond LONGEST_S."""
        if not duration_s <= LONGEST_S:
            raise ConfigError(
                f"this motion lasts {duration_s:.3g} s, at most {LONGEST_S:g} s are played: is it asked for "
                "in m, rad and Hz?"
            )
        return max(1, round(duration_s / self.tick_s)) * self.tick_s

    def steps(self, duration_s: float) -> int:
        """Fine steps in `seconds(duration_s)`."""
        return round(self.seconds(duration_s) / self.step_s)

    def rows(self, motion: Motion) -> Array:
        """Positions of a motion at the rows."""
        return motion.p[:: self.fine]

    def rest(self, like: Array, duration_s: float = REST_S) -> Array:
        """Rows of standstill at the last row of `like`."""
        count = round(self.seconds(duration_s) * self.rate_hz)
        return np.repeat(like[-1:], count, axis=0)


def chosen(plan: Moving, rig: RigFile, default: Sequence[str]) -> tuple[str, ...]:
    """Coordinates of the plan, else `default`; ConfigError for one that the rig has not."""
    names = plan.coordinates or tuple(default)
    for name in names:
        if name not in rig.coordinates:
            raise ConfigError(
                f"{rig.name} has no coordinate {name!r}; it has {', '.join(rig.coordinates)}"
            )
    if len(set(names)) < len(names):
        raise ConfigError(f"coordinates: {', '.join(names)} names one twice")
    return names


def preferred(rig: RigFile) -> str:
    """The coordinate that an experiment moves if not told: heave, pitch or the only one."""
    return next((c for c in ("heave", "pitch") if c in rig.coordinates), rig.coordinates[0])


def each(amplitude: Sequence[float], moving: Sequence[str]) -> tuple[float, ...]:
    """One amplitude for each that moves; ConfigError where the numbers do not match."""
    if len(amplitude) not in (1, len(moving)):
        raise ConfigError(
            f"amplitude: {len(amplitude)} values for {len(moving)} that move ({', '.join(moving)}); "
            "give one for all or one each"
        )
    return tuple(amplitude) * (len(moving) // len(amplitude))


def sized(
    rig: RigFile, moving: Sequence[str], asked: Sequence[float], units: Array, rate_hz: float
) -> tuple[float, ...]:
    """Amplitude of each moving coordinate: as asked, else where its own limits are all used.

    `units` (m, k): positions of each at amplitude 1.
    """
    if asked:
        return each(asked, moving)
    limits = np.array([rig.limits, *rig.cue_limits()])
    values, sizes = units, []
    for row in limits:
        peaks = np.max(np.abs(values), axis=0)
        sizes.append([row[rig.coordinates.index(c)] for c in moving] / peaks)
        values = np.gradient(values, 1.0 / rate_hz, axis=0)
    return tuple(np.min(sizes, axis=0).tolist())


def placed(rig: RigFile, moving: Sequence[str], units: Array, amplitude: Sequence[float]) -> Array:
    """Columns of `units` (m, k) times amplitude, at their places among the rig's coordinates (m, n)."""
    poses = np.zeros((len(units), len(rig.coordinates)))
    poses[:, [rig.coordinates.index(c) for c in moving]] = units * np.asarray(amplitude)
    return poses


def tone_shape(plan: Chirp | Sweep | Heave, rig: RigFile) -> Shape:
    """One motion for all coordinates that move: chirp, sweep or sinusoid."""
    grid = Grid(rig)
    moving = chosen(plan, rig, [preferred(rig)])
    fade = grid.steps(plan.fade_s)
    motion, period_s = _tone(plan, grid)
    _check_fades(plan.fade_s, len(motion.a) - 1, fade, grid)
    one = grid.rows(faded(motion, fade, fade))
    units = _framed(np.tile(one[:, None], len(moving)), grid)
    amplitude = sized(rig, moving, plan.amplitude, units, grid.rate_hz)
    full = placed(rig, moving, units, amplitude)
    begin_s = grid.seconds(REST_S) + fade * grid.step_s
    end_s = grid.seconds(REST_S) + (len(motion.a) - 1 - fade) * grid.step_s
    if isinstance(plan, Heave):
        segment = Segment(
            name="sinusoid",
            start_s=begin_s,
            end_s=begin_s + plan.cycles * period_s,
            periods=plan.cycles,
        )
    else:
        segment = Segment(name=plan.kind, start_s=begin_s, end_s=end_s)
    return Shape(
        moving, amplitude, lambda s: s * full, (segment,), period_s, is_relative=not plan.amplitude
    )


def circle_shape(plan: Circle, rig: RigFile) -> Shape:
    """Two coordinates of one kind, cosine and sine at constant speed."""
    grid = Grid(rig)
    moving = chosen(plan, rig, _plane(rig))
    if len(moving) != 2 or len({c in ROTATIONS for c in moving}) != 1:
        raise ConfigError(
            f"circle: needs two coordinates that both are lengths or both angles, got "
            f"{', '.join(moving) or 'none'} ({rig.name} has {', '.join(rig.coordinates)})"
        )
    if len(plan.amplitude) > 1:
        raise ConfigError("circle: amplitude is its radius, one value")
    fade = grid.steps(plan.fade_s)
    w = 2.0 * np.pi / plan.period_s
    round_s = plan.turns * plan.period_s
    t = np.arange(2 * fade + grid.steps(round_s) + 1) * grid.step_s - fade * grid.step_s
    cosine, sine = np.cos(w * t), np.sin(w * t)
    motions = (
        Motion(grid.step_s, -(w**2) * cosine, -w * sine, cosine),
        Motion(grid.step_s, -(w**2) * sine, w * cosine, sine),
    )
    rows = np.column_stack([grid.rows(faded(m, fade, fade)) for m in motions])
    units = _framed(rows, grid)
    asked = plan.amplitude or (() if moving[0] in ROTATIONS else (CIRCLE_RADIUS_M,))
    radius = min(sized(rig, moving, asked, units, grid.rate_hz))
    full = placed(rig, moving, units, (radius, radius))
    begin_s = grid.seconds(REST_S) + fade * grid.step_s
    segment = Segment(name="circle", start_s=begin_s, end_s=begin_s + round_s, periods=plan.turns)
    return Shape(
        moving,
        (radius, radius),
        lambda s: s * full,
        (segment,),
        plan.period_s,
        is_relative=not asked,
    )


def _tone(plan: Chirp | Sweep | Heave, grid: Grid) -> tuple[Motion, float]:
    """The motion without its fades, and its period (0: none), s."""
    if isinstance(plan, Chirp):
        duration_s = grid.seconds(plan.duration_s)
        return chirp(plan.law, plan.f_min, plan.f_max, duration_s, grid.step_s), 0.0
    if isinstance(plan, Sweep):
        held_s = 1.0 / plan.f_min
        rise_s = grid.seconds(held_s + plan.duration_s) - held_s
        return sweep(plan.f_min, plan.f_max, rise_s, grid.step_s), 0.0
    whole_s = 2.0 * grid.seconds(plan.fade_s) + plan.cycles / plan.frequency
    grid.seconds(whole_s)
    whole_s = ceil(whole_s / grid.tick_s - 1.0e-9) * grid.tick_s
    motion = chirp("linear", plan.frequency, plan.frequency, whole_s, grid.step_s)
    return motion, 1.0 / plan.frequency


def _check_fades(fade_s: float, steps: int, fade: int, grid: Grid) -> None:
    if 2 * fade >= steps:
        raise ConfigError(
            f"fade_s: {fade_s:g} s in and out do not fit into {steps * grid.step_s:g} s of motion; "
            "shorten the fade or lengthen the motion"
        )


def _framed(rows: Array, grid: Grid) -> Array:
    """Rows with standstill before and after."""
    return np.concatenate([grid.rest(rows[:1]), rows, grid.rest(rows)])


def _plane(rig: RigFile) -> tuple[str, ...]:
    for pair in (("surge", "sway"), ("pitch", "roll")):
        if set(pair) <= set(rig.coordinates):
            return pair
    return rig.coordinates
