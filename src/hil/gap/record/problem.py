"""Rig, stretches and twin as one vector problem: measured samples, predictions, sensitivities, all flat.

Every question about the gap is asked of the same flat vector of N samples: all judged signals of all
stretches, each at its own instants. Parameters are those of the model's table (`hil.sim.parameters`), so
any subset of the catalogue can be moved; sensitivities are differences in the search coordinate of each,
in which the model depends smoothly on it. All replays of a call run in parallel.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.errors import IdentificationError
from hil.gap.record.coarse import coarser, tells
from hil.gap.record.leaf import Leaf
from hil.gap.record.led import replay_led
from hil.gap.record.replays import run_all
from hil.gap.record.sides import sided
from hil.gap.record.standstill import LOOSE, at_rest, is_held, sags_s
from hil.gap.record.ticks import Clocks, at_ticks
from hil.identify.replay import Stretch
from hil.sim.parameters import ParameterTable
from hil.sim.twin import Replay

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SETTLE_S: Final = 0.5
"""Start of a stretch that is not judged: how the rig rested before is not known."""
ENOUGH: Final = 1000.0
"""Samples that tell all there is: beyond them the small ways in which any twin is wrong count, not noise [set
on healthy records of the used-up exam of seed 81 and of a second world: so weighed, their nuisances stay near
their priors' means]."""
AT_LEAST: Final = 3.0
"""Samples that count as one in any record: costs are rugged, for a frame comes before a tick or after it."""
FEWEST: Final = 20
"""A signal with fewer samples in a stretch is left out of it."""
MOTION_STEP_S: Final = 0.005
"""Of the grid that `Problem.motion` is told on: regions are coarser by far."""
BIAS: Final = ".sensor_bias.offset"
FORCES: Final = ("force", "current")
"""Quantities by which a drive answers its force."""
LATENCY: Final = ".sensor_latency.delay"


@dataclass(frozen=True, slots=True)
class Series:
    """One signal of one stretch: where it stands in the flat vector."""

    signal: str
    stretch: int
    part: slice

    @property
    def actuator(self) -> str:
        """The actuator it belongs to, or "imu"."""
        return self.signal.partition(".")[0]

    @property
    def quantity(self) -> str:
        """position, velocity, force, current, gyro or accel: the name of its noise in the rig file."""
        return self.signal.partition(".")[2].partition("_")[0]


class Problem:
    """Measured and predicted samples of some stretches of one rig; N samples.

    `clocks`: where the ticks of the drives lie, as far as is known (`hil.gap.record.arrivals`); setpoints of
    others act half a tick after their arrival, as they do on average.
    IdentificationError where a stretch lacks setpoints, or nothing can be judged.
    """

    def __init__(
        self,
        rig: RigFile,
        pieces: Sequence[Stretch],
        *,
        clocks: Clocks | None = None,
        settle_s: float = SETTLE_S,
    ) -> None:
        self.rig = rig
        self.sent = tuple(sided(rig, piece) for piece in pieces)
        """Stretches as they were recorded, but for forces that were set: those answer from their own side."""
        self.clocks: Clocks = {} if clocks is None else clocks
        self.pieces = tuple(at_ticks(rig, self.sent, self.clocks))
        """Stretches whose setpoints act at the drives' ticks."""
        self.settle_s = settle_s
        self.table = ParameterTable(rig)
        self.base: Array = self.table.from_effects(rig.effects)
        """Parameter vector of the rig file's own effects."""
        self.jobs: list[Replay] = []
        series: list[Series] = []
        size = 0
        for s, piece in enumerate(self.pieces):
            signals = judged(rig, piece)
            for name in signals:
                count = len(piece.samples[name][0])
                series.append(Series(name, s, slice(size, size + count)))
                size += count
            self.jobs.append(self.job(piece))
        self._coarse_base: tuple[bytes, Array] | None = None
        self.series: tuple[Series, ...] = tuple(series)
        if not series:
            raise IdentificationError(
                f"{', '.join(p.name for p in pieces)}: holds no signal that the twin of {rig.name} answers"
            )
        self.measured: Array = np.concatenate([self._samples(x)[1] for x in series])
        self.t_s: Array = np.concatenate([self._samples(x)[0] for x in series])
        self.kept: Mask = self._judged_samples()
        """(N,) samples that are judged."""
        if not self.kept.any():
            raise IdentificationError(
                f"{', '.join(p.name for p in pieces)}: nothing moved by {1e3 * LOOSE:g} mm or mrad: there is "
                "nothing to judge a twin by"
            )

    def job(self, piece: Stretch, rig: RigFile | None = None) -> Replay:
        """A stretch packed for the twin (of `rig`), answering its judged signals at their instants."""
        stamps = {name: piece.samples[name][0] for name in judged(self.rig, piece)}
        return self._job(piece, stamps, rig)

    def _job(
        self, piece: Stretch, stamps: Mapping[str, Array], rig: RigFile | None = None
    ) -> Replay:
        missing = [
            a for a in self.rig.actuator_names if not len(piece.setpoints.get(a, ((), ()))[0])
        ]
        if missing:
            kind = "setpoint" if piece.mode == "position" else "force_setpoint"
            raise IdentificationError(
                f"{piece.name}: holds no {', '.join(f'{a}.{kind}' for a in missing)}, so the twin cannot "
                "replay it"
            )
        return replay_led(rig or self.rig, piece, stamps)

    def _samples(self, x: Series) -> tuple[Array, Array]:
        return self.pieces[x.stretch].samples[x.signal]

    def _judged_samples(self) -> Mask:
        """(N,) those from when on their actuator moves, but no force while it is told to stand still, and no
        motion, where forces are set, while it rests or turns."""
        loose = [self._loose_s(piece) for piece in self.pieces]
        kept = np.zeros(self.size, dtype=bool)
        for x in self.series:
            t, sent, driven = self.t_s[x.part], self.sent[x.stretch], self.rig.actuator_names
            if x.quantity in FORCES and x.actuator in driven:
                still = at_rest(sent, x.actuator, t)
            else:
                still = is_held(sent, [x.actuator] if x.actuator in driven else driven, t)
            kept[x.part] = (t >= loose[x.stretch][x.actuator]) & ~still
        return kept

    def _loose_s(self, piece: Stretch) -> dict[str, float]:
        """By actuator, and "imu": from when on its signals are judged; never where it never moves."""
        start = piece.span_s[0]
        out = {}
        for a in self.rig.actuator_names:
            t, told = piece.setpoints[a]
            moved = np.abs(told - told[0]) > LOOSE
            first = float(t[np.argmax(moved)]) if moved.any() else np.inf
            out[a] = start + self.settle_s if piece.mode == "force" else first + self.settle_s
            out[a] = max(out[a], start + sags_s(self.rig, piece, a))
        begun = [s for s in out.values() if np.isfinite(s)]
        return {**out, "imu": max(begun, default=start + self.settle_s)}

    @property
    def size(self) -> int:
        """N."""
        return len(self.measured)

    @property
    def discount(self) -> float:
        """How many samples count as one beside what is known of the nuisances."""
        return max(AT_LEAST, float(self.kept.sum()) / ENOUGH)

    @property
    def signals(self) -> tuple[str, ...]:
        """Every judged signal once."""
        return tuple(dict.fromkeys(x.signal for x in self.series))

    @property
    def actuators(self) -> tuple[str, ...]:
        """Names of what `motion` tells position, velocity and force of."""
        return tuple(self.rig.actuator_names)

    @property
    def are_forces(self) -> bool:
        """Whether the setpoints of any stretch are forces."""
        return any(piece.mode == "force" for piece in self.pieces)

    def leads(self, signal: str) -> bool:
        """Whether the answers of `signal` lead the twin: what its sensor errs by moves all of the rig."""
        return self.are_forces and signal.endswith(".position")

    def with_clocks(self, clocks: Clocks) -> Problem:
        """The same data, with the drives' ticks elsewhere."""
        return Problem(self.rig, self.sent, clocks=clocks, settle_s=self.settle_s)

    def on(self, pieces: Sequence[Stretch], clocks: Clocks) -> Problem:
        """The same questions of other stretches."""
        return Problem(self.rig, pieces, clocks=clocks, settle_s=self.settle_s)

    def own_leaves(self, without: Collection[str]) -> list[Leaf] | None:
        """Candidates of a kind of problem that has its own; None: those of a driven rig."""
        del without
        return None

    def answers(self, vectors: Array) -> Array:
        """(B, N) samples for B parameter vectors (B, P of the table); NaN where the twin cannot stand."""
        return self._answers(self.jobs, np.atleast_2d(vectors))

    def _answers(self, jobs: Sequence[Replay], rows: Array) -> Array:
        flat = run_all([(job, row) for row in rows for job in jobs])
        per = len(jobs)
        return np.array([np.concatenate(flat[b * per : (b + 1) * per]) for b in range(len(rows))])

    def forces_late(
        self, vector: Array, late_s: Sequence[float], *, in_step: bool = False
    ) -> Array:
        """(L, N) answers for one vector where forces and currents are answered `late_s` (L,) later;
        `in_step`: of drives whose loops have a tick whenever a setpoint acts."""
        out = np.empty((len(late_s), self.size))
        asked = [
            np.subtract.outer(self.t_s[x.part], late_s)
            if x.quantity in FORCES
            else self.t_s[x.part][:, None]
            for x in self.series
        ]
        orders = [np.argsort(t, axis=None, kind="stable") for t in asked]
        tasks = []
        for s, piece in enumerate(self.pieces):
            stamps = {
                x.signal: t.ravel()[order]
                for x, t, order in zip(self.series, asked, orders, strict=True)
                if x.stretch == s
            }
            ticked = self.rig.actuator_names if in_step else piece.ticked
            tasks.append((self._job(replace(piece, ticked=ticked), stamps), vector))
        flats = run_all(tasks, once=True)
        for x, t, order in zip(self.series, asked, orders, strict=True):
            job, _ = tasks[x.stretch]
            answers = np.empty(t.size)
            answers[order] = job.by_signal(flats[x.stretch])[x.signal]
            out[:, x.part] = answers.reshape(t.shape).T
        return out

    def changes(self, vectors: Array, vector: Array, base: Array) -> Array:
        """(B, N) by how much the answers for B vectors differ from those for `vector`, which are `base`: of
        a twin with longer ticks where that tells as much (`hil.gap.record.coarse`)."""
        jobs = self._coarse_jobs
        coarse = tells(self.table, vectors, vector) if jobs else np.zeros(len(vectors), dtype=bool)
        out = np.empty((len(vectors), self.size))
        if coarse.any():
            key = vector.tobytes()
            if self._coarse_base is None or self._coarse_base[0] != key:
                self._coarse_base = key, self._answers(jobs, np.array([vector]))[0]
            out[coarse] = self._answers(jobs, vectors[coarse]) - self._coarse_base[1]
        if not coarse.all():
            out[~coarse] = self.answers(vectors[~coarse]) - base
        return out

    @cached_property
    def _coarse_jobs(self) -> list[Replay]:
        """The stretches packed for a twin with longer ticks; none where the rig's are as long as may be."""
        rig = coarser(self.rig)
        return [] if rig is None else [self.job(piece, rig) for piece in self.pieces]

    def predict(self, vectors: Array) -> Array:
        """`answers`; IdentificationError where the twin cannot stand with the first of `vectors`."""
        out = self.answers(vectors)
        if not np.all(np.isfinite(out[0])):
            raise IdentificationError(
                f"{self.rig.name}: the twin cannot stand where the run began: is it the rig file of the "
                "rig that ran?"
            )
        return out

    def residual(self, vector: Array) -> Array:
        """(N,) measured minus predicted."""
        return np.asarray(self.measured - self.predict(vector)[0])

    def jacobian(
        self,
        names: Sequence[str | tuple[str, ...]],
        vector: Array,
        base: Array | None = None,
        most: Sequence[float] | None = None,
    ) -> Array:
        """(N, P) d prediction / d search coordinate of each named parameter, at `vector`.

        A tuple of names moves together. One-sided differences over the table's search step, away from the
        nearer bound; `base`: the prediction at `vector`, where it is known already; `most`: the largest step
        of each, in its search coordinate. Biases of signals cost no replay, latencies of different signals
        one for all.
        """
        groups = [(n,) if isinstance(n, str) else n for n in names]
        ends = [np.inf] * len(groups) if most is None else most
        out = np.zeros((self.size, len(groups)))
        rows: list[Array] = []
        places: list[tuple[int, int, float, Mask | None]] = []
        shared = np.array(vector)
        late: list[tuple[int, float, Mask]] = []
        for k, group in enumerate(groups):
            own = self._own_samples(group)
            if own is not None and all(n.endswith(BIAS) for n in group):
                out[own, k] = 1.0
            elif own is not None and not any(np.any(own & m) for _, _, m in late):
                shared, span = self._stepped(group, shared, ends[k])
                late.append((k, span, own))
            else:
                row, span = self._stepped(group, vector, ends[k])
                places.append((k, len(rows), span, None))
                rows.append(row)
        if late:
            places += [(k, len(rows), span, own) for k, span, own in late]
            rows.append(shared)
        if rows:
            at = base is None
            flat = self.predict(np.array([vector, *rows] if at else rows))
            start = flat[0] if base is None else base
            for k, row_of, span, own in places:
                change = (flat[row_of + at] - start) / span
                out[:, k] = change if own is None else np.where(own, change, 0.0)
        return out

    def _own_samples(self, group: tuple[str, ...]) -> Mask | None:
        """(N,) the samples of the signals that a group of biases or latencies of signals acts on alone."""
        parts = [n.removesuffix(e) for n in group for e in (BIAS, LATENCY) if n.endswith(e)]
        if len(parts) != len(group) or "imu" in parts or any(map(self.leads, parts)):
            return None
        mask = np.zeros(self.size, dtype=bool)
        for x in self.series:
            if x.signal in parts:
                mask[x.part] = True
        return mask

    def _stepped(
        self, group: tuple[str, ...], vector: Array, most: float = np.inf
    ) -> tuple[Array, float]:
        """`vector` with the parameters of a group one search step on, `most` at most, and that step."""
        first = self.table[group[0]]
        z = first.to_search(float(vector[self.table.index(group[0])]))
        top = max(first.to_search(first.lower), first.to_search(first.upper))
        size = min(first.search_step, most)
        step = size if z + size <= top else -size
        row = np.array(vector)
        for name in group:
            i = self.table.index(name)
            p = self.table.entries[i]
            row[i] = p.from_search(p.to_search(float(vector[i])) + step)
        return row, step

    def motion(self, vector: Array) -> list[dict[str, Array]]:
        """For each stretch, how the twin moves: "t" (M,) on a grid, `<actuator>.position|velocity|force`
        (M,). Free of noise, so that regions of operation do not depend on the sensors."""
        quantities = ("position", "velocity", "force")
        names = [f"{a}.{q}" for a in self.rig.actuator_names for q in quantities]
        return self.traced(vector, names, MOTION_STEP_S, self.rig.bus.answer_delay)

    def traced(
        self, vector: Array, names: Sequence[str], step_s: float, late_s: float = 0.0
    ) -> list[dict[str, Array]]:
        """For each stretch, what the twin answers: "t" (M,) on a grid of `step_s`, and each of the signals
        `names` (M,), stamped `late_s` later."""
        jobs, grids = [], []
        for piece in self.pieces:
            t = np.arange(*piece.span_s, step_s)
            jobs.append((self._job(piece, dict.fromkeys(names, t + late_s)), vector))
            grids.append(t)
        flat = run_all(jobs, once=True)
        return [
            {"t": t, **job.by_signal(values)}
            for t, (job, _), values in zip(grids, jobs, flat, strict=True)
        ]


def judged(rig: RigFile, piece: Stretch) -> list[str]:
    """The signals of a stretch that the twin answers and that hold enough samples, in the rig's order."""
    names = [
        f"{a}.{q}" for a in rig.actuator_names for q in ("position", "velocity", "force", "current")
    ]
    if rig.imu is not None:
        names += [f"imu.{q}_{c}" for q in ("gyro", "accel") for c in "xyz"]
    return [n for n in names if n in piece.samples and len(piece.samples[n][0]) >= FEWEST]


def predict_all(problems: Iterable[Problem], vector: Array) -> list[Array]:
    """What each of `problems` predicts (N,) for one parameter vector, on all cores; raises as `predict`."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(lambda problem: problem.predict(vector)[0], problems))
