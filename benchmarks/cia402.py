"""CiA 402: six axes in real time, what a cycle of theirs costs, and 1 kHz beside the 10 ms parameter channel.

Half an hour in one piece. In parts: `python -m benchmarks cia402 --save rows.json --parts real-1000`, then
others with the same file; the tables show all rows that it holds.

Chirps on the one-axis bench through the whole daemon in simulated time, as `benchmarks.tracking` has
them. The cost is the thread's own processor time, so other load on the machine does not count; beside it
the same cycle's frames made and taken by the `canopen` package, which controls nothing.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import canopen
from canopen.profiles.p402 import BaseNode402

from benchmarks import cia402_realtime
from benchmarks.figure import Cell, Options, Table
from benchmarks.parts import Part, measured
from benchmarks.rigs import profiles, variant
from benchmarks.tracking import Chirp, bandwidths, chirp_figures, response, ride
from hil.config import RigFile
from hil.configfile import data_folder
from hil.control.demo_ride import DemoRide
from hil.control.streaming import cues
from hil.daemon.core import RigCore
from hil.daemon.simulated import SimulatedSession, cue_at
from hil.daemon.wire import encode
from hil.drivefiles import load_profiles
from hil.drives.profiles import Profiles

AXES = 6
AT_1_KHZ = {"cycle": 0.001, "setpoint_delay": 0.00115}
REAL_TIME_S = (600.0, 60.0)
"""How long our daemon and `canopen`'s master run in real time, s."""


@dataclass(frozen=True, slots=True)
class Way:
    """A rig file in a control mode, as `tracking.ride` takes it."""

    name: str
    short: str
    file: str
    mode: str

    def rig(self) -> RigFile:
        """The rig in this mode."""
        return variant(self.file, control={"mode": self.mode})

    def profiles(self) -> Profiles:
        """Its drive files."""
        return profiles() if self.file == "axis" else load_profiles(self.rig())


WAYS = (
    Way("10 ms channel, drive's cascade", "channel-drive", "axis", "drive"),
    Way("10 ms channel, computed torque", "channel-torque", "axis", "computed_torque"),
    Way("1 kHz, drive's cascade (csp)", "fast-drive", "axis_canopen", "drive"),
    Way("1 kHz, computed torque (cst)", "fast-torque", "axis_canopen", "computed_torque"),
)


def followed(way: Way, narrow: Chirp, wide: Chirp) -> tuple[Cell, ...]:
    """Error and bandwidth of one way."""
    errors = chirp_figures(ride(way, narrow, narrow.duration_s))
    found = response(ride(way, wide, wide.duration_s), wide)
    return (*errors, *bandwidths(*found))


def chirps(options: Options) -> list[Part]:
    """Error and bandwidth of each way."""
    narrow = Chirp(0.1, 5.0, 6.0 if options.quick else 20.0)
    wide = Chirp(1.0, 40.0, 5.0 if options.quick else 15.0)
    blank = Table(
        f"chirp 0.1-5 Hz in {narrow.duration_s:g} s, 3 mm of the axis; bandwidth from 1-40 Hz in "
        f"{wide.duration_s:g} s",
        ("RMS error, mm", "max error, mm", "-3 dB, Hz", "-90°, Hz"),
        {},
        "simulated time: bus arithmetic, delays, jitter, noise and quantisation of the rig files included",
    )
    return [
        Part(f"chirp-{way.short}", blank, way.name, partial(followed, way, narrow, wide))
        for way in WAYS
    ]


def our_cost(mode: str, seconds: float) -> tuple[Cell, ...]:
    """Processor time of the core a cycle, six axes at 1 kHz, riding: what is due, what came, its records."""
    rig = variant("stewart_canopen", control={"mode": mode}, bus=AT_1_KHZ)
    session = SimulatedSession(rig, load_profiles(rig))
    meters = {name: Meter(getattr(RigCore, name)) for name in ("on_due", "on_frame")}
    encoding = Meter(encode)
    session.on_record = encoding
    core = session.core
    session.arm()
    for name, meter in meters.items():
        setattr(core, name, meter.bound(core))
    start_s = session.now_s
    motion = DemoRide(rig)
    for cue in cues(motion.poses, 0.0, 1.0 + seconds, "benchmark"):
        if cue.received_s > 1.0 and not encoding.counts:
            for meter in (*meters.values(), encoding):
                meter.counts = True
            first = core._schedule.cycles
        session.cue(cue_at(cue, start_s))
    cycles = core._schedule.cycles - first
    spent = [1e6 * m.spent_s / cycles for m in (*meters.values(), encoding)]
    return (*spent, sum(spent), sum(spent) / 10.0)


