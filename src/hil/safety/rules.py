"""The gate's rules for setpoints: small functions that say which rule a value breaks.

Every comparison asks for what is allowed (`not value <= bound`), so that NaN is refused. A setpoint is
judged as the drive will run it, which takes one bus cycle for each setpoint that it is given, however late
that came: a position in a straight line from the setpoint before, a speed at once. Time that has gone by
without a setpoint allows nothing: a sender that has missed cycles goes on from where it was, and does not
make up for them in one stroke.

Nor may setpoints come faster than the drive can run them: a sender's schedule has one a cycle, of which
each may leave late by up to a cycle and the next one in time, and so much may the setpoints passed be ahead
of the clock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

from hil.config import RigFile
from hil.drives.meaning import SetpointKind
from hil.safety.rulenames import Rule

SLACK: Final = 1.05
"""Setpoints may exceed velocity_max and acceleration_max by this factor: they are chords of a curve that
was planned to the limits, rounded to the drive's increments."""
AHEAD_CYCLES: Final = 1.25
"""How far the setpoints passed may be ahead of the clock, cycles: one for the latest frame that a sender's
schedule allows before one that is in time, and room for what clocks are rounded to."""


@dataclass(frozen=True, slots=True)
class DriveLimits:
    """What setpoints of one drive must keep to, SI at the actuator's output."""

    name: str
    kind: SetpointKind
    low_m: float
    """Lowest position setpoint: the stroke's lower end plus the margin, m or rad."""
    high_m: float
    velocity_max: float
    acceleration_max: float
    force_max_n: float
    following_error_m: float
    resolution_m: float
    """One increment of the drive's position reference."""


@dataclass(frozen=True, slots=True)
class GateLimits:
    """What the gate holds a rig to."""

    drives: tuple[DriveLimits, ...]
    cycle_s: float
    fresh_s: float
    """A measured position older than this is worth nothing."""


class Measured(NamedTuple):
    """A measured position and when it was received."""

    value: float
    at_s: float


class Passed(NamedTuple):
    """The last setpoint that went out, and how it continues."""

    value: float
    """m or rad; where speeds are sent, the measured position."""
    speed: float
    slot_s: float
    """The latest instant at which it can have been due: the setpoints before it took a cycle each, s."""
    at_s: float
    """When it went out, s."""


class Broken(NamedTuple):
    """A rule that a setpoint breaks, and the sentence that says how."""

    rule: Rule
    text: str


def gate_limits(rig: RigFile, *kinds: SetpointKind) -> GateLimits:
    """The gate's limits from a rig file; `kinds`: what its drives are sent, one for all or one each."""
    safety = rig.safety
    return GateLimits(
        drives=tuple(
            DriveLimits(
                name=a.name,
                kind=kinds[i % len(kinds)],
                low_m=a.stroke[0] + safety.stroke_margin,
                high_m=a.stroke[1] - safety.stroke_margin,
                velocity_max=a.velocity_max,
                acceleration_max=a.acceleration_max,
                force_max_n=a.force_max,
                following_error_m=safety.following_error,
                resolution_m=1.0 / a.drive.counts_per_unit,
            )
            for i, a in enumerate(rig.actuators)
        ),
        cycle_s=rig.bus.cycle,
        fresh_s=safety.answer_timeout,
    )


def judge_measured(measured: Measured | None, fresh_s: float, now_s: float) -> Broken | None:
    """Nothing is asked of a drive whose position is not known now."""
    if measured is None:
        return Broken(Rule.NOT_MEASURED, "its position has never been measured")
    if not abs(now_s - measured.at_s) <= fresh_s:
        return Broken(
            Rule.NOT_MEASURED,
            f"its position was last measured {now_s - measured.at_s:.3f} s ago, {fresh_s:g} s allowed",
        )
    return None


def judge_force(limits: DriveLimits, force_n: float) -> Broken | None:
    """A force setpoint stays within the drive's force."""
    if not abs(force_n) <= limits.force_max_n:
        return Broken(
            Rule.FORCE, f"force {force_n:.1f} N is beyond ±{limits.force_max_n:g} N (force_max)"
        )
    return None


