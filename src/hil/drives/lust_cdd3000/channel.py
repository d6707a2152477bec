"""The parameter channel of one drive: its configuration and its measurements, a question a slot.

An answer to a question not asked is counted and never followed. What a person asks besides has at most one
slot between two turns of the measurements, answered or not: no question makes a drive lose its position.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from hil.config import RigFile
from hil.drives.enquiry import Enquiry
from hil.drives.lust_cdd3000.codec import Answer, AnswerStatus, Mode, Request
from hil.drives.lust_cdd3000.configure import Configuration, gains_of, settings_of
from hil.drives.lust_cdd3000.scales import Scales, kind_of
from hil.drives.meaning import writable_parameters
from hil.drives.profile import LustProfile
from hil.drives.slots import SlotScheduler
from hil.signals import Quantity


@dataclass(frozen=True, slots=True)
class _Question:
    """A request in a slot, and the quantity that its answer measures."""

    request: Request
    quantity: Quantity | None = None
    enquiry: Enquiry | None = None
    """A person's, besides operation."""

    @property
    def number(self) -> int:
        """Number of the parameter asked for."""
        return self.request.number

    @property
    def insists(self) -> bool:
        """All but a person's are asked until they are answered."""
        return self.enquiry is None


@dataclass(frozen=True, slots=True)
class Taken:
    """What an answer brought: a measurement, a refusal that must stop the drive, or neither."""

    quantity: Quantity | None = None
    value: float = 0.0
    """m or rad, m/s or rad/s, N or N·m, A."""
    refusal: str | None = None


_NOTHING: Final = Taken()


class ParameterChannel:
    """Questions to one drive and what comes of their answers."""

    def __init__(self, rig: RigFile, index: int, profile: LustProfile, scales: Scales) -> None:
        actuator = rig.actuators[index]
        self._scales = scales
        self._held = writable_parameters(profile.parameters)
        self._repeat_limit = profile.timing.repeat_limit
        questions = {
            q: _Question(Request(scales.parameters[q].number, Mode.READ), q)
            for q in (*rig.bus.pattern, "position")
        }
        self._ask_position = None if "position" in rig.bus.pattern else questions["position"]
        self.slots = SlotScheduler(
            tuple(questions[q] for q in rig.bus.pattern), profile.timing.answer_wait
        )
        self.configuration = Configuration(
            settings_of(rig, actuator, profile, kind_of(rig, profile)),
            gains_of(actuator, profile),
            barrier=questions["position"].number,
        )
        self.position: int | None = None
        """Last known position, increments; None since the drive restarted."""
        self._enquiries: list[_Question] = []
        self._enquired_turn = 0

    @property
    def held(self) -> frozenset[int]:
        """Numbers of all parameters that hil may write: it writes them itself."""
        return self._held

    def enquire(self, enquiry: Enquiry) -> None:
        """Read a parameter, between two turns of the measurements, until it is answered or given up."""
        question = Request(enquiry.number, Mode.READ)
        self._enquiries.append(_Question(question, enquiry=enquiry))

    def restart(self) -> None:
        """The drive has restarted: nothing is in flight, and where it stands is not known."""
        self.slots.reset()
        self.position = None

    def ask(self, now_s: float, *, configuring: bool) -> Request | None:
        """The question for this slot: configuration, one position where the pattern has none, the pattern."""
        request = self.configuration.request() if configuring else None
        first = None if self.position is not None else self._ask_position
        if first is None and request is None:
            first = self._next_enquiry()
        question = self.slots.ask(now_s, first if request is None else _Question(request))
        if question is not None and question.enquiry is not None:
            self._enquired_turn = self.slots.turns
            self._enquiries.append(self._enquiries.pop(0))
        return None if question is None else question.request

    def _next_enquiry(self) -> _Question | None:
        if self._enquiries:
            self._enquiries = [q for q in self._enquiries if q.enquiry and not q.enquiry.is_done]
        if not self._enquiries or self.slots.turns == self._enquired_turn:
            return None
        return self._enquiries[0]

    def take(self, answer: Answer) -> Taken | None:
        """What an answer brings; None where it was not asked for."""
        repeat = bool(answer.status & AnswerStatus.REPEAT_ACTION)
        question = self.slots.answered(answer.number, repeat=repeat)
        if question is None:
            return None
        if repeat:
            in_row = self.slots.repeats_in_row
            if in_row < self._repeat_limit:
                return _NOTHING
            return Taken(
                refusal=f"asked {in_row} times in a row to repeat parameter {answer.number}"
            )
        if question.enquiry is not None:
            if answer.status:
                question.enquiry.failed(f"parameter {answer.number}: {answer.status}")
            else:
                question.enquiry.answered(answer.value.to_bytes(4, "little", signed=True))
            return _NOTHING
        self.configuration.answered(question.request, answer)
        if question.quantity is None:
            return _NOTHING
        what = f"its {question.quantity} (parameter {answer.number})"
        if answer.status:
            return Taken(refusal=f"does not answer {what}: {answer.status}")
        value = self._scales.measured(question.quantity, answer.value)
        if not math.isfinite(value):
            return Taken(refusal=f"answers {what} with no number")
        if question.quantity == "position":
            self.position = self._scales.reference("position", value)
        return Taken(question.quantity, value)
