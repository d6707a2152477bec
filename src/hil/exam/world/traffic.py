"""What goes to and fro between host, drives and sensors: when frames were sent, taken and received.

`chance` draws what a record tells (send times), `dark` what it does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.exam.world.body import Sensor, World
from hil.runs.folder import run_mode
from hil.sim.catalogue import IMU_CHANNELS

Array = NDArray[np.float64]

FRAME_BITS: Final = 125
"""A frame of eight bytes; a number of this world's own, as all of it is."""
BUSY: Final = 0.3
"""Chance that a frame finds the bus taken."""
TALK_S: Final = 5e-4
"""From a slot's start until the drive has the request."""
SOONEST_S: Final = 1e-4
"""After its sending, a force reaches its drive."""


@dataclass(frozen=True, slots=True)
class Answers:
    """Of a signal's N samples: when each was taken, arrived, and is said to have arrived."""

    taken_s: Array
    received_s: Array
    stamps_s: Array


@dataclass(frozen=True, slots=True)
class Exchanged:
    """Frames of one drive: when K setpoints were sent, when those that were not lost arrived and which they
    are, and its answers by signal."""

    sent_s: Array
    arrived_s: Array
    kept: NDArray[np.int64]
    answers: dict[str, Answers]


def exchanged(
    world: World, i: int, t_k: Array, chance: np.random.Generator, dark: np.random.Generator
) -> Exchanged:
    """What goes to and fro between the host and drive i, one setpoint for each cycle at t_k (K,)."""
    rig, bus, lost = world.rig, world.rig.bus, world.lost
    frame_s = FRAME_BITS / rig.can.bitrate
    slot = bus.stagger * i if bus.schedule == "parameter" else 0.0
    sent = rising(t_k + slot + np.abs(chance.normal(0.0, bus.jitter, len(t_k))))
    wait = frame_s * dark.random(len(sent)) * (dark.random(len(sent)) < BUSY)
    there = sent + bus.setpoint_delay + world.setpoint_delay_s[i] + wait - 0.5 * BUSY * frame_s
    kept = dark.random(len(sent)) >= lost.get("setpoints", 0.0)
    kept[0] = True
    if run_mode(rig) == "force":  # what it holds follows from what was measured until it was sent
        there = np.maximum(there, sent + SOONEST_S)
    answers, pattern = {}, bus.pattern
    for q in dict.fromkeys(pattern):
        turns = [k for k, x in enumerate(pattern) if x == q]
        asked = np.ones(len(sent), dtype=bool)
        if bus.schedule == "parameter":
            asked = np.isin(np.arange(len(sent)) % len(pattern), turns)
        stamp = sent[asked] + TALK_S + bus.answer_delay + frame_s * dark.random(asked.sum())
        stamp = stamp[dark.random(len(stamp)) >= lost.get("answers", 0.0)]
        signal = f"{rig.actuator_names[i]}.{q}"
        taken = stamp - bus.answer_delay - world.answer_delay_s[i]
        taken = taken + dark.normal(0.0, bus.answer_jitter, len(stamp))
        taken = taken - world.sensors.get(signal, Sensor()).latency_s
        answers[signal] = Answers(taken, stamp, stamp * (1.0 + world.clocks.get("drives", 0.0)))
    return Exchanged(sent, rising(there)[kept], np.flatnonzero(kept), answers)


def sampled(world: World, duration_s: float, dark: np.random.Generator) -> dict[str, Answers]:
    """Samples of the IMU by signal."""
    imu = world.rig.imu
    assert imu is not None
    t = np.arange(0.003 * dark.random(), duration_s, 1.0 / imu.rate)
    received = t - imu.group_delay_s + imu.delay
    stamps = received * (1.0 + world.clocks.get("imu", 0.0))
    out = {}
    for channel in IMU_CHANNELS:
        signal = f"imu.{channel}"
        late_s = world.sensors.get(signal, Sensor()).latency_s
        out[signal] = Answers(t + dark.normal(0.0, 2e-5) - late_s, received, stamps)
    return out


def rising(t: Array) -> Array:
    """`t` where it rises, and what it had reached where it falls."""
    return np.maximum.accumulate(t)
