"""What one control step costs, and which part of it: the real core, riding, timed in place.

Everything runs as in the daemon, in simulated time; stopwatches sit around the core's own calls. Beside
it the bare inverse dynamics of the same rig, in the same run. Times are CPU time of the thread, warm: what
others on the machine take away shows in the loop's lateness, not here.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.bare import compiled_dynamics, packed_model
from benchmarks.figure import Options, Table
from benchmarks.rigs import profiles, variant
from hil.config import RigFile
from hil.control.demo_ride import DemoRide
from hil.control.streaming import cues
from hil.daemon.simulated import SimulatedSession, cue_at
from hil.rigs import build_rig

MODES = ("drive", "cascade", "computed_torque")
WARM_S = 4.0
STAGES = (
    ("observer", "estimate"),
    ("shaper", "step"),
    ("_controller", "step"),
    ("observer", "applied"),
)


class Stopwatch:
    """Durations of calls, µs, by name."""

    def __init__(self) -> None:
        self.us: dict[str, list[float]] = {}

    def wrap(self, owner: Any, method: str, name: str) -> None:
        """Time every call of `owner.method` from now on."""
        plain: Callable[..., Any] = getattr(owner, method)
        durations = self.us.setdefault(name, [])

        def timed(*args: Any, **keys: Any) -> Any:
            start = time.thread_time_ns()
            result = plain(*args, **keys)
            durations.append((time.thread_time_ns() - start) * 1e-3)
            return result

        setattr(owner, method, timed)

    def clear(self) -> None:
        """Forget what was measured."""
        for durations in self.us.values():
            durations.clear()


def rig_of(name: str, mode: str) -> RigFile:
    """The rig in this mode, on the parameter channel whatever its own bus."""
    bus = {"schedule": "parameter", "cycle": 0.01, "stagger": 0.0011, "retimed": False}
    return variant(name, control={"mode": mode}, bus={**bus, "pattern": ("position", "force")})


def watch(rig: RigFile, ride_s: float) -> dict[str, np.ndarray]:
    """Durations of the core's calls, µs, over `ride_s` of riding."""
    session = SimulatedSession(rig, profiles(), wake_jitter_s=0.0)
    core, watchstop = session.core, Stopwatch()
    motion, link = core._motion, core._link
    session.arm()
    watchstop.wrap(core, "on_frame", "frame in")
    _wrap_due(watchstop, core)
    watchstop.wrap(core, "cue", "cue in")
    for part, method in STAGES:
        watchstop.wrap(getattr(motion, part), method, f"{part.strip('_')}.{method}")
    watchstop.wrap(core._machine, "step", "rig states")
    watchstop.wrap(link, "findings", "monitor")
    watchstop.wrap(core._telling, "report", "state record")
    for driver in link.drives:
        watchstop.wrap(driver, "on_slot", "slot: driver")
    watchstop.wrap(link.gate, "pass_frame", "gate, one frame")
    ride, start_s = DemoRide(rig), session.now_s
    gc.collect()
    gc.disable()  # as the control process does while it is armed
    try:
        for cue in cues(ride.poses, 0.0, WARM_S + ride_s, "benchmark"):
            if cue.received_s <= WARM_S:
                watchstop.clear()
            session.cue(cue_at(cue, start_s))
    finally:
        gc.enable()
    if core.state != "engaged":
        raise RuntimeError(f"{rig.name} is {core.state}, not engaged")
    return {name: np.array(us) for name, us in watchstop.us.items()}


def _wrap_due(stopwatch: Stopwatch, core: Any) -> None:
    """Time `on_due` apart: calls that begin a cycle (with the first slot) and calls of a later slot."""
    plain = core.on_due
    cycle = stopwatch.us.setdefault("cycle begins", [])
    slot = stopwatch.us.setdefault("a later slot", [])

    def timed(now_s: float) -> Any:
        cycles = core._schedule.cycles
        start = time.thread_time_ns()
        frames = plain(now_s)
        us = (time.thread_time_ns() - start) * 1e-3
        (cycle if core._schedule.cycles > cycles else slot).append(us)
        return frames

    core.on_due = timed


def bare_dynamics(rig: RigFile, states: int = 2000) -> tuple[np.ndarray, float]:
    """Inverse dynamics, µs: each of many calls from Python, and the mean inside compiled code."""
    model = build_rig(rig)
    rng = np.random.default_rng(0)
    shape = (states, model.n)
    q = rng.uniform(-0.5, 0.5, shape) * model.limits
    qd, qdd = rng.normal(size=shape), rng.normal(size=shape)
    packed = packed_model(rig)
    compiled_dynamics(*packed, q[:1], qd[:1], qdd[:1])
    best = np.inf
    for _ in range(5):
        start = time.thread_time_ns()
        compiled_dynamics(*packed, q, qd, qdd)
        best = min(best, (time.thread_time_ns() - start) * 1e-3 / states)
    calls = np.empty(states)
    for k, state in enumerate(zip(q, qd, qdd, strict=True)):
        start = time.thread_time_ns()
        model.inverse_dynamics(*state)
        calls[k] = (time.thread_time_ns() - start) * 1e-3
    return calls, best


def measure(options: Options = Options()) -> list[Table]:  # noqa: B008 - a frozen value
    """Costs in each mode for motorcycle and Stewart platform, then the stages of each."""
    ride_s = 2.0 if options.quick else 30.0
    names = ("motorcycle",) if options.quick else ("motorcycle", "stewart")
    costs: dict[str, tuple[float, ...]] = {}
    tables = []
    for name in names:
        stages: dict[str, list[float]] = {}
        for mode in MODES:
            us = watch(rig_of(name, mode), ride_s)
            steps = np.sum([us[f"{p.strip('_')}.{m}"] for p, m in STAGES], axis=0)
            costs[f"{name}, {mode}"] = _row(steps)
            for stage, durations in us.items():
                stages.setdefault(stage, []).extend(_row(durations))
        calls, inside = bare_dynamics(variant(name))
        costs[f"{name}, bare inverse dynamics, one call"] = _row(calls)
        costs[f"{name}, bare inverse dynamics, compiled"] = (inside, float("nan"))
        heads = tuple(f"{mode} {what}" for mode in MODES for what in ("p50", "p99"))
        rows = {stage: tuple(values) for stage, values in stages.items()}
        tables.append(Table(f"{name}: the core's calls by part, µs", heads, rows))
    note = "a control step is observer, shaper, controller and the observer's note of what was sent"
    return [Table("one control step, µs", ("p50", "p99"), costs, note), *tables]


def _row(us: np.ndarray) -> tuple[float, ...]:
    return tuple(np.percentile(us, (50, 99)).tolist())
