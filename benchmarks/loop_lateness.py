"""How late a bare asyncio loop wakes for a timerfd on this machine: the floor under the rig's loop.

python benchmarks/loop_lateness.py --duration 10
"""

from __future__ import annotations

import argparse
import asyncio
import gc
import math
import os
import time
from dataclasses import dataclass

import numpy as np

from hil.bus.timerfd import Timer

EDGES_US = (20, 50, 100, 200, 500, 1000, 2000, 5000, 10000)
"""Upper edges of the histogram's classes, µs; the last class is open."""


@dataclass(frozen=True, slots=True)
class Lateness:
    """Lateness of every wake of one loop, µs, and the periods it missed altogether."""

    period_s: float
    late_us: np.ndarray
    overruns: int


async def measure(period_s: float, duration_s: float) -> Lateness:
    """Wake every `period_s` for `duration_s`; lateness is from the due instant to the callback."""
    loop = asyncio.get_running_loop()
    cycles = max(1, round(duration_s / period_s))
    late_us = np.empty(cycles)
    done = loop.create_future()
    first_s = time.monotonic() + 2 * period_s
    due = woken = 0

    def expired() -> None:
        nonlocal due, woken
        now_s = time.monotonic()
        if woken < cycles:  # of periods slept through, the first one tells how late this wake is
            late_us[woken] = (now_s - (first_s + due * period_s)) * 1e6
            woken += 1
        due += timer.expirations()
        if due >= cycles and not done.done():
            done.set_result(None)

    with Timer() as timer:
        timer.arm_every(first_s, period_s)
        loop.add_reader(timer, expired)
        try:
            await done
        finally:
            loop.remove_reader(timer)
    return Lateness(period_s, late_us[:woken], due - woken)


def table(results: list[Lateness]) -> str:
    """The figures and a histogram of each loop, as text."""
    lines = [
        f"{'period':>8} {'wakes':>7} {'p50':>8} {'p99':>8} {'max':>8} {'overruns':>9}   (late, µs)"
    ]
    for result in results:
        p50, p99 = np.percentile(result.late_us, (50, 99))
        lines.append(
            f"{result.period_s * 1e3:>5g} ms {result.late_us.size:>7} {p50:>8.1f} {p99:>8.1f} "
            f"{result.late_us.max():>8.1f} {result.overruns:>9}"
        )
    lines.append("")
    lines.append(f"{'late':>12} " + " ".join(f"{r.period_s * 1e3:>6g} ms" for r in results))
    bounds = (-math.inf, *EDGES_US, math.inf)
    shares = [np.histogram(r.late_us, bounds)[0] / r.late_us.size for r in results]
    for n, upper in enumerate(bounds[1:]):
        label = f"< {upper:g} µs" if upper < math.inf else f">= {EDGES_US[-1]} µs"
        lines.append(f"{label:>12} " + " ".join(f"{share[n]:>9.3%}" for share in shares))
    return "\n".join(lines)


def main() -> None:
    """Measure a 10 ms and a 1 ms loop, or those asked for, one after the other."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--duration", type=float, default=10.0, help="s for each loop (%(default)s)"
    )
    parser.add_argument(
        "--period", type=float, action="append", help="ms; may be given again (10 and 1)"
    )
    options = parser.parse_args()
    periods_ms = options.period or [10.0, 1.0]
    if options.duration <= 0 or min(periods_ms) <= 0:
        parser.error("durations and periods must be positive")
    gc.collect()
    gc.freeze()
    results = [asyncio.run(measure(period / 1e3, options.duration)) for period in periods_ms]
    policy = {os.SCHED_OTHER: "other", os.SCHED_FIFO: "fifo", os.SCHED_RR: "rr"}
    print(
        f"{os.cpu_count()} CPUs, load {os.getloadavg()[0]:.1f}, "
        f"scheduling {policy.get(os.sched_getscheduler(0), 'unknown')}\n"
    )
    print(table(results))


if __name__ == "__main__":
    main()
