"""The power stage of a simulated CiA 402 drive: its state machine, what trips it, and how it stops.

Stop reactions (hold at full force, then power off) are [M]; the standards leave them to the maker.
"""

from __future__ import annotations

import math

from hil.drives.cia402.mapping import HOMING_MODE
from hil.drives.cia402.meaning import INTERPOLATE
from hil.drives.cia402.profile import Cia402Profile
from hil.drives.power import (
    FAULTED,
    RESET_BIT,
    PowerCommand,
    PowerState,
    decode_control_word,
    encode_status_word,
    respond,
)
from hil.sim.cia402.homing import Homing
from hil.sim.cia402.motion import Motion402
from hil.sim.cia402.objects import Objects
from hil.sim.course import Course
from hil.sim.plant import Plant

FOLLOWING, COURSE = 0x8611, 0x8612
"""Emergency error codes: following error, end of the stroke (CiA 402-2 [M])."""


class PowerStage:
    """Power of drive `i` of the plant. `code` is the error that it is in fault for, 0 without."""

    def __init__(
        self, plant: Plant, i: int, objects: Objects, motion: Motion402, profile: Cia402Profile
    ) -> None:
        self.state = PowerState.SWITCH_ON_DISABLED
        self.voltage = True
        self.homing = Homing(plant, i, objects, motion, profile)
        self._plant, self._i, self._objects, self._motion = plant, i, objects, motion
        self._stop_s = profile.simulated.quick_stop
        self.restart()

    def restart(self) -> None:
        """As after power-on."""
        self.word = self.code = 0
        self.off_s = math.inf
        """When a stop that is under way ends in power off, s."""
        self.enabled_s = -math.inf
        self._course = Course(self._motion.senses)
        self._outside_s = math.inf

    @property
    def is_on(self) -> bool:
        """Force is made as told."""
        return self.state is PowerState.OPERATION_ENABLED

    def obey(self, now_s: float, word: int) -> None:
        """A control word acts."""
        command = decode_control_word(word)
        edge = bool(word & RESET_BIT) and not self.word & RESET_BIT
        start_homing = bool(word & INTERPOLATE) and not self.word & INTERPOLATE
        self.word = word
        before = self.state
        after = respond(before, command, reset_edge=edge, supplied=self.voltage)
        self._plant.advance(now_s)
        if before is PowerState.FAULT and after is not PowerState.FAULT:
            self.code = 0
            self._course.reset()
        if before is PowerState.QUICK_STOP_ACTIVE and after is not before:
            self.power_off(now_s, after)
        elif before is not PowerState.OPERATION_ENABLED:
            self.state = after
            if after is not before and self.is_on:
                self._motion.enable(self._objects)
                self.enabled_s = now_s
        elif after is PowerState.QUICK_STOP_ACTIVE:
            self.quick_stop(now_s)
        elif after is not before:
            self.power_off(now_s, after)
        is_asked = command is PowerCommand.ENABLE and start_homing
        if self.is_on and is_asked and self._objects.value(0x6060) == HOMING_MODE:
            self.homing.start(now_s)

    def on_time(self, now_s: float) -> None:
        """What stops and searches do by themselves."""
        if now_s >= self.off_s:
            self.power_off(now_s, PowerState.FAULT if self.code else PowerState.SWITCH_ON_DISABLED)
        self.homing.on_time(now_s)

    @property
    def next_due_s(self) -> float:
        """When `on_time` has something to do, s."""
        return min(self.off_s, self.homing.next_due_s)

    def watch(self, now_s: float) -> int | None:
        """The ends of the stroke and the following error: the code of what is wrong."""
        if not self.is_on:
            return None
        self._plant.advance(now_s)
        if self._course.is_left():
            return COURSE
        if abs(self._motion.following_counts()) <= self._objects.value(0x6065):
            self._outside_s = math.inf
        elif self._outside_s == math.inf:
            self._outside_s = now_s
        elif now_s - self._outside_s > self._objects.value(0x6066) * 1e-3:
            return FOLLOWING
        return None

    def trip(self, now_s: float, code: int) -> bool:
        """Fault: hold at once where it stands, power off after the quick stop. False if it is in fault."""
        if self.state in FAULTED:
            return False
        self._plant.advance(now_s)
        self.code = code
        if self.is_on:
            self._stand(now_s)
            self.state = PowerState.FAULT_REACTION
        else:
            self.power_off(now_s, PowerState.FAULT)
        return True

    def quick_stop(self, now_s: float) -> None:
        """Hold where it stands, then power off."""
        self._plant.advance(now_s)
        self._stand(now_s)
        self.state = PowerState.QUICK_STOP_ACTIVE

    def power_off(self, now_s: float, state: PowerState) -> None:
        """The brake closes."""
        self._plant.advance(now_s)
        self._plant.set_mode(self._i, "off")
        self.off_s = self._outside_s = math.inf
        self.homing.stop()
        self.state = state

    def set_voltage(self, now_s: float, *, present: bool) -> None:
        """The power supply of its motor comes or goes."""
        self.voltage = present
        if not present:
            faulted = self.state in FAULTED
            self.power_off(now_s, PowerState.FAULT if faulted else PowerState.SWITCH_ON_DISABLED)

    @property
    def status_word(self) -> int:
        """Object 0x6041."""
        word = encode_status_word(self.state, voltage=self.voltage)
        if self.voltage:
            word |= 0x0010
        return word | self.homing.status_bits

    def _stand(self, now_s: float) -> None:
        self.homing.stop()
        self._motion.hold()
        self.off_s = now_s + self._stop_s
