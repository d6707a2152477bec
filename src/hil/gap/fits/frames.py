"""Setpoints that never arrived, by what each would have changed.

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
from hil.gap.fits.lost import (
    Burst,
    Lost,
    at_once,
    bursts_of,
    count,
    replaced,
    without,
)
from hil.gap.record.leaf import Leaf, Start
from hil.gap.record.problem import Problem
from hil.gap.record.replays import run_all

Array = NDArray[np.float64]

EVERY: Final = 12
"""Marks of frames so far apart do not reach each other."""
REACH: Final = 10
"""Cycles over which a mark is looked for."""
ODDS: Final = 6.0
"""Nats that a frame's mark must earn: few frames are lost."""
PASSES: Final = 6
"""Times at most that marks are looked for, each beside the frames found so far: where one in eight is lost
their marks lie over each other."""
SHOWS: Final = 3.0
"""Times ODDS that a frame's mark must have for its loss to show, whatever noise lies over it."""
FEWEST: Final = 4
PLAIN: Final = (2, 60.0)
"""Frames, and nats of their marks, that tell as well: two that are lost as a rig is struck [healthy records
and faults from outside, 142 records of two worlds: two or three marks have 35 at most]."""
LOUD: Final = 5.0
"""Spreads of the noise from which on what is left about lost frames may be a burst's [R]."""
AT_ONCE: Final = 0.5
"""Share of the lost frames of several drives that are one cycle's, from which on they may have come late: a
host that stalls sends them all once it goes on."""
GONE: Final = 0.8
"""Of what stands about such frames, what must go where they are lost [motorcycles of two worlds of others:
0.95 where a bus loses whole cycles, 0.58 to 0.65 where hosts stall for 15 to 20 ms]."""
EFFECT: Final = "lost_frames"
SETPOINTS: Final = "bus.lost_frames.setpoints"
ANSWERS: Final = "bus.lost_frames.answers"


def fit_lost_frames(c: Calibrated, base: Fit) -> Fit | None:
    """`base` without the setpoints that this record says were lost; None where there are hardly any, or
    where all drives lack those of the same cycles and much is left about them."""
    problem = c.problem
    if any(p.mode != "position" for p in problem.pieces):
        return None
    lost, plain = _find(c, base)
    lost = _borne_out(c, base, lost)
    frames = count(lost)
    if frames < PLAIN[0]:
        return None
    residual = problem.measured - _answers(problem, base, [lost])[0]
    if not np.all(np.isfinite(residual)):
        return None
    white = c.noise.whiten(problem, residual)
    shared = at_once(problem.pieces, lost, problem.rig.bus.cycle)
    if shared > AT_ONCE and _gone(c, base.white, white, lost) < GONE:
        return None
    if frames < FEWEST and base.cost(c.train) - float(np.sum(loss(white[c.train]))) < PLAIN[1]:
        return None
    vector = np.array(base.vector)
    share, of = _share(problem, lost, plain)
    vector[problem.table.index(SETPOINTS)] = share
    leaf = Leaf(EFFECT, "bus", (SETPOINTS, ANSWERS), (Start({}, ()),), None)
    sd = np.array([np.sqrt(share / of), 0.0])
    return replace(
        base, leaves=(*base.leaves, leaf), names=(*base.names, SETPOINTS, ANSWERS),
        values=np.append(base.values, [share, 0.0]), search_sd=np.append(base.search_sd, sd),
        vector=vector, residual=residual, white=white,
        extra_cost=base.extra_cost + ODDS * frames,
    )  # fmt: skip


def _borne_out(c: Calibrated, base: Fit, lost: list[Lost]) -> list[Lost]:
    """Those of `lost` beside which the positions of their own drive are no further off: three of one leg had
    stood for how the spring of another law rings in the IMU."""
    found = bursts_of(lost, c.problem.pieces)
    if not found:
        return lost
    more = loss(_left(c, base, lost)) - loss(base.white)
    placed = np.zeros(c.problem.size, dtype=bool)
    for x in c.problem.series:
        placed[x.part] = x.quantity == "position"
    worse = [b for b in found if np.sum(more[_near(c.problem, b) & placed]) > ODDS]
    return replaced(lost, [(b, np.empty(0, dtype=np.int64)) for b in worse])


