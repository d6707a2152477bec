"""Which case is what: decks of sixty, shuffled, so that everything comes up and nothing can be counted on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from typing import Final, TypeVar

import numpy as np

from benchmarks.other_rides.effects import CALIBRATED, OF_SENSORS, PHYSICAL, PLACES
from benchmarks.other_rides.outside import MAKERS

T = TypeVar("T")

HEALTHY, PAIRS, OUTSIDE, SINGLES = 18, 6, 12, 24
SIZE: Final = HEALTHY + PAIRS + OUTSIDE + SINGLES
REFERENCES: Final = 1.0 / 3.0
"""Share of those cases with a healthy ride that need none."""


@dataclass(frozen=True, slots=True)
class Card:
    """One case: the catalogue's effects with their places, or one from outside, or neither."""

    effects: tuple[tuple[str, str], ...] = ()
    outside: int | None = None
    severity: int | None = None
    reference: bool = False


def cards(seed: int, last: int) -> list[Card]:
    """The cards of cases 0 to `last`."""
    out: list[Card] = []
    places = {effect: _forever(seed, 10 + k, PLACES[effect]) for k, effect in enumerate(PLACES)}
    outsiders = _forever(seed, 1, tuple(range(len(MAKERS))))
    extras = _forever(seed, 2, tuple(PLACES))
    for block in range(last // SIZE + 1):
        rng = np.random.default_rng(np.random.SeedSequence([seed, block, 3]))
        deck: list[tuple[tuple[str, ...], bool]] = [((), False)] * HEALTHY + [((), True)] * OUTSIDE
        twice = 2 * tuple(PLACES)
        deck += [((e,), False) for e in twice]
        deck += [((next(extras),), False) for _ in range(SINGLES - len(twice))]
        deck += [
            ((str(rng.choice(PHYSICAL)), str(rng.choice(OF_SENSORS))), False) for _ in range(PAIRS)
        ]
        for k in rng.permutation(SIZE):
            names, strange = deck[k]
            alone = len(names) == 1
            out.append(
                Card(
                    tuple((e, next(places[e])) for e in names),
                    next(outsiders) if strange else None,
                    int(rng.choice([1, 3, 10], p=[0.2, 0.4, 0.4] if alone else [0.0, 0.5, 0.5])),
                    bool(set(names) & set(CALIBRATED)) or bool(rng.random() < REFERENCES),
                )
            )
    return out[: last + 1]


def _forever(seed: int, stream: int, items: tuple[T, ...]) -> Iterator[T]:
    """Each of `items` once, then once more in another order, and so on."""
    for turn in count():
        rng = np.random.default_rng(np.random.SeedSequence([seed, turn, stream]))
        for k in rng.permutation(len(items)):
            yield items[k]
