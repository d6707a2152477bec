"""The gate's boundary table: what is done, and what each sent frame must come to.

A case is a list of steps: ("arm",), ("disarm",), ("at", i, value, t) for a measured
position, and ("send", t, frame, rule or None); t in cycles. test_gate.py runs it against the gate,
test_mutations.py against every mutant of it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from hil.frames import Frame
from tests.safety.bench import (
    CYCLE_S,
    EPS,
    START,
    START_LEFT,
    STOP,
    alive,
    bare_on,
    force,
    network,
    off,
    on,
    read,
    reset,
    speed,
    sync,
    system,
    write,
)

Step = tuple[Any, ...]
NAN, INF = math.nan, math.inf


@dataclass(frozen=True)
class Case:
    name: str
    steps: Sequence[Step]
    kind: str = "position"
    read_only: bool = False
    limits: Mapping[str, float] = field(default_factory=dict)


def ok(t: float, frame: Frame) -> Step:
    return ("send", t, frame, None)


def no(t: float, frame: Frame, rule: str) -> Step:
    return ("send", t, frame, rule)


def first(value: float, rule: str | None, at: float = 0.0) -> list[Step]:
    """An armed rig, measured at `at`, asked for its first setpoint `value`."""
    return [("arm",), ("at", 0, at, 10.0), ("send", 10.0, on(value), rule)]


def motion(*points: tuple[float, float, str | None]) -> list[Step]:
    """(t, setpoint, rule): an armed rig at 0 at t = 0, measured freshly at its last passed setpoint."""
    steps: list[Step] = [("arm",)]
    here = 0.0
    for t, value, rule in points:
        steps += [("at", 0, here, t), ("send", t, on(value), rule)]
        here = here if rule else value
    return steps


def speeds(
    *points: tuple[float, float, str | None], at: float = 0.0, age: float = 0.0
) -> list[Step]:
    """(t, speed, rule): an armed rig that stands at `at`, measured `age` cycles before each."""
    steps: list[Step] = [("arm",)]
    for t, value, rule in points:
        steps += [("at", 0, at, t - age), ("send", t, speed(value), rule)]
    return steps


A = 21.0 + 2.0**-9
"""Largest change of travel from one cycle to the next: 1.05 · 20 and two increments' rounding."""

SLUGGISH = {"acceleration_max": 10.0 / CYCLE_S**2}
"""Half the acceleration."""

V = 21.0 + 2.0**-8
"""Largest change of a sluggish drive's speed from one cycle to the next, /s."""

