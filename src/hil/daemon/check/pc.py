"""Whether this PC can keep time: rights, processor, clock. Reads /proc and /sys only."""

from __future__ import annotations

import math
import os
import resource
from pathlib import Path
from typing import Final

from hil.config import RigFile
from hil.daemon.check.finding import Finding
from hil.daemon.realtime import PRIORITY

_SERVICE: Final = "etc/systemd/system/hild.service"
_CAP_IPC_LOCK: Final = 14
_CAP_SYS_NICE: Final = 23
_STEADY_CLOCKS: Final = ("tsc", "arch_sys_counter", "kvm-clock", "hyperv_clocksource_tsc_page")
BASE_S: Final = 0.1e-3
AXIS_S: Final = 0.1e-3
"""Processor time of a cycle and of each axis in it, from `python -m benchmarks cia402` (docs/figures.md)."""
_COMFORTABLE: Final = 0.5
_RT_SHARE: Final = 0.9
"""The loop needs a few percent of one processor; less than this much left to real time is a misfit."""


def check_pc(root: Path) -> list[Finding]:
    """All about the PC whose /proc, /sys and /etc are below `root`."""
    return [
        _fifo(root),
        _memory(root),
        _throttling(root),
        *_governor(root),
        _clock(root),
        _load(root),
    ]


def check_cycle(rig: RigFile) -> list[Finding]:
    """Whether a processor has the time that a fast rig's cycles take."""
    if rig.bus.schedule != "fast":
        return []
    axes, cycle_s = len(rig.actuators), rig.bus.cycle
    share = (BASE_S + AXIS_S * axes) / cycle_s
    text = (
        f"{axes} {'axes' if axes > 1 else 'axis'} at {1.0 / cycle_s:.0f} Hz take about {share:.0%} of a "
        "processor (measured on one of 2 CPUs: six axes at 1 kHz took 69 %)"
    )
    if share <= _COMFORTABLE:
        return [Finding("ok", "cycle", text)]
    fits_s = math.ceil((BASE_S + AXIS_S * axes) / _COMFORTABLE * 1e3) * 1e-3
    remedy = (
        f"leave a processor to the daemon alone and watch `hil latency`, or set bus.cycle = {fits_s:g} with "
        f"bus.setpoint_delay = {fits_s + rig.bus.setpoint_delay - cycle_s:g}"
    )
    return [Finding("warn", "cycle", f"{text}: setpoints will come late now and then", remedy)]


def _fifo(root: Path) -> Finding:
    if _capable(root, _CAP_SYS_NICE) or _limit(resource.RLIMIT_RTPRIO) >= PRIORITY:
        return Finding("ok", "real time", f"SCHED_FIFO {PRIORITY} is permitted")
    return _right_missing(
        root,
        "real time",
        f"SCHED_FIFO {PRIORITY} is not permitted: other programs delay the loop",
        f"add `@hil - rtprio {PRIORITY}` to /etc/security/limits.conf and log in again",
    )


def _memory(root: Path) -> Finding:
    if _capable(root, _CAP_IPC_LOCK) or _limit(resource.RLIMIT_MEMLOCK) == float("inf"):
        return Finding("ok", "memory", "memory may be locked in RAM")
    return _right_missing(
        root,
        "memory",
        "memory may not be locked in RAM: a page fault costs the loop milliseconds",
        "add `@hil - memlock unlimited` to /etc/security/limits.conf and log in again",
    )


def _right_missing(root: Path, topic: str, text: str, remedy: str) -> Finding:
    if (root / _SERVICE).is_file():
        return Finding(
            "ok", topic, "hild.service has its own rights; a `hil run` from here has not"
        )
    return Finding("warn", topic, text, f"run it as a service (`hil service install`), or {remedy}")


def _throttling(root: Path) -> Finding:
    runtime = _number(root / "proc/sys/kernel/sched_rt_runtime_us")
    period = _number(root / "proc/sys/kernel/sched_rt_period_us")
    if runtime is None or period is None:
        return Finding("warn", "throttling", "whether the kernel throttles real time is not known")
    if runtime < 0 or runtime >= _RT_SHARE * period:
        share = 1.0 if runtime < 0 else runtime / period
        return Finding("ok", "throttling", f"real time may have {share:.0%} of a processor")
    return Finding(
        "warn",
        "throttling",
        f"the kernel stops real-time processes after {runtime / period:.0%} of each "
        f"{period / 1e6:g} s",
        "sysctl kernel.sched_rt_runtime_us=950000",
    )


def _governor(root: Path) -> list[Finding]:
    files = sorted((root / "sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor"))
    governors = {path.read_text().strip() for path in files}
    if not governors:
        return []  # a machine that does not change its clock, or a virtual one
    if governors == {"performance"}:
        return [Finding("ok", "processor", "runs at full clock (governor performance)")]
    return [
        Finding(
            "warn",
            "processor",
            f"slows down when idle (governor {', '.join(sorted(governors))}): it wakes late",
            "cpupower frequency-set -g performance, or a start-up unit that does so",
        )
    ]


def _clock(root: Path) -> Finding:
    path = root / "sys/devices/system/clocksource/clocksource0/current_clocksource"
    name = path.read_text().strip() if path.is_file() else ""
    if name in _STEADY_CLOCKS:
        return Finding("ok", "clock", f"the clock source is {name}")
    if not name:
        return Finding("warn", "clock", "the clock source is not known")
    return Finding(
        "warn",
        "clock",
        f"the clock source is {name}: each look at the clock costs a microsecond or more",
        "see `dmesg | grep -i tsc` for why it is not tsc; the firmware's settings often mend it",
    )


def _load(root: Path) -> Finding:
    path = root / "proc/loadavg"
    load = float(path.read_text().split()[0]) if path.is_file() else 0.0
    processors = os.cpu_count() or 1
    text = f"load {load:.1f} on {processors} processor{'s' if processors > 1 else ''}"
    if load <= 0.7 * processors:
        return Finding("ok", "load", text)
    remedy = "stop what else runs here; `top` shows it"
    return Finding("warn", "load", f"{text}: other programs want the processor too", remedy)


def _limit(which: int) -> float:
    soft = resource.getrlimit(which)[0]
    return float("inf") if soft == resource.RLIM_INFINITY else soft


def _capable(root: Path, capability: int) -> bool:
    path = root / "proc/self/status"
    lines = path.read_text().splitlines() if path.is_file() else []
    masks = [int(line.split()[1], 16) for line in lines if line.startswith("CapEff:")]
    return bool(masks and masks[0] >> capability & 1)


def _number(path: Path) -> int | None:
    try:
        return int(path.read_text())
    except (OSError, ValueError):
        return None
