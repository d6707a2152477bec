"""Judges every cue before it may shape motion: accepted, limited by a rule, or refused by a rule.

accepted
limited:future       poses further ahead than cue.future were dropped
limited:workspace    poses outside ± limits were moved onto the limit
limited:velocity     poses ask for more speed than cue.velocity; shaping will lag behind them
refused:malformed    sequence number, times or number of poses make no sense
refused:coordinates  a pose has not one value a coordinate
refused:not_finite   a pose holds NaN or infinity
refused:client       another client is active
refused:duplicate    the sequence number was already seen
refused:order        the sequence number is older than one already seen
refused:time         the client's time did not advance
refused:clock        the client's time is further from zero than any clock's
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

from hil.config import RigFile
from hil.signals import Cue, TimedPose

MOST_POSES: Final = 256
"""More poses than this in one cue would cost the control loop its cycle."""
MOST_CLOCK_S: Final = 1.0e11
"""Three thousand years from zero; there a double still tells 15 µs apart, and differences stay finite."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of a cue. `cue` is what may be shaped, None where it was refused."""

    name: str
    text: str
    cue: Cue | None

    @property
    def is_accepted(self) -> bool:
        """True where the cue (or what limits left of it) may move the rig."""
        return self.cue is not None


class CueGuard:
    """Keeps one client at a time and its sequence in order. `counts` tells verdicts by name."""

    def __init__(self, rig: RigFile) -> None:
        self._coordinates = rig.coordinates
        self._limits = rig.limits
        self._velocity = rig.cue_limits()[0]
        self._future_s = rig.cue.future
        self._stale_s = rig.cue.stale
        self._last: Cue | None = None
        self.counts: Counter[str] = Counter()

    def active_client(self, now_s: float) -> str | None:
        """The client whose cues are followed, None where its last good cue is stale."""
        last = self._last
        if last is None or now_s - last.received_s > self._stale_s:
            return None
        return last.client

    def age_s(self, now_s: float) -> float:
        """Time since the last cue that was not refused, s; inf before the first."""
        return math.inf if self._last is None else now_s - self._last.received_s

    def check(self, cue: Cue, now_s: float) -> Verdict:
        """Judge one cue as it arrives."""
        name, text = self._refusal(cue, now_s)
        if name:
            self.counts[f"refused:{name}"] += 1
            return Verdict(f"refused:{name}", f"cue {cue.seq} of {cue.client}: {text}", None)
        rules: dict[str, str] = {}
        shaped = self._limit(cue, rules)
        self._last = shaped
        if not rules:
            self.counts["accepted"] += 1
            return Verdict("accepted", "", shaped)
        self.counts.update(f"limited:{rule}" for rule in rules)
        rule, text = next(iter(rules.items()))
        return Verdict(f"limited:{rule}", f"cue {cue.seq} of {cue.client}: {text}", shaped)

    def _refusal(self, cue: Cue, now_s: float) -> tuple[str, str]:
        fault = self._shape_fault(cue)
        if fault[0]:
            return fault
        last = self._last if self.active_client(now_s) is not None else None
        if last is None:
            return "", ""
        if cue.client != last.client:
            return "client", f"{last.client} drives the rig; wait until it has stopped"
        if cue.seq == last.seq:
            return "duplicate", "this sequence number was already received"
        if cue.seq < last.seq:
            return "order", f"came after number {last.seq}"
        if cue.t_client_s <= last.t_client_s:
            return "time", f"t = {cue.t_client_s} s is not after {last.t_client_s} s"
        return "", ""

    def _shape_fault(self, cue: Cue) -> tuple[str, str]:
        if isinstance(cue.seq, bool) or not isinstance(cue.seq, int) or cue.seq < 0:
            return "malformed", f"seq must be a whole number from 0, got {cue.seq!r}"
        if not 1 <= len(cue.poses) <= MOST_POSES:
            return "malformed", f"holds {len(cue.poses)} poses, 1 to {MOST_POSES} are allowed"
        before = -1.0e-9
        for timed in cue.poses:
            if not math.isfinite(timed.dt_s) or timed.dt_s <= before:
                return "malformed", f"dt = {timed.dt_s} s: dt starts at 0 or later and increases"
            before = timed.dt_s
            if len(timed.pose) != len(self._coordinates):
                return (
                    "coordinates",
                    f"a pose has {len(timed.pose)} values, this rig needs {self._coordinates}",
                )
            if not all(math.isfinite(value) for value in timed.pose):
                return "not_finite", f"pose {timed.pose} holds a value that is not finite"
        if not math.isfinite(cue.t_client_s) or not math.isfinite(cue.received_s):
            return "malformed", f"t = {cue.t_client_s} is no time"
        if abs(cue.t_client_s) > MOST_CLOCK_S:
            return "clock", f"t = {cue.t_client_s} s lies outside ±{MOST_CLOCK_S} s"
        return "", ""

    def _limit(self, cue: Cue, rules: dict[str, str]) -> Cue:
        poses = tuple(p for p in cue.poses if p.dt_s <= self._future_s) or cue.poses[:1]
        if len(poses) < len(cue.poses) or poses[0].dt_s > self._future_s:
            rules["future"] = f"poses more than {self._future_s} s ahead were dropped"
            poses = tuple(replace(p, dt_s=min(p.dt_s, self._future_s)) for p in poses)
        poses = tuple(self._inside(p, rules) for p in poses)
        limited = replace(cue, poses=poses)
        self._check_speed(limited, rules)
        return limited

    def _inside(self, timed: TimedPose, rules: dict[str, str]) -> TimedPose:
        pose = tuple(
            min(max(value, -limit), limit)
            for value, limit in zip(timed.pose, self._limits, strict=True)
        )
        if pose == timed.pose:
            return timed
        for name, value, limit in zip(self._coordinates, timed.pose, self._limits, strict=True):
            if abs(value) > limit:
                rules["workspace"] = f"{name} = {value} lies outside ±{limit}"
        return TimedPose(timed.dt_s, pose)

    def _check_speed(self, cue: Cue, rules: dict[str, str]) -> None:
        """Speed between successive poses, from the last one of the cue before that came earlier."""
        points = [(cue.t_client_s + p.dt_s, p.pose) for p in cue.poses]
        last = self._last
        if last is not None and last.client == cue.client:
            earlier = [(last.t_client_s + p.dt_s, p.pose) for p in last.poses]
            earlier = [point for point in earlier if point[0] < points[0][0]]
            points = earlier[-1:] + points
        for (t0, p0), (t1, p1) in pairwise(points):
            for k, name in enumerate(self._coordinates):
                speed = abs(p1[k] - p0[k]) / max(t1 - t0, 1.0e-6)
                if speed > self._velocity[k]:
                    rules["velocity"] = (
                        f"{name} at {speed:.4g}/s is faster than {self._velocity[k]:g}/s"
                    )
                    return
