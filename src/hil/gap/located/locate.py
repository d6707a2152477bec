"""Where the twin differs from the rig: by signal, frequency band and operating region, above the floor.

The steps: data sanity; twin replayed; how setpoint stamps meet the drives' ticks; nuisances refitted; the
floor drawn and refitted alike; energies by cell; shares of what stands above the floor with intervals by
resampling blocks of time. docs/gap.md says why each is done so.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from hil.config import RigFile
from hil.gap.catalogue.nuisances import Nuisance, default_nuisances
from hil.gap.floor.lateness import without_lateness
from hil.gap.floor.noise import NoiseModel, find_noise, projected, rougher
from hil.gap.located.cells import Cells, count_cells
from hil.gap.located.phase import settled
from hil.gap.located.residual import Refit
from hil.gap.located.result import RATIO, Evidence, Located, Place, SignalGap, interval, unit_of
from hil.gap.located.sanity import Finding, check_answers, check_runs, fewer, refuse
from hil.gap.record.arrivals import find_clocks
from hil.gap.record.problem import Problem
from hil.gap.record.regions import region_codes
from hil.gap.record.repeats import find_repeats
from hil.gap.record.runs import as_runs
from hil.gap.record.thin import thinned
from hil.gap.record.ticks import Clocks
from hil.identify.replay import stretches
from hil.runs import Run

Array = NDArray[np.float64]

CLEAR: Final = 6.0
"""-log10 of the chance below which a cell is no chance, with some thousand looked at."""
LEVEL: Final = 1.25
"""Within this ratio a cell may be noise whose level the model misses [R]."""
MATERIAL: Final = 0.05
"""Of its signal's whole floor, in energy, that a band must add to be called a gap by itself."""
RESAMPLES: Final = 400
CONCENTRATED: Final = 0.1
"""share × log(share / time share), in nine resamples of ten, from which on a region is named [R]."""
LEAST_TIME: Final = 0.01
"""Of a signal's samples, for a region to be named."""
DIMENSION_WEIGHT: Final = {
    "speed": 1.0, "position": 0.7, "direction": 0.7, "load": 0.7, "time": 0.5,
}  # fmt: skip
"""What an effect does with speed is what it is known by; others must be clearer to be named [R]."""
MOST_PLACES: Final = 12
LEAST_SHARE: Final = 0.02


def locate(
    runs: Run | pd.DataFrame | Iterable[Run | pd.DataFrame],
    rig: RigFile,
    *,
    nuisances: Sequence[Nuisance] | None = None,
    healthy: Located | None = None,
    clocks: Clocks | None = None,
    near: Located | None = None,
    is_tried: bool = False,
    seed: int = 0,
) -> Located:
    """Locate the gap between `runs` (Run objects, or frames with column t and one a signal) and `rig`'s twin.

    `nuisances` (default: `default_nuisances`) are refitted first. `healthy`: what was located on references,
    whose noise tells how much of this record's can be noise, and whose own gap is none here. `clocks`: the
    drives' ticks, where they are known better than the rig file's twin tells them. `near`: what was located
    of the same runs by a twin that is nearly this one, with the same ticks. `is_tried`: the twin is one that
    is tried on runs beside which the rig file's own made sense: where it makes none, it is the wrong twin.
    IdentificationError where the data cannot carry an answer names signal and reason.
    """
    loaded = as_runs(runs, rig)
    findings = check_runs(loaded, rig)
    refuse(findings)
    pieces, every = thinned(rig, [piece for run in loaded for piece in stretches(run)])
    findings += [fewer(every)] if every > 1 else []
    rng = np.random.default_rng(seed)
    smooth = Problem(rig, pieces)
    findings += [f for f in check_answers(smooth) if not (is_tried and f.severity == "error")]
    refuse(findings)
    problem = smooth.with_clocks(find_clocks(smooth) if clocks is None else clocks)
    chosen = nuisances or default_nuisances(rig, problem.signals, are_forces=problem.are_forces)
    guess = find_noise(problem, problem.base, rng, count=2)
    known = None if near is None else near.evidence.jacobian
    best = settled(problem, guess, chosen, known)
    found = find_noise(
        problem, best.vector, rng, repeats=find_repeats(problem),
        residual=without_lateness(problem, best.vector, best.residual),
        healthy=None if healthy is None else healthy.evidence.noise.levels,
    )  # fmt: skip
    found = projected(found, problem, best.jacobian, best.prior_sd)
    if healthy is not None:
        found = rougher(found, problem, healthy.roughness)
    evidence = evidence_of(problem, found, best, problem.motion(best.vector))
    names = tuple(run.path.name for run in loaded)
    return located(rig, names, evidence, best, findings, rng)


