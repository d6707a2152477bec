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


def test_springs_are_not_asked_where_the_twin_has_them(monkeypatch):
    def none(q, mine, twin):
        raise AssertionError("a glimpse of the same twin")

    monkeypatch.setattr(twins, "sprung_twin", lambda rig, bend_hz: rig)
    monkeypatch.setattr(twins, "glimpsed", none)
    told = SimpleNamespace(verdict="unknown", effects=[])
    mine = SimpleNamespace(answer=lambda seed: told, is_large=True, rig="sprung")
    assert on_springs(SimpleNamespace(seed=0), mine) == (mine, None)


def test_all_candidates_are_looked_at_beside_the_softest_springs_alone_that_explain_better(
    monkeypatch,
):
    looked, unknown = [], SimpleNamespace(verdict="unknown", effects=[])

    def seen(q, mine, twin):
        other = SimpleNamespace(rig=twin)
        return SimpleNamespace(is_promising=twin > 80.0, may_be_nothing=False, other=other)

    def whole(q, located, parts, bank):
        looked.append(located)
        return SimpleNamespace(
            rig=located, calibrated=None, fits=[None], answer=lambda seed: unknown
        )

    monkeypatch.setattr(twins, "sprung_twin", lambda rig, bend_hz: bend_hz)
    monkeypatch.setattr(twins, "glimpsed", seen)
    monkeypatch.setattr(twins, "considered", whole)
    monkeypatch.setattr(twins, "explains_better", lambda c, fits, others: True)
    mine = SimpleNamespace(
        answer=lambda seed: unknown, is_large=True, rig=None, calibrated=None, fits=[None],
        parts=None, bank=None,
    )  # fmt: skip
    question = SimpleNamespace(seed=0, say=lambda text: None, locate=lambda rig: rig)
    assert on_springs(question, mine) == (mine, None)
    assert looked == [90.0], "one round of all candidates, not one for each"
