"""The parameter server of a simulated CANLust drive: numbers, types, bounds, and what a write does."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from hil.config import Actuator
from hil.drives.lust_cdd3000.codec import AnswerStatus, Mode, from_wire, to_wire
from hil.drives.lust_cdd3000.scales import Scales
from hil.drives.profile import LustProfile, Parameter, WireType
from hil.signals import Quantity
from hil.sim.plant import Plant

_QUANTITIES: Final[tuple[Quantity, ...]] = ("position", "velocity", "force", "current")


@dataclass(slots=True)
class _Stored:
    """A parameter that keeps what is written to it, within bounds."""

    type: WireType
    raw: int
    lowest: float
    highest: float
    while_enabled: bool = True
    apply: Callable[[float], None] | None = None
    show: Callable[[float], float] | None = None


class ParameterServer:
    """The parameters of drive `i`. Written values last until the drive restarts."""

    def __init__(
        self,
        actuator: Actuator,
        i: int,
        plant: Plant,
        profile: LustProfile,
        measure: Callable[[Quantity], float | None],
    ) -> None:
        self._actuator, self._i, self._plant = actuator, i, plant
        self._profile = profile
        self._measure = measure
        self._scales = Scales(actuator.drive, profile)
        self._measured: dict[int, Quantity] = {
            self._scales.parameters[q].number: q
            for q in _QUANTITIES
            if q != "current" or actuator.force_per_ampere is not None
        }
        self.restart()

    def restart(self) -> None:
        """As after power-on: no watchdog, position mode, gains of the rig file."""
        p, a = self._profile.parameters, self._actuator
        ahead, gains, mode = p.precontrol, p.gains, p.operating_mode
        modes = (mode.position, mode.force)
        self._stored = {
            p.watchdog.number: _Stored("int32", 0, 0, p.watchdog.largest),
            mode.number: _Stored("int32", mode.position, min(modes), max(modes), False),
            **self._gain(ahead.velocity, "velocity_ff", a.velocity_ff, 2.0),
            **self._gain(ahead.acceleration, "acceleration_ff", a.acceleration_ff, 2.0),
            **self._gain(ahead.friction, "friction_ff", a.friction_ff, 2.0),
            **self._gain(gains.position, "position_gain", a.position_gain, math.inf, "position"),
            **self._gain(gains.speed, "speed_gain", a.speed_gain, math.inf, "speed"),
            **self._gain(gains.integral, "integral_gain", a.integral_gain, math.inf, "integral"),
        }

    @property
    def watchdog_s(self) -> float:
        """The watchdog's time, s; 0 is none."""
        watchdog = self._profile.parameters.watchdog
        return self._stored[watchdog.number].raw * watchdog.unit

    @property
    def takes_force(self) -> bool:
        """References are torques."""
        mode = self._profile.parameters.operating_mode
        return self._stored[mode.number].raw == mode.force

    def answer(
        self, number: int, mode: int, value: int, *, enabled: bool
    ) -> tuple[AnswerStatus, int] | None:
        """Status and value of the answer to a request; None where the answer gets lost on its way."""
        if mode not in (Mode.READ, Mode.WRITE):
            return AnswerStatus.UNKNOWN_MODE, 0
        quantity = self._measured.get(number)
        if quantity is not None:
            if mode == Mode.WRITE:
                return AnswerStatus.CHANGE_NOT_PERMITTED, 0
            measured = self._measure(quantity)
            if measured is None:
                return None
            return AnswerStatus(0), self._scales.answer(quantity, measured)
        stored = self._stored.get(number)
        if stored is None:
            return AnswerStatus.UNKNOWN_PARAMETER, 0
        if mode == Mode.WRITE:
            return self._write(stored, value, enabled), value
        if stored.show is None:
            return AnswerStatus(0), stored.raw
        shown = stored.show(from_wire(stored.type, stored.raw))
        return AnswerStatus(0), to_wire(stored.type, shown)

    def _write(self, stored: _Stored, raw: int, enabled: bool) -> AnswerStatus:
        if enabled and not stored.while_enabled:
            return AnswerStatus.CHANGE_NOT_PERMITTED
        value = from_wire(stored.type, raw)
        if not stored.lowest <= value <= stored.highest or not math.isfinite(value):
            return AnswerStatus.BAD_VALUE
        stored.raw = raw
        if stored.apply is not None:
            stored.apply(value)
        return AnswerStatus(0)

    def _gain(
        self, parameter: Parameter, name: str, value: float, highest: float, loop: str = ""
    ) -> dict[int, _Stored]:
        """A gain of the drive's loops, given to the plant when written.

        What it reads back is the loop's true gain: with the effect `loop_gain`, not the rig file's.
        """
        scale, plant, i = parameter.scale, self._plant, self._i

        def apply(wire: float) -> None:
            plant.set_gains(i, **{name: wire * scale})

        def show(wire: float) -> float:
            index = plant.table.index(f"{self._actuator.name}.loop_gain.{loop}")
            return wire * float(plant.parameters[index])

        raw = to_wire(parameter.type, value / scale)
        apply(from_wire(parameter.type, raw))
        return {
            parameter.number: _Stored(
                parameter.type,
                raw,
                0.0,
                highest / scale,
                apply=apply,
                show=show if loop else None,
            )
        }
