"""Shapes the motion every few milliseconds and plays it cycle by cycle: a rig of 1 ms needs no plan each.

The shaper's states, each of which has a stop that keeps all limits, are nodes `SHAPING_S` apart; between two
of them runs the polynomial of fifth order that has both nodes' position, velocity and acceleration. So
setpoints have no step and their speed has none. What is asked (follow, hold, park) counts from the next node
on. A rig whose cycle is as long is shaped in each cycle.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.control.reference import Reference
from hil.control.shaping import CueShaper
from hil.rigs import Manipulator

Vector = NDArray[np.float64]

SHAPING_S: Final = 0.005
"""Between two nodes at most, s: half of what the parameter channel's rigs are shaped at."""


class PacedShaper:
    """A `CueShaper` asked every `every` cycles. `shaper` takes cues, gain and mode."""

    def __init__(self, rig: RigFile, manipulator: Manipulator) -> None:
        self.every = max(1, int(SHAPING_S / rig.bus.cycle + 1e-6))
        bus = rig.bus.model_copy(update={"cycle": self.every * rig.bus.cycle})
        self.shaper = CueShaper(rig.model_copy(update={"bus": bus}), manipulator)
        self._cycle_s = rig.bus.cycle
        self._n = manipulator.n
        self._between = _basis(self.every, bus.cycle)
        self._played = self.every
        self._from = np.zeros((3, self._n))
        self._node: Reference | None = None
        self._rows: NDArray[np.float64] = np.zeros((self.every, 3, self._n))
        self._began_at_rest = True

    @property
    def at_rest(self) -> bool:
        """Whether what is played has come to rest."""
        is_done = self._played == self.every
        return self.shaper.at_rest and (is_done or self._began_at_rest)

    @property
    def at_parked(self) -> bool:
        """Whether it rests in the parked pose."""
        return self.at_rest and self.shaper.at_parked

    def reset(self, pose: Vector) -> None:
        """Start from rest at `pose` (n,)."""
        self.shaper.reset(pose)
        self._from = np.array([pose, np.zeros(self._n), np.zeros(self._n)])
        self._node, self._played = None, self.every

    def step(self, now_s: float) -> Reference:
        """The motion wanted one bus cycle after `now_s`. Call once a cycle."""
        if self.every == 1:
            return self.shaper.step(now_s)
        if self._played == self.every:
            self._plan(now_s)
        node = self._node
        assert node is not None
        pose, velocity, acceleration = self._rows[self._played]
        self._played += 1
        return Reference(now_s + self._cycle_s, pose, velocity, acceleration, node.limited)

    def _plan(self, now_s: float) -> None:
        if self._node is not None:
            node = self._node
            self._from = np.array([node.pose, node.velocity, node.acceleration])
        self._began_at_rest = self.shaper.at_rest
        node = self._node = self.shaper.step(now_s)
        ends = np.concatenate((self._from, (node.pose, node.velocity, node.acceleration)))
        self._rows = (self._between @ ends).reshape(self.every, 3, self._n)
        self._rows[-1] = ends[3:]
        self._played = 0


def _basis(every: int, span_s: float) -> NDArray[np.float64]:
    """Position, velocity, acceleration after 1..every parts of `span_s` from both ends' (3 every, 6)."""
    powers = np.arange(6)

    def rows(t_s: float) -> NDArray[np.float64]:
        up = np.concatenate((np.zeros(2), t_s**powers))
        first, second = powers * up[1:7], powers * (powers - 1) * up[:6]
        return np.array([up[2:], first, second])

    ends = np.concatenate((rows(0.0), rows(span_s)))
    at = np.concatenate([rows(span_s * (k + 1) / every) for k in range(every)])
    basis: NDArray[np.float64] = at @ np.linalg.inv(ends)
    return basis