class Meter:
    """A function with the thread's processor time that it takes."""

    def __init__(self, function: Callable[..., object]) -> None:
        self._function = function
        self.spent_s = 0.0
        self.counts = False

    def __call__(self, *arguments: object) -> Any:
        """Call it."""
        began_s = time.thread_time()
        result = self._function(*arguments)
        if self.counts:
            self.spent_s += time.thread_time() - began_s
        return result

    def bound(self, owner: object) -> Callable[..., object]:
        """As a method of `owner`."""
        return lambda *arguments: self(owner, *arguments)


class Nowhere(canopen.Network):  # type: ignore[misc]  # mypy skips that library
    """canopen's network without a bus."""

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """It is sent."""


def their_cost(cycles: int) -> tuple[Cell, ...]:
    """The same frames by `canopen`: SYNC, six targets by name, six answers to its callbacks. No control."""
    network = Nowhere()
    eds = str(data_folder("drives") / "cia402" / "device.eds")
    nodes = []
    for number in range(1, AXES + 1):
        node = BaseNode402(number, eds)
        network.add_node(node)
        for pdo, variables in (
            (node.rpdo[1], (0x6040, 0x607A)),
            (node.tpdo[1], (0x6041, 0x6064, 0x6077)),
        ):
            pdo.clear()
            for index in variables:
                pdo.add_variable(index)
            pdo.cob_id = (0x200 if pdo is node.rpdo[1] else 0x180) + number
            pdo.enabled = True
            pdo.subscribe()
        nodes.append(node)
    answer = bytearray(b"\x37\x02" + bytes(6))
    due_s = came_s = 0.0
    for k in range(cycles):
        began_s = time.thread_time()
        network.sync.transmit()
        for node in nodes:
            node.rpdo[1][0x6040].raw = 0x0F
            node.rpdo[1][0x607A].raw = round(1e5 * math.sin(1e-3 * k))
            node.rpdo[1].transmit()
        between_s = time.thread_time()
        for node in nodes:
            network.notify(0x180 + node.id, answer, 1e-3 * k)
            position = node.tpdo[1][0x6064].raw
        due_s += between_s - began_s
        came_s += time.thread_time() - between_s
    if position != 0:
        raise RuntimeError(f"an answer of zeros is read as {position}")
    spent = (1e6 * due_s / cycles, 1e6 * came_s / cycles)
    return (*spent, math.nan, sum(spent), sum(spent) / 10.0)


def costs(options: Options) -> list[Part]:
    """Microseconds of processor time a cycle, and the share of one processor that is at 1 kHz."""
    seconds = 0.5 if options.quick else 5.0
    blank = Table(
        f"six axes at 1 kHz on two buses, processor time of the master over {seconds:g} s, µs a cycle",
        ("due", "answers", "records", "sum", "share of a processor, %"),
        {},
        "without the system calls that send and receive; in between the simulated rig has the caches, so "
        "that the daemon by itself takes less: the table in real time says how much",
    )
    ours = [
        Part(f"cost-{mode}", blank, f"hil, {mode}", partial(our_cost, mode, seconds))
        for mode in ("drive", "cascade", "computed_torque")
    ]
    theirs = partial(their_cost, round(1000 * seconds))
    return [*ours, Part("cost-canopen", blank, "canopen: the frames alone", theirs)]


def measure(options: Options = Options()) -> list[Table]:  # noqa: B008 - a frozen value
    """Real time, costs, chirps."""
    real_s = (8.0, 5.0) if options.quick else REAL_TIME_S
    real = cia402_realtime.parts((0.001, 0.002), *real_s)
    return measured([*real, *costs(options), *chirps(options)], options)
