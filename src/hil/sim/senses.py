"""What a simulated drive measures, and when its replies leave."""

from __future__ import annotations

import numpy as np

from hil.bus.load import RECKONED_BITS
from hil.config import RigFile
from hil.signals import Quantity
from hil.sim.plant import Plant


class Senses:
    """Encoder and current of drive `i` with the rig file's noise, steps and answer delay."""

    def __init__(self, rig: RigFile, i: int, plant: Plant, rng: np.random.Generator) -> None:
        noise = rig.noise
        self._noise = {
            "position": (noise.position, noise.position_step),
            "velocity": (noise.velocity, noise.velocity_step),
            "force": (noise.force, noise.force_step),
            "current": (noise.current, noise.current_step),
        }
        self._bus, self._i, self._plant, self._rng = rig.bus, i, plant, rng
        self._stroke = rig.actuators[i].stroke
        self.frame_s = RECKONED_BITS / rig.can.bitrates[rig.actuators[i].drive.bus]
        """Time that the drive reckons one frame on the bus with, s."""

    def reply_s(self, now_s: float) -> float:
        """When a reply leaves, so that it is received `bus.answer_delay` after now, jitter apart, s."""
        jitter_s = self._bus.answer_jitter * float(self._rng.standard_normal())
        return now_s + max(self._bus.answer_delay + jitter_s - self.frame_s, 0.0)

    def measure(self, quantity: Quantity) -> float | None:
        """A reading now, with noise, the effects of its sensor and rounding; None where it gets lost."""
        spread, step = self._noise[quantity]
        noise = spread * float(self._rng.standard_normal())
        value = self._plant.answer(self._i, quantity, self._plant.now_s, noise)
        if value is None or step == 0.0:
            return value
        return round(value / step) * step

    def beyond_course(self) -> float:
        """How far the drive stands outside its stroke, m or rad; 0 inside."""
        low, high = self._stroke
        position = self._plant.position(self._i)
        return max(low - position, position - high, 0.0)
