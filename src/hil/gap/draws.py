"""What noise looks like: recordings of the twin itself, with the sensors and the bus of the rig file.

One draw replays the stretches with what the rig file leaves to chance: a setpoint frame waits for the bus,
so it may reach the drive in another tick than its stamp says; an answer's delay varies; the sensor adds
noise and rounds. A draw minus the smooth prediction is what a residual is where there is no gap at all.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.gap.problem import Problem, Series, run_all
from hil.identify.replay import Stretch
from hil.sim.twin import Twin

Array = NDArray[np.float64]

FRAME_BITS: Final = 125
"""A frame of eight bytes with the mean number of stuff bits [M]."""
STAMP_SHARE: Final = 0.02
"""Of a tick of the position loop: no stamp is believed to tell better than that when its value held [R].
Otherwise an encoder without noise would count a microsecond of timing as gap."""
WAIT_FRAMES: Final = 2.0
"""A frame waits for up to so many others: the one on the bus and one of higher priority [R]."""


class Wait(NamedTuple):
    """Shares of the longest wait on the bus by which a drive's setpoints and answers vary."""

    setpoints: float
    answers: float


def longest_wait_s(rig: RigFile) -> float:
    """Most that a setpoint waits for the bus: no more than the rig file's setpoint delay, which has it in."""
    return min(WAIT_FRAMES * FRAME_BITS / rig.can.bitrate, rig.bus.setpoint_delay)


def at_ticks(problem: Problem, vector: Array) -> Array:
    """`vector` of the smooth twin with delays that make the drives' ticks act as late on average.

    A smooth setpoint acts half a tick after its arrival; one at the ticks acts at the next of them, which
    may lie always near or always far where bus cycle and ticks keep step.
    """
    bus, out = problem.rig.bus, np.array(vector)
    if bus.retimed or not problem.smooth:
        return out
    tick = bus.position_loop
    for a in problem.rig.actuator_names:
        told = [p.setpoints[a][0] for p in problem.pieces if p.mode == "position"]
        if not told:
            continue
        t = np.concatenate(told)
        i = problem.table.index(f"{a}.transport_delay.delay")
        wait = longest_wait_s(problem.rig) * (np.linspace(0.0, 1.0, 16) - 0.5)
        arrivals = (t[:, None] + wait + bus.setpoint_delay).ravel()
        asked = float(vector[i]) + 0.5 * tick
        low, high = asked - 1.5 * tick, asked + 0.5 * tick
        for _ in range(20):  # how late the next tick is rises with the delay: halve
            middle = 0.5 * (low + high)
            late = float(np.mean(np.ceil((arrivals + middle) / tick) * tick - arrivals))
            low, high = (middle, high) if late < asked else (low, middle)
        out[i] = np.clip(0.5 * (low + high), *_bounds(problem, i))
    return out


def _bounds(problem: Problem, i: int) -> tuple[float, float]:
    entry = problem.table.entries[i]
    return entry.lower, entry.upper


def draws(
    problem: Problem,
    vector: Array,
    rng: np.random.Generator,
    count: int,
    waits: Mapping[str, Wait] | None = None,
) -> Array:
    """(count, N) residuals of records that the twin itself made, against `problem`'s own prediction.

    `waits`: by actuator the shares of the longest wait by which arrivals and answers vary; default: all.
    """
    base = problem.predict(vector)[0]
    exact = at_ticks(problem, vector)
    longest_s = longest_wait_s(problem.rig)
    tasks = []
    for _ in range(count):
        for k, piece in enumerate(problem.pieces):
            told = {
                a: (_waited(t, _wait(waits, a).setpoints * longest_s, rng), v)
                for a, (t, v) in piece.setpoints.items()
            }
            series = [x for x in problem.series if x.stretch == k]
            stamps = {
                x.signal: _late(piece, x, problem.rig, _wait(waits, x.actuator), rng)
                for x in series
            }
            twin = Twin(problem.rig, payload=piece.payload)
            tasks.append((twin.record(told, stamps, mode=piece.mode), exact))
    flat = run_all(tasks)
    per = len(problem.pieces)
    out = np.array([np.concatenate(flat[d * per : (d + 1) * per]) for d in range(count)])
    for x in problem.series:
        out[:, x.part] = _sensed(out[:, x.part], problem.rig, x, rng)
    return np.asarray(out - base)


def sensor_sigma(rig: RigFile, x: Series) -> float:
    """Noise of one sample with its rounding, by the rig file, in the signal's unit; never 0."""
    spread, step = sensor_noise(rig, x.quantity)
    return float(np.hypot(spread, step / np.sqrt(12.0))) or 1e-12


def sensor_noise(rig: RigFile, quantity: str) -> tuple[float, float]:
    """Standard deviation and step of position, velocity, force, current, gyro or accel."""
    noise = rig.noise
    return float(getattr(noise, quantity)), float(getattr(noise, f"{quantity}_step"))


def _waited(t: Array, wait_s: float, rng: np.random.Generator) -> Array:
    """Send stamps with a wait drawn for each, less the mean wait, which the setpoint delay has in."""
    late = wait_s * (rng.random(len(t)) - 0.5)
    return np.maximum.accumulate(t + late)


def _late(piece: Stretch, x: Series, rig: RigFile, wait: Wait, rng: np.random.Generator) -> Array:
    """Receive stamps moved to where the sample may really have been taken."""
    t = piece.samples[x.signal][0]
    late = wait.answers * longest_wait_s(rig) * (rng.random(len(t)) - 0.5)
    if x.actuator != "imu":
        spread_s = max(rig.bus.answer_jitter, STAMP_SHARE * rig.bus.position_loop)
        late = late + spread_s * rng.standard_normal(len(t))
    return np.maximum.accumulate(t - late)


def _wait(waits: Mapping[str, Wait] | None, place: str) -> Wait:
    return Wait(1.0, 1.0) if waits is None else waits.get(place, Wait(1.0, 1.0))


def _sensed(values: Array, rig: RigFile, x: Series, rng: np.random.Generator) -> Array:
    spread, step = sensor_noise(rig, x.quantity)
    noisy = values + spread * rng.standard_normal(values.shape)
    return noisy if step == 0.0 else np.asarray(np.round(noisy / step) * step)
