"""A simulated CiA 402 drive on CANopen: what a servo drive with this EDS does, as far as the standards tell.

It boots, serves its objects, watches its master's heartbeat and sends EMCY; its process data are in
`cia402_exchange`, its power stage and faults in `cia402_power`, its search for zero in `cia402_homing`, what
it does to the plant in modes ip, csp, csv, cst in `cia402_motion`. What the standards leave open is in the
drive file's table `simulated`. Pure: told the time, it gives frames and instants.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from hil.config import RigFile
from hil.drives.cia402 import codec
from hil.drives.cia402.profile import Cia402Profile
from hil.drives.power import FAULTED, PowerState
from hil.errors import ProtocolError
from hil.frames import Frame
from hil.sim.cia402.exchange import ProcessData
from hil.sim.cia402.motion import Motion402
from hil.sim.cia402.objects import Objects
from hil.sim.cia402.power import PowerStage
from hil.sim.cia402.sdo_server import SdoServer
from hil.sim.plant import Plant

Timed = list[tuple[float, Frame]]

HEARTBEAT_LOST = 0x8130
"""Emergency error code (CiA 301 [M])."""
TARGETS = (0x607A, 0x6071, 0x60FF, 0x60C1)
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
        self.nmt = _NmtState.BOOT_UP
        self._profile, self._cycle_s = profile, rig.bus.cycle
        self.objects = Objects(profile, actuator, self.node)
        self.motion = Motion402(rig, i, plant, profile, rng)
        self._power = PowerStage(plant, i, self.objects, self.motion, profile)
        sync_bits_s = 55 / rig.can.bitrates[actuator.drive.bus]
        self._data = ProcessData(
            self.objects, self.motion, self._power, profile, rig.bus.cycle, sync_bits_s
        )
        self._sdo = SdoServer(self.objects.read, self.objects.write)
        self.objects.live = self._live()
        self.objects.before_write = self._written
        self._now_s = plant.now_s
        self._silent = False
        self._storm_s = math.inf
        self._start(self._now_s)

    def _start(self, now_s: float) -> None:
        self.nmt = _NmtState.BOOT_UP
        self._boot_s = now_s + self._profile.simulated.boot
        self._beat_s = self._watched_s = math.inf
        self._power.restart()
        self._data.restart()
        self._sdo.reset()

    @property
    def power(self) -> PowerState:
        """State of its power stage."""
        return self._power.state

    @property
    def missed(self) -> int:
        """Setpoints missed so far."""
        return self._data.missed

    @property
    def is_referenced(self) -> bool:
        """Its positions count from the zero that homing found, or its encoder knows."""
        return self._power.homing.is_referenced

    @property
    def status_word(self) -> int:
        """Object 0x6041."""
        return self._power.status_word

    def _live(self) -> dict[tuple[int, int], Callable[[], int]]:
        live: dict[tuple[int, int], Callable[[], int]] = {
            (0x1001, 0): lambda: int(self._power.code != 0),
            (0x2001, 0): lambda: int(self.is_referenced),
            (0x603F, 0): lambda: self._power.code,
            (0x6040, 0): lambda: self._power.word,
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
            if self.nmt is not _NmtState.OPERATIONAL:
                return []
            return self._emergencies(self._data.on_target(now_s, frame.data))
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
        self._power.on_time(now_s)
        if now_s >= self._watched_s:
            self._watched_s = math.inf
            out += self._master_is_gone()
        if now_s >= (late_s := self._data.late_s):
            out += self._emergencies(self._data.miss(now_s))
            self._data.sync_s = late_s - 0.5 * self._cycle_s
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
            self._power.next_due_s,
            self._watched_s,
            self._data.late_s,
            beat_s,
            self._storm_s,
        )

    @property
    def _period_s(self) -> float:
        return 0.0 if self.nmt is _NmtState.BOOT_UP else self.objects.value(0x1017) * 1e-3

    @property
    def _heartbeat_due_s(self) -> float:
        return self._now_s if self._beat_s == math.inf else self._beat_s

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
            self._restart()
        elif command is codec.NmtCommand.START:
            self.nmt = _NmtState.OPERATIONAL
        else:
            was = self.nmt
            stops = command is codec.NmtCommand.STOP
            self.nmt = _NmtState.STOPPED if stops else _NmtState.PRE_OPERATIONAL
            if was is _NmtState.OPERATIONAL and self._power.is_on:
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
            self._power.trip(self._now_s, code)
            return []
        if reaction == 2 and self.power not in FAULTED:
            self._power.power_off(self._now_s, PowerState.SWITCH_ON_DISABLED)
        elif reaction and self._power.is_on:
            self._power.quick_stop(self._now_s)
        return []

    def _on_sync(self) -> Timed:
        if self.nmt is not _NmtState.OPERATIONAL:
            self._data.sync_s = self._now_s
            return []
        out = self._emergencies(self._data.on_sync(self._now_s))
        wrong = self._power.watch(self._now_s)
        if wrong is not None and self._power.trip(self._now_s, wrong):
            out += self._emergencies([wrong])
        answer = self._data.answer()
        if answer is not None:
            out.append((self.motion.senses.reply_s(self._now_s), Frame(*answer)))
        return out

    def _emergencies(self, codes: list[int]) -> Timed:
        return [self._emergency(code) for code in codes]

    def _written(self, key: tuple[int, int], value: int) -> None:
        """Objects that act when they are written over SDO."""
        if key == (0x6040, 0):
            self._power.obey(self._now_s, value)
        elif key == (0x1017, 0):
            self._beat_s = self._now_s
        elif key == (0x1016, 1):
            self._watched_s = math.inf  # from the first heartbeat on
        elif key[0] in TARGETS and self._power.is_on:
            self.objects.put(key, value)
            self.motion.target(self.objects, self._now_s)

    # -- how to break it -----------------------------------------------------------------------------

    def set_fault(self, code: int) -> Timed:
        """It finds an error by itself now; returns what it sends."""
        return self._emergencies([code] if self._power.trip(self._now_s, code) else [])

    def silence(self, *, silent: bool = True) -> None:
        """Its bus cable is cut: it hears and says nothing."""
        self._silent = silent

    def storm(self, now_s: float, *, on: bool = True) -> None:
        """It sends emergency messages every 2 ms, or ends to."""
        self._storm_s = now_s if on else math.inf

    def wrong_pdos(self, count: int) -> None:
        """Its next `count` PDOs have another length than is mapped."""
        self._data.wrong = count

    def set_voltage(self, now_s: float, *, present: bool) -> None:
        """The power supply of its motor comes or goes."""
        self._now_s = now_s
        self._power.set_voltage(now_s, present=present)

    def reboot(self, now_s: float) -> None:
        """It starts again: all that was written is gone, and where zero is, if its encoder does not know."""
        self._now_s = now_s
        self._restart()
        self._power.homing.restart()

    def _restart(self) -> None:
        self._power.power_off(self._now_s, PowerState.SWITCH_ON_DISABLED)
        self.objects.restart()
        self._start(self._now_s)
