"""One drive by itself, at the desk: read, write, home, jog. Everything that leaves passes the gate.

Holds the rig's lock, so it never runs beside a daemon. The drive is run by its own driver, as in operation,
but alone: the other drives of the rig are told nothing.
"""

from __future__ import annotations

import select
import time
from collections.abc import Callable
from contextlib import ExitStack
from types import TracebackType
from typing import Final, Self

from hil.bus.port import BusPort, open_port
from hil.config import RigFile
from hil.daemon.commission.access import OverBus
from hil.daemon.commission.rig import alone, calm, unbounded
from hil.daemon.core.link import Link
from hil.daemon.lock import RigLock
from hil.drives import DrivePhase, PowerGoal, build_drivers
from hil.drives.cia402 import codec as canopen
from hil.drives.cia402.driver import Cia402Driver
from hil.drives.driver import DriveDriver
from hil.drives.lust_cdd3000.codec import encode_system
from hil.drives.profile import LustProfile
from hil.drives.profiles import DriveProfile, Profiles
from hil.errors import BusBusy, ConfigError, DriveError, HilError
from hil.frames import Frame
from hil.safety import Finding, Rule

READY_S: Final = 15.0
OFF_CYCLES: Final = 10
OFF_S: Final = 1.0
JOG_SHARE: Final = 0.1
"""Of velocity_max: the fastest that a drive is jogged."""
HOMING_ATTAINED, HOMING_ERROR = 0x1000, 0x2000
"""Bits 12 and 13 of the status word in homing mode (CiA 402-2) [M]."""
HOMING_START_CYCLES: Final = 5
"""So long after the start those bits may still be those of an earlier search."""


