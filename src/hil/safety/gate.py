"""The one gate to the wire: every frame that leaves passes here, or is refused, counted and named.

It knows nothing of the drivers. What a frame asks it reads back from the frame's bytes through the drive
family's `FrameMeaning`; the rules are in `hil.safety.rules`. Frames that take power away always pass,
except in read-only mode.
"""

from __future__ import annotations

from collections import Counter, deque
from typing import Final, NamedTuple

from hil.drives.meaning import Ask, FrameMeaning, Meaning
from hil.frames import BUS_SHIFT, Frame
from hil.safety.reactions import Cause, Finding
from hil.safety.rulenames import Rule
from hil.safety.rules import (
    Broken,
    GateLimits,
    Measured,
    Passed,
    judge_force,
    judge_measured,
    judge_position,
    judge_velocity,
)

RATE_CYCLES: Final = 20
RATE_FRAMES: Final = 21
"""One frame a cycle and identifier, and one more: the first of the window late, the last one early."""
DUPLICATE_CYCLES: Final = 0.25
HARMLESS: Final = frozenset({Rule.READ_ONLY, Rule.DUPLICATE})
"""Refusals that say nothing bad of the sender: listening only, or a frame the drive has just had."""


class Verdict(NamedTuple):
    """Whether a frame may go out: what it asks, or the rule it breaks and a sentence."""

    ok: bool
    meaning: Meaning | None = None
    """What a frame that may go out asks of whom: what is worth recording as sent."""
    rule: Rule | None = None
    text: str = ""


