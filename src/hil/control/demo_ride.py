"""A ride of one minute as motion cues: lane changes, a curve, braking and accelerating.

The motorcycle is the model for all rigs: lean makes roll; heading follows from lean through
yaw rate = g lean / v, the steady turn of a single-track vehicle at small lean; deceleration tilts
forward (pitch > 0 in R = Rz·Ry·Rx, z up). Amplitudes are chosen for feel [M] and then lowered until
each coordinate keeps a share of the rig's limits of position, velocity, acceleration and jerk.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile

DURATION_S: Final = 60.0
SHARE: Final = 0.6
"""Of each limit that the ride uses: several coordinates move at once and share the actuators."""

_GRAVITY: Final = 9.81
_SPEED: Final = 25.0
"""m/s: 90 km/h, at which lanes are changed [M]."""

_DOUBLET_PEAK: Final = 0.6495190528383290
"""Largest sin 2πu sin²πu, at u = 1/3: 3√3 / 8."""

Array = NDArray[np.float64]
_Track = Callable[[Array], Array]

_AMPLITUDES: Final = {
    "roll": 0.15,
    "yaw": 0.15,  # the heading of a lane change is per rad of lean
    "pitch": 0.10,
    "surge": 0.12,
    "sway": 0.12,
    "heave": 0.02,
    "position": 0.10,
}
"""rad or m; a tenth of a radian is about what a rider leans in a motorway lane change [M]."""

# start (s), duration (s), direction and strength, 1 = as strong as the ride gets
_LANE_CHANGES: Final = ((4.0, 5.0, 1.0), (15.0, 5.0, -1.0), (33.0, 4.5, 0.9), (47.0, 4.5, -0.9))
_CURVES: Final = ((22.0, 9.0, 0.8),)
_BRAKING: Final = ((11.0, 3.5, 0.5), (39.0, 5.0, 1.0), (54.0, 4.5, 0.7))
_ACCELERATING: Final = ((1.0, 4.0, 0.6), (29.0, 4.5, 0.8), (44.0, 5.0, 1.0))


class DemoRide:
    """The ride on one rig: `pose(t_s)` at any time, neutral and at rest before 0 and after 60 s."""

    duration_s = DURATION_S

    def __init__(self, rig: RigFile) -> None:
        self.coordinates = rig.coordinates
        velocity, acceleration, jerk = rig.cue_limits()
        bounds = zip(rig.limits, velocity, acceleration, jerk, strict=True)
        self._gains = np.array(
            [
                _gain(_TRACKS[name], _AMPLITUDES[name], limits)
                for name, limits in zip(rig.coordinates, bounds, strict=True)
            ]
        )

    def pose(self, t_s: float) -> tuple[float, ...]:
        """Pose at `t_s`, in the rig's order of coordinates, rad or m."""
        return tuple(map(float, self.poses(np.array([t_s]))[0]))

    def poses(self, t_s: Array) -> Array:
        """Poses (n, coordinates) at times (n,), rad or m."""
        tracks = [_TRACKS[name](t_s) for name in self.coordinates]
        return np.asarray(np.column_stack(tracks) * self._gains)


def _gain(track: _Track, amplitude: float, limits: Sequence[float]) -> float:
    """`amplitude`, or what keeps `track` and its first three derivatives within SHARE of `limits`."""
    step_s = 1e-3
    values = track(np.arange(0.0, DURATION_S, step_s))
    gain = amplitude
    for limit in limits:
        gain = min(gain, SHARE * limit / float(np.abs(values).max()))
        values = np.diff(values) / step_s
    return gain


def _progress(t_s: Array, start_s: float, duration_s: float) -> Array:
    return np.asarray(np.clip((t_s - start_s) / duration_s, 0.0, 1.0))


def _doublet(u: Array) -> Array:
    """Lean to one side, then to the other: peaks ±1, ends upright with no speed and no jolt."""
    return np.asarray(np.sin(2.0 * np.pi * u) * np.sin(np.pi * u) ** 2 / _DOUBLET_PEAK)


def _bump(u: Array) -> Array:
    """There and back: 0, 1 at half time, 0; three derivatives vanish at the ends."""
    return np.asarray(np.sin(np.pi * u) ** 4)


def _plateau(u: Array) -> Array:
    """Rise over 30 % of the time, hold, fall over 30 %."""
    return _smooth(np.clip(u / 0.3, 0.0, 1.0)) * _smooth(np.clip((1.0 - u) / 0.3, 0.0, 1.0))


def _smooth(x: Array) -> Array:
    """Step from 0 to 1 whose first three derivatives vanish at both ends."""
    return x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3)


def _sum(t_s: Array, manoeuvres: Sequence[tuple[float, float, float]], shape: _Track) -> Array:
    """Each manoeuvre's `shape` over its own progress 0..1, times its strength, added up."""
    total = np.zeros_like(t_s)
    for start_s, duration_s, strength in manoeuvres:
        total = total + strength * shape(_progress(t_s, start_s, duration_s))
    return total


def _lean(t_s: Array) -> Array:
    return _sum(t_s, _LANE_CHANGES, _doublet) + _sum(t_s, _CURVES, _plateau)


def _heading(t_s: Array) -> Array:
    """Integral of the steady turn's yaw rate through each lane change; a curve only turns in.

    ∫ sin 2πu sin²πu du = sin⁴πu / 2π, so a lane change's heading is a bump. A platform cannot keep
    turning: in a curve it shows the onset and washes it out.
    """
    scale = _GRAVITY / _SPEED / (2.0 * np.pi) / _DOUBLET_PEAK
    turns = [(at, d, s * scale * d) for at, d, s in (*_LANE_CHANGES, *_CURVES)]
    return _sum(t_s, turns, _bump)


def _deceleration(t_s: Array) -> Array:
    braking = _sum(t_s, _BRAKING, _plateau)
    return braking - _sum(t_s, _ACCELERATING, lambda u: _plateau(u) * _gear_shifts(u))


def _gear_shifts(u: Array) -> Array:
    """Two short losses of drive while accelerating."""
    return 1.0 - 0.35 * _sum(u, ((0.32, 0.16, 1.0), (0.57, 0.16, 1.0)), _bump)


def _onset(t_s: Array) -> Array:
    """A push at the beginning of each acceleration and braking, washed out by its middle."""
    pulls = [(at, 0.5 * d, -s) for at, d, s in _BRAKING]
    pushes = [(at, 0.5 * d, s) for at, d, s in _ACCELERATING]
    return _sum(t_s, (*pulls, *pushes), _bump)


def _road(t_s: Array) -> Array:
    """Gentle undulations that fade in and out with the ride [M]."""
    waves = np.zeros_like(t_s)
    for hz, height, phase in ((0.31, 1.0, 0.4), (0.83, 0.4, 1.9), (1.7, 0.12, 0.7)):
        waves = waves + height * np.sin(2.0 * np.pi * hz * t_s + phase)
    return waves * _smooth(_progress(t_s, 0.0, 2.0)) * (1.0 - _smooth(_progress(t_s, 58.0, 2.0)))


_TRACKS: Final[dict[str, _Track]] = {
    "roll": _lean,
    "yaw": _heading,
    "pitch": _deceleration,
    "surge": _onset,
    "sway": _heading,
    "heave": _road,
    "position": lambda t_s: _lean(t_s) - 0.6 * _deceleration(t_s),
}
