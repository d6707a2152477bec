"""Rides and their twin as the one vector problem that every question about the gap is asked of."""

from __future__ import annotations

import os
from collections.abc import Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.bicycle.recorded import Ride
from hil.bicycle.sensors import IMU_SIGNALS
from hil.config import BicycleFile
from hil.errors import IdentificationError
from hil.gap.bicycle.leaves import ride_leaves
from hil.gap.bicycle.twin import FREE_M_S, LEAN_TORQUE, RideTwin
from hil.gap.bicycle.wheels import TYRES, Wheels
from hil.gap.record.leaf import Leaf
from hil.gap.record.problem import Mask, Problem, Series
from hil.rigs.bicycle import pack
from hil.sim.parameters import Parameter, ParameterTable

Array = NDArray[np.float64]

EARLY_S: Final = 0.005
"""By which stamps may be early beyond the delays that the rig file takes off: three times what a healthy
bicycle's clocks are apart."""
TURNING_S: Final = 0.02
"""The same of the steer, for a bicycle turns later than it is steered: three times what tyres
turn it later by, give or take (`hil.gap.bicycle.wheels`)."""


@dataclass(frozen=True, slots=True)
class RidePiece:
    """A ride as a stretch, on a road whose slope (N,) is known; None where it is level."""

    ride: Ride
    slope: Array | None = None

    @property
    def name(self) -> str:
        """Of the run."""
        return self.ride.name

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last instant, s on the run's clock."""
        t = self.ride.t_s
        return float(t[0]), float(t[-1])

    def until(self, end_s: float) -> RidePiece:
        """The same ride up to an instant."""
        count = int(np.searchsorted(self.ride.t_s, end_s, side="right"))
        slope = None if self.slope is None else self.slope[:count]
        return RidePiece(replace(self.ride, angles=self.ride.angles[:count]), slope)


class RideProblem(Problem):
    """Measured and predicted samples of some rides of one bicycle: IMU signals, and the lean torque left.

    `slopes`: of the rides' roads, where they are known; `wheels`: what they were ridden on.
    IdentificationError where no ride carries an IMU and no rider's mass tells the lean torque.
    """

    def __init__(
        self,
        rig: BicycleFile,
        rides: Sequence[Ride],
        slopes: Sequence[Array | None] = (),
        wheels: Wheels = TYRES,
    ) -> None:
        self.rig: Any = rig
        self.rides = tuple(rides)
        self.wheels = wheels
        self.clocks = {}
        self.settle_s = 0.0
        self.table = ParameterTable(rig)
        self.table.entries = tuple(_causal(p, rig) for p in self.table.entries)
        self.base: Array = self.table.from_effects(rig.effects)
        bicycle = pack(rig)
        self.twins: list[RideTwin] = []
        series: list[Series] = []
        measured: list[Array] = []
        stamps: list[Array] = []
        kept: list[Mask] = []
        pieces = []
        size = 0
        for k, (recorded, slope) in enumerate(zip_longest(rides, slopes)):
            signals = [s for s in IMU_SIGNALS if s in recorded.imu]
            if rig.rider.mass > 0.0:
                signals.append(LEAN_TORQUE)
            twin = RideTwin(rig, bicycle, recorded, tuple(signals), slope)
            self.twins.append(twin)
            t = recorded.t_s
            pieces.append(RidePiece(recorded, slope))
            known = twin.measured()
            free = twin.speed() > FREE_M_S
            for s in signals:
                count = len(known[s])
                series.append(Series(s, k, slice(size, size + count)))
                size += count
                measured.append(known[s])
                stamps.append(t[twin.judged])
                kept.append(free if s == LEAN_TORQUE else np.ones(count, dtype=bool))
        self.pieces: Any = tuple(pieces)
        self.sent = self.pieces
        self.series = tuple(series)
        if not series:
            raise IdentificationError(
                f"{', '.join(p.name for p in pieces)}: holds no IMU, and no rider's mass is known, so a ride "
                "says nothing against its model"
            )
        self.measured: Array = np.concatenate(measured)
        self.t_s: Array = np.concatenate(stamps)
        self.kept: Mask = np.concatenate(kept)

    @property
    def actuators(self) -> tuple[str, ...]:
        """A bicycle has none."""
        return ()

    @property
    def are_forces(self) -> bool:
        """No: nothing is told to a bicycle."""
        return False

    @property
    def discount(self) -> float:
        """1: what a bicycle's model gets wrong is in the noise of its rides."""
        return 1.0

    def on(self, pieces: Any, clocks: Any) -> RideProblem:
        """The same questions of other rides."""
        del clocks  # drives have them
        return RideProblem(
            self.rig, [p.ride for p in pieces], [p.slope for p in pieces], self.wheels
        )

    def values(self, vector: Array) -> dict[str, float]:
        """A parameter vector by name."""
        names = (p.name for p in self.table.entries)
        return dict(zip(names, vector.tolist(), strict=True))

    def own_leaves(self, without: Collection[str]) -> list[Leaf] | None:
        """A ride's own candidates."""
        return ride_leaves(self, without)

    def answers(self, vectors: Array) -> Array:
        """(B, N) samples for B parameter vectors (B, P of the table); NaN where the twin cannot stand."""
        rows = [self.values(v) for v in np.atleast_2d(vectors)]
        tasks = [(twin, row) for row in rows for twin in self.twins]
        if len(tasks) == 1:
            flat = [_flat(*tasks[0])]
        else:
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                flat = list(pool.map(lambda task: _flat(*task), tasks))
        per = len(self.twins)
        return np.array([np.concatenate(flat[b * per : (b + 1) * per]) for b in range(len(rows))])

    def changes(self, vectors: Array, vector: Array, base: Array) -> Array:
        """(B, N) by how much the answers for B vectors differ from `base`: rides have no ticks."""
        del vector
        return np.asarray(self.answers(vectors) - base)

    def motion(self, vector: Array) -> list[dict[str, Array]]:
        """For each ride "t", "speed" (m/s), "front" (normal force, N) and "yaw_rate" at its judged rows."""
        out = []
        for twin in self.twins:
            motion = twin.motion(self.values(vector))
            rows = twin.judged
            out.append(
                {
                    "t": twin.recorded.t_s[rows],
                    "speed": motion.speed[rows],
                    "front": motion.normal[rows, 1],
                    "yaw_rate": motion.qd[rows, 2],
                }
            )
        return out

    def _own_samples(self, group: tuple[str, ...]) -> Mask | None:
        """Biases of lean, wheel and steer act through the ride: only those of what the twin answers act on
        their own samples."""
        if not all(name.startswith(("imu.", LEAN_TORQUE)) for name in group):
            return None
        return super()._own_samples(group)


def _causal(p: Parameter, rig: BicycleFile) -> Parameter:
    """`p`, a latency with the bound that no sensor answers before it is asked, a slip with the bound that no
    wheel goes further than it rolls."""
    if p.effect == "wheel_slip":
        return replace(p, lower=0.0)
    if p.effect != "sensor_latency":
        return p
    known = rig.sensors.lean_delay if p.location == "lean" else 0.0
    if p.location == "steer":
        return replace(p, lower=-TURNING_S)
    if p.location.startswith("imu") and rig.imu is not None:
        known = rig.imu.delay + rig.imu.group_delay_s
    return replace(p, lower=-(known + EARLY_S))


def _flat(twin: RideTwin, values: dict[str, float]) -> Array:
    answer = twin.answer(values)
    return np.concatenate([answer[s] for s in twin.signals])