class Gate:
    """Judges every outgoing frame of a rig. Disarmed at birth."""

    def __init__(
        self, limits: GateLimits, meaning: FrameMeaning, *, read_only: bool = False
    ) -> None:
        n = len(limits.drives)
        self.limits = limits
        self.read_only = read_only
        self.passed = 0
        self.refused: Counter[Rule] = Counter()
        self._meaning = meaning
        self._armed = False
        self._is_off: list[bool | None] = [None] * n  # None: not told anything since our start
        self._tracks: list[Passed | None] = [None] * n
        self._measured: list[Measured | None] = [None] * n
        self._times: dict[int, deque[float]] = {
            key: deque(maxlen=RATE_FRAMES) for key in meaning.lengths
        }
        self._frames: dict[int, bytes] = {}
        self._findings: list[Finding] = []

    @property
    def armed(self) -> bool:
        """The latch."""
        return self._armed

    @property
    def powered(self) -> bool:
        """Whether any drive has been told to be on and not, since, to be off."""
        return any(off is False for off in self._is_off)

    def arm(self) -> None:
        """Let power-on control words and setpoints pass. Who calls it has checked the rig."""
        self._armed = not self.read_only

    def disarm(self) -> None:
        """Let no power-on control word and no setpoint pass any more."""
        self._armed = False
        self._forget()

    def refuses_write(self, i: int, number: int) -> str | None:
        """Why a write of drive `i`'s parameter `number` would be refused now; None where it would pass."""
        broken = self._judge_write(i, number)
        return None if broken is None else broken.text

    def measured(self, i: int, value: float, now_s: float) -> None:
        """Drive `i` answered position `value`, m or rad."""
        self._measured[i] = Measured(value, now_s)

    def findings(self) -> tuple[Finding, ...]:
        """The refusals since the last call that the state machine must react to."""
        found, self._findings = tuple(self._findings), []
        return found

    def pass_frame(self, now_s: float, frame: Frame) -> Verdict:
        """Whether `frame` may leave at `now_s`. Who asks must send it at once, or not at all."""
        outcome = self._judge(now_s, frame)
        if isinstance(outcome, Meaning):
            self.passed += 1
            return Verdict(True, outcome)
        self.refused[outcome.rule] += 1
        text = f"{frame} refused ({outcome.rule.value}): {outcome.text}"
        if outcome.rule not in HARMLESS:
            self._findings.append(Finding(Cause.GATE_REFUSED, text))
        return Verdict(False, None, outcome.rule, text)

    def _judge(self, now_s: float, frame: Frame) -> Meaning | Broken:
        if self.read_only:
            return Broken(Rule.READ_ONLY, "this daemon only listens")
        can_id, data, is_extended, is_remote, is_error, bus = frame
        if is_remote or is_extended or is_error:
            return Broken(Rule.FRAME_FORM, "remote, extended and error frames are never sent")
        key = bus << BUS_SHIFT | can_id
        length = self._meaning.lengths.get(key)
        if length is None:
            return Broken(Rule.UNKNOWN_ID, "no drive of this rig listens to this identifier")
        if len(data) != length:
            return Broken(Rule.LENGTH, f"{len(data)} data bytes instead of {length}")
        meaning = self._meaning.meaning(key, data)
        if meaning.ask is Ask.POWER_OFF and meaning.actuator is not None:
            self._is_off[meaning.actuator] = True
            self._tracks[meaning.actuator] = None
            return meaning
        if meaning.ask is Ask.SYSTEM_STOP:
            self._forget()
            return meaning
        broken = self._judge_rate(now_s, key, data) or self._judge_ask(now_s, meaning)
        if broken is not None:
            return broken
        self._times[key].append(now_s)
        self._frames[key] = data
        return meaning

    def _judge_rate(self, now_s: float, key: int, data: bytes) -> Broken | None:
        cycle_s = self.limits.cycle_s
        times = self._times[key]
        if not times:
            return None
        if len(times) == RATE_FRAMES and not now_s - times[0] >= RATE_CYCLES * cycle_s:
            return Broken(Rule.RATE, f"more than {RATE_FRAMES} frames in {RATE_CYCLES} cycles")
        if self._frames[key] == data and not (now_s - times[-1] >= DUPLICATE_CYCLES * cycle_s):
            return Broken(Rule.DUPLICATE, f"sent already {(now_s - times[-1]) * 1e3:.2f} ms ago")
        return None

    def _judge_ask(self, now_s: float, meaning: Meaning) -> Broken | None:
        match meaning.ask:
            case Ask.POWER_ON if meaning.actuator is not None and meaning.setpoint is not None:
                return self._judge_power_on(now_s, meaning, meaning.actuator, meaning.setpoint)
            case Ask.READ | Ask.SYNC | Ask.ALIVE:
                return None
            case Ask.NETWORK:
                if self._armed:
                    return Broken(
                        Rule.NETWORK_ARMED, f"{meaning.text} would take a drive from an armed rig"
                    )
                return None
            case Ask.WRITE if meaning.actuator is not None:
                return self._judge_write(meaning.actuator, meaning.parameter)
            case Ask.FAULT_RESET:
                if self._armed:
                    return Broken(Rule.RESET_ARMED, "an armed rig resets no error by itself")
                return None
            case Ask.SYSTEM_START:
                off = self._is_off
                if meaning.actuators is not None:
                    off = [off[i] for i in meaning.actuators]
                if not self._armed and not all(off):
                    return Broken(Rule.START_UNARMED, "not every drive has been told to be off")
                return None
            case _:
                return Broken(Rule.UNKNOWN_MEANING, meaning.text or "it asks nothing that is known")

    def _judge_write(self, i: int, number: int | None) -> Broken | None:
        if number not in self._meaning.writable(i):
            return Broken(Rule.WRITE_PARAMETER, f"the profile lets nobody write parameter {number}")
        if self.powered:
            return Broken(
                Rule.WRITE_POWERED, f"parameter {number} is not written while drives are powered"
            )
        return None

    def _judge_power_on(
        self, now_s: float, meaning: Meaning, i: int, setpoint: float
    ) -> Broken | None:
        if not self._armed:
            return Broken(Rule.DISARMED, "the rig is not armed")
        broken = self._judge_setpoint(now_s, meaning, i, setpoint)
        if broken is not None:
            return Broken(broken.rule, f"{self.limits.drives[i].name}: {broken.text}")
        self._is_off[i] = False
        return None

    def _judge_setpoint(
        self, now_s: float, meaning: Meaning, i: int, value: float
    ) -> Broken | None:
        limits, measured = self.limits.drives[i], self._measured[i]
        if meaning.kind != limits.kind:
            return Broken(
                Rule.SETPOINT_KIND, f"a {meaning.kind} setpoint where {limits.kind} is sent"
            )
        broken = judge_measured(measured, self.limits.fresh_s, now_s)
        if broken is not None or measured is None:
            return broken
        if limits.kind == "force":
            return judge_force(limits, value)
        last = self._tracks[i]
        if last is not None and not now_s - last.at_s <= self.limits.fresh_s:
            last = None
        judge = judge_position if limits.kind == "position" else judge_velocity
        outcome = judge(limits, self.limits.cycle_s, last, measured, now_s, value)
        if isinstance(outcome, Broken):
            return outcome
        self._tracks[i] = outcome
        return None

    def _forget(self) -> None:
        self._tracks = [None] * len(self._tracks)