def judge_position(
    limits: DriveLimits,
    cycle_s: float,
    last: Passed | None,
    measured: Measured,
    now_s: float,
    value: float,
) -> Passed | Broken:
    """A position setpoint inside stroke, near the measured position, not too fast, not too sudden.

    `last` is None for the first setpoint after power-on or after a gap: it is then judged as if the
    measured position, at rest, had been the setpoint one cycle ago.
    """
    if not limits.low_m <= value <= limits.high_m:
        return Broken(
            Rule.STROKE,
            f"setpoint {value:.5f} is outside {limits.low_m:g}..{limits.high_m:g} (stroke less margin)",
        )
    if not abs(value - measured.value) <= limits.following_error_m:
        return Broken(
            Rule.FOLLOWING,
            f"setpoint {value:.5f} is {abs(value - measured.value):.5f} from the measured "
            f"{measured.value:.5f}, {limits.following_error_m:g} allowed (following_error)",
        )
    slot_s = _slot(cycle_s, last, now_s)
    if isinstance(slot_s, Broken):
        return slot_s
    value_before, speed_before = (measured.value, 0.0) if last is None else last[:2]
    speed = (value - value_before) / cycle_s
    top = limits.velocity_max * SLACK
    if not abs(speed) <= top:
        return Broken(
            Rule.SPEED,
            f"setpoint asks for {abs(speed):.4f} /s, {top:.4f} /s allowed (velocity_max)",
        )
    return _sudden(limits, cycle_s, speed_before, speed) or Passed(value, speed, slot_s, now_s)


def judge_velocity(
    limits: DriveLimits,
    cycle_s: float,
    last: Passed | None,
    measured: Measured,
    now_s: float,
    value: float,
) -> Passed | Broken:
    """A speed setpoint not too fast, not too sudden, from which the drive can still stop inside its stroke.

    `last` is None after power-on or a gap: the drive is then taken to be at rest.
    """
    top = limits.velocity_max * SLACK
    if not abs(value) <= top:
        return Broken(
            Rule.SPEED, f"speed {abs(value):.4f} /s is asked, {top:.4f} /s allowed (velocity_max)"
        )
    slot_s = _slot(cycle_s, last, now_s)
    if isinstance(slot_s, Broken):
        return slot_s
    broken = _sudden(limits, cycle_s, 0.0 if last is None else last.speed, value)
    if broken is not None:
        return broken
    age_s = now_s - measured.at_s + cycle_s
    stop = measured.value + value * (age_s + 0.5 * abs(value) / limits.acceleration_max)
    if not (value >= 0.0 or stop >= limits.low_m) or not (value <= 0.0 or stop <= limits.high_m):
        return Broken(
            Rule.STROKE,
            f"at {value:.4f} /s it would come to rest at {stop:.5f}, outside {limits.low_m:g}.."
            f"{limits.high_m:g} (stroke less margin)",
        )
    return Passed(measured.value, value, slot_s, now_s)


def _slot(cycle_s: float, last: Passed | None, now_s: float) -> float | Broken:
    """When a setpoint that goes out now was due at the latest, s, unless it comes too soon."""
    slot_s = now_s if last is None else max(last.slot_s + cycle_s, now_s)
    if not slot_s - now_s <= AHEAD_CYCLES * cycle_s:
        return Broken(
            Rule.RATE,
            f"setpoints came {(slot_s - now_s) / cycle_s:.2f} cycles faster than one a cycle, "
            f"{AHEAD_CYCLES:g} allowed",
        )
    return slot_s


def _sudden(limits: DriveLimits, cycle_s: float, before: float, speed: float) -> Broken | None:
    """A change of speed, m/s or rad/s, within a cycle's acceleration and what increments round."""
    allowed = limits.acceleration_max * SLACK * cycle_s + 2.0 * limits.resolution_m / cycle_s
    if not abs(speed - before) <= allowed:
        return Broken(
            Rule.ACCELERATION,
            f"setpoint changes speed from {before:.4f} to {speed:.4f} /s at once, "
            f"{allowed:.4f} allowed (acceleration_max)",
        )
    return None
