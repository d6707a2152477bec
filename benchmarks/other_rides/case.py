"""One case: drawn, ridden, recorded, and written with its answer sealed apart."""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.other_rides.bicycle import (
    Bicycle,
    Outing,
    draw_bicycle,
    draw_outing,
    go,
    noisy,
)
from benchmarks.other_rides.deck import Card
from benchmarks.other_rides.effects import make
from benchmarks.other_rides.fault import Sized, sized
from benchmarks.other_rides.outside import MAKERS
from benchmarks.other_rides.plan import KINDS
from benchmarks.other_rides.sensing import recorded
from hil.config import BicycleFile

MOST_RIDES: Final = 3
FIRST_DAY: Final = datetime(2026, 3, 2, 9, 0, tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class Run:
    """One record of a case."""

    outing: Outing
    bicycle: Bicycle
    role: str


@dataclass(frozen=True, slots=True)
class Case:
    """A case before it is written."""

    name: str
    index: int
    runs: tuple[Run, ...]
    answer: dict[str, Any]
    notes: dict[str, Any]


def draw(rig: BicycleFile, seed: int, index: int, card: Card) -> Case:
    """Case `index`: a bicycle, its rides, its faults at the size that the card asks for."""
    of_bicycle, of_rides, of_fault, of_order = (
        np.random.default_rng(s) for s in np.random.SeedSequence([seed, index]).spawn(4)
    )
    healthy = draw_bicycle(of_bicycle)
    kinds = ["mixed", *of_rides.permutation(KINDS[1:])][: of_rides.integers(1, MOST_RIDES + 1)]
    rides = [draw_outing(str(kind), of_rides, rig, healthy.body) for kind in kinds]
    faults = [make(effect, place, of_fault) for effect, place in card.effects]
    if card.outside is not None:
        faults.append(MAKERS[card.outside](of_fault))
    found = [sized(rig, healthy, fault, card.severity or 1, rides) for fault in faults]
    faulty = healthy
    for s in found:
        faulty = s.fault.on(faulty, s.size)
    runs = [Run(outing, faulty, "diagnose") for outing in rides]
    if card.reference:
        spare = draw_outing("mixed", of_rides, rig, healthy.body)
        runs.insert(int(of_order.integers(len(runs) + 1)), Run(spare, healthy, "reference"))
    answer = _answer(rig, card, found, faulty, rides)
    notes = {
        "seed": seed,
        "index": index,
        "severity_drawn": card.severity if found else None,
        "faults": [s.describe() for s in found],
        "body": asdict(healthy.body),
        "sensors": {s: asdict(c) for s, c in healthy.sensing.channels.items()},
        "mount": healthy.sensing.mount,
        "clock": healthy.sensing.clock,
        "rides": [{"role": r.role, "kind": r.outing.ride.plan.kind} for r in runs],
    }
    return Case(f"b{seed:02d}{index:04d}", index, tuple(runs), answer, notes)


def write(case: Case, rig: BicycleFile, rig_path: Path, out: Path) -> None:
    """Run folders under `out`/cases, answer and notes under `out`/answers."""
    folder, sealed = out / "cases" / case.name, out / "answers" / case.name
    for place in (folder, sealed):
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
    answer = _json(case.answer)
    (sealed / "answer.json").write_bytes(answer)
    (sealed / "notes.json").write_bytes(_json(case.notes))
    shutil.copyfile(rig_path, folder / "rig.toml")
    seal = hashlib.sha256(answer).hexdigest()
    for k, run in enumerate(case.runs):
        place = folder / f"run{k + 1}"
        place.mkdir()
        started = FIRST_DAY + timedelta(hours=case.index, minutes=5 * k)
        (place / "run.toml").write_text(
            f'format = "hil-run/1"\nrig = "{rig.name}"\nmode = "ride"\n'
            f"started = {started:%Y-%m-%dT%H:%M:%SZ}\n"
            f'note = "{run.outing.ride.plan.kind}"\nrole = "{run.role}"\nanswer_sha256 = "{seal}"\n'
        )
        truth = go(rig, run.bicycle.body, run.outing).truth
        answers = noisy(rig, truth, run.bicycle.sensing, run.outing)
        recorded(rig, answers, run.outing.luck).to_parquet(place / "signals.parquet", index=False)


def _answer(
    rig: BicycleFile, card: Card, found: list[Sized], faulty: Bicycle, rides: list[Outing]
) -> dict[str, Any]:
    verdict = "no_gap" if not found else "identified" if card.effects else "unknown"
    effects = [
        {
            "effect": s.fault.effect,
            "location": s.fault.location,
            "parameters": s.fault.parameters(s.size, rig, faulty, rides),
        }
        for s in found
        if card.effects
    ]
    answer: dict[str, Any] = {"verdict": verdict, "effects": effects, "rig": rig.name}
    if found:
        answer["severity"] = min(s.severity for s in found)
    return answer


def _json(values: dict[str, Any]) -> bytes:
    return (json.dumps(values, indent=1, default=float) + "\n").encode()
