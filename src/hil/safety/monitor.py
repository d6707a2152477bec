"""What comes in is checked against what was asked and what the rig can be.

Each check is one sentence of physics: no actuator is outside its stroke, none is faster than its drive can
move it, each is where it was sent within the drive's known lag, and commanded motion produces measured
motion. Besides, nobody else sends on our identifiers, and the IMU goes on talking.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Final

from hil.config import Actuator, RigFile
from hil.control.cascade import cascade_position_rate
from hil.drives.meaning import FrameMeaning
from hil.frames import Frame
from hil.safety.reactions import Cause, Finding
from hil.safety.trail import Trail
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
        self._told = Trail(MOTION_S + bounds.settle_s)
        self._told_since_s = -inf
        # Speeds told, falling: the first is the fastest of late.
        self._speeds: deque[tuple[float, float]] = deque()
        self._motion_s = -inf
        self._seen = Trail(MOTION_S + bounds.settle_s)
        self._received_s = -inf
        self._fast = 0

    def commanded(self, position_m: float, now_s: float) -> None:
        """A setpoint went out that means this position."""
        told, speeds, b = self._told, self._speeds, self.bounds
        if told.times and now_s - told.times[-1] > b.answer_timeout_s:
            told.clear()
            speeds.clear()
        if told.times:
            speed = abs(position_m - told.values[-1]) / b.cycle_s
            while speeds and speeds[-1][1] <= speed:
                speeds.pop()
            speeds.append((now_s, speed))
            while speeds[0][0] < now_s - b.settle_s and len(speeds) > 1:
                speeds.popleft()
        else:
            self._told_since_s = now_s
        told.add(now_s, position_m)

    def position(self, sample: Sample) -> list[Finding]:
        """A position was measured."""
        _, _, value, sampled_s, self._received_s = sample
        b = self.bounds
        found = [] if b.low_m <= value <= b.high_m else self._outside(value)
        found += self._following(value, sampled_s)
        seen = self._seen
        if seen.times:
            since_s = sampled_s - seen.times[-1]
            if since_s < 0.5 * b.cycle_s:
                return found  # too near to tell a speed
            found += self.speed((value - seen.values[-1]) / since_s)
        seen.add(sampled_s, value)
        if sampled_s - self._motion_s >= MOTION_EVERY_S:
            found += self._motion(sampled_s)
        return found

    def speed(self, speed: float) -> Sequence[Finding]:
        """A speed was measured, or follows from two positions."""
        b = self.bounds
        if abs(speed) <= b.speed_max:
            self._fast = 0
            return ()
        self._fast += 1
        if self._fast < OVERSPEED_SAMPLES:
            return ()
        text = f"{b.name} moves at {abs(speed):.3f} /s, {b.speed_max:.3f} /s allowed"
        return (Finding(Cause.OVERSPEED, text),)

    def silence(self, now_s: float) -> Sequence[Finding]:
        """A drive that is being told setpoints must answer its position."""
        b, told_s = self.bounds, self._told.times
        if not told_s or now_s - told_s[-1] > 2.0 * b.cycle_s:
            return ()
        age_s = now_s - max(self._received_s, self._told_since_s)
        if age_s <= b.answer_timeout_s:
            return ()
        text = f"{b.name} has answered no position for {age_s:.3f} s"
        return (Finding(Cause.ANSWERS_LOST, text),)

    def _outside(self, value: float) -> list[Finding]:
        b = self.bounds
        text = f"{b.name} is at {value:.4f}, outside its stroke {b.low_m:g}..{b.high_m:g}"
        return [Finding(Cause.OUTSIDE_STROKE, text)]

    def _following(self, value: float, sampled_s: float) -> Sequence[Finding]:
        """|setpoint − measured| at the sample's instant, less what the drive's lag explains."""
        b, times = self.bounds, self._told.times
        k = len(times) - 1
        while k >= 0 and times[k] > sampled_s:
            k -= 1
        if k < 0 or sampled_s - times[k] > 2.0 * b.cycle_s:
            return ()
        fastest = self._speeds[0][1] if self._speeds else 0.0
        allowed = b.following_m + fastest * b.lag_s
        error = abs(self._told.values[k] - value)
        if error <= allowed:
            return ()
        text = f"{b.name} is {error:.4f} from its setpoint, {allowed:.4f} allowed with its lag"
        return (Finding(Cause.FOLLOWING_ERROR, text),)

    def _motion(self, now_s: float) -> Sequence[Finding]:
        b = self.bounds
        self._motion_s = now_s
        start_s = now_s - MOTION_S - b.settle_s
        commanded = self._told.travel(start_s, now_s - b.settle_s)
        if commanded < b.following_m / MOTION_OF_FOLLOWING:
            return ()
        measured = self._seen.travel(start_s)
        if measured >= MOTION_SHARE * commanded:
            return ()
        text = f"{b.name} was told to move {commanded:.4f} and moved {measured:.4f}"
        return (Finding(Cause.NO_MOTION, text),)


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

    def on_frame(self, frame: Frame) -> Sequence[Finding]:
        """A frame was received; ours never are, so one with an identifier of ours is another master's."""
        if frame.is_error or frame.is_extended or frame.key not in self._ours:
            return ()
        return (Finding(Cause.SECOND_MASTER, f"someone else sent {frame}, an identifier of ours"),)

    def on_sample(self, i: int, sample: Sample) -> Sequence[Finding]:
        """A value of actuator `i` was measured; i beyond the last actuator is the IMU."""
        if i >= len(self.actuators):
            self._imu_s = sample.received_s
        elif sample.quantity == "position":
            return self.actuators[i].position(sample)
        elif sample.quantity == "velocity":
            return self.actuators[i].speed(sample.value)
        return ()

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
