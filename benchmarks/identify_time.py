"""How long `hil identify fit` takes for a run of 60 s, read from its folder and corrected by the twin.

The run is the demo's ride with noise, jitter and delays, through the whole daemon in simulated time. Compiled
code is in the cache; the start of the program is not counted.
"""

from __future__ import annotations

import resource
import tempfile
import time
from pathlib import Path

from benchmarks.figure import Options, Table
from benchmarks.rigs import profiles, variant
from hil.configfile import rig_toml
from hil.control.demo_ride import DemoRide
from hil.control.streaming import cues
from hil.daemon.simulated import record_ride
from hil.identify.estimate import LinearOptions, identify
from hil.runs import load_run

RIGS = ("axis", "motorcycle", "stewart")
RIDE_S = 60.0
COLUMNS = ("run, s", "parameters", "of them told", "wall s", "processor s")


def identified(name: str, ride_s: float) -> tuple[float, int, int, float, float]:
    """The row of one rig."""
    rig = variant(name)
    ride = DemoRide(rig)
    with tempfile.TemporaryDirectory(prefix="hil-") as folder:
        played = cues(lambda t_s: ride.poses(t_s % ride.duration_s), 0.0, ride_s, "benchmark")
        path = record_ride(rig, rig_toml(rig), profiles(), list(played), Path(folder))
        identify(
            [load_run(path, rig)], rig, LinearOptions(draws=1)
        )  # compiles what is not in the cache
        wall_s, processor_s = time.monotonic(), _processor_s()
        run = load_run(path, rig)
        found = identify([run], rig).identification
        wall_s, processor_s = time.monotonic() - wall_s, _processor_s() - processor_s
    told = sum(e.identifiable for e in found.estimates)
    return run.duration_s, len(found.estimates), told, wall_s, processor_s


def _processor_s() -> float:
    """Of this process and its children that have ended, s."""
    used = [resource.getrusage(w) for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


def measure(options: Options = Options()) -> list[Table]:  # noqa: B008 - a frozen value
    """Every rig by the default method."""
    ride_s = 10.0 if options.quick else RIDE_S
    rows = {name: identified(name, ride_s) for name in (RIGS[:1] if options.quick else RIGS)}
    return [Table(f"identification of {ride_s:g} s of riding", COLUMNS, rows)]