class Desk:
    """One drive on its bus, for as long as it is entered. DriveError names what the drive does not do."""

    def __init__(self, rig: RigFile, profiles: Profiles, actuator: str) -> None:
        self.rig, _ = alone(rig, actuator)
        self._whole = rig
        name = self.rig.actuators[0].drive.profile
        self.profile: DriveProfile = calm(profiles[name])
        self.drives = build_drivers(self.rig, {name: self.profile})
        self.link = Link(self.rig, self.drives)
        self.driver: DriveDriver = self.drives[0]
        self.position: float | None = None
        self.objects = OverBus(self)
        """Its objects or parameters."""
        self._stack = ExitStack()
        self._was_told = False
        self._stays_on = False  # or has not said that it is off
        self._port: BusPort

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.enter_context(RigLock(self._whole.name, *self._whole.can.urls))
            self._port = open_port(self.rig.can.url, bitrate_bps=self.rig.can.bitrate)
            stack.callback(self._port.close)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if self._was_told and not self._stays_on:
                self._release()
        finally:
            self._stack.close()

    def _release(self) -> None:
        """Let the drive forget that it had a master: its watchdog would miss it."""
        if isinstance(self.profile, LustProfile):
            self.send(encode_system(self.profile.ids, self.profile.system.stop))
        else:
            reset = canopen.NmtCommand.RESET_COMMUNICATION
            self.send(Frame(canopen.NMT_ID, canopen.encode_nmt(reset, self.rig.address(0))))

    # -- the drive in operation ------------------------------------------------------------------------

    def run(
        self,
        goal: PowerGoal,
        until: Callable[[], bool],
        within_s: float,
        setpoint: Callable[[float], float] | None = None,
    ) -> bool:
        """Cycles until `until` holds, at most `within_s`; `setpoint` by seconds since the start."""
        start_s = time.monotonic()
        due_s = start_s
        while (now_s := time.monotonic()) - start_s < within_s:
            frames = self.link.sync(now_s) + self.link.begin(now_s)
            value = None if setpoint is None else setpoint(now_s - start_s)
            frames += self.link.slot(now_s, 0, goal, value, value)
            self._send(frames)
            self.drives.take_events()
            due_s = max(due_s + self.rig.bus.cycle, now_s)
            self._listen(due_s)
            self._complain(self.link.findings(time.monotonic()))
            self.link.records.clear()
            if until():
                return True
        return False

    def prepare(self) -> None:
        """From nothing to ready: configured as in operation, power off. DriveError says what it lacks."""
        self._was_told = True
        why = ""

        def is_ready() -> bool:
            nonlocal why
            status = self.driver.status
            why = status.error or why or status.waiting_for or ""
            return status.phase is DrivePhase.READY

        if not self.run(PowerGoal.RESET, is_ready, READY_S):
            raise DriveError(why or f"{self.driver.name} is {self.phase.value}")
        self.run(PowerGoal.OFF, lambda: self.position is not None, 1.0)

    @property
    def phase(self) -> DrivePhase:
        """How far the drive has come."""
        return self.driver.status.phase

    def enable(self) -> None:
        """Force, where it stands."""
        self.link.gate.arm()
        if not self.run(PowerGoal.ON, lambda: self.phase is DrivePhase.ENABLED, 3.0):
            raise DriveError(
                f"{self.driver.name} does not enable: {self.driver.status.error or self.phase.value}"
            )

    def disable(self) -> None:
        """Power off, told several times; DriveError where it does not say that it is.

        Such a drive is not released: its own watchdog is what is left to stop it.
        """
        left = OFF_CYCLES

        def done() -> bool:
            nonlocal left
            left -= 1
            return left <= 0 and self._is_off()

        try:
            self.run(PowerGoal.OFF, done, OFF_S)
        except HilError:
            pass
        finally:
            self.link.gate.disarm()
        self._stays_on = self.phase in (DrivePhase.ENABLED, DrivePhase.FAULT)
        if self._stays_on:
            name, error = self.driver.name, self.driver.status.error
            raise DriveError(error or f"{name} does not go off: take its power away by hand")

    def jog(self, distance: float, speed: float) -> float:
        """Move by `distance`, m or rad, no faster than `speed`; returns where it came to rest.

        ConfigError where it would leave the stroke or is asked to be fast.
        """
        actuator = self.rig.actuators[0]
        fastest = JOG_SHARE * actuator.velocity_max
        if not 0.0 < speed <= fastest:
            unit = "rad/s" if self.rig.is_rotary else "m/s"
            raise ConfigError(
                f"a drive is jogged at more than 0 and up to {fastest:g} {unit} "
                f"({JOG_SHARE:.0%} of velocity_max), not at {speed:g}"
            )
        self.prepare()
        assert self.position is not None
        start = self.position
        margin = self.rig.safety.stroke_margin
        low, high = actuator.stroke[0] + margin, actuator.stroke[1] - margin
        if not low <= start + distance <= high:
            raise ConfigError(
                f"from {start:.4f} by {distance:g} it would go to {start + distance:.4f}, outside "
                f"{low:g}..{high:g}"
            )
        lasts_s = max(
            1.875 * abs(distance) / speed, 0.2
        )  # 1.875: peak over mean speed of the quintic

        def wanted(t_s: float) -> float:
            u = min(max(t_s / lasts_s, 0.0), 1.0)
            return start + distance * u**3 * (10.0 - 15.0 * u + 6.0 * u * u)

        try:
            self.enable()
            self.run(
                PowerGoal.ON, lambda: self.phase is not DrivePhase.ENABLED, lasts_s + 0.3, wanted
            )
            if self.phase is not DrivePhase.ENABLED:
                raise DriveError(
                    self.driver.status.error or f"{self.driver.name} went off by itself"
                )
        finally:
            self.disable()
        return self.position

    def home(self, set_up: Callable[[], None], timeout_s: float) -> float:
        """Let a CiA 402 drive search its zero; `set_up` writes mode and method. Returns its position then."""
        driver = self.driver
        if not isinstance(driver, Cia402Driver):
            raise DriveError(
                f"{driver.name}: its family tells no homing over the bus; home it with its maker's program "
                '(homing = "drive" in its file waits for that)'
            )
        self._was_told = True
        self.link = Link(unbounded(self.rig), self.drives)
        self.run(PowerGoal.RESET, lambda: driver.boot.done, READY_S)
        driver.boot.is_referenced = True  # what keeps it from READY is what we are about to do
        self.prepare()
        set_up()
        try:
            self.enable()
            driver.is_homing = True
            ended = HOMING_ATTAINED | HOMING_ERROR
            self.run(PowerGoal.ON, self._is_off, HOMING_START_CYCLES * self.rig.bus.cycle)
            if not self.run(
                PowerGoal.ON, lambda: bool(driver.word & ended) or self._is_off(), timeout_s
            ):
                raise DriveError(f"{driver.name} has not found its zero within {timeout_s:g} s")
            if driver.word & HOMING_ERROR or self._is_off():
                raise DriveError(
                    f"{driver.name}: homing failed: {driver.status.error or 'status bit 13'}"
                )
        finally:
            driver.is_homing = False
            self.disable()
        assert self.position is not None
        return self.position

    def _is_off(self) -> bool:
        return self.phase is not DrivePhase.ENABLED

    # -- the wire ------------------------------------------------------------------------------------

    def send(self, frame: Frame) -> None:
        """One frame, through the gate, no oftener than it lets it pass; DriveError where it refuses."""
        while True:
            verdict = self.link.gate.pass_frame(time.monotonic(), frame)
            if verdict.ok:
                self._port.send(frame)
                return
            if verdict.rule not in (Rule.RATE, Rule.DUPLICATE):
                raise DriveError(verdict.text)
            time.sleep(0.25 * self.rig.bus.cycle)

    def ask(self, frame: Frame, take: Callable[[Frame], bool], within_s: float) -> bool:
        """Send a frame and hand what comes to `take` until it says that this was it."""
        self.send(frame)
        end_s = time.monotonic() + within_s
        while (left_s := end_s - time.monotonic()) > 0.0:
            select.select([self._port], [], [], left_s)
            for t_s, heard in self._port.receive():
                self.link.receive(t_s, heard)  # its heartbeats go on counting
                self.link.records.clear()
                if take(heard):
                    return True
        return False

    def _send(self, frames: list[Frame]) -> None:
        for frame in frames:
            try:
                self._port.send(frame)
            except BusBusy:
                continue  # the next cycle sends it anew

    def _listen(self, until_s: float) -> None:
        while (left_s := until_s - time.monotonic()) > 0.0:
            select.select([self._port], [], [], left_s)
            for t_s, frame in self._port.receive():
                for sample in self.link.receive(t_s, frame)[0]:
                    if sample.quantity == "position":
                        self.position = sample.value

    def _complain(self, findings: tuple[Finding, ...]) -> None:
        if self.link.gate.armed and findings:
            raise DriveError(f"stopped: {findings[0].text}")
