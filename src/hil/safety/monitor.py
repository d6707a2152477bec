"""What comes in is checked against what was asked and what the rig can be.

Each check is one sentence of physics: no actuator is outside its stroke, none is faster than its drive can
move it, each is where it was sent within the drive's known lag, and commanded motion produces measured
motion. Besides, nobody else sends on our identifiers, and the IMU goes on talking.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from math import inf
from typing import Final, NamedTuple

from hil.config import Actuator, RigFile
from hil.control.cascade import cascade_position_rate
from hil.drives.meaning import FrameMeaning
from hil.frames import Frame
from hil.safety.reactions import Cause, Finding
from hil.signals import Sample

OVERSPEED: Final = 1.2
"""Measured speed over velocity_max that no overshoot of a speed loop explains."""
OVERSPEED_SAMPLES: Final = 2
"""So many in a row: one wrong sample makes one wrong speed, two of opposite sign at most."""
SETTLED: Final = 5.0
"""Time constants 1/k_p of the position loop after which the lag of an earlier motion is gone (e⁻⁵)."""
MOTION_S: Final = 0.3
"""Length of commanded motion that is looked at."""
MOTION_OF_FOLLOWING: Final = 6.0
"""Commanded travel that must show in the measurement: following_error over this."""
MOTION_SHARE: Final = 0.1
"""Least share of the commanded travel that must show: friction may eat some of a small motion, not 90 %."""
MOTION_EVERY_S: Final = 0.05
"""How often that is looked at."""
IMU_TIMEOUT_S: Final = 0.5


class _Point(NamedTuple):
    t_s: float
    value: float


@dataclass(frozen=True, slots=True)
class _Bounds:
    """What one actuator's measurements are held to, SI at its output."""

    name: str
    low_m: float
    high_m: float
    speed_max: float
    following_m: float
    lag_s: float
    """How long a loop that works is behind its setpoints: 1/k_p + cycle + setpoint delay."""
    settle_s: float
    """How long until an earlier motion has no more part in the lag."""
    answer_timeout_s: float
    cycle_s: float


def _position_rates(rig: RigFile) -> list[float]:
    """Rate k_p, 1/s, of the loop that brings each actuator to its setpoint: the drive's or the daemon's."""
    if rig.control.mode == "cascade":
        return [cascade_position_rate(rig)] * len(rig.actuators)
    # Law "pd" has a force gain, not a rate: its lag is 1/rate of its two gains' ratio.
    return [
        a.position_gain / (max(a.speed_gain, 1e-9) if a.law == "pd" else 1.0) for a in rig.actuators
    ]


def _bounds(rig: RigFile, actuator: Actuator, rate: float) -> _Bounds:
    bus = rig.bus
    return _Bounds(
        name=actuator.name,
        low_m=actuator.stroke[0],
        high_m=actuator.stroke[1],
        speed_max=OVERSPEED * actuator.velocity_max,
        following_m=rig.safety.following_error,
        lag_s=1.0 / rate + bus.cycle + bus.setpoint_delay,
        settle_s=SETTLED / rate + bus.cycle * (1 + len(bus.pattern)) + bus.setpoint_delay,
        answer_timeout_s=rig.safety.answer_timeout,
        cycle_s=bus.cycle,
    )