def _gone(c: Calibrated, before: Array, after: Array, lost: Sequence[Lost]) -> float:
    """Share of the robust loss above noise about `lost` frames that goes from one whitened residual (N,) to
    the other."""
    about = np.zeros(c.problem.size, dtype=bool)
    for burst in bursts_of(lost, c.problem.pieces):
        about |= _near(c.problem, burst)
    about &= c.train

    def size(white: Array) -> float:
        return float(np.sum(loss(white[about])))

    noise = float(np.mean([size(c.noise.whiten(c.problem, draw)) for draw in c.noise.draws]))
    stood = size(before) - noise
    return (size(before) - size(after)) / stood if stood > 0.0 else 1.0


def _find(c: Calibrated, base: Fit) -> tuple[list[Lost], list[Lost]]:
    """Lost frames of each stretch and drive, and all whose loss would show: those whose marks the record has,
    then those that it has beside them, as long as the frames turned are worth it."""
    problem, white = c.problem, base.white
    lost: list[Lost] = [
        {a: np.empty(0, dtype=np.int64) for a in p.setpoints} for p in problem.pieces
    ]
    turned, plain = _worth_turning(c, base, lost, white)
    for _ in range(PASSES):
        if not count(turned):
            break
        further = [
            {a: np.setxor1d(k, now[a]) for a, k in one.items()}
            for one, now in zip(turned, lost, strict=True)
        ]
        left = _left(c, base, further)
        if not _pays(white, left, lost, further):
            break
        lost, white = further, left
        if count(lost) < FEWEST:
            break
        lost, white = _in_bursts(c, base, lost, white)
        turned, _ = _worth_turning(c, base, lost, white)
    return lost, plain


def _in_bursts(
    c: Calibrated, base: Fit, lost: list[Lost], white: Array
) -> tuple[list[Lost], Array]:
    """`lost` with whole bursts in place of frames that leave much about them, and what is left (N,).

    Where nothing reaches a drive for longer its mark is unlike those of single frames: these find an end of
    it, and others behind it that were not lost.
    """
    problem = c.problem
    for _ in range(PASSES):
        near = [(b, _near(problem, b)) for b in bursts_of(lost, problem.pieces)]
        near = [(b, part) for b, part in near if np.any(np.abs(white[part]) > LOUD)]
        if not near:
            break
        runs = [b.runs() for b, _ in near]
        tried = [
            replaced(lost, [(b, mine[k]) for (b, _), mine in zip(near, runs, strict=True)])
            for k in range(len(runs[0]))
        ]
        worth = np.full((len(tried), len(near)), -np.inf)
        for k, answer in enumerate(_answers(problem, base, tried)):
            if not np.all(np.isfinite(answer)):
                continue
            gain = loss(white) - loss(c.noise.whiten(problem, problem.measured - answer))
            for j, (b, part) in enumerate(near):
                more = len(runs[j][k]) - b.lost
                worth[k, j] = float(np.sum(gain[part])) - ODDS * more
        best = np.argmax(worth, axis=0)
        chosen = [
            (b, runs[j][k])
            for j, ((b, _), k) in enumerate(zip(near, best, strict=True))
            if worth[k, j] > 0.0
        ]
        further = replaced(lost, chosen)
        left = _left(c, base, further)
        if not chosen or not _pays(white, left, lost, further):
            break
        lost, white = further, left
    return lost, white


def _near(problem: Problem, burst: Burst) -> NDArray[np.bool_]:
    """(N,) samples of the drive that a burst's mark reaches, were it as long as any that is tried."""
    sent = problem.pieces[burst.stretch].setpoints[burst.actuator][0]
    most = np.concatenate(burst.runs())
    out = np.zeros(len(problem.measured), dtype=bool)
    for x in problem.series:
        if x.stretch == burst.stretch and x.actuator == burst.actuator:
            t = problem.t_s[x.part]
            end = sent[most.max()] + REACH * problem.rig.bus.cycle
            out[x.part] = (t >= sent[most.min()]) & (t < end) & problem.kept[x.part]
    return out