def evidence_of(
    problem: Problem, noise: NoiseModel, best: Refit, motion: Sequence[dict[str, Array]]
) -> Evidence:
    """The refitted twin beside `noise`, cell by cell; `motion`: the twin's, as `Problem.motion` gives it."""
    cells = count_cells(
        problem, noise, noise.tamed(problem, best.residual), region_codes(problem, motion)
    )
    return Evidence(problem, noise, best.vector, best.residual, best.jacobian, tuple(motion), cells)


def located(
    rig: RigFile,
    runs: tuple[str, ...],
    evidence: Evidence,
    best: Refit,
    findings: Sequence[Finding],
    rng: np.random.Generator,
) -> Located:
    """The answer that `evidence` gives: signals, places and the sentence."""
    cells, problem = evidence.cells, evidence.problem
    turns = isinstance(rig, RigFile) and rig.is_rotary  # rides bring the bicycle's file
    whole = np.array([d == "" for d in cells.dimension])
    blocks = cells.energy.shape[1]
    picks = rng.multinomial(blocks, np.full(blocks, 1.0 / blocks), RESAMPLES).astype(float)
    clear = _clear(cells)
    total = float(cells.excess[whole & clear].sum())
    drawn_total = np.maximum((cells.excess[whole & clear] @ picks.T).sum(axis=0), 1e-12)
    floors = evidence.noise.floor(problem)
    signals = []
    for s, name in enumerate(problem.signals):
        mine = whole & (cells.signal == s)
        if not mine.any():
            continue
        count = float(cells.samples[mine].max())
        energy = float(cells.energy[mine].sum()) / count
        drawn = (cells.energy[mine].sum(axis=0) @ picks.T) / count
        signals.append(
            SignalGap(
                name,
                unit_of(name, is_rotary=turns),
                float(np.sqrt(energy)) * floors[name],
                _scaled(interval(np.sqrt(drawn)), floors[name]),
                floors[name],
                float(cells.score[mine].max()),
                float(cells.excess[mine & clear].sum()) / total if total > 0.0 else 0.0,
            )
        )
    samples = sum(
        float(cells.samples[whole & (cells.signal == s)].max()) for s in set(cells.signal)
    )
    before = np.sqrt(cells.energy[whole].sum() / samples)
    drawn_before = np.sqrt(cells.energy[whole].sum(axis=0) @ picks.T / samples)
    places = _places(evidence, picks, total, drawn_total, floors) if total > 0.0 else []
    material = clear & (cells.excess.sum(axis=1) > MATERIAL * cells.samples) & _above(cells, RATIO)
    is_gap = any(x.ratio > RATIO for x in signals) or bool(np.any(whole & material))
    return Located(
        rig.name, runs, float(before), 1.0, interval(drawn_before), is_gap,
        _sentence(is_gap, signals, places), tuple(signals), tuple(places if is_gap else ()),
        best.fitted, evidence.noise.text, tuple(findings), evidence,
    )  # fmt: skip


def _clear(cells: Cells) -> NDArray[np.bool_]:
    """(C,) cells that stand above the floor beyond chance and beyond what the floor's own level may miss."""
    return np.asarray((cells.score > CLEAR) & _above(cells, LEVEL))


def _above(cells: Cells, ratio: float) -> NDArray[np.bool_]:
    """(C,) cells whose root mean square is `ratio` times the floor's or more."""
    return np.asarray(cells.energy.sum(axis=1) > ratio**2 * cells.floor.sum(axis=1))