class ActuatorMonitor:
    """One actuator: what it was told and what it answered, over the last half second or so."""

    def __init__(self, bounds: _Bounds) -> None:
        self.bounds = bounds
        self._told: deque[_Point] = deque()
        self._speeds: deque[_Point] = deque()  # falling: its first is the fastest of late
        self._motion_s = -inf
        self._seen: deque[_Point] = deque()
        self._received_s: float | None = None
        self._fast = 0

    def commanded(self, position_m: float, now_s: float) -> None:
        """A setpoint went out that means this position."""
        told, speeds, b = self._told, self._speeds, self.bounds
        if told and now_s - told[-1].t_s > b.answer_timeout_s:
            told.clear()
            speeds.clear()
        if told:
            speed = abs(position_m - told[-1].value) / b.cycle_s
            while speeds and speeds[-1].value <= speed:
                speeds.pop()
            speeds.append(_Point(now_s, speed))
            _drop(speeds, now_s - b.settle_s)
        told.append(_Point(now_s, position_m))
        _drop(told, now_s - MOTION_S - b.settle_s)

    def position(self, sample: Sample) -> list[Finding]:
        """A position was measured."""
        _, _, value, sampled_s, self._received_s = sample
        found = self._stroke(value)
        found += self._following(value, sampled_s)
        seen, b = self._seen, self.bounds
        if seen:
            last_s, last = seen[-1]
            if sampled_s - last_s < 0.5 * b.cycle_s:
                return found  # too near to tell a speed
            found += self.speed((value - last) / (sampled_s - last_s))
        seen.append(_Point(sampled_s, value))
        _drop(seen, sampled_s - MOTION_S - b.settle_s)
        if sampled_s - self._motion_s >= MOTION_EVERY_S:
            found += self._motion(sampled_s)
        return found

    def speed(self, speed: float) -> list[Finding]:
        """A speed was measured, or follows from two positions."""
        b = self.bounds
        self._fast = 0 if abs(speed) <= b.speed_max else self._fast + 1
        if self._fast < OVERSPEED_SAMPLES:
            return []
        text = f"{b.name} moves at {abs(speed):.3f} /s, {b.speed_max:.3f} /s allowed"
        return [Finding(Cause.OVERSPEED, text)]

    def silence(self, now_s: float) -> list[Finding]:
        """A drive that is being told setpoints must answer its position."""
        b = self.bounds
        if not self._told or now_s - self._told[-1].t_s > 2.0 * b.cycle_s:
            return []
        age_s = now_s - max(self._received_s or 0.0, self._told[0].t_s)
        if age_s <= b.answer_timeout_s:
            return []
        text = f"{b.name} has answered no position for {age_s:.3f} s"
        return [Finding(Cause.ANSWERS_LOST, text)]

    def _stroke(self, value: float) -> list[Finding]:
        b = self.bounds
        if b.low_m <= value <= b.high_m:
            return []
        text = f"{b.name} is at {value:.4f}, outside its stroke {b.low_m:g}..{b.high_m:g}"
        return [Finding(Cause.OUTSIDE_STROKE, text)]

    def _following(self, value: float, sampled_s: float) -> list[Finding]:
        """|setpoint − measured| at the sample's instant, less what the drive's lag explains."""
        b = self.bounds
        last = next((p for p in reversed(self._told) if p[0] <= sampled_s), None)
        if last is None or sampled_s - last.t_s > 2.0 * b.cycle_s:
            return []
        fastest = self._speeds[0].value if self._speeds else 0.0
        allowed = b.following_m + fastest * b.lag_s
        error = abs(last.value - value)
        if error <= allowed:
            return []
        text = f"{b.name} is {error:.4f} from its setpoint, {allowed:.4f} allowed with its lag"
        return [Finding(Cause.FOLLOWING_ERROR, text)]

    def _motion(self, now_s: float) -> list[Finding]:
        b = self.bounds
        self._motion_s = now_s
        start_s, settled_s = now_s - MOTION_S - b.settle_s, now_s - b.settle_s
        commanded = _travel(p for p in self._told if start_s <= p.t_s <= settled_s)
        if commanded < b.following_m / MOTION_OF_FOLLOWING:
            return []
        measured = _travel(p for p in self._seen if p.t_s >= start_s)
        if measured >= MOTION_SHARE * commanded:
            return []
        text = f"{b.name} was told to move {commanded:.4f} and moved {measured:.4f}"
        return [Finding(Cause.NO_MOTION, text)]


class Monitor:
    """All that comes in from one rig's bus."""

    def __init__(self, rig: RigFile, meaning: FrameMeaning) -> None:
        self.actuators = tuple(
            ActuatorMonitor(_bounds(rig, a, rate))
            for a, rate in zip(rig.actuators, _position_rates(rig), strict=True)
        )
        self._ours = frozenset(meaning.lengths)
        self._has_imu = rig.imu is not None
        self._imu_s: float | None = None

    def on_frame(self, frame: Frame) -> list[Finding]:
        """A frame was received; ours never are, so one with an identifier of ours is another master's."""
        if frame.is_error or frame.is_extended or frame.key not in self._ours:
            return []
        return [Finding(Cause.SECOND_MASTER, f"someone else sent {frame}, an identifier of ours")]

    def on_sample(self, i: int, sample: Sample) -> list[Finding]:
        """A value of actuator `i` was measured; i beyond the last actuator is the IMU."""
        if i >= len(self.actuators):
            self._imu_s = sample.received_s
        elif sample.quantity == "position":
            return self.actuators[i].position(sample)
        elif sample.quantity == "velocity":
            return self.actuators[i].speed(sample.value)
        return []

    def commanded(self, i: int, position_m: float, now_s: float) -> None:
        """The position, m or rad, that what was just sent to drive `i` means, whatever kind it was."""
        self.actuators[i].commanded(position_m, now_s)

    def findings(self, now_s: float) -> list[Finding]:
        """What is wrong because nothing came. Call once a cycle."""
        found = [f for actuator in self.actuators for f in actuator.silence(now_s)]
        if self._imu_s is None:
            self._imu_s = now_s
        if self._has_imu and now_s - self._imu_s > IMU_TIMEOUT_S:
            text = f"the IMU has said nothing for {now_s - self._imu_s:.1f} s"
            found.append(Finding(Cause.IMU_LOST, text))
        return found


def _travel(points: Iterable[_Point]) -> float:
    values = [p.value for p in points]
    return max(values) - min(values) if values else 0.0


def _drop(points: deque[_Point], before_s: float) -> None:
    """Forget what is older, but never the last."""
    while points[0][0] < before_s and len(points) > 1:
        points.popleft()
