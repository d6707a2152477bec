"""A simulated CiA 402 drive on CANopen: what a servo drive with this EDS does, as far as the standards tell.

It boots, serves its objects, sends and takes process data at SYNC, follows the CiA 402 state machine,
watches its master's heartbeat, the ends of its stroke and its following error, homes, sends EMCY, and moves
the plant in modes ip, csp, csv, cst. What the standards leave open is in the drive file's table
`simulated`; stop reactions (hold at full force, then power off) are [M]. Pure: told the time, it gives frames
and instants.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from hil.config import RigFile
from hil.drives.cia402 import codec
from hil.drives.cia402.configure import AT_ONCE, DISABLED
from hil.drives.cia402.mapping import HOMING_MODE, MODE_CODES
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
from hil.errors import ProtocolError
from hil.frames import Frame
from hil.sim.cia402_motion import Motion402
from hil.sim.cia402_objects import Objects
from hil.sim.plant import Plant
from hil.sim.sdo_server import SdoServer

Timed = list[tuple[float, Frame]]

HEARTBEAT_LOST, PDO_LENGTH, FOLLOWING, COURSE, MISSED = 0x8130, 0x8210, 0x8611, 0x8612, 0xFF01
"""Emergency error codes that it sends by itself (CiA 301 and 402-2 [M]; the last is the maker's)."""
COURSE_SLACK_M: Final = 1e-3
"""A drive reset beyond the end of its stroke may move so much further out before it stops again [M]."""
TARGET_REACHED: Final = 0x0400
HOMING_ATTAINED: Final = 0x1000
_NmtState = codec.NmtState


class SimulatedCia402:
    """Drive `i` of a rig. `set_fault`, `silence`, `reboot`, `set_voltage`, `storm`, `wrong_pdos` break it."""

    def __init__(
        self, rig: RigFile, i: int, plant: Plant, profile: Cia402Profile, rng: np.random.Generator
    ) -> None:
        actuator = rig.actuators[i]
        self.name = actuator.name
        self.node = rig.address(i)
        self.frames = codec.node_ids(self.node)
        self.power = PowerState.SWITCH_ON_DISABLED
        self.voltage = True
        self.nmt = _NmtState.BOOT_UP
        self.missed = 0
        """Setpoints missed so far."""
        self._profile, self._plant, self._i = profile, plant, i
        self._cycle_s = rig.bus.cycle
        self.objects = Objects(profile, actuator, self.node)
        self.motion = Motion402(rig, i, plant, profile, rng)
        self._sdo = SdoServer(self.objects.read, self.objects.write)
        self.objects.live = self._live()
        self.objects.before_write = self._written
        self._now_s = plant.now_s
        self._sync_bits_s = 55 / rig.can.bitrates[actuator.drive.bus]
        self._silent = False
        self._storm_s = math.inf
        self._wrong_bytes = 0
        self._start(self._now_s)

    def _start(self, now_s: float) -> None:
        self.nmt = _NmtState.BOOT_UP
        self._boot_s = now_s + self._profile.simulated.boot
        self._beat_s = self._watched_s = self._off_s = self._homed_s = math.inf
        self._control = 0
        self._target: bytes | None = None
        self._sync_s = -math.inf
        self._in_a_row = 0
        self._allowance = 0.0
        self._outside_s = math.inf
        self._code = 0
        self.is_referenced = self._profile.homing.kind == "absolute"
        self._attained = False
        self._sdo.reset()

    def _live(self) -> dict[tuple[int, int], Callable[[], int]]:
        live: dict[tuple[int, int], Callable[[], int]] = {
            (0x1001, 0): lambda: int(self._code != 0),
            (0x2001, 0): lambda: int(self.is_referenced),
            (0x603F, 0): lambda: self._code,
            (0x6040, 0): lambda: self._control,
            (0x6041, 0): lambda: self.status_word,
            (0x6061, 0): lambda: self.objects.value(0x6060),
            (0x6064, 0): lambda: self.motion.actual("position", self._now_s),
            (0x606C, 0): lambda: self.motion.actual("velocity", self._now_s),
            (0x6077, 0): lambda: self.motion.actual("force", self._now_s),
            (0x60F4, 0): lambda: self.motion.following_counts(),
        }
        for key, entry in self._profile.objects.entries.items():
            if key in live and entry.size is None:
                del live[key]
        return live

    # -- frames and time -----------------------------------------------------------------------------

    def on_frame(self, now_s: float, frame: Frame) -> Timed:
        """A frame reaches the drive at `now_s`; frames to others and garbage do nothing."""
        if self._silent or frame.is_remote or frame.is_extended or frame.is_error:
            return []
        if self.nmt is _NmtState.BOOT_UP:
            return []
        self._now_s = now_s
        can_id = frame.can_id
        if can_id == codec.SYNC_ID:
            return self._on_sync()
        if can_id == self.objects.value(0x1400, 1) & 0x7FF:
            return self._on_values(frame.data)
        if can_id == self.frames.sdo_request and self.nmt is not _NmtState.STOPPED:
            answer = self._sdo.on_request(frame.data)
            later_s = self.motion.senses.reply_s(now_s)
            return [] if answer is None else [(later_s, Frame(self.frames.sdo_answer, answer))]
        if can_id == codec.NMT_ID:
            return self._on_nmt(frame.data)
        watched = self.objects.value(0x1016, 1)
        if watched and can_id == codec.HEARTBEAT_BASE + (watched >> 16 & 0x7F):
            self._watched_s = now_s + (watched & 0xFFFF) * 1e-3
        return []

    def on_time(self, now_s: float) -> Timed:
        """What the drive does by itself up to `now_s`."""
        self._now_s = now_s
        out: Timed = []
        if now_s >= self._boot_s:
            self._boot_s = math.inf
            self.nmt = _NmtState.PRE_OPERATIONAL
            self._beat_s = math.inf
            out.append(self._heartbeat(_NmtState.BOOT_UP))
        if now_s >= self._off_s:
            self._power_off(PowerState.FAULT if self._code else PowerState.SWITCH_ON_DISABLED)
        if now_s >= self._watched_s:
            self._watched_s = math.inf
            out += self._master_is_gone()
        if now_s >= self._homed_s:
            self._homed_s = math.inf
            self._attained = self.is_referenced = True
        if now_s >= self._sync_due_s:
            out += self._missed()
            self._sync_s += self._cycle_s
        if self._period_s and now_s >= self._heartbeat_due_s:
            self._beat_s = now_s + self._period_s
            out.append(self._heartbeat(self.nmt))
        if now_s >= self._storm_s:
            self._storm_s = now_s + 0.002
            out.append(self._emergency(0x7300))
        return [] if self._silent else out

    @property
    def next_due_s(self) -> float:
        """When `on_time` has something to do, s."""
        beat_s = self._heartbeat_due_s if self._period_s else math.inf
        return min(
            self._boot_s,
            self._off_s,
            self._watched_s,
            self._homed_s,
            self._sync_due_s,
            beat_s,
            self._storm_s,
        )

    @property
    def _period_s(self) -> float:
        return 0.0 if self.nmt is _NmtState.BOOT_UP else self.objects.value(0x1017) * 1e-3

    @property
    def _heartbeat_due_s(self) -> float:
        return self._now_s if self._beat_s == math.inf else self._beat_s

    @property
    def _sync_due_s(self) -> float:
        """A SYNC is missed half a cycle after it should have come."""
        if self.power is not PowerState.OPERATION_ENABLED or not self._is_cyclic:
            return math.inf
        return self._sync_s + 1.5 * self._cycle_s

    @property
    def _is_cyclic(self) -> bool:
        return self.objects.value(0x6060) in MODE_CODES.values()

    # -- the network ---------------------------------------------------------------------------------

    def _on_nmt(self, data: bytes) -> Timed:
        try:
            command, node = codec.decode_nmt(data)
        except ProtocolError:
            return []
        if node not in (0, self.node):
            return []
        if command is codec.NmtCommand.RESET_NODE:
            self.reboot(self._now_s)
        elif command is codec.NmtCommand.RESET_COMMUNICATION:
            was_referenced = self.is_referenced
            self.reboot(self._now_s)
            self.is_referenced = was_referenced
        elif command is codec.NmtCommand.START:
            self.nmt = _NmtState.OPERATIONAL
        else:
            was = self.nmt
            stops = command is codec.NmtCommand.STOP
            self.nmt = _NmtState.STOPPED if stops else _NmtState.PRE_OPERATIONAL
            if was is _NmtState.OPERATIONAL and self.power is PowerState.OPERATION_ENABLED:
                return self._abort_connection(0)
        return []

    def _heartbeat(self, state: codec.NmtState) -> tuple[float, Frame]:
        return self._now_s, Frame(self.frames.heartbeat, codec.encode_heartbeat(state))

    def _emergency(self, code: int) -> tuple[float, Frame]:
        data = codec.encode_emcy(codec.Emergency(code, int(code != 0)))
        return self._now_s, Frame(self.frames.emcy, data)

    def _master_is_gone(self) -> Timed:
        return [self._emergency(HEARTBEAT_LOST), *self._abort_connection(HEARTBEAT_LOST)]

    def _abort_connection(self, code: int) -> Timed:
        """Object 0x6007: nothing, fault, power off or quick stop; without force only a fault is told."""
        reaction = self.objects.value(0x6007)
        if reaction == 1 and code:
            return self._trip(code, told=True)
        if reaction == 2 and self.power not in FAULTED:
            self._power_off(PowerState.SWITCH_ON_DISABLED)
        elif reaction and self.power is PowerState.OPERATION_ENABLED:
            self._quick_stop()
        return []

    def _on_sync(self) -> Timed:
        out: Timed = []
        self._sync_s = self._now_s
        if self.nmt is not _NmtState.OPERATIONAL:
            return []
        if self.objects.value(0x1400, 2) < AT_ONCE - 1:  # a synchronous RPDO
            if self._target is not None:
                out += self._take(self._target, self._now_s - self._sync_bits_s - self._cycle_s)
                self._target = None
            elif self.power is PowerState.OPERATION_ENABLED:
                out += self._missed()
        elif self._target is None and self.power is PowerState.OPERATION_ENABLED:
            out += self._missed()
        else:
            self._target = None
        out += self._watch()
        if (
            not self.objects.value(0x1800, 1) & DISABLED
            and 1 <= self.objects.value(0x1800, 2) <= 240
        ):
            at_s = self.motion.senses.reply_s(self._now_s)
            out.append((at_s, Frame(self.objects.value(0x1800, 1) & 0x7FF, self._values())))
        return out

    def _values(self) -> bytes:
        if self._wrong_bytes > 0:
            self._wrong_bytes -= 1
            return bytes(3)
        mapped = self.objects.mapped(0x1A00)
        return b"".join(self.objects.read(e.index, e.sub) for e in mapped)

    def _on_values(self, data: bytes) -> Timed:
        if self.nmt is not _NmtState.OPERATIONAL or self.objects.value(0x1400, 1) & DISABLED:
            return []
        if len(data) != sum(e.size or 0 for e in self.objects.mapped(0x1600)):
            return [self._emergency(PDO_LENGTH)]
        self._target = data
        if self.objects.value(0x1400, 2) >= AT_ONCE - 1:
            return self._take(data, self._now_s - self.motion.senses.frame_s)
        return []

    def _take(self, data: bytes, at_s: float) -> Timed:
        """Process data acts: control word first, then the target of the mode."""
        self._in_a_row = 0
        values: dict[int, int] = {}
        for entry in self.objects.mapped(0x1600):
            size = entry.size or 0
            part, data = data[:size], data[size:]
            value = entry.decode(part)
            assert isinstance(value, int)
            values[entry.index] = value
            self.objects.put((entry.index, entry.sub), value)
        if 0x6040 in values:
            self._obey(values[0x6040])
        if self.power is PowerState.OPERATION_ENABLED and self._is_cyclic:
            self.motion.target(self.objects, at_s)
        return []

    def _missed(self) -> Timed:
        """One more setpoint did not come in time."""
        self.missed += 1
        self._in_a_row += 1
        reactions = self._profile.simulated.missed_setpoints
        reaction = reactions[min(self._in_a_row, len(reactions)) - 1]
        if reaction == "fault":
            return self._trip(MISSED)
        self.motion.missed(reaction, self._now_s - self._cycle_s)
        return []

    # -- the power stage -----------------------------------------------------------------------------

    def _written(self, key: tuple[int, int], value: int) -> None:
        """Objects that act when they are written over SDO."""
        if key == (0x6040, 0):
            self._obey(value)
        elif key == (0x1017, 0):
            self._beat_s = self._now_s
        elif key == (0x1016, 1):
            self._watched_s = math.inf  # from the first heartbeat on
        elif (
            key[0] in (0x607A, 0x6071, 0x60FF, 0x60C1)
            and self.power is PowerState.OPERATION_ENABLED
        ):
            self.objects.put(key, value)
            self.motion.target(self.objects, self._now_s)

    def _obey(self, word: int) -> None:
        command = decode_control_word(word)
        edge = bool(word & RESET_BIT) and not self._control & RESET_BIT
        start_homing = bool(word & INTERPOLATE) and not self._control & INTERPOLATE
        self._control = word
        before = self.power
        after = respond(before, command, reset_edge=edge)
        if not self.voltage and after not in FAULTED:
            after = PowerState.SWITCH_ON_DISABLED
        self._plant.advance(self._now_s)
        if before is PowerState.FAULT and after is not PowerState.FAULT:
            self._code = 0
            self._allowance = self.motion.senses.beyond_course() + COURSE_SLACK_M
        if after is PowerState.QUICK_STOP_ACTIVE and before is PowerState.OPERATION_ENABLED:
            self._quick_stop()
        elif before is PowerState.OPERATION_ENABLED and after is not before:
            self._power_off(after)
        elif before is not after:
            self.power = after
            if after is PowerState.OPERATION_ENABLED:
                self.motion.enable(self.objects)
                self._sync_s = self._now_s
        enabled = self.power is PowerState.OPERATION_ENABLED and command is PowerCommand.ENABLE
        if enabled and start_homing and self.objects.value(0x6060) == HOMING_MODE:
            self._home()

    def _home(self) -> None:
        """Its search is not modelled: after a while it stands referenced where it is [M]."""
        self._attained = False
        self._homed_s = self._now_s + 0.5

    def _quick_stop(self) -> None:
        self._plant.advance(self._now_s)
        self.motion.hold()
        self.power = PowerState.QUICK_STOP_ACTIVE
        self._off_s = self._now_s + self._profile.simulated.quick_stop

    def _watch(self) -> Timed:
        """The ends of the stroke and the following error."""
        if self.power is not PowerState.OPERATION_ENABLED:
            return []
        self._plant.advance(self._now_s)
        beyond = self.motion.senses.beyond_course()
        if beyond == 0.0:
            self._allowance = 0.0
        elif beyond > self._allowance:
            return self._trip(COURSE)
        if abs(self.motion.following_counts()) <= self.objects.value(0x6065):
            self._outside_s = math.inf
        elif self._outside_s == math.inf:
            self._outside_s = self._now_s
        elif self._now_s - self._outside_s > self.objects.value(0x6066) * 1e-3:
            return self._trip(FOLLOWING)
        return []

    def _trip(self, code: int, *, told: bool = False) -> Timed:
        """Fault: hold at once where it stands, power off after the quick stop; EMCY goes out."""
        if self.power in FAULTED:
            return []
        self._plant.advance(self._now_s)
        self._code = code
        if self.power is PowerState.OPERATION_ENABLED:
            self.motion.hold()
            self.power = PowerState.FAULT_REACTION
            self._off_s = self._now_s + self._profile.simulated.quick_stop
        else:
            self._power_off(PowerState.FAULT)
        return [] if told else [self._emergency(code)]

    def _power_off(self, state: PowerState) -> None:
        self._plant.advance(self._now_s)
        self._plant.set_mode(self._i, "off")
        self._off_s = self._homed_s = self._outside_s = math.inf
        self.power = state

    @property
    def status_word(self) -> int:
        """Object 0x6041."""
        word = encode_status_word(self.power, voltage=self.voltage)
        if self.voltage:
            word |= 0x0010
        if self.objects.value(0x6060) == HOMING_MODE and self._attained:
            word |= HOMING_ATTAINED | TARGET_REACHED
        return word

    # -- how to break it -----------------------------------------------------------------------------

    def set_fault(self, code: int) -> Timed:
        """It finds an error by itself now; returns what it sends."""
        return self._trip(code)

    def silence(self, *, silent: bool = True) -> None:
        """Its bus cable is cut: it hears and says nothing."""
        self._silent = silent

    def storm(self, now_s: float, *, on: bool = True) -> None:
        """It sends emergency messages every 2 ms, or ends to."""
        self._storm_s = now_s if on else math.inf

    def wrong_pdos(self, count: int) -> None:
        """Its next `count` PDOs have another length than is mapped."""
        self._wrong_bytes = count

    def set_voltage(self, now_s: float, *, present: bool) -> None:
        """The power supply of its motor comes or goes."""
        self._now_s = now_s
        self.voltage = present
        if not present:
            faulted = self.power in FAULTED
            self._power_off(PowerState.FAULT if faulted else PowerState.SWITCH_ON_DISABLED)

    def reboot(self, now_s: float) -> None:
        """It starts again: all that was written is gone."""
        self._now_s = now_s
        self._power_off(PowerState.SWITCH_ON_DISABLED)
        self.objects.restart()
        self._start(now_s)