def _places(
    evidence: Evidence, picks: Array, total: float, drawn_total: Array, floors: dict[str, float]
) -> list[Place]:
    """The strongest cells of each signal and band, with the region that they gather in; neighbours joined."""
    cells, problem = evidence.cells, evidence.problem
    clear = _clear(cells)
    named: dict[tuple[int, str], list[tuple[int, int]]] = {}
    for c in np.flatnonzero([d == "" for d in cells.dimension]):
        if clear[c]:
            r = _region(cells, int(c), picks)
            named.setdefault((int(cells.signal[c]), cells.region[r]), []).append((int(c), r))
    out = []
    for (s, region), members in named.items():
        for group in _joined(cells, members):
            inner = [r for _, r in group]
            excess = cells.excess[inner].sum(axis=0)
            count = float(cells.samples[inner].max())
            floor = floors[problem.signals[s]]
            out.append(
                Place(
                    problem.signals[s],
                    (min(cells.band[r][0] for r in inner), max(cells.band[r][1] for r in inner)),
                    region,
                    float(excess.sum()) / total,
                    interval(np.clip(excess @ picks.T / drawn_total, 0.0, 1.0)),
                    count / float(cells.samples[group[0][0]]),
                    float(np.sqrt(cells.energy[inner].sum() / count)) * floor,
                    float(np.sqrt(cells.floor[inner].sum() / count)) * floor,
                )
            )
    out.sort(key=lambda p: -p.share)
    return [p for p in out if p.share >= LEAST_SHARE][:MOST_PLACES]


def _region(cells: Cells, c: int, picks: Array) -> int:
    """The cell of the region in which the gap of band `c` gathers most, or `c` itself.

    Gathering: share × log(share / time share), the region's part of the information that the partition
    gives on where the gap stands; it must hold when blocks of time are resampled. A region in which the
    rig stays for less than half a period of the band's highest frequency cannot hold that band.
    """
    whole = cells.excess[c] @ picks.T
    ok = whole > 0.1 * float(cells.excess[c].sum())
    best, most = c, CONCENTRATED
    for r in np.flatnonzero(
        (cells.signal == cells.signal[c]) & np.array([b == cells.band[c] for b in cells.band])
    ):
        part = float(cells.samples[r] / cells.samples[c])
        too_short = cells.dwell_s[r] * cells.band[r][1] < 0.5
        if cells.dimension[r] == "" or cells.score[r] < CLEAR or too_short or part < LEAST_TIME:
            continue
        share = np.clip((cells.excess[r] @ picks.T)[ok] / whole[ok], 1e-6, 1.0)
        gathered = DIMENSION_WEIGHT[cells.dimension[r]] * float(
            np.quantile(share * np.log(share / part), 0.1)
        )
        if gathered > most:
            best, most = int(r), gathered
    return best


def _joined(cells: Cells, members: list[tuple[int, int]]) -> list[list[tuple[int, int]]]:
    """Members whose bands touch, together."""
    groups: list[list[tuple[int, int]]] = []
    for m in sorted(members, key=lambda m: cells.band[m[0]][0]):
        if groups and cells.band[groups[-1][-1][0]][1] == cells.band[m[0]][0]:
            groups[-1].append(m)
        else:
            groups.append([m])
    return groups


def _sentence(is_gap: bool, signals: Sequence[SignalGap], places: Sequence[Place]) -> str:
    if not is_gap or not places:
        worst = max(signals, key=lambda s: s.ratio)
        return (
            "No gap: what is left after calibration is noise in every signal, band and region "
            f"(largest: {worst.signal} at {worst.ratio:.2f} times its floor)."
        )
    p = places[0]
    return (
        f"{100.0 * p.share:.0f} % of the explainable gap stands in {p.text}, "
        f"{p.rms / p.noise_floor:.1f} times the floor there."
    )


def _scaled(pair: tuple[float, float], factor: float) -> tuple[float, float]:
    return pair[0] * factor, pair[1] * factor
