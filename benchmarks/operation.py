"""Ten minutes of simulated operation: does every slot carry a pair of setpoint and answered parameter?

The whole daemon in simulated time, riding the demo's minute again and again, host jitter of the rig file
included.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from benchmarks.figure import Options, Table
from benchmarks.rigs import profiles, variant
from hil.config import RigFile
from hil.control.demo_ride import DemoRide
from hil.control.streaming import cues
from hil.daemon.records import EventRecord, Record, StateRecord
from hil.daemon.simulated import SimulatedSession, cue_at
from hil.signals import Cue

RIGS = ("motorcycle", "axis")
OPERATION_S = 600.0
COLUMNS = (
    "cycles",
    "overruns",
    "slots",
    "pairs",
    "slots with a pair, %",
    "answers asked again",
    "bus load, %",
    "warnings and faults",
    "wall s",
    "processor s",
    "simulated s / processor s",
)


def operate(rig: RigFile, operation_s: float) -> tuple[str | float | int, ...]:
    """The row of one rig."""
    session = SimulatedSession(rig, profiles())
    states: list[StateRecord] = []
    troubles = 0

    def look(record: Record) -> None:
        nonlocal troubles
        if isinstance(record, StateRecord):
            states.append(record)
        elif isinstance(record, EventRecord) and record.severity != "info":
            troubles += 1

    session.on_record = look
    session.arm()
    start_s, first = session.now_s, states[-1]
    busy_s, states[:] = session.bus.totals.busy_s, []
    wall_s, processor_s = time.monotonic(), time.thread_time()
    for cue in _riding(rig, operation_s):
        session.cue(cue_at(cue, start_s))
    wall_s, processor_s = time.monotonic() - wall_s, time.thread_time() - processor_s
    last, lasted_s = states[-1], session.now_s - start_s
    slots, pairs = last.slots - first.slots, last.pairs - first.pairs
    moving = np.mean([s.state == "engaged" for s in states])
    if moving < 0.99:
        raise RuntimeError(f"{rig.name} was engaged only {moving:.0%} of the time: {last}")
    return (
        last.cycles - first.cycles,
        last.overruns - first.overruns,
        slots,
        pairs,
        100.0 * pairs / slots,
        sum(driver.status.repeats for driver in session.core._link.drives),
        100.0 * (session.bus.totals.busy_s - busy_s) / lasted_s,
        troubles,
        wall_s,
        processor_s,
        lasted_s / processor_s,
    )


def _riding(rig: RigFile, duration_s: float) -> Iterator[Cue]:
    """The demo's ride, repeated; it begins and ends at neutral."""
    ride = DemoRide(rig)
    return cues(lambda t_s: ride.poses(np.mod(t_s, ride.duration_s)), 0.0, duration_s, "benchmark")


def measure(options: Options = Options()) -> list[Table]:  # noqa: B008 - a frozen value
    """Every rig that ships with these drives."""
    operation_s = 20.0 if options.quick else OPERATION_S
    rows = {name: operate(variant(name), operation_s) for name in RIGS}
    return [Table(f"{operation_s:g} s of simulated operation, riding", COLUMNS, rows)]
