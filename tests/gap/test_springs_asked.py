"""When a twin on springs is asked: of small and unknown gaps, and of what springs look like."""

from types import SimpleNamespace

import pytest

from hil.gap.rounds import twins
from hil.gap.rounds.twins import on_springs


@pytest.mark.parametrize(
    ("verdict", "effects", "is_large", "asked"),
    [
        ("no_gap", (), False, False),
        ("identified", ("coulomb_friction",), False, True),
        ("identified", ("coulomb_friction",), True, False),
        ("identified", ("loop_gain",), True, True),
        ("unknown", (), True, True),
    ],
)
def test_springs_are_asked_of_small_and_unknown_gaps(
    monkeypatch, verdict, effects, is_large, asked
):
    glimpses = []
    monkeypatch.setattr(twins, "sprung_twin", lambda rig, bend_hz: bend_hz)
    nothing = SimpleNamespace(is_promising=False, may_be_nothing=False)
    monkeypatch.setattr(twins, "glimpsed", lambda q, mine, twin: glimpses.append(twin) or nothing)
    told = SimpleNamespace(verdict=verdict, effects=[SimpleNamespace(effect=x) for x in effects])
    mine = SimpleNamespace(answer=lambda seed: told, is_large=is_large, rig=None)
    question = SimpleNamespace(seed=0, say=lambda text: None)
    assert on_springs(question, mine) == (mine, None)
    assert bool(glimpses) is asked
