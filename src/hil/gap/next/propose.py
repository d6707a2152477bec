"""Which of many motions to play next: drawn, scored, the best one made as the daemon would let it through."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from hil.blas import one_blas_thread
from hil.config import RigFile
from hil.errors import HilError, IdentificationError
from hil.gap.next.candidates import Candidate, read_candidates, simplest
from hil.gap.next.score import Split, payloads_of, split_of
from hil.gap.next.sketches import Sketch, draw_sketches, generic_multisine

Report = Callable[[str], None]

SECONDS: Final = 25.0
SKETCHES: Final = {1: 20, 3: 12}
FEWEST: Final = 8
"""Motions that are drawn, by degrees of freedom; beyond those of the table FEWEST."""
BOLTING: Final = 0.05
"""Nats that a payload must be worth: somebody has to weigh it and bolt it on."""
WEIGHED: Final = 3
"""Best motions that are tried with a payload too."""
DECIDED: Final = 0.02
"""Nats of expected entropy below which nobody is sent for a payload."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """The experiment to play, and what it is expected to tell."""

    sketch: Sketch
    split: Split
    candidates: tuple[Candidate, ...]
    generic: Split | None
    """What a multisine of the same length would tell."""
    tried: int
    rig: RigFile

    @property
    def sentence(self) -> str:
        """What it splits, and what to expect."""
        pairs = [
            f"{self.candidates[a].name} from {self.candidates[b].name}"
            for a, b in self.split.apart()
        ]
        alike = "".join(
            f" {a.name} is {b.name} where nothing tells them apart: the simpler stands."
            for i, a in enumerate(self.candidates) for j, b in enumerate(self.candidates)
            if a.holds(b) and (min(i, j), max(i, j)) not in self.split.apart()
        )  # fmt: skip
        if not pairs:
            return (
                f"No motion within the limits of {self.rig.name} splits "
                f"{', '.join(c.name for c in self.candidates)} with these sensors; "
                f"the best of {self.tried} is {self._motion()}. Another sensor is needed.{alike}"
            )
        generic = "" if self.generic is None else (
            f" (a multisine of the same length: {100.0 * self.generic.right:.0f} %)"
        )  # fmt: skip
        return (
            f"Play {self._motion()}: it tells {'; '.join(pairs)}. Expected probability of the true one after "
            f"it: {100.0 * self.split.right:.0f} %{generic}.{alike}"
        )

    def _motion(self) -> str:
        s = self.sketch
        text = f"{s.trajectory.duration_s:.0f} s of {s.kind} ({s.text})"
        if not s.payload_kg:
            return text
        return f"{text} twice, the second time with {s.payload_kg:g} kg at the centre of gravity"

    def table(self) -> dict[str, Any]:
        """The diagnosis file's `next_experiment`."""
        s, payload = self.sketch, None
        if s.payload_kg:
            values = (s.payload_kg, *self.rig.mass.cog)
            payload = dict(zip(("mass", "x", "y", "z"), values, strict=True))
        names = [c.name for c in self.candidates]
        return {
            "sentence": self.sentence, "kind": s.kind, "motion": s.text,
            "duration_s": s.trajectory.duration_s, "payload": payload,
            "candidates": names,
            "splits": [[names[a], names[b]] for a, b in self.split.apart()],
            "expected_probability": self.split.right,
            "expected_entropy": self.split.entropy,
            "generic_probability": None if self.generic is None else self.generic.right,
            "tried": self.tried,
        }  # fmt: skip


@one_blas_thread()
def propose(
    tables: Mapping[str, Any],
    rig: RigFile,
    *,
    seconds: float = SECONDS,
    count: int | None = None,
    payload: bool = True,
    seed: int = 0,
    report: Report | None = None,
) -> Proposal:
    """The best of `count` drawn motions of `seconds` for the candidates of a diagnosis.

    `payload`: whether one can be bolted on. IdentificationError where fewer than two candidates are left,
    where all that is left is one and laws that hold it, or no motion can be ridden. Equal `seed`, equal
    answer.
    """
    say = report or (lambda _: None)
    candidates, shared = read_candidates(tables, rig)
    signals = tuple(tables["gap"]["signals"])
    rng = np.random.default_rng(seed)
    many = count or SKETCHES.get(len(rig.coordinates), FEWEST)

    def scored(sketches: list[Sketch]) -> list[tuple[float, Sketch, Split]]:
        out = []
        for sketch in sketches:
            say(f"{sketch.kind}: {sketch.text}" + (" with a payload" if sketch.payload_kg else ""))
            try:
                split = split_of(sketch, rig, candidates, shared, signals, seed)
            except HilError:  # moves too little, or a pose does not close
                continue
            if split is not None:
                out.append((_cost(sketch, split, rig.mass.m), sketch, split))
        return sorted(out, key=lambda x: x[0])

    ranked = scored(draw_sketches(rig, seconds, many, rng))
    if not ranked:
        raise IdentificationError(
            f"{rig.name}: none of the motions drawn can be ridden by every candidate"
        )
    if payload and ranked[0][2].entropy > DECIDED:
        able = [s for _, s, _ in ranked[:WEIGHED]]
        short = [replace(s, payload_kg=kg) for s in able for kg in payloads_of(rig)]
        ranked = sorted([*ranked, *scored(short)], key=lambda x: x[0])
    _, best, split = ranked[0]
    plain = simplest(candidates)
    if plain is not None and not split.apart():
        others = ", ".join(c.name for c in candidates if c is not plain)
        raise IdentificationError(
            f"{others}: with the values found this is {plain.name}, and no motion tells them apart: the "
            "simpler stands, there is nothing to split"
        )
    try:
        usual = split_of(generic_multisine(rig, best.trajectory.duration_s, seed), rig, candidates, shared,
                         signals, seed)  # fmt: skip
    except HilError:
        usual = None
    return Proposal(best, split, tuple(candidates), usual, many, rig)


def _cost(sketch: Sketch, split: Split, mass_kg: float) -> float:
    """Expected entropy, what bolting costs (beside a platform of so much), and where all is decided the
    nearest pair."""
    apart = split.distance[~np.eye(len(split.prior), dtype=bool)]
    near = float(np.min(np.maximum(apart.reshape(len(split.prior), -1), 0.0)))
    bolting = BOLTING * (1.0 + sketch.payload_kg / mass_kg) if sketch.payload_kg else 0.0
    return split.entropy + bolting - 0.003 * float(np.log1p(near))


def next_experiment(tables: Mapping[str, Any], rig: RigFile, seed: int = 0) -> dict[str, Any]:
    """`next_experiment` of the diagnosis `tables`: what to play, what it splits, what to expect.

    IdentificationError as `propose`.
    """
    return propose(tables, rig, seed=seed).table()
