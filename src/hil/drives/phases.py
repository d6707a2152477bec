"""The phases of one drive, from its first sign of life to force and to a fault, as the master sees them.

ABSENT → LOGGED_ON: it was heard (a log-on or boot-up frame). → CONFIGURED: watchdog and settings are written
and read back. → READY: it was started (System Start, NMT start), the DRIVECOM machine stands before its last
step, its hardware enable is there, it is referenced and has answered every quantity asked of it.
→ ENABLED: it says so after we asked for it. → FAULT: latched and named until PowerGoal.RESET, and from there
configured again from the start. One machine for every family: CiA 402 kept DRIVECOM's states.

ON counts from READY only, and must be given anew there: a drive whose enable comes back never
starts by itself. A drive that makes force although it has long been told to be off is a fault too, and told
even where another fault is latched: whoever goes near the rig believes that its drives are off.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final, Generic, Literal, TypeVar

from hil.drives.driver import DrivePhase, PowerGoal
from hil.drives.fault_reset import FaultReset
from hil.drives.phase_inputs import PhaseSettings, Preparation, Reported
from hil.drives.power import FAULTED, FORCEFUL, PREPARED, PowerCommand, PowerState
from hil.signals import Event

ERROR_LENGTH: Final = 400
"""What is told while a fault is latched is added to it up to so many characters: errors come in storms."""
STAYS_ON: Final = "drive_stays_on"
DOUBLED: Final = 5
"""So many more answers than questions, while a drive is configured, are of another drive of its number."""
_MAY_ENABLE: Final = (DrivePhase.READY, DrivePhase.ENABLED)


S = TypeVar("S", bound=Reported)


class PhaseMachine(Generic[S]):
    """Where a drive stands, what it is commanded, and why it stands no further."""

    def __init__(
        self,
        who: str,
        settings: PhaseSettings,
        nothing_known: S,
        configuration: Preparation,
        quantities: Iterable[str],
        answer_timeout_s: float,
    ) -> None:
        self.phase = DrivePhase.ABSENT
        self.started = False
        """It has been started since it was last heard for the first time."""
        self.error: str | None = None
        self._nothing_known = nothing_known
        self.status = nothing_known
        self.muted = False
        """Nothing may be said to the drive."""
        self.heard_s: float | None = None
        self.events: list[Event] = []
        self._who = who
        self._settings = settings
        self._configuration = configuration
        self._quantities = frozenset(quantities)
        self._answer_timeout_s = answer_timeout_s
        self._goal = PowerGoal.OFF
        self._unanswered = set(self._quantities)
        self._spoken_to = False
        self._off_seen = False
        self._since_s = 0.0
        self._status_s = 0.0
        self._on_since_s: float | None = None
        self._enable_sent_s = -math.inf
        self._off_since_s: float | None = None
        self._on_told = False
        self._reset: FaultReset | None = None

    # -- what happens --------------------------------------------------------------------------------

    def log_on(self, now_s: float) -> bool:
        """The drive's log-on frame was seen. True where everything begins anew.

        A log-on that was on its way when we first spoke to the drive means nothing.
        """
        self.heard_s = now_s
        self.started = False
        if self.phase in _MAY_ENABLE:
            self.fault(now_s, "drive_rebooted", "logged on while running: it has restarted")
        elif self.phase is DrivePhase.FAULT and self._spoken_to:
            self.fault(now_s, "drive_rebooted", "has restarted since")
        elif self.phase is not DrivePhase.FAULT:
            again = self._spoken_to and now_s - self._since_s > self._settings.repeat_s
            if again:
                self._say(now_s, "warning", "drive_rebooted", "logs on again: it has restarted")
            if again or self.phase is DrivePhase.ABSENT:
                self._restart(now_s)
                return True
        return False

    def took_status(self, now_s: float, status: S) -> None:
        """A status frame was received."""
        self.heard_s = self._status_s = now_s
        self.status = status

    def start(self, now_s: float) -> None:
        """It is started now: a drive that tells nothing before has its time to begin."""
        self.started = True
        self._status_s = now_s

    def answered(self, now_s: float, quantity: str | None) -> None:
        """A request was answered; `quantity` where it measured one."""
        self.heard_s = now_s
        self._spoken_to = True
        if quantity is not None:
            self._unanswered.discard(quantity)

    def wants(self, now_s: float, goal: PowerGoal) -> None:
        """What the rig wants from this slot on."""
        self._goal = goal
        if goal is not PowerGoal.ON:
            self._on_since_s = None
            self._off_seen = self._off_seen or self.phase in _MAY_ENABLE
        elif self._on_since_s is None and self._off_seen:
            self._on_since_s = now_s
        if goal is not PowerGoal.RESET or self.phase is not DrivePhase.FAULT:
            self._reset = None
        elif self._reset is None:
            self._reset = FaultReset(now_s, self._settings.reset_hold_s)

    def surplus(self, now_s: float, answers: int) -> None:
        """It has given `answers` more than it was asked for."""
        if self.phase is DrivePhase.LOGGED_ON and answers >= DOUBLED:
            text = "answers twice what it is asked once: another drive has its number and would move too"
            self.fault(now_s, "drive_doubled", text)

    def absent(self, now_s: float) -> None:
        """Wait for its log-on, in silence."""
        self._forget(now_s)
        self.started = False
        self._enter(now_s, DrivePhase.ABSENT)

    def fault(self, now_s: float, name: str, text: str) -> None:
        """Latch a fault; what is told while one is latched is added to it."""
        if self.phase is DrivePhase.FAULT:
            if self.error and len(self.error) < ERROR_LENGTH and text not in self.error:
                self.error = f"{self.error}; {text}"
            return
        self.error = f"{self._who} {text}"
        self._on_since_s = self._reset = None
        self._off_seen = False
        self._on_told = name == STAYS_ON
        self._configuration.restart()
        self.phase = DrivePhase.FAULT
        self._since_s = now_s
        self.events.append(Event(now_s, "fault", name, self.error))

    # -- what follows --------------------------------------------------------------------------------

    def command(self, now_s: float) -> PowerCommand:
        """The command of this slot. ENABLE comes from here alone, never before the watchdog is verified."""
        command = self._command(now_s)
        if command is PowerCommand.ENABLE:
            self._enable_sent_s, self._off_since_s = now_s, None
        elif self._off_since_s is None:
            self._off_since_s = now_s
        return command

    def _command(self, now_s: float) -> PowerCommand:
        if self.phase is DrivePhase.FAULT:
            return PowerCommand.DISABLE if self._reset is None else self._reset.command(now_s)
        ready = self.phase in _MAY_ENABLE and self.started and self._configuration.watchdog_ok
        if ready and self._on_since_s is not None:
            return PowerCommand.ENABLE
        is_stopping = (
            self.status.power is PowerState.QUICK_STOP_ACTIVE
        )  # which PREPARE does not end
        if self.started and self.phase in (DrivePhase.CONFIGURED, *_MAY_ENABLE) and not is_stopping:
            return PowerCommand.PREPARE
        return PowerCommand.DISABLE

    def judge(self, now_s: float) -> None:
        """Go as far forward or back as what is known demands."""
        if self.phase is DrivePhase.FAULT:
            self._judge_off(now_s)
            self._judge_reset(now_s)
        if self.phase in (DrivePhase.ABSENT, DrivePhase.FAULT):
            return
        trouble = self._silence(now_s) or self._refusal() or self._power_trouble(now_s)
        makes_force = self.status.power is PowerState.OPERATION_ENABLED
        if trouble is not None:
            self.fault(now_s, *trouble)
        elif self.phase is DrivePhase.LOGGED_ON:
            if self._configuration.done:
                for note in self._configuration.notes:
                    self._say(now_s, "warning", "drive_gain_differs", note)
                self._enter(now_s, DrivePhase.CONFIGURED)
        elif self.phase is DrivePhase.CONFIGURED:
            if self.waiting_for() is None:
                self._enter(now_s, DrivePhase.READY)
        elif self.phase is DrivePhase.READY:
            if makes_force:
                self._enter(now_s, DrivePhase.ENABLED)
            elif (lacks := self._lacks()) is not None:
                self._say(now_s, "warning", "drive_not_ready", f"is no longer ready: {lacks}")
                self._enter(now_s, DrivePhase.CONFIGURED)
        elif not makes_force:
            self._enter(now_s, DrivePhase.READY)

    def told_off_for(self, now_s: float) -> float:
        """How long it has been told to make no force, s; a loop that stood still has told it nothing."""
        return 0.0 if self._off_since_s is None else now_s - self._off_since_s

    @property
    def resetting(self) -> bool:
        """A fault is being reset."""
        return self._reset is not None

    @property
    def referenced(self) -> bool:
        """Positions count from the rig file's zero."""
        return self._settings.absolute or self.status.referenced

    def waiting_for(self) -> str | None:
        """What keeps the drive from READY, or from heeding ON; None where nothing does, and in FAULT."""
        if self.phase is DrivePhase.ABSENT:
            return f"{self._who} {self._settings.absent}"
        if self.phase is DrivePhase.LOGGED_ON:
            return f"{self._who} is being configured"
        if self.phase is DrivePhase.READY and self._goal is PowerGoal.ON and not self._off_seen:
            return f"{self._who} was asked to be on before it was ready: ask for off, then for on"
        if self.phase is not DrivePhase.CONFIGURED:
            return None
        if not self.started:
            return f"{self._who} {self._settings.unstarted}"
        if self._unanswered:
            return f"{self._who} has not answered its {', '.join(sorted(self._unanswered))} yet"
        lacks = self._lacks()
        return f"{self._who}: {lacks}" if lacks else None

    # -- judgement, piece by piece -------------------------------------------------------------------

    def _lacks(self) -> str | None:
        """What the drive itself lacks to be enabled."""
        if not self.status.enpo:
            return f"its hardware enable {self._settings.enable_input} is not there"
        if self.status.power not in PREPARED:
            return f"its power stage is {self.status.power}"
        return None if self.referenced else "it is not referenced: home it"

    def _silence(self, now_s: float) -> tuple[str, str] | None:
        status_limit_s = self._settings.status_timeout_s
        limit_s = self._answer_timeout_s if self.phase in _MAY_ENABLE else status_limit_s
        quiet_s = now_s - (now_s if self.heard_s is None else self.heard_s)
        if quiet_s > limit_s:
            return "drive_silent", f"has answered nothing for {quiet_s:.2f} s"
        tells = self.started or self._settings.tells_unstarted
        if tells and now_s - self._status_s > status_limit_s:
            return "drive_silent", f"has sent no status for {now_s - self._status_s:.2f} s"
        return None

    def _refusal(self) -> tuple[str, str] | None:
        prepared = self._configuration
        return None if prepared.failure is None else (prepared.failure_name, prepared.failure)

    def _power_trouble(self, now_s: float) -> tuple[str, str] | None:
        power, settings = self.status.power, self._settings
        if power in FAULTED:
            return "drive_error", "reports a fault in its status"
        asked = self._on_since_s is not None
        if power is PowerState.OPERATION_ENABLED:
            if self.phase is DrivePhase.ENABLED:
                return self._enabled_trouble(now_s)
            if now_s - self._enable_sent_s > settings.status_timeout_s:
                return "drive_enabled_itself", "makes force although nobody asked it to"
            return None
        if not asked or self.phase not in _MAY_ENABLE:
            return None
        if not self.status.enpo:
            return "enpo_lost", f"has lost its hardware enable {settings.enable_input}"
        if self.phase is DrivePhase.ENABLED or power not in PREPARED:
            return "drive_dropped_out", f"left operation by itself: it is now {power}"
        if now_s - (self._on_since_s or now_s) > settings.enable_timeout_s:
            return "drive_not_enabled", f"did not enable within {settings.enable_timeout_s:g} s"
        return None

    def _enabled_trouble(self, now_s: float) -> tuple[str, str] | None:
        settings = self._settings
        if not self.status.enpo:
            return "enpo_lost", f"has lost its hardware enable {settings.enable_input}"
        if not self.referenced:
            return "reference_lost", "is not referenced any more: its position means nothing"
        if self.told_off_for(now_s) > settings.off_timeout_s:
            return STAYS_ON, self._stays_on
        return None

    @property
    def _stays_on(self) -> str:
        return (
            f"still makes force {self._settings.off_timeout_s:g} s after it was told to be off: "
            "take its power away by hand"
        )

    def _judge_off(self, now_s: float) -> None:
        """In a fault, which hides nothing: told once for each that is latched."""
        off_s = min(self.told_off_for(now_s), now_s - self._since_s)
        is_known = now_s - self._status_s <= self._settings.status_timeout_s
        is_on = is_known and self.status.power in FORCEFUL
        if not is_on or off_s <= self._settings.off_timeout_s or self._on_told:
            return
        self._on_told = True
        self.fault(now_s, STAYS_ON, self._stays_on)
        self.events.append(Event(now_s, "fault", STAYS_ON, f"{self._who} {self._stays_on}"))

    def _judge_reset(self, now_s: float) -> None:
        if self._reset is None:
            return
        quiet_s = self._settings.status_timeout_s
        if self.muted or self.heard_s is None or now_s - self.heard_s > quiet_s:
            self.absent(now_s)
        elif self._reset.is_answered(self._status_s) and self.status.power not in FAULTED:
            self._say(now_s, "info", "drive_reset", "is reset and is configured again")
            self._restart(now_s)

    # -- changes of phase ----------------------------------------------------------------------------

    def _restart(self, now_s: float) -> None:
        self._forget(now_s)
        self.heard_s = now_s
        self._enter(now_s, DrivePhase.LOGGED_ON)

    def _forget(self, now_s: float) -> None:
        """Nothing that was known of the drive holds any more."""
        self._configuration.restart()
        self.status = self._nothing_known
        self.error = None
        self.muted = False
        self._unanswered = set(self._quantities)
        self._spoken_to = self._off_seen = False
        self._status_s = now_s
        self._on_since_s = self._reset = None
        self._enable_sent_s = -math.inf

    def _enter(self, now_s: float, phase: DrivePhase) -> None:
        self._since_s = now_s
        if phase not in _MAY_ENABLE:
            self._on_since_s = None
        self._off_seen = phase in _MAY_ENABLE and (self._off_seen or self._goal is not PowerGoal.ON)
        if phase is not self.phase:
            self.phase = phase
            self._say(now_s, "info", "drive_phase", f"is {phase.value}")

    def _say(
        self, now_s: float, severity: Literal["info", "warning"], name: str, text: str
    ) -> None:
        self.events.append(Event(now_s, severity, name, f"{self._who} {text}"))
