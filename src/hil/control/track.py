"""Where the client wants the rig to be: its timed poses on our clock, as a smooth function of time.

Cues arrive late by a varying network delay. The client's own time stamps do not vary, so its poses
are placed by those stamps plus the smallest delay seen lately: network jitter never becomes motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.control.interpolation import derivatives, evaluate
from hil.signals import Cue

Vector = NDArray[np.float64]

WINDOW_S: Final = 5.0
"""Half the memory of the offset estimate: 100 ppm of clock drift moves it by 0.5 ms in this time."""
ACCELERATE_S: Final = 0.06
"""How long past the last pose its acceleration is believed; then only its velocity."""
COAST_S: Final = 0.12
"""How long past the last pose its velocity is believed; then the target stands still."""
EDGE_POSES: Final = 4
EDGE_S: Final = 0.12
"""Poses whose parabola tells speed and acceleration at the newest: few and young, so that it is now."""
HISTORY_S: Final = 0.5
MERGE_S: Final = 1.0e-4
MERGE_SHARE: Final = 0.25
"""A pose planned earlier and nearer to a new one than this, or than this share of the new cue's own step,
is superseded by it: their difference says nothing about speed."""


class ClientClock:
    """Our time minus the client's: the smallest received - t_client of the last 5 to 10 seconds."""

    def __init__(self) -> None:
        self._older = np.inf
        self._newer = np.inf
        self._since_s = -np.inf

    def observe(self, t_client_s: float, received_s: float) -> float:
        """Take one pair of times, return the offset to add to client times, s."""
        if received_s - self._since_s > WINDOW_S:
            gap = received_s - self._since_s > 2.0 * WINDOW_S
            self._older = np.inf if gap else self._newer
            self._newer = np.inf
            self._since_s = received_s
        self._newer = min(self._newer, received_s - t_client_s)
        return float(min(self._older, self._newer))


class CueTrack:
    """Accepted poses in the client's time, as a motion in ours (`hil.control.interpolation`).

    A pair of poses that only a jump could join (faster than `velocity_max`) lends no slope to its
    neighbours, so a step in the cue is a step to a resting target and not a kick.
    """

    def __init__(self, velocity_max: Vector, future_s: float) -> None:
        self._velocity_max = velocity_max
        self._future_s = future_s
        self.clear()

    def __len__(self) -> int:
        return len(self._times)

    @property
    def newest_s(self) -> float:
        """Our time of the pose furthest ahead, -inf without one, s."""
        return float(self._times[-1]) + self._offset_s if len(self._times) else -np.inf

    def clear(self) -> None:
        """Forget client and poses."""
        n = len(self._velocity_max)
        self._clock = ClientClock()
        self._origin_s = 0.0  # a client that counts from 1970 leaves no digits for microseconds
        self._offset_s = 0.0
        self._times: Vector = np.empty(0)
        self._poses: Vector = np.empty((0, n))
        self._velocity: Vector = np.empty((0, n))
        self._acceleration: Vector = np.empty((0, n))
        self._out = np.empty((3, n))

    def add(self, cue: Cue) -> None:
        """Take a validated cue: its poses replace what was planned from its first pose on.

        A better offset moves the whole motion in time, what is kept of it as well: no two poses come
        to stand beside each other that the client sent apart.
        """
        if not len(self._times):
            self._origin_s = cue.t_client_s
        client_s = cue.t_client_s - self._origin_s
        self._offset_s = self._clock.observe(client_s, cue.received_s)
        now_s = cue.received_s - self._offset_s
        dt_s = np.array([pose.dt_s for pose in cue.poses])
        steps = np.diff(dt_s, prepend=-np.inf)
        new = client_s + dt_s
        usable = (new <= now_s + self._future_s) & (steps >= MERGE_S)
        if not usable.any():
            return
        near = max(MERGE_S, MERGE_SHARE * steps[1]) if len(dt_s) > 1 else MERGE_S
        keep = int(np.searchsorted(self._times, new[0] - near, "right"))
        oldest = int(np.searchsorted(self._times, now_s - HISTORY_S, "right"))
        kept = slice(min(oldest, max(keep - 3, 0)), keep)
        poses = np.array([pose.pose for pose in cue.poses])
        self._times = np.concatenate([self._times[kept], new[usable]])
        self._poses = np.concatenate([self._poses[kept], poses[usable]])
        self._velocity = np.empty_like(self._poses)
        self._acceleration = np.empty_like(self._poses)
        derivatives(
            self._times, self._poses, self._velocity_max, self._velocity, self._acceleration
        )
        self._velocity[-1], self._acceleration[-1] = self._fit_edge()

    def target(self, t_s: float) -> tuple[Vector, Vector, Vector]:
        """Pose, velocity and acceleration wanted at `t_s` on our clock, each (n,). Needs a pose."""
        at_s = t_s - self._offset_s
        if at_s < self._times[0]:
            zero = np.zeros_like(self._poses[0])
            return self._poses[0].copy(), zero, zero
        if at_s >= self._times[-1]:
            return self._beyond(at_s - self._times[-1])
        evaluate(
            self._times,
            self._poses,
            self._velocity,
            self._acceleration,
            self._velocity_max,
            at_s,
            self._out,
        )
        pose, velocity, acceleration = self._out.copy()
        return pose, velocity, acceleration

    def targets(self, times_s: Sequence[float]) -> Vector:
        """`target` at several instants (times, 3, n)."""
        return np.array([self.target(t_s) for t_s in times_s])

    def _fit_edge(self) -> tuple[Vector, Vector]:
        """Velocity and acceleration at the newest pose: parabola through the last few, by least squares.

        A coordinate's poses from before a jump do not count.
        """
        times = self._times[-EDGE_POSES:]
        poses = self._poses[-EDGE_POSES:]
        back = times - times[-1]
        first = int(np.searchsorted(back, -EDGE_S))
        back, poses = back[first:], poses[first:]
        n = poses.shape[1]
        velocity, acceleration = np.zeros(n), np.zeros(n)
        if len(back) < 2:
            return velocity, acceleration
        jumps = np.abs(np.diff(poses, axis=0) / np.diff(back)[:, None]) > self._velocity_max
        since = np.where(jumps, np.arange(1, len(back))[:, None], 0).max(axis=0)
        for first in set(since.tolist()):
            t, same = back[first:], since == first
            p = poses[first:, same] - poses[-1, same]
            if len(t) == 2:
                velocity[same] = p[0] / t[0]
            elif len(t) > 2:
                powers = np.stack([np.ones_like(t), t, 0.5 * t * t], axis=1)
                fit = np.linalg.lstsq(powers, p, rcond=None)[0]
                velocity[same], acceleration[same] = fit[1], fit[2]
        return velocity, acceleration

    def _beyond(self, ahead: float) -> tuple[Vector, Vector, Vector]:
        velocity, acceleration = self._velocity[-1], self._acceleration[-1]
        ta = min(ahead, ACCELERATE_S)
        tv = min(max(ahead - ACCELERATE_S, 0.0), COAST_S - ACCELERATE_S)
        v_end = velocity + acceleration * ta
        pose = self._poses[-1] + ta * (velocity + 0.5 * acceleration * ta) + v_end * tv
        zero = np.zeros_like(pose)
        if ahead > COAST_S:
            return pose, zero, zero
        return pose, v_end, acceleration if ahead <= ACCELERATE_S else zero
