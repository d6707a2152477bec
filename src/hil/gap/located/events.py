"""Events that no root mean square shows: what stands out in a few samples, or in one frequency."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.signal import lombscargle

from hil.gap.catalogue.nuisances import WOBBLE_M
from hil.gap.floor.noise import time_sensitivity
from hil.gap.located.result import Located
from hil.gap.record.problem import Problem
from hil.identify.replay import Stretch

Array = NDArray[np.float64]

WILD: Final = {"position": 3.0, "accel": 4.5}
"""Floors of a signal, lone samples and all, that are a gap alone: healthy rigs of three worlds stay below 1.2
and 3.1, for late frames are felt by accelerometers as well, but for one of a fourth at its limit of
speed: 4.7, which frames late by one tick make."""
STRUCK: Final = {"position": 10.0, "force": 250.0, "current": 250.0}
"""Spreads that a lone sample must have to be a gap alone, what a frame that is LATE does among them: healthy
rigs of two worlds stay below 4.6 and, struck by the latest of frames, 121."""
TWICE: Final = 2.0
"""Times as many that a position must have where no second one has them: where noise has heavy tails, one of
tens of thousands had 11.7."""
LATE: Final = 0.2
"""Of a cycle."""
NEAR: Final = 9
"""Samples about one, of which the one that feels time most tells how late frames kick."""
HELD: Final = {
    "position": (3, 8.0),
    "velocity": (3, 12.0),
    "gyro": (6, 8.0),
    "accel": (6, 8.0),
    "force": (6, 25.0),
    "current": (6, 25.0),
}
"""Samples one after the other, and spreads by which all of them must be off to one side to be a gap alone:
healthy rigs of two worlds stay below 4.7, 4.6, 3.2, 3.4 and 9.2 (60 records), but for two velocities of the
used-up exam of seed 117, which have 8.7."""
TRANSIENT_M: Final = 8e-6
"""By which a drive gives way for some milliseconds where friction turns round, as friction within a tenth of
the file's and of another law does: 6 N on 60 kg held at 20 Hz [R; a healthy axis of a world of others whose
encoder tells tenths of a micrometre has 10 µm with its screw's wobble]."""
STUCK: Final = {"position": (3, 10.0), "force": (3, 40.0), "current": (3, 40.0)}
"""The same of a start, which is not judged else: healthy rigs of two worlds stay below 2.8 and 12.1 (75
records)."""
AT_ONCE: Final = 3
"""This part of a start is what a drive is off by at once."""
KNOCK: Final = 16.0
BESIDE: Final = {"force": 120.0, "current": 120.0, "accel": 200.0}
"""Spreads of a position, and of its force or an accelerometer at once: a late answer moves the one, a late
setpoint the others. Healthy rigs of two worlds stay below six tenths of these (95 records)."""
NEARLY: Final = 2.5
"""Cycles of the bus that are at once: what a late frame does is over after them."""
MOST: Final = 40
"""Largest samples of a position that are looked at."""


HUM: Final = 0.3
"""Of a force's residual, that one frequency must hold where the motion itself has next to nothing (LEAST): a
push that comes and goes by the clock. Healthy rigs of two worlds stay below 0.1 (75 records)."""
LEAST: Final = 0.05
HUM_HZ: Final = (0.1, 10.0)
HEARD: Final = 100
"""Samples that a series must have to be heard."""
CUT: Final = 5.0
"""Spreads at which its residual is cut: a few kicks have every frequency."""
FINE: Final = 4.0
"""Frequencies for each that a record tells apart."""


