"""The ride computed while it is ridden: the same equations on the stream, half a second late.

A zero-phase filter needs what comes after. So the newest stretch of samples is smoothed again and
again and only its part older than DELAY_S is taken, when the filter no longer changes it; the path goes
on from where it stood. What comes out is the offline analysis, DELAY_S later.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.bicycle.effects import RideEffects
from hil.bicycle.sensors import IMU_SIGNALS, calibrated
from hil.config import BicycleFile
from hil.config.bicycle import BICYCLE, SIGNALS
from hil.rigs.bicycle import Smooth, pack, ride, smooth
from hil.signals import IMU_QUANTITIES, Sample

Array = NDArray[np.float64]

DELAY_S: Final = 0.5
"""Two and a half periods of a 5 Hz filter: what comes later changes a smooth angle by under 1e-4 of it."""
WINDOW_S: Final = 2.5
CHUNK: Final = 10
"""Samples computed at once: ten times a second at 100 Hz."""


@dataclass(frozen=True, slots=True)
class LiveState:
    """What the model says of one instant; SI units."""

    t_s: float
    x: float
    y: float
    yaw: float
    lean: float
    steer: float
    speed: float
    steer_torque: float
    drive_torque: float
    normal_rear: float
    normal_front: float
    friction_demand: float
    imu_off: dict[str, float]
    """By IMU quantity: measured minus model over the last chunk (mean)."""


class LiveRide:
    """Fed with samples, gives states. Holds no clock; time is the samples' own."""

    def __init__(self, rig: BicycleFile) -> None:
        self._rig = rig
        self._bicycle = pack(rig)
        self._effects = RideEffects.of(rig).rigid
        self._dt_s = 1.0 / rig.rate
        self._series: dict[str, deque[tuple[float, float]]] = {
            s: deque() for s in (*SIGNALS, *IMU_QUANTITIES)
        }
        self._next_s: float | None = None
        self._start: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
        self._zero: float | None = None
        still = np.zeros((2, 3))  # compiled code loads now, not while samples wait
        ride(self._bicycle, Smooth(self._dt_s, still, still, still))

    def add(self, sample: Sample) -> None:
        """Take in one sample of the bicycle or its IMU."""
        if sample.source in (BICYCLE, "imu") and sample.quantity in self._series:
            self._series[sample.quantity].append((sample.sampled_s, sample.value))

    def states(self) -> list[LiveState]:
        """What can be said since the last call."""
        out = []
        while (chunk := self._ready()) is not None:
            out.append(self._advance(chunk))
        return out

    def _ready(self) -> tuple[float, float] | None:
        """Start and end of the next stretch that samples cover, or None."""
        angles = [self._series[s] for s in SIGNALS]
        if any(len(a) < 2 for a in angles):
            return None
        if self._next_s is None:
            self._next_s = max(a[0][0] for a in angles)
        end = self._next_s + CHUNK * self._dt_s
        newest = min(a[-1][0] for a in angles)
        return (self._next_s, end) if newest >= end + DELAY_S else None

    def _advance(self, span: tuple[float, float]) -> LiveState:
        start, end = span
        first = max(a[0][0] for a in (self._series[s] for s in SIGNALS))
        before = min(int((start - first) / self._dt_s), int(WINDOW_S / self._dt_s))
        after = int(DELAY_S / self._dt_s)
        grid = start + self._dt_s * np.arange(-before, CHUNK + 1 + after)
        zero = (self._rig.sensors.lean_zero, 0.0, self._rig.sensors.steer_zero)
        columns = []
        for s, z in zip(SIGNALS, zero, strict=True):
            t, values = self._arrays(s)
            late = self._rig.sensors.lean_delay if s == "lean" else 0.0
            columns.append(np.interp(grid + late, t, values) - z)
        if self._zero is None:
            self._zero = float(columns[1][0])
        columns[1] = columns[1] - self._zero
        how = self._rig.conditioning
        true = self._effects.true_angles(
            np.asarray(grid, dtype=np.float64), np.column_stack(columns)
        )
        told = smooth(true, self._dt_s, how.cutoff, how.order)
        part = slice(before, before + CHUNK + 1)  # the last sample is the next stretch's first
        piece = Smooth(self._dt_s, told.angle[part], told.rate[part], told.acceleration[part])
        motion = self._effects.motion(self._bicycle, piece, self._start)
        last = motion.q[-1]
        self._start = (float(last[0]), float(last[1]), float(last[2]), float(last[7]))
        self._next_s = end
        instants = np.asarray(grid[part], dtype=np.float64)
        off = self._imu_off(instants, self._effects.imu(instants, motion))
        self._forget(end - WINDOW_S - DELAY_S)
        k = CHUNK
        return LiveState(
            end, float(last[0]), float(last[1]), float(last[2]), float(last[3]), float(last[6]),
            float(motion.speed[k]), float(motion.steer_torque[k]), float(motion.drive_torque[k]),
            float(motion.normal[k, 0]), float(motion.normal[k, 1]),
            float(motion.friction_demand[k].max()), off,
        )  # fmt: skip

    def _imu_off(self, t: Array, model: Array) -> dict[str, float]:
        out = {}
        raw = {f"imu.{q}": self._arrays(q) for q in IMU_QUANTITIES if len(self._series[q])}
        for signal, (stamps, values) in calibrated(raw, self._rig.sensors).items():
            inside = (stamps >= t[0]) & (stamps < t[-1])
            if inside.any():
                told = np.interp(stamps[inside], t, model[:, IMU_SIGNALS.index(signal)])
                out[signal.partition(".")[2]] = float(np.mean(values[inside] - told))
        return out

    def _arrays(self, signal: str) -> tuple[Array, Array]:
        pairs = np.array(self._series[signal]).reshape(-1, 2)
        return pairs[:, 0], pairs[:, 1]

    def _forget(self, until_s: float) -> None:
        for series in self._series.values():
            while len(series) > 2 and series[1][0] < until_s:
                series.popleft()
