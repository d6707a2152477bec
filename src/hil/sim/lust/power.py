"""The power stage of a simulated CDD3000: the DRIVECOM machine, what trips it, and how it stops.

Errors and their codes follow drives/lust_cdd3000/drive.toml and the user manual CM-CAN1 [F]; stop reactions
(hold at full force, then power off) are [M]. Pure: told the time.
"""

from __future__ import annotations

import math
from typing import Final

from hil.config import RigFile
from hil.drives.lust_cdd3000.codec import Control
from hil.drives.lust_cdd3000.scales import Scales
from hil.drives.meaning import SetpointKind
from hil.drives.power import FAULTED, PowerCommand, PowerState, respond
from hil.drives.profile import LustProfile
from hil.sim.course import Course
from hil.sim.lust.parameters import ParameterServer
from hil.sim.plant import Plant
from hil.sim.senses import Senses


class PowerStage:
    """Power of drive `i` of the plant."""

    def __init__(
        self,
        rig: RigFile,
        i: int,
        plant: Plant,
        profile: LustProfile,
        senses: Senses,
        parameters: ParameterServer,
    ) -> None:
        self.state = PowerState.SWITCH_ON_DISABLED
        self.enpo = True
        """The hardware enable."""
        self.scales: Final = Scales(rig.actuators[i].drive, profile)
        self._i, self._plant, self._profile = i, plant, profile
        self._senses, self._parameters = senses, parameters
        self._watch_period_s = 1.2 * rig.bus.cycle
        self._watched_s = plant.now_s
        self._off_s = math.inf
        """When a stop that is under way ends in power off, s."""
        self._course = Course(self._senses)
        self._reference = 0

    @property
    def is_on(self) -> bool:
        """Force is made as told."""
        return self.state is PowerState.OPERATION_ENABLED

    @property
    def due_s(self) -> float:
        """When `on_time` has something to do, s."""
        return min(self._off_s, self._watched_s) if self.is_on else self._off_s

    def obey(self, now_s: float, control: Control, *, reset_edge: bool = False) -> None:
        """Follow the DRIVECOM machine; a positioning-mode drive prepares itself."""
        command = control.command
        if self._profile.layout.kind == "posmod" and command is PowerCommand.DISABLE:
            command = PowerCommand.PREPARE
        before = self.state
        after = respond(before, command, reset_edge=reset_edge, supplied=self.enpo)
        self._plant.advance(now_s)
        if before is PowerState.FAULT and after is not PowerState.FAULT:
            self._course.reset()
        if before is PowerState.OPERATION_ENABLED and after is not before:
            self.switch_off(now_s, after)
        elif before is not after:
            self.state = after
            if self.is_on:
                self._plant.set_mode(
                    self._i, "force" if self._parameters.takes_force else "position"
                )
                self._watched_s = now_s
        if self.is_on:
            self._reference = control.reference
            value = self.scales.setpoint(self._kind, control.reference)
            self._plant.set_setpoint(self._i, value, now_s - self._senses.frame_s)

    def on_time(self, now_s: float) -> int | None:
        """What happens by itself up to `now_s`; the code of an error that is found."""
        if now_s >= self._off_s:
            self.switch_off(now_s, PowerState.FAULT)
        return self.watch(now_s) if now_s >= self._watched_s else None

    def watch(self, now_s: float) -> int | None:
        """The ends of the stroke and the following error, once each cycle: the code of an error."""
        if not self.is_on:
            return None
        self._plant.advance(now_s)
        self._watched_s = now_s + self._watch_period_s
        if self._course.is_left():
            return self._profile.code_of("course_limitation")
        if self._kind == "position":
            reference = self.scales.setpoint("position", self._reference)
            error = abs(reference - self._plant.position(self._i))
            if error > self._profile.supervision.following_error:
                return self._profile.code_of("following_error")
        return None

    def trip(self, now_s: float) -> bool:
        """Error: hold at once where it stands, power off after the quick stop. False in fault already."""
        if self.state in FAULTED:
            return False
        self._plant.advance(now_s)
        if self.is_on:
            self._plant.set_mode(self._i, "position")
            self.state = PowerState.FAULT_REACTION
            self._off_s = now_s + self._profile.supervision.quick_stop
        else:
            self.switch_off(now_s, PowerState.FAULT)
        return True

    def switch_off(self, now_s: float, state: PowerState) -> None:
        """No force from now on."""
        self._plant.advance(now_s)
        self._plant.set_mode(self._i, "off")
        self._off_s = math.inf
        self.state = state

    @property
    def _kind(self) -> SetpointKind:
        return "force" if self._parameters.takes_force else "position"
