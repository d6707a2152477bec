"""One case from rig, seed and index alone: the specimen, its runs, the effect and its size, the answer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd

from benchmarks.third_lab.commission import aged, commission
from benchmarks.third_lab.deck import RIGS, cards, kind
from benchmarks.third_lab.effect import Effect, Setting, World
from benchmarks.third_lab.motions import FAMILIES, cue
from benchmarks.third_lab.plant import Plant, nominal
from benchmarks.third_lab.record import table
from benchmarks.third_lab.severity import LEVELS, Stage, level_of, size_for
from benchmarks.third_lab.world import Chance, run
from hil.config import RigFile

PLACES: Final = 2
"""Times that an effect is tried, each at a place drawn anew, before the next card is taken."""

LEAST: Final = {"one": 0.6, "two": LEVELS[1], "outside": 2.3}
"""Severity below which an effect at its largest is passed over for another."""

PAIR_MARGIN: Final = 1.15
"""Two effects together are aimed so far above their level, for neither may fall short of it."""

ALIKE: Final = 0.6
"""Two effects whose traces have a larger cosine are no pair: nobody could tell them apart."""

_MOST_RUNS: Final = {"axis": 3, "motorcycle": 3, "stewart": 2}


@dataclass(frozen=True)
class Case:
    """What is written of a case."""

    records: tuple[pd.DataFrame, ...]
    roles: tuple[str, ...]
    answer: dict[str, Any]
    notes: dict[str, Any]


@dataclass(frozen=True)
class Sized:
    """An effect with the size that was found for it."""

    effect: Effect
    size: float
    severity: float

    def entry(self) -> dict[str, Any]:
        """As answers have it."""
        parameters = {k: float(v) for k, v in self.effect.parameters(self.size).items()}
        return {
            "effect": self.effect.name,
            "location": self.effect.location,
            "parameters": parameters,
        }


def make(rig_name: str, rig: RigFile, seed: int, index: int) -> Case:
    """Case `index` of `seed`."""
    rng = np.random.default_rng(np.random.SeedSequence([3, RIGS.index(rig_name), seed, 0, index]))
    ideal = nominal(rig)
    first_day = commission(ideal, rng)
    today = aged(*first_day, rng)
    families = [str(f) for f in rng.permutation(list(FAMILIES))]
    runs = int(rng.integers(1, _MOST_RUNS[rig_name] + 1))
    stage = _stage(ideal, today, families[:runs], rng)
    mine = kind(rig_name, seed, index)
    sized = _draw(rig_name, seed, index, stage, rng) if mine != "healthy" else []
    world = today
    for s in sized:
        world = s.effect.apply(s.size, world)
    traces = stage.play(world)
    if traces is None:
        raise RuntimeError(f"{rig_name} {seed} {index}: both effects together trip the drives")
    records = [table(*world, t, c) for t, c in zip(traces, stage.chances, strict=True)]
    roles = ["diagnose"] * runs
    if any(s.effect.calibrates_away for s in sized) or rng.random() < 0.33:
        records.append(_reference(ideal, first_day, families[-1], rng))
        roles.append("reference")
    answer = _answer(rig_name, mine, sized)
    by_signal = stage.severities(world) if sized else {}
    notes = {
        "kind": mine,
        "motions": families[:runs],
        "reference_motion": families[-1] if len(roles) > runs else None,
        "effects": [s.entry() | {"size": s.size, "severity": s.severity} for s in sized],
        "severity_by_signal": {k: round(v, 3) for k, v in (by_signal or {}).items()},
        "floor": {k: float(f"{v:.4g}") for k, v in stage.floor.items()} if sized else {},
        "healthy": _specimen(today),
    }
    return Case(tuple(records), tuple(roles), answer, notes)


def _stage(ideal: Plant, world: World, families: list[str], rng: np.random.Generator) -> Stage:
    cues = tuple(cue(f, rng, ideal, rng.uniform(20.0, 40.0)) for f in families)
    chances = [tuple(Chance.draw(rng, ideal, len(c)) for c in cues) for _ in range(2)]
    return Stage(ideal, world, cues, *chances)


def _draw(rig: str, seed: int, index: int, stage: Stage, rng: np.random.Generator) -> list[Sized]:
    """One effect or two, or a fault from outside, at severities drawn 20 : 40 : 40."""
    mine = kind(rig, seed, index)
    forces = np.concatenate([t.force for t in stage.traces], axis=1)
    moved = [(t.position[:, 40:] - t.position[:, :-40]) / (40 * t.dt) for t in stage.traces]
    mean = np.abs(forces.mean(axis=1))
    setting = Setting(
        stage.ideal,
        rng,
        np.stack([mean, np.abs(forces).max(axis=1)], axis=1),
        np.abs(np.concatenate(moved, axis=1)).max(axis=1),
    )
    levels, odds = (LEVELS, (0.2, 0.4, 0.4)) if mine == "one" else (LEVELS[1:], (0.5, 0.5))
    own, rest = cards(rig, seed, index)
    found: list[Sized] = []
    for maker in [*own, *(rest[k] for k in rng.permutation(len(rest)))]:
        target = float(rng.choice(levels, p=odds)) * (PAIR_MARGIN if mine == "two" else 1.0)
        for _ in range(PLACES):
            effect = maker(setting)
            size = size_for(stage, effect, target, LEAST[mine])
            if size is None or (mine == "two" and not _apart(stage, found, Sized(effect, *size))):
                continue
            found.append(Sized(effect, *size))
            break
        if len(found) == (2 if mine == "two" else 1):
            return found
    raise RuntimeError(f"{rig} {seed} {index}: no card leaves a trace on this motion")


def _apart(stage: Stage, found: list[Sized], more: Sized) -> bool:
    """Whether `more` is unlike what was found, and the drives bear both at once."""
    own = stage.signature(more.effect.apply(more.size, stage.world))
    for other in found:
        there = other.effect.apply(other.size, stage.world)
        both = more.effect.apply(more.size, there)
        if abs(float(stage.signature(there) @ own)) > ALIKE or stage.play(both) is None:
            return False
    return True


def _reference(ideal: Plant, world: World, family: str, rng: np.random.Generator) -> pd.DataFrame:
    pose = cue(family, rng, ideal, rng.uniform(20.0, 35.0))
    chance = Chance.draw(rng, ideal, len(pose))
    return table(*world, run(world[0], ideal, pose, chance), chance)


def _answer(rig: str, mine: str, sized: list[Sized]) -> dict[str, Any]:
    """Of two effects the severity is that of the weaker."""
    verdict = {"healthy": "no_gap", "outside": "unknown"}.get(mine, "identified")
    effects = [s.entry() for s in sized] if verdict == "identified" else []
    severity = level_of(min(s.severity for s in sized)) if sized else 0.0
    return {"verdict": verdict, "effects": effects, "rig": rig, "severity": severity}


def _specimen(world: World) -> dict[str, Any]:
    """The healthy rig's departures that matter most, for the examiner."""
    plant, sensing = world
    return {
        "mass": plant.mass,
        "cog": plant.cog.tolist(),
        "tilt": plant.tilt.tolist(),
        "friction_law": [
            "lugre" if plant.get(a, "law") else "maxwell" for a in plant.rig.actuator_names
        ],
        "coulomb": [plant.get(a, "coulomb_pos") for a in plant.rig.actuator_names],
        "setpoint_delay": [plant.get(a, "setpoint_delay") for a in plant.rig.actuator_names],
        "answer_delay": sensing.answer_delay.tolist(),
    }
