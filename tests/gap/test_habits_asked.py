"""Habits that explain better at a glimpse: all candidates are looked at once, beside all of them."""

from types import SimpleNamespace

import pytest

from hil.gap.rounds import twins
from hil.gap.rounds.twins import with_habits


def habit(name):
    return SimpleNamespace(
        step=name, is_plain=False, is_unlike=False, twin=lambda rig, share: (*rig, name)
    )


MOUNT, TAKES_TIME, WEIGHS = map(habit, ("mount", "takes time", "weighs"))


def taken(rig):
    return SimpleNamespace(
        rig=rig, located=None, calibrated=None, fits=rig, is_large=True, parts=None, bank=None
    )


@pytest.mark.parametrize("stands", [True, False])
def test_habits_that_explain_better_are_looked_at_in_one_round(monkeypatch, stands):
    looked = []

    def seen(q, mine, twin):
        is_better = twin[-1] != "takes time"
        return SimpleNamespace(
            other=taken(twin), is_better=is_better, is_promising=is_better, located=lambda q: twin
        )

    def whole(q, located, parts, bank):
        looked.append(located)
        return taken(located)

    monkeypatch.setattr(twins, "mount_of", lambda located: MOUNT)
    monkeypatch.setattr(twins, "share_of", lambda habit, located: 1.0)
    monkeypatch.setattr(twins, "glimpsed", seen)
    monkeypatch.setattr(twins, "considered", whole)
    monkeypatch.setattr(twins, "explains_better", lambda c, fits, others: stands)
    mine = taken(())
    found, habits = with_habits(SimpleNamespace(say=lambda text: None), mine, (TAKES_TIME, WEIGHS))
    assert looked == [("mount", "weighs")]
    assert (found is mine) is not stands
    assert habits == ([(MOUNT, 1.0), (WEIGHS, 1.0)] if stands else [])