def jumps(located: Located) -> tuple[str | None, float]:
    """The signal in which an event stands out most, in what is a gap alone: WILD, STRUCK, HELD,
    STUCK, KNOCK, HUM.

    An encoder's answers do not jump by themselves, and nothing in the noise strikes an accelerometer. Forces
    are asked for single blows only: a frame that reaches its drive a tick late kicks harder than much of what
    is a gap, but no harder than a frame can be late. And no frame, however late, holds several samples of a
    signal off to one side.
    """
    problem = located.evidence.problem
    shocks, knocks = _shocks(located), _knocks(located)
    held = held_off(problem, located.evidence.residual, located.evidence.noise.sigma)
    worst, most = None, 0.0
    for signal in problem.signals:
        quantity = next(x.quantity for x in problem.series if x.signal == signal)
        times = max(
            _wild(located, signal, quantity),
            shocks.get(signal, 0.0) / STRUCK.get(quantity, np.inf),
            held.get(signal, 0.0),
            knocks.get(signal, 0.0),
            _hum(located, signal) / HUM,
        )
        if times > most:
            worst, most = signal, times
    return worst, most


def _wild(located: Located, signal: str, quantity: str) -> float:
    """Root mean square of a signal's residual, lone samples and all, in what is a gap alone; of an
    accelerometer, where that is one, of what a late frame's kick does not reach."""
    e, asked = located.evidence, WILD.get(quantity)
    parts = [x.part for x in e.problem.series if x.signal == signal]
    kept = np.concatenate([e.problem.kept[p] for p in parts])
    if asked is None or not kept.any():
        return 0.0
    sigma = np.concatenate([e.noise.sigma[p] for p in parts])[kept]
    drawn = np.hstack([e.noise.draws[:, p] for p in parts])[:, kept] / sigma
    usual = max(float(np.sqrt(np.mean(drawn**2))), 1.0) if drawn.size else 1.0

    def size(left: Array) -> float:
        return float(np.sqrt(np.mean((left / sigma) ** 2))) / usual / asked

    left = np.abs(np.concatenate([e.residual[p] for p in parts])[kept])
    if quantity != "accel" or not e.problem.actuators or size(left) <= 1.0:
        return size(left)
    kicks = _kicks(e.problem, e.vector)
    kick = np.concatenate([maximum_filter1d(kicks[p], NEAR) for p in parts])[kept]
    return size(np.maximum(left - kick, np.minimum(left, sigma)))


def _kicks(problem: Problem, vector: Array) -> Array:
    """(N,) by how much frames that act a tick of their drive late, every second of them, change each sample:
    at speed a line that stands still for a tick brakes hard."""
    bus = problem.rig.bus
    late_s = min(bus.position_loop, 0.5 * bus.cycle)
    usual, most = problem.predict(vector)[0], np.zeros(problem.size)
    for second in (0, 1):

        def delayed(piece: Stretch, second: int = second) -> Stretch:
            told = {}
            for a, (t, v) in piece.setpoints.items():
                after = t + late_s * (np.arange(len(t)) % 2 == second)
                told[a] = np.maximum.accumulate(after), v  # none overtakes the one before it
            return replace(piece, setpoints=told)

        moved = problem.on([delayed(piece) for piece in problem.sent], problem.clocks)
        most = np.maximum(most, np.abs(moved.predict(vector)[0] - usual))
    return most


