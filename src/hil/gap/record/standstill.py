"""Where a record says nothing of the rig: at rest, friction holds whatever force it was left with.

A drive's integrator may keep its force, creep may let it go; both are friction at rest, within its band, and
depend on laws and history that no rig file holds. So forces are judged while setpoints move, and from a rest
on when they have moved so far that friction has turned. Where the setpoints are forces it is the motion that
says nothing at rest or when it turns: bristles of that friction bend with every force that a loop sets.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from hil.config import RigFile
from hil.identify.replay import Stretch
from hil.sim.twin import lead_w

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SLOW: Final = 2e-4
"""m/s or rad/s: setpoints that move slower stand still."""
SETTLES_S: Final = 0.03
"""After the last move, forces are still those of braking."""
PAUSE_S: Final = 0.1
"""A shorter stop is a reversal."""
LOOSE: Final = 5e-4
"""m or rad: until it has moved so far, what an actuator's stiction and integrator hold is not known."""
AHEAD_S: Final = 0.02
TURN_S: Final = 0.1
"""An actuator that moves by less than LOOSE from so long before to so long after rests or turns round."""
RESTS_S: Final = 0.4
"""From so long on it has rested: somewhere in the band of its friction, and the twin elsewhere in its own."""
FOUND: Final = 5.0
"""Time constants of what leads a twin, until it has found its way from there [R: of a critically damped one,
4 % are left]."""
SAG: Final = 1e-4
SAG_SPREADS: Final = 5.0
"""m or rad beside standard deviations of a position, by which one that is to stand still has sagged."""
SAG_SAMPLES: Final = 5
FADES: Final = 5.0
"""Time constants in which a sag fades, and samples that must show it."""
FEWEST: Final = 50
"""Samples that must be left; a record that hardly moves is judged as it is."""


def at_rest(piece: Stretch, actuator: str, t_s: Array) -> Mask:
    """Which of the instants `t_s` (N,) find the actuator commanded to stand still."""
    t, told = piece.setpoints[actuator]
    if piece.mode != "position" or len(t) < 2:
        return np.zeros(len(t_s), dtype=bool)
    moving = t[1:][np.abs(np.diff(told)) > SLOW * np.maximum(np.diff(t), 1e-6)]
    if not len(moving):
        return np.zeros(len(t_s), dtype=bool)
    k = np.searchsorted(moving, t_s)
    since = t_s - np.where(k > 0, moving[np.maximum(k - 1, 0)], -np.inf)
    until = np.where(k < len(moving), moving[np.minimum(k, len(moving) - 1)], np.inf) - t_s
    out = (since > SETTLES_S) & (until > AHEAD_S) & (since + until > PAUSE_S)
    for first in moving[np.diff(moving, prepend=-np.inf) > PAUSE_S]:
        held = t_s >= first - AHEAD_S
        away = np.abs(told - told[np.searchsorted(t, first) - 1]) > LOOSE
        loose = t[(t >= first) & away]
        out |= held & (t_s < (loose[0] if len(loose) else np.inf))
    return out if np.count_nonzero(~out) >= FEWEST else np.zeros(len(t_s), dtype=bool)


def is_held(piece: Stretch, actuators: Sequence[str], t_s: Array) -> Mask:
    """Which of the instants `t_s` (N,) find one of `actuators` at rest or turning, where forces are set."""
    out = np.zeros(len(t_s), dtype=bool)
    for a in actuators:
        t, x = piece.samples.get(f"{a}.position", (np.empty(0), np.empty(0)))
        if piece.mode != "force" or len(t) < 2:
            continue
        window = 2 * round(TURN_S / float(np.median(np.diff(t)))) + 1
        held = maximum_filter1d(x, window) - minimum_filter1d(x, window) < LOOSE
        edge = np.flatnonzero(np.diff(held.astype(np.int8), prepend=0, append=0))
        for first, end in zip(edge[::2].tolist(), edge[1::2].tolist(), strict=True):
            until = float(t[min(end, len(t) - 1)])
            until += FOUND / lead_w(t) if until - t[first] > RESTS_S else 0.0
            out |= (t_s >= t[first]) & (t_s < until)
    return out if np.count_nonzero(~out) >= FEWEST else np.zeros(len(t_s), dtype=bool)


def sags_s(rig: RigFile, piece: Stretch, actuator: str) -> float:
    """How long from the start of a stretch on an actuator sags under its load; 0 where it does not.

    A drive that is switched on takes the load over from its brake: the position gives way until the
    integrator carries it, and comes back with the time constant of that, speed gain over integral gain.
    """
    drive = next(a for a in rig.actuators if a.name == actuator)
    t, told = piece.setpoints[actuator]
    at, x = piece.samples.get(f"{actuator}.position", (np.empty(0), np.empty(0)))
    if piece.mode != "position" or drive.law == "pd" or drive.integral_gain <= 0.0:
        return 0.0
    moved = np.abs(told - told[0]) > LOOSE
    still = x[at < (t[np.argmax(moved)] if moved.any() else np.inf)] - told[0]
    most = SAG + SAG_SPREADS * float(np.hypot(rig.noise.position, rig.noise.position_step))
    if len(still) < SAG_SAMPLES or np.median(np.sort(np.abs(still))[-SAG_SAMPLES:]) < most:
        return 0.0
    return FADES * drive.speed_gain / drive.integral_gain