CASES = [
    # -- forms -------------------------------------------------------------------------------------------
    Case("read-only passes nothing, not even off", [
        ("arm",), no(0.0, off(), "read_only"), no(0.0, read(1), "read_only"),
        no(0.0, system(STOP), "read_only"), no(0.0, on(0.0), "read_only"),
    ], read_only=True),
    Case("no remote frame", [no(0.0, off()._replace(is_remote=True), "frame_form")]),
    Case("no extended frame", [no(0.0, off()._replace(is_extended=True), "frame_form")]),
    Case("no error frame", [no(0.0, off()._replace(is_error=True), "frame_form")]),
    Case("an identifier next to ours", [no(0.0, Frame(0x202, b"\x00"), "unknown_id")]),
    Case("a byte too few", [no(0.0, Frame(0x300, b"\x00"), "length")]),
    Case("a byte too many", [no(0.0, Frame(0x200, b"\x00\x00"), "length")]),
    Case("a frame that is not understood", [("arm",), no(0.0, system(b"\x05"), "unknown_meaning")]),
    # -- silence at boot, the latch ----------------------------------------------------------------------
    Case("at boot off, stop, reads and declared writes pass", [
        ok(0.0, off()), ok(0.0, system(STOP)), ok(0.0, read(200)), ok(0.5, write(7)), ok(0.5, reset()),
    ]),
    Case("at boot no power", [("at", 0, 0.0, 0.0), no(0.0, on(0.0), "disarmed")]),
    Case("no power without a setpoint, armed or not", [
        no(0.0, bare_on(), "unknown_meaning"), ("arm",), ("at", 0, 0.0, 0.0),
        no(0.0, bare_on(), "unknown_meaning"),
    ]),
    Case("disarmed again no power", [
        *first(0.0, None), ("disarm",), no(11.0, on(0.0), "disarmed"),
    ]),
    Case("at boot no System Start", [no(0.0, system(START), "start_unarmed")]),
    Case("no System Start while one drive has not been told to be off", [
        ok(0.0, off(0)), no(0.0, system(START), "start_unarmed"),
    ]),
    Case("System Start once every drive has been told to be off", [
        ok(0.0, off(0)), ok(0.0, off(1)), ok(0.0, system(START)),
    ]),
    Case("System Start of one family once its own drives have been told to be off", [
        no(0.0, system(START_LEFT), "start_unarmed"), ok(0.0, off(0)), ok(0.0, system(START_LEFT)),
    ]),
    Case("the other family's drives are no help", [
        ok(0.0, off(1)), no(0.0, system(START_LEFT), "start_unarmed"),
    ]),
    Case("no System Start after a disarm without off", [
        ok(0.0, off(0)), ok(0.0, off(1)), *first(0.0, None), ("disarm",),
        no(11.0, system(START), "start_unarmed"),
    ]),
    Case("System Start while armed", [("arm",), ok(0.0, system(START))]),
    Case("no error reset while armed", [("arm",), no(0.0, reset(), "reset_armed"), ok(0.0, off())]),
    Case("a node is started or stopped while disarmed", [ok(0.0, network()), ok(1.0, network(1))]),
    Case("no node is started or stopped while armed", [("arm",), no(0.0, network(), "network_armed")]),
    Case("SYNC and our heartbeat pass always, but not in bursts", [
        ok(0.0, sync()), ok(0.0, alive()), ("arm",), ok(1.0, sync()), ok(1.0, alive()),
        no(1.125, alive(), "duplicate"),
    ]),
    Case("off passes always: too often, unmeasured, armed or not", [
        ok(0.0, off()), ok(0.0, off()), ("arm",), *[ok(0.0, off())] * 40,
    ]),
    # -- parameters --------------------------------------------------------------------------------------
    Case("a parameter that is not declared writable", [
        no(0.0, write(6), "write_parameter"), no(0.0, write(9), "write_parameter"), ok(0.0, write(8)),
    ]),
    Case("what one drive's profile lets be written is not written to another", [
        ok(0.0, write(7)), no(0.0, write(7, 1), "write_parameter"), ok(0.0, write(8, 1)),
    ]),
    Case("no write while any drive is powered, reads as ever", [
        *first(0.0, None), no(10.0, write(8, 1), "write_powered"), ok(10.0, read(7, 1)),
    ]),
    Case("writes again once the drive is off", [*first(0.0, None), ok(10.5, off()), ok(10.5, write(7))]),
    Case("writes again only once every drive is off", [
        *first(0.0, None), ("at", 1, 0.0, 10.0), ok(10.0, on(0.0, 1)), ok(10.5, off()),
        no(10.5, write(7), "write_powered"), ok(10.5, off(1)), ok(10.5, write(7)),
    ]),
    # -- how often ---------------------------------------------------------------------------------------
    Case("21 frames in 20 cycles, the 22nd a moment too early", [
        *[ok(0.5 * k, read(k)) for k in range(21)], no(20.0 - EPS, read(99), "rate"),
    ]),
    Case("21 frames in 20 cycles, the 22nd in time", [
        *[ok(0.5 * k, read(k)) for k in range(21)], ok(20.0, read(99)), no(20.5 - EPS, read(98), "rate"),
    ]),
    Case("each identifier counts for itself", [
        *[ok(0.5 * k, read(k)) for k in range(21)], ok(10.5, read(99, 1)),
    ]),
    Case("a refused frame does not count", [
        *[no(0.5 * k, write(6), "write_parameter") for k in range(30)], ok(15.0, write(7)),
    ]),
    Case("the same frame again, a moment too early", [
        ok(0.0, read(1)), no(0.25 - EPS, read(1), "duplicate"),
    ]),
    Case("the same frame again, late enough", [ok(0.0, read(1)), ok(0.25, read(1))]),
    Case("the same as the last frame, not as the first", [
        ok(0.0, read(1)), ok(1.0, read(2)), no(1.125, read(2), "duplicate"), ok(1.125, read(1)),
    ]),
    Case("another frame at once", [ok(0.0, read(1)), ok(0.0, read(2)), ok(0.0, read(1))]),
    Case("the same frame on another identifier", [ok(0.0, read(1)), ok(0.0, read(1, 1))]),
    # -- measured ----------------------------------------------------------------------------------------
    Case("never measured", [("arm",), no(0.0, on(0.0), "not_measured")]),
    Case("the other drive was measured", [("arm",), ("at", 1, 0.0, 0.0), no(0.0, on(0.0), "not_measured")]),
    Case("measured just fresh enough", [("arm",), ("at", 0, 0.0, 1.0), ok(6.0, on(0.0))]),
    Case("measured a moment too long ago", [
        ("arm",), ("at", 0, 0.0, 1.0), no(6.0 + EPS, on(0.0), "not_measured"),
    ]),
    Case("measured too far in the future: a broken clock", [
        ("arm",), ("at", 0, 0.0, 11.0 + EPS), no(6.0, on(0.0), "not_measured"),
    ]),
    Case("measured NaN", first(0.0, "following", at=NAN)),
    # -- stroke ------------------------------------------------------------------------------------------
    Case("at the upper end", first(100.0, None, at=90.0)),
    Case("beyond the upper end", first(100.0 + EPS, "stroke", at=90.0)),
    Case("at the lower end", first(-100.0, None, at=-90.0)),
    Case("beyond the lower end", first(-100.0 - EPS, "stroke", at=-90.0)),
    Case("NaN", first(NAN, "stroke")),
    Case("infinite", first(INF, "stroke")),
    # -- distance from the measured position ---------------------------------------------------------------
    Case("as far ahead as may be", [
        *motion((0.0, 10.0, None), (1.0, 20.0, None), (2.0, 30.0, None)),
        ("at", 0, -10.0, 3.0), ok(3.0, on(40.0)),
    ]),
    Case("too far ahead", [
        *motion((0.0, 10.0, None), (1.0, 20.0, None), (2.0, 30.0, None)),
        ("at", 0, -10.0 - EPS, 3.0), no(3.0, on(40.0), "following"),
    ]),
    Case("too far behind", [
        *motion((0.0, -10.0, None), (1.0, -20.0, None), (2.0, -30.0, None)),
        ("at", 0, 10.0 + EPS, 3.0), no(3.0, on(-40.0), "following"),
    ]),
    # -- speed -------------------------------------------------------------------------------------------
    Case("first setpoint one fastest cycle from the measured position", first(21.0, None)),
    Case("first setpoint a little further", first(21.0 + EPS, "speed")),
    Case("first setpoint a little further, downwards", first(-21.0 - EPS, "speed")),
    Case("at full speed", motion((0.0, 21.0, None), (1.0, 42.0, None))),
    Case("a little faster", motion((0.0, 21.0, None), (1.0, 42.0 + EPS, "speed"))),
    Case("however late: one cycle's travel", motion(
        (0.0, 21.0, None), (1.49, 42.0, None), (4.4, 63.0, None))),
    Case("however late: no more than that", motion(
        (0.0, 21.0, None), (1.49, 42.0 + EPS, "speed"), (2.0, 42.0 + EPS, "speed"),
        (4.9, 42.0 + EPS, "speed"))),
    Case("early by any time: still one cycle's travel", motion((0.0, 21.0, None), (0.3, 42.0, None))),
    Case("skipped cycles are not made up for", motion((0.0, 21.0, None), (2.0, 63.0, "speed"))),
    Case("a late frame, then one in time", motion(
        (0.0, 20.0, None), (1.75, 40.0, None), (2.0, 60.0, None), (3.0, 80.0, None))),
    Case("gathering speed as suddenly as may be while cycles are skipped and frames are late", motion(
        (0.0, 7.0, None), (1.75, 21.0, None), (4.5, 42.0, None), (5.0, 63.0, None), (8.9, 84.0, None))),
    # -- not faster than one a cycle ---------------------------------------------------------------------
    Case("as far ahead of the clock as may be", motion(
        (0.0, 1.0, None), (0.75, 2.0, None), (0.875, 3.0, None), (1.75, 4.0, None), (2.75, 5.0, None))),
    Case("a moment further ahead of the clock", motion(
        (0.0, 1.0, None), (0.75, 2.0, None), (0.875, 3.0, None), (1.75 - EPS, 4.0, "rate"),
        (1.75, 4.0, None))),
    Case("a late frame gives no time away to those after it", motion(
        (0.0, 1.0, None), (3.5, 2.0, None), (3.5, 3.0, None), (3.75, 4.0, "rate"), (4.25, 4.0, None))),
    Case("a late frame does not make the next ones early", motion(
        (0.0, 1.0, None), (1.99, 2.0, None), (2.0, 3.0, None), (3.0, 4.0, None), (4.0, 5.0, None))),
    Case("a refused setpoint takes no time", motion(
        (0.0, 1.0, None), (0.5, 99.0, "following"), (0.5, 98.0, "following"), (0.75, 2.0, None),
        (0.875, 3.0, None))),
    # -- acceleration --------------------------------------------------------------------------------------
    Case("from rest as suddenly as may be", first(10.5 + 2.0**-9, None), limits=SLUGGISH),
    Case("from rest a little more suddenly", first(10.5 + 2.0**-9 + EPS, "acceleration"), limits=SLUGGISH),
    Case("from rest downwards a little more suddenly", first(-10.5 - 2.0**-9 - EPS, "acceleration"),
         limits=SLUGGISH),
    Case("reversed as suddenly as may be", motion((0.0, 10.5, None), (1.0, 21.0 - A, None))),
    Case("reversed a little more suddenly", motion((0.0, 10.5, None), (1.0, 21.0 - A - EPS, "acceleration"))),
    Case("reversed upwards a little more suddenly", motion(
        (0.0, -10.5, None), (1.0, -21.0 + A + EPS, "acceleration"))),
    Case("over two cycles no more suddenly", motion(
        (0.0, 10.5, None), (2.0, 21.0 - A - EPS, "acceleration"))),
    Case("the speed before is remembered", motion(
        (0.0, 20.0, None), (1.0, 20.0, None), (2.0, 15.0, None), (3.0, 32.0, "acceleration"))),
    Case("a late frame's speed is remembered as it is", motion(
        (0.0, 20.0, None), (2.0, 40.0, None), (3.0, 38.0, "acceleration"))),
    # -- gaps, off, the other drive -----------------------------------------------------------------------
    Case("a gap just short enough continues", motion(
        (0.0, -10.0, None), (1.0, 0.0, None), (6.0, -11.0 - A + 20.0 + EPS, "acceleration"))),
    Case("a longer gap starts again at the measured position, at rest", motion(
        (0.0, -10.0, None), (1.0, 0.0, None), (6.0 + EPS, -21.0, None))),
    Case("after off it starts again at the measured position", [
        *motion((0.0, 20.0, None), (1.0, 40.0, None)), ok(1.5, off()), ("at", 0, 40.0, 2.0),
        no(2.0, on(19.0 - EPS), "speed"), ok(2.0, on(40.0 - 21.0)),
    ]),
    Case("after a disarm it starts again at the measured position", [
        *motion((0.0, 20.0, None)), ("disarm",), ("arm",), ("at", 0, -20.0, 1.0), ok(1.0, on(-21.0)),
    ]),
    Case("after System Stop it starts again at the measured position", [
        *motion((0.0, 20.0, None)), ok(0.5, system(STOP)), ("at", 0, -20.0, 1.0), ok(1.0, on(-21.0)),
    ]),
    Case("each drive has its own track", [
        *first(20.0, None), ("at", 1, -50.0, 10.0), ok(10.0, on(-50.0, 1)), ("at", 0, 20.0, 11.0),
        ok(11.0, on(40.0)), ok(11.0, on(-51.0, 1)),
    ]),
    # -- speed setpoints -----------------------------------------------------------------------------------
    Case("the largest speed", speeds((0.0, 42.0, None)), kind="velocity"),
    Case("more speed", speeds((0.0, 42.0 + EPS, "speed")), kind="velocity"),
    Case("more speed downwards", speeds((0.0, -42.0 - EPS, "speed")), kind="velocity"),
    Case("NaN speed", speeds((0.0, NAN, "speed")), kind="velocity"),
    Case("speed from rest as suddenly as may be", speeds((0.0, V, None)), kind="velocity", limits=SLUGGISH),
    Case("speed from rest a little more suddenly", speeds((0.0, V + EPS, "acceleration")),
         kind="velocity", limits=SLUGGISH),
    Case("speed from rest downwards a little more suddenly", speeds((0.0, -V - EPS, "acceleration")),
         kind="velocity", limits=SLUGGISH),
    Case("speed reversed as suddenly as may be", speeds((0.0, 20.0, None), (1.0, 20.0 - V, None)),
         kind="velocity", limits=SLUGGISH),
    Case("speed reversed a little more suddenly", speeds(
        (0.0, 20.0, None), (1.0, 20.0 - V - EPS, "acceleration")), kind="velocity", limits=SLUGGISH),
    Case("speed over two cycles no more suddenly", speeds(
        (0.0, 20.0, None), (2.0, 20.0 - V - EPS, "acceleration"), (2.0, 20.0 - V, None)),
        kind="velocity", limits=SLUGGISH),
    Case("the largest speed refused takes no time, others as far ahead of the clock as may be", speeds(
        (0.0, 1.0, None), (0.75, 2.0, None), (0.875, 99.0, "speed"), (0.875, 3.0, None),
        (1.75 - EPS, 4.0, "rate"), (1.75, 4.0, None)), kind="velocity"),
    Case("a speed from which it still stops", speeds((0.0, 40.0, None), at=70.0), kind="velocity"),
    Case("a speed from which it stops beyond the end", speeds((0.0, 40.0, "stroke"), at=70.0 + EPS),
         kind="velocity"),
    Case("a speed from which it still stops below", speeds((0.0, -40.0, None), at=-70.0), kind="velocity"),
    Case("a speed from which it stops beyond the lower end", speeds((0.0, -40.0, "stroke"), at=-70.0 - EPS),
         kind="velocity"),
    Case("what was measured a cycle ago has moved on", speeds((3.0, 40.0, None), at=50.0, age=1.0),
         kind="velocity"),
    Case("what was measured a cycle ago has moved on too far", speeds(
        (3.0, 40.0, "stroke"), at=50.0 + EPS, age=1.0), kind="velocity"),
    Case("beyond the end it may come back, and stand", speeds((0.0, -10.0, None), (1.0, 0.0, None), at=120.0),
         kind="velocity"),
    Case("beyond the lower end it may come back, and stand", speeds(
        (0.0, 10.0, None), (1.0, 0.0, None), at=-120.0), kind="velocity"),
    Case("beyond the end it may not creep on", speeds(
        (0.0, -EPS, None), (1.0, EPS, "stroke"), at=120.0), kind="velocity"),
    Case("beyond the lower end it may not creep on", speeds(
        (0.0, EPS, None), (1.0, -EPS, "stroke"), at=-120.0), kind="velocity"),
    Case("a speed where NaN was measured", speeds((0.0, 10.0, "stroke"), at=NAN), kind="velocity"),
    Case("a speed where positions are sent", speeds((0.0, 0.0, "setpoint_kind"))),
    # -- force -------------------------------------------------------------------------------------------
    Case("the largest force", [("arm",), ("at", 0, 0.0, 0.0), ok(0.0, force(64.0)), ok(1.0, force(-64.0))],
         kind="force"),
    Case("more force", [("arm",), ("at", 0, 0.0, 0.0), no(0.0, force(64.0 + EPS), "force")], kind="force"),
    Case("more force downwards", [("arm",), ("at", 0, 0.0, 0.0), no(0.0, force(-64.0 - EPS), "force")],
         kind="force"),
    Case("NaN force", [("arm",), ("at", 0, 0.0, 0.0), no(0.0, force(NAN), "force")], kind="force"),
    Case("force on a drive that is not measured", [
        ("arm",), no(0.0, force(0.0), "not_measured"),
    ], kind="force"),
    Case("force where positions are sent", [
        ("arm",), ("at", 0, 0.0, 0.0), no(0.0, force(0.0), "setpoint_kind"),
    ]),
    Case("a position where forces are sent", [
        ("arm",), ("at", 0, 0.0, 0.0), no(0.0, on(0.0), "setpoint_kind"),
    ], kind="force"),
]  # fmt: skip


def run(case: Case, gate: Any) -> list[str]:
    """What differs from the table; empty where the gate does as it says."""
    wrong = []
    for number, step in enumerate(case.steps):
        match step:
            case ("arm",):
                gate.arm()
            case ("disarm",):
                gate.disarm()
            case ("at", i, value, t):
                gate.measured(i, value, t * CYCLE_S)
            case ("send", t, frame, expected):
                verdict = gate.pass_frame(t * CYCLE_S, frame)
                rule = None if verdict.rule is None else verdict.rule.value
                if rule != expected or verdict.ok is not (expected is None):
                    wrong.append(f"step {number}: {frame} at {t}: {rule}, expected {expected}")
            case _:
                raise ValueError(step)
    return wrong
