"""Where the client wants the rig to be: its timed poses on our clock, as a smooth function of time.

Cues arrive late by a varying network delay. The client's own time stamps do not vary, so its poses
are placed by those stamps plus the smallest delay seen lately: network jitter never becomes motion.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import Final

import numpy as np
from numpy.typing import NDArray

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
"""Poses closer in time than this are one pose: their difference says nothing about speed."""


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
    """Accepted poses in order of our time, interpolated by cubic Hermite segments.

    A pair of poses that only a jump could join (faster than `velocity_max`) lends no slope to its
    neighbours, so a step in the cue is a step to a resting target and not a kick.
    """

    def __init__(self, velocity_max: Vector, future_s: float) -> None:
        self._velocity_max = velocity_max
        self._future_s = future_s
        self._clock = ClientClock()
        self._times: list[float] = []
        self._poses: list[Vector] = []
        self._edge = (np.zeros_like(velocity_max), np.zeros_like(velocity_max))

    def __len__(self) -> int:
        return len(self._times)

    @property
    def newest_s(self) -> float:
        """Our time of the pose furthest ahead, -inf without one, s."""
        return self._times[-1] if self._times else -np.inf

    def clear(self) -> None:
        """Forget client and poses."""
        self._clock = ClientClock()
        self._times.clear()
        self._poses.clear()

    def add(self, cue: Cue) -> None:
        """Take a validated cue: its poses replace what was planned from its first pose on."""
        offset = self._clock.observe(cue.t_client_s, cue.received_s) + cue.t_client_s
        poses = [p for p in cue.poses if offset + p.dt_s <= cue.received_s + self._future_s]
        if not poses:
            return
        first = offset + poses[0].dt_s - MERGE_S
        keep = bisect_right(self._times, first)
        oldest = bisect_right(self._times, cue.received_s - HISTORY_S)
        oldest = min(oldest, max(keep - 3, 0))
        self._times = self._times[oldest:keep]
        self._poses = self._poses[oldest:keep]
        for pose in poses:
            self._times.append(offset + pose.dt_s)
            self._poses.append(np.asarray(pose.pose, dtype=np.float64))
        self._edge = self._fit_edge()

    def target(self, t_s: float) -> tuple[Vector, Vector, Vector]:
        """Pose, velocity and acceleration wanted at `t_s` on our clock, each (n,). Needs a pose."""
        times = self._times
        i = bisect_right(times, t_s)
        if i == 0:
            zero = np.zeros_like(self._poses[0])
            return self._poses[0].copy(), zero, zero
        if i == len(times):
            return self._beyond(t_s)
        p0, p1 = self._poses[i - 1], self._poses[i]
        h = times[i] - times[i - 1]
        secant = (p1 - p0) / h
        jump = np.abs(secant) > self._velocity_max
        v0 = self._slope(i - 1)
        v1 = self._slope(i)
        u = (t_s - times[i - 1]) / h
        c2 = 3.0 * secant - 2.0 * v0 - v1
        c3 = v0 + v1 - 2.0 * secant
        pose = p0 + h * u * (v0 + u * (c2 + u * c3))
        velocity = v0 + u * (2.0 * c2 + 3.0 * u * c3)
        acceleration = (2.0 * c2 + 6.0 * u * c3) / h
        if jump.any():
            pose = np.where(jump, p0 + (p1 - p0) * u, pose)
            velocity = np.where(jump, 0.0, velocity)
            acceleration = np.where(jump, 0.0, acceleration)
        return pose, velocity, acceleration

    def _secant(self, i: int) -> tuple[Vector, NDArray[np.bool_]]:
        """Mean velocity from pose i to i + 1, and where it may be believed (no jump)."""
        secant = (self._poses[i + 1] - self._poses[i]) / (self._times[i + 1] - self._times[i])
        return secant, np.abs(secant) <= self._velocity_max

    def _slope(self, i: int) -> Vector:
        """Velocity at pose i: derivative of the parabola through it and its neighbours."""
        last = len(self._times) - 1
        if last == 0:
            return np.zeros_like(self._poses[0])
        if i == last:
            return self._edge[0]
        right, right_ok = self._secant(i)
        if i == 0:
            return np.where(right_ok, right, 0.0)
        left, left_ok = self._secant(i - 1)
        hl = self._times[i] - self._times[i - 1]
        hr = self._times[i + 1] - self._times[i]
        mean = (left * hr + right * hl) / (hl + hr)
        one_sided = np.where(left_ok, left, np.where(right_ok, right, 0.0))
        return np.where(left_ok & right_ok, mean, one_sided)

    def _fit_edge(self) -> tuple[Vector, Vector]:
        """Velocity and acceleration at the newest pose: parabola through the last few, by least squares.

        A coordinate's poses from before a jump do not count.
        """
        times = np.array(self._times[-EDGE_POSES:])
        poses = np.array(self._poses[-EDGE_POSES:])
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

    def _beyond(self, t_s: float) -> tuple[Vector, Vector, Vector]:
        velocity, acceleration = self._edge
        ahead = t_s - self._times[-1]
        ta = min(ahead, ACCELERATE_S)
        tv = min(max(ahead - ACCELERATE_S, 0.0), COAST_S - ACCELERATE_S)
        v_end = velocity + acceleration * ta
        pose = self._poses[-1] + ta * (velocity + 0.5 * acceleration * ta) + v_end * tv
        zero = np.zeros_like(pose)
        if ahead > COAST_S:
            return pose, zero, zero
        return pose, v_end, acceleration if ahead <= ACCELERATE_S else zero
