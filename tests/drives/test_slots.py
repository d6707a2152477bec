"""The slot scheduler: one question a slot, one in flight, none left out."""

from __future__ import annotations

from dataclasses import dataclass

from hypothesis import given
from hypothesis import strategies as st

from hil.drives.slots import SlotScheduler


@dataclass(frozen=True)
class Ask:
    number: int
    insists: bool = True


POSITION, FORCE, SETTING = Ask(1), Ask(2), Ask(9)


def scheduler() -> SlotScheduler[Ask]:
    return SlotScheduler((POSITION, FORCE), answer_wait_s=0.008)


def test_quantities_take_turns() -> None:
    s = scheduler()
    asked = []
    for k in range(6):
        question = s.ask(k * 0.01, None)
        asked.append(question)
        assert s.answered(question.number, repeat=False) is question
    assert asked == [POSITION, FORCE] * 3
    assert (s.slots, s.pairs, s.timeouts, s.repeats) == (6, 6, 0, 0)


def test_configuration_goes_first_and_the_pattern_goes_on_where_it_was() -> None:
    s = scheduler()
    for expected, first in ((POSITION, None), (SETTING, SETTING), (FORCE, None)):
        assert s.ask(0.0, first) is expected
        s.answered(expected.number, repeat=False)


def test_ask_again_means_the_same_question_in_the_next_slot() -> None:
    s = scheduler()
    s.ask(0.0, None)
    assert s.answered(1, repeat=True) is POSITION
    assert s.ask(0.01, SETTING) is POSITION
    assert s.answered(1, repeat=False) is POSITION
    assert s.ask(0.02, None) is FORCE
    assert (s.repeats, s.repeats_in_row, s.pairs) == (1, 0, 2)


def test_what_was_not_answered_is_asked_again_and_counted() -> None:
    s = scheduler()
    assert s.ask(0.00, None) is POSITION
    assert s.ask(0.01, None) is POSITION
    assert s.timeouts == 1
    s.answered(1, repeat=False)
    assert s.ask(0.02, None) is FORCE


def test_a_question_that_does_not_insist_is_asked_once_and_the_pattern_goes_on() -> None:
    s, once = scheduler(), Ask(7, insists=False)
    assert s.ask(0.00, once) is once
    assert s.ask(0.01, None) is POSITION
    s.answered(1, repeat=False)
    assert s.ask(0.02, once) is once
    assert s.answered(7, repeat=True) is once
    assert s.ask(0.03, None) is FORCE
    assert (s.timeouts, s.repeats, s.repeats_in_row, s.turns) == (1, 1, 0, 1)


def test_only_one_question_is_in_flight() -> None:
    s = scheduler()
    assert s.ask(0.000, None) is POSITION
    assert s.ask(0.004, None) is None
    assert s.ask(0.008, None) is POSITION
    assert (s.slots, s.timeouts) == (3, 1)


def test_answers_to_questions_not_asked_are_counted_and_close_nothing() -> None:
    s = scheduler()
    assert s.answered(1, repeat=False) is None
    s.ask(0.0, None)
    assert s.answered(2, repeat=False) is None
    assert s.answered(1, repeat=False) is POSITION
    assert s.answered(1, repeat=False) is None
    assert (s.unasked, s.pairs) == (3, 1)


@given(st.lists(st.sampled_from(["answer", "repeat", "none", "wrong"]), max_size=60))
def test_slots_add_up_whatever_the_drive_answers(script: list[str]) -> None:
    s = scheduler()
    for k, what in enumerate(script):
        question = s.ask(k * 0.01, None)
        assert question is not None, "a slot went unused"
        if what in ("answer", "repeat"):
            assert s.answered(question.number, repeat=what == "repeat") is question
        elif what == "wrong":
            assert s.answered(77, repeat=False) is None
    unanswered = sum(w in ("none", "wrong") for w in script)
    assert s.slots == len(script) == s.pairs + unanswered
    assert s.timeouts == sum(w in ("none", "wrong") for w in script[:-1])
    assert s.repeats == script.count("repeat")