def _shocks(located: Located) -> dict[str, float]:
    """By signal of a drive, its largest lone sample over its noise and what late frames do to it; of a
    position the second largest, which one alone must be TWICE of."""
    e = located.evidence
    parts = [x for x in e.problem.series if x.quantity in STRUCK]
    if not parts:
        return {}
    late = LATE * e.problem.rig.bus.cycle * np.abs(time_sensitivity(e.problem, e.vector))
    out: dict[str, float] = {}
    for x in parts:
        near = maximum_filter1d(late[x.part], NEAR)
        size = np.abs(e.residual[x.part]) / (e.noise.sigma[x.part] + near)
        size = size * e.problem.kept[x.part]
        first = int(np.argmax(size))
        largest = float(size[first])
        if x.quantity == "position":
            others = np.delete(size, slice(max(first - NEAR // 2, 0), first + NEAR // 2 + 1))
            largest = max(largest / TWICE, float(np.max(others, initial=0.0)))
        out[x.signal] = max(out.get(x.signal, 0.0), largest)
    return out


def held_off(problem: Problem, residual: Array, sigma: Array) -> dict[str, float]:
    """By signal, the largest run of samples of a residual (N,) off to one side, in what is a gap alone;
    nothing of a ride, which roads shake. `sigma` (N,): spreads."""
    out: dict[str, float] = {}
    if not problem.actuators:
        return out
    for x in problem.series:
        # what any screw wobbles by and any friction lets go of holds nothing off, however fine its encoder
        own_m = WOBBLE_M + TRANSIENT_M if x.quantity == "position" else 0.0
        spread = own_m / HELD["position"][1]
        off, kept = residual[x.part] / np.maximum(sigma[x.part], spread), problem.kept[x.part]
        begun = int(np.argmax(kept)) if kept.any() else 0
        every_s = float(np.median(np.diff(problem.t_s[x.part])))
        least = 1 + math.ceil(NEARLY * problem.rig.bus.cycle / every_s)
        most = max(
            _run(np.where(kept, off, 0.0), HELD.get(x.quantity), least),
            _run(_growing(off[:begun]), STUCK.get(x.quantity), least),
        )
        out[x.signal] = max(out.get(x.signal, 0.0), most)
    return out


def _growing(off: Array) -> Array:
    """What a start (N,) is off by more than it was at once: a load sags onto a drive that has just been
    switched on, until the integrator carries it, and that fades; an actuator that sticks falls behind."""
    if not len(off):
        return off
    at_once = float(np.max(np.abs(off[: max(len(off) // AT_ONCE, 1)])))
    return np.asarray(np.sign(off) * np.maximum(np.abs(off) - at_once, 0.0))


def _run(off: Array, asked: tuple[int, float] | None, least: int) -> float:
    """Smallest of as many samples to one side as are `asked`, `least` at least, over what is asked."""
    if asked is None:
        return 0.0
    samples, spreads = max(asked[0], least), asked[1]
    if len(off) < samples:
        return 0.0
    return (
        max(float(np.max(minimum_filter1d(side * off, samples))) for side in (1.0, -1.0)) / spreads
    )


def _knocks(located: Located) -> dict[str, float]:
    """By position's signal, the largest sample that a force's or an accelerometer's goes with, in what is a
    gap alone."""
    e = located.evidence
    size = np.abs(e.residual / e.noise.sigma) * e.problem.kept
    out: dict[str, float] = {}
    for x in e.problem.series:
        if x.quantity != "position":
            continue
        near_s = NEARLY * e.problem.rig.bus.cycle
        t = e.problem.t_s[x.part]
        for y in e.problem.series:
            if (
                y.quantity not in BESIDE
                or y.stretch != x.stretch
                or y.actuator not in (x.actuator, "imu")
            ):
                continue
            for k in np.argsort(-size[x.part])[:MOST]:
                beside = np.abs(e.problem.t_s[y.part] - t[k]) < near_s
                struck = float(np.max(size[y.part][beside], initial=0.0))
                both = min(float(size[x.part][k]) / KNOCK, struck / BESIDE[y.quantity])
                out[x.signal] = max(out.get(x.signal, 0.0), both)
    return out


def _hum(located: Located, signal: str) -> float:
    """Largest share of a force's residual in one frequency that its motion does not have; 0 of others."""
    e = located.evidence
    most = 0.0
    for x in e.problem.series:
        kept = e.problem.kept[x.part]
        if x.signal != signal or x.quantity not in ("force", "current") or kept.sum() < HEARD:
            continue
        t = e.problem.t_s[x.part][kept]
        span_s = float(t[-1] - t[0])
        top_hz = min(HUM_HZ[1], 0.4 / float(np.median(np.diff(t))))
        hz = np.arange(max(HUM_HZ[0], 3.0 / span_s), top_hz, 1.0 / (FINE * span_s))
        left = (e.residual[x.part] / e.noise.sigma[x.part])[kept]
        told = (e.problem.measured[x.part] - e.residual[x.part])[kept]
        shares = [
            lombscargle(t, v - v.mean(), 2.0 * np.pi * hz, normalize=True)
            for v in (np.clip(left, -CUT, CUT), told)
            if np.any(v != v[0])
        ]
        if len(hz) and len(shares) == 2:
            most = max(most, float(np.max(np.where(shares[1] < LEAST, shares[0], 0.0))))
    return most