def _pays(white: Array, left: Array, lost: Sequence[Lost], further: Sequence[Lost]) -> bool:
    """Whether what is `left` with `further` in place of `lost`, `white` before, is worth the frames more."""
    gain = float(np.sum(loss(white)) - np.sum(loss(left)))
    return gain > ODDS * (count(further) - count(lost))


def _left(c: Calibrated, base: Fit, lost: Sequence[Lost]) -> Array:
    """(N,) what the twin without those frames leaves, whitened."""
    return c.noise.whiten(c.problem, c.problem.measured - _answers(c.problem, base, [lost])[0])


def _worth_turning(
    c: Calibrated, base: Fit, lost: Sequence[Lost], white: Array
) -> tuple[list[Lost], list[Lost]]:
    """Frames that the record would rather have lost, or arrived if they stand in `lost`; and those whose
    turn could not be overlooked."""
    problem = c.problem
    combed = [
        [
            {
                a: np.setxor1d(np.arange(first, len(t), EVERY), one[a])
                for a, (t, _) in p.setpoints.items()
            }
            for p, one in zip(problem.pieces, lost, strict=True)
        ]
        for first in range(EVERY)
    ]
    now, *others = _answers(problem, base, [list(lost), *combed])
    gains = [{a: np.zeros(len(t)) for a, (t, _) in p.setpoints.items()} for p in problem.pieces]
    sizes = [{a: np.zeros(len(t)) for a, (t, _) in p.setpoints.items()} for p in problem.pieces]
    for first, answer in enumerate(others):
        mark = c.noise.whiten(problem, np.where(np.isfinite(answer), answer - now, 0.0))
        gain = loss(white) - loss(white - mark)
        gain[np.abs(mark) < 0.02] = 0.0
        size = loss(mark)
        for x in problem.series:
            if x.actuator == "imu":
                continue
            sent = problem.pieces[x.stretch].setpoints[x.actuator][0][first::EVERY]
            t = problem.t_s[x.part]
            k = np.searchsorted(sent, t, side="right") - 1
            ok = (k >= 0) & problem.kept[x.part]
            ok &= t < sent[np.maximum(k, 0)] + REACH * problem.rig.bus.cycle
            for nats, of_each in ((gains, gain), (sizes, size)):
                total = np.bincount(k[ok], of_each[x.part][ok], minlength=len(sent))
                nats[x.stretch][x.actuator][first::EVERY] += total
    turned = [
        {a: _peaks(g, one[a]) for a, g in nats.items()}
        for nats, one in zip(gains, lost, strict=True)
    ]
    plain = [{a: np.flatnonzero(g > SHOWS * ODDS) for a, g in nats.items()} for nats in sizes]
    return turned, plain


def _share(problem: Problem, lost: Sequence[Lost], plain: Sequence[Lost]) -> tuple[float, int]:
    """Share of the frames that were lost, and of how many: of those whose loss shows, else of all."""
    found = sum(
        len(np.intersect1d(one[a], k))
        for one, two in zip(lost, plain, strict=True)
        for a, k in two.items()
    )
    if found:
        return found / count(plain), count(plain)
    frames = sum(len(t) for p in problem.pieces for t, _ in p.setpoints.values())
    return count(lost) / frames, frames


def _peaks(gain: Array, lost: NDArray[np.int64]) -> NDArray[np.int64]:
    """Of neighbours only the best: the mark of one frame looks a little like the next one's."""
    worth = gain - ODDS
    worth[lost] = gain[lost] + ODDS
    return np.flatnonzero(
        (worth > 0.0) & (worth >= np.roll(worth, 1)) & (worth > np.roll(worth, -1))
    )


def _answers(problem: Problem, base: Fit, many: Sequence[Sequence[Lost]]) -> list[Array]:
    """The twin's samples where these frames never arrived, for each of `many`."""
    flat = run_all(
        [
            (problem.job(without(p, one)), base.vector)
            for lost in many
            for p, one in zip(problem.pieces, lost, strict=True)
        ],
        once=True,
    )
    per = len(problem.pieces)
    return [np.concatenate(flat[k * per : (k + 1) * per]) for k in range(len(many))]
