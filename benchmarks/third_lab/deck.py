"""Which case is of which kind, and which card it starts from: shuffled decks, so that everything comes up."""

from __future__ import annotations

from typing import Final

import numpy as np

from benchmarks.third_lab import (
    effects_body,
    effects_drive,
    effects_friction,
    effects_sensor,
    outside,
)
from benchmarks.third_lab.effect import Maker

RIGS: Final = ("axis", "motorcycle", "stewart")

TEN: Final = ("healthy",) * 3 + ("one",) * 4 + ("two",) + ("outside",) * 2
"""Kinds of case in every ten."""

CARDS: Final = {"healthy": 0, "one": 1, "two": 2, "outside": 1}

_NOT_ON_AXIS: Final = ("payload_cog", "payload_inertia", "geometry_error", "position_offset")
"""Without trace on a carriage whose encoder counts from its own zero."""


def makers(rig: str) -> tuple[Maker, ...]:
    """The catalogue's effects on `rig`, in a fixed order."""
    modules = (effects_friction, effects_drive, effects_body, effects_sensor)
    every = [m for module in modules for m in module.MAKERS]
    return tuple(m for m in every if rig != "axis" or m.__name__ not in _NOT_ON_AXIS)


def kind(rig: str, seed: int, index: int) -> str:
    """Of case `index`."""
    order = _rng(rig, seed, 1, index // 10).permutation(10)
    return TEN[order[index % 10]]


def cards(rig: str, seed: int, index: int) -> tuple[list[Maker], list[Maker]]:
    """The case's own cards, and all others of the deck, should its own leave no trace on this motion."""
    mine = kind(rig, seed, index)
    deck = outside.MAKERS if mine == "outside" else makers(rig)
    alike, stream = (("outside",), 3) if mine == "outside" else (("one", "two"), 2)
    drawn = sum(CARDS[k] for i in range(index) if (k := kind(rig, seed, i)) in alike)
    piles = [_rng(rig, seed, stream, drawn // len(deck) + k).permutation(len(deck)) for k in (0, 1)]
    order = list(dict.fromkeys(np.concatenate(piles)[drawn % len(deck) :].tolist()))
    return [deck[k] for k in order[: CARDS[mine]]], [deck[k] for k in order[CARDS[mine] :]]


def _rng(rig: str, seed: int, *where: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence([3, RIGS.index(rig), seed, *where]))
