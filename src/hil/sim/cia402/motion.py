"""What a simulated CiA 402 drive does with its targets, mode by mode, and what it measures."""

from __future__ import annotations

from typing import Literal

import numpy as np

from hil.config import RigFile
from hil.drives.cia402.codec import clamp
from hil.drives.cia402.mapping import MODE_CODES, TARGETS, CyclicMode, Units
from hil.drives.cia402.profile import Cia402Profile, Missed
from hil.sim.cia402.objects import Objects
from hil.sim.plant import Plant
from hil.sim.senses import Senses

_MODES: dict[int, CyclicMode] = {code: mode for mode, code in MODE_CODES.items()}


class Motion402:
    """Moves drive `i` of the plant. Mode csv is the speed loop alone: position gain 0, speed fed forward."""

    def __init__(
        self, rig: RigFile, i: int, plant: Plant, profile: Cia402Profile, rng: np.random.Generator
    ) -> None:
        self._actuator = rig.actuators[i]
        self._precontrol = rig.control.precontrol
        self._plant, self._i = plant, i
        self._cycle_s = rig.bus.cycle
        self._units = Units(self._actuator)
        self.counts_per_unit = self._actuator.drive.counts_per_unit
        self.zero_m = 0.0
        """Where the drive's zero is, in the rig file's coordinates: where its encoder knows it, the same."""
        self.senses = Senses(rig, i, plant, rng)
        self._mode: CyclicMode | None = None
        self._value = self._before = 0.0
        self._last = {"position": 0, "velocity": 0, "force": 0}

    def enable(self, objects: Objects) -> None:
        """Force is to be made, in the mode that 0x6060 says; other modes hold the position."""
        self._mode = _MODES.get(objects.value(0x6060))
        a, whole = self._actuator, self._precontrol and self._mode in ("csp", "ip")
        self._plant.set_gains(
            self._i,
            position_gain=0.0 if self._mode == "csv" else a.position_gain,
            velocity_ff=1.0 if self._mode == "csv" or whole else a.velocity_ff,
            acceleration_ff=1.0 if whole else a.acceleration_ff,
            friction_ff=1.0 if whole else a.friction_ff,
        )
        self._plant.set_mode(self._i, "force" if self._mode == "cst" else "position")
        self._value = self._before = (
            0.0 if self._mode in ("cst", "csv") else self._plant.position(self._i)
        )
        self._integrated = self._plant.position(self._i)

    def hold(self) -> None:
        """Stand still, by position."""
        self._mode = None
        self._plant.set_gains(self._i, position_gain=self._actuator.position_gain)
        self._plant.set_mode(self._i, "position")
        self._value = self._before = self._plant.position(self._i)

    def target(self, objects: Objects, at_s: float) -> None:
        """The mode's target object counts, as if its frame had been sent at `at_s`."""
        if self._mode is None:
            return
        field = TARGETS[self._mode]
        raw = objects.value(field.index, field.sub)
        kind: Literal["position", "force", "velocity"]
        kind = {"cst": "force", "csv": "velocity"}.get(self._mode, "position")  # type: ignore[assignment]
        value = self._units.si(kind, raw)
        self._before, self._value = (
            self._value,
            value + (self.zero_m if kind == "position" else 0.0),
        )
        self._send(at_s)

    def go(self, position_m: float, at_s: float) -> None:
        """A point of a path of the drive's own."""
        self._plant.set_setpoint(self._i, position_m, at_s)

    def missed(self, reaction: Missed, at_s: float) -> None:
        """No target came: go on as before, or hold the last one."""
        if self._mode in ("csp", "ip"):
            step = self._value - self._before if reaction == "extrapolate" else 0.0
            self._before, self._value = self._value, self._value + step
        elif self._mode == "csv" and reaction == "hold":
            self._value = 0.0
        if self._mode is not None:
            self._send(at_s)

    def _send(self, at_s: float) -> None:
        value = self._value
        if self._mode == "csv":
            self._integrated += value * self._cycle_s
            value = self._integrated
        self._plant.set_setpoint(self._i, value, at_s)

    def following_counts(self) -> int:
        """Object 0x60F4: target less actual position, increments; 0 in modes without a position loop."""
        if self._mode not in ("csp", "ip"):
            return 0
        return round(
            (self._value - self._plant.position(self._i)) * self._actuator.drive.counts_per_unit
        )

    def actual(self, quantity: Literal["position", "velocity", "force"], now_s: float) -> int:
        """An actual value in the drive's units, with noise and rounding; the last one where the effect
        `lost_frames` loses it."""
        self._plant.advance(now_s)
        value = self.senses.measure(quantity)
        if value is not None:
            value -= self.zero_m if quantity == "position" else 0.0
            size = 2 if quantity == "force" else 4
            self._last[quantity] = clamp(self._units.raw(quantity, value), size, signed=True)
        return self._last[quantity]
