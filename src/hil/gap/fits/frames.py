"""Frames that never arrived: setpoints by what each would have changed, answers by the slots left empty.

Which setpoints were lost is not in a record, but each lost one leaves a mark of its own: the drive holds
where the line would have gone on. The twin is asked for that mark, every so many frames at once; a frame
counts as lost where the record has its mark rather than the twin's own motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.gap.fits.fitted import Calibrated, Fit, loss
from hil.gap.record.leaf import Leaf, Start
from hil.gap.record.problem import Problem, run_all
from hil.identify.replay import Stretch

Array = NDArray[np.float64]
Lost = dict[str, NDArray[np.int64]]

EVERY: Final = 12
"""Marks of frames so far apart do not reach each other."""
REACH: Final = 10
"""Cycles over which a mark is looked for."""
ODDS: Final = 6.0
"""Nats that a frame's mark must earn: few frames are lost."""
FEWEST: Final = 4
PLAIN: Final = (2, 60.0)
"""Frames, and nats of their marks, that tell as well: two that are lost as a rig is struck [healthy records
and faults from outside, 142 records of two worlds: two or three marks have 35 at most]."""
AT_ONCE: Final = 0.5
"""Share of the lost frames of several drives that are one cycle's, from which on it was no bus that lost
them, one by one, but a host that sent none."""
EFFECT: Final = "lost_frames"
SETPOINTS: Final = "bus.lost_frames.setpoints"
ANSWERS: Final = "bus.lost_frames.answers"


def lost_answers(problem: Problem) -> float:
    """Share of the drives' answers that are missing, by the gaps in their rows."""
    missing, told = 0.0, 0.0
    for x in problem.series:
        if x.actuator == "imu":
            continue
        steps = np.diff(problem.t_s[x.part])
        usual = float(np.median(steps))
        slots = np.round(steps / usual)
        missing += float(np.sum(np.maximum(slots - 1.0, 0.0)[slots < 10.0]))
        told += float(np.sum(slots[slots < 10.0]))
    return missing / max(told, 1.0)


def fit_lost_frames(c: Calibrated, base: Fit) -> Fit | None:
    """`base` without the setpoints that this record says were lost; None where there are hardly any, or
    where all drives lack those of the same cycles."""
    problem = c.problem
    if any(p.mode != "position" for p in problem.pieces) or problem.rig.bus.cycle < 2e-3:
        return None
    lost = _find(c, base)
    count = sum(len(v) for one in lost for v in one.values())
    if count < PLAIN[0] or _at_once(problem, lost) > AT_ONCE:
        return None
    frames = sum(len(t) for p in problem.pieces for t, _ in p.setpoints.values())
    dropped = Problem(
        problem.rig,
        [_without(p, one) for p, one in zip(problem.sent, lost, strict=True)],
        clocks=problem.clocks,
        settle_s=problem.settle_s,
    )
    answer = dropped.answers(base.vector)[0]
    if not np.all(np.isfinite(answer)):
        return None
    residual = problem.measured - answer
    white = c.noise.whiten(problem, residual)
    if count < FEWEST and base.cost(c.train) - float(np.sum(loss(white[c.train]))) < PLAIN[1]:
        return None
    vector = np.array(base.vector)
    share, missing = count / frames, lost_answers(problem)
    vector[problem.table.index(SETPOINTS)] = share
    leaf = Leaf(EFFECT, "bus", (SETPOINTS, ANSWERS), (Start({}, ()),), None)
    sd = np.array([np.sqrt(share / frames), np.sqrt(max(missing, 1e-4) / frames)])
    return replace(
        base, leaves=(*base.leaves, leaf), names=(*base.names, SETPOINTS, ANSWERS),
        values=np.append(base.values, [share, missing]), search_sd=np.append(base.search_sd, sd),
        vector=vector, residual=residual, white=white,
        extra_cost=base.extra_cost + ODDS * count,
    )  # fmt: skip


def _find(c: Calibrated, base: Fit) -> list[Lost]:
    problem = c.problem
    now = problem.measured - base.residual
    jobs = []
    for first in range(EVERY):
        for p in problem.pieces:
            every = {a: np.arange(first, len(t), EVERY) for a, (t, _) in p.setpoints.items()}
            jobs.append((problem.job(_without(p, every)), base.vector))
    flat = run_all(jobs)
    per = len(problem.pieces)
    out: list[Lost] = [{} for _ in problem.pieces]
    for a in problem.rig.actuator_names:
        gains = [np.zeros(len(p.setpoints[a][0])) for p in problem.pieces]
        for first in range(EVERY):
            answer = np.concatenate(flat[first * per : (first + 1) * per])
            mark = c.noise.whiten(problem, np.where(np.isfinite(answer), answer - now, 0.0))
            gain = loss(base.white) - loss(base.white - mark)
            gain[np.abs(mark) < 0.02] = 0.0
            for x in problem.series:
                if x.actuator != a:
                    continue
                sent = problem.pieces[x.stretch].setpoints[a][0][first::EVERY]
                t = problem.t_s[x.part]
                k = np.searchsorted(sent, t, side="right") - 1
                ok = (k >= 0) & problem.kept[x.part]
                ok &= t < sent[np.maximum(k, 0)] + REACH * problem.rig.bus.cycle
                total = np.bincount(k[ok], gain[x.part][ok], minlength=len(sent))
                gains[x.stretch][first::EVERY] += total
        for s, g in enumerate(gains):
            # of neighbours only the best: the mark of one frame looks a little like the next one's
            best = (g > ODDS) & (g >= np.roll(g, 1)) & (g > np.roll(g, -1))
            out[s][a] = np.flatnonzero(best)
    return out


def _at_once(problem: Problem, lost: Sequence[Lost]) -> float:
    """Share of the lost frames in whose cycle another drive's was lost as well."""
    half = 0.5 * problem.rig.bus.cycle
    shared, total = 0, 0
    for piece, one in zip(problem.pieces, lost, strict=True):
        at = {a: piece.setpoints[a][0][k] for a, k in one.items()}
        for a, own in at.items():
            others = np.sort(np.concatenate([np.empty(0), *(t for b, t in at.items() if b != a)]))
            early, late = (np.searchsorted(others, own + edge) for edge in (-half, half))
            shared += int(np.sum(late > early))
            total += len(own)
    return shared / max(total, 1)


def _without(piece: Stretch, lost: Lost) -> Stretch:
    told = {}
    for a, (t, v) in piece.setpoints.items():
        keep = np.ones(len(t), dtype=bool)
        keep[lost.get(a, np.empty(0, dtype=np.int64))] = False
        keep[0] = True
        told[a] = (t[keep], v[keep])
    return replace(piece, setpoints=told)
