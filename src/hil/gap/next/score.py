"""How well a motion would split the candidates: each one's twin rides it, all are held against each other.

If a were the truth, how near could the twin with b come? Both answer the motion; what b's own parameters and
the nuisances can make up for is taken out in the linear picture of `hil.gap.search.linear`, with the
nuisances held by their priors; what is left, whitened by the floor, its samples counted as a diagnosis counts
them, is the distance. From the distances follows the posterior to be expected, and from that how often one
candidate alone would be left.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from hil.config import RigFile
from hil.control.setpoints import slot_offsets
from hil.gap.catalogue.nuisances import Nuisance, default_nuisances
from hil.gap.fits.evidence import RANGE
from hil.gap.floor.noise import NoiseModel, find_noise
from hil.gap.next.candidates import Candidate, vector_of
from hil.gap.next.sketches import Sketch
from hil.gap.record.problem import Problem
from hil.identify.replay import Stretch
from hil.rigs import Manipulator
from hil.sim.parameters import Parameter
from hil.sim.twin import Payload

Array = NDArray[np.float64]

CLEAR: Final = 0.95
"""Probability from which on a candidate stands alone."""
PAYLOADS: Final = (0.15, 0.4)
"""Of the platform's mass, for payloads that may be asked for."""
STRONG: Final = 0.9
"""Of the largest force, that a play with a payload may take."""


@dataclass(frozen=True, slots=True)
class Split:
    """What is to be expected after a motion; C candidates."""

    distance: Array
    """(C, C) of the best that b (column) could do were a (row) the truth, in spreads of the noise."""
    posterior: Array
    """(C, C) expected probability of b were a the truth."""
    prior: Array
    """(C,)."""

    @property
    def entropy(self) -> float:
        """Expected, nats."""
        q = np.maximum(self.posterior, 1e-300)
        return float(-self.prior @ np.sum(q * np.log(q), axis=1))

    @property
    def right(self) -> float:
        """Expected probability of the true candidate."""
        return float(self.prior @ np.diag(self.posterior))

    @property
    def alone(self) -> float:
        """Chance that one candidate alone is left."""
        return float(self.prior @ (np.diag(self.posterior) > CLEAR))

    def apart(self) -> list[tuple[int, int]]:
        """Pairs of which, whichever is true, the other is left behind."""
        q, n = self.posterior, len(self.prior)
        return [
            (a, b) for a in range(n) for b in range(a + 1, n)
            if min(q[a, a] / (q[a, a] + q[a, b]), q[b, b] / (q[b, b] + q[b, a])) > CLEAR
        ]  # fmt: skip


def payloads_of(rig: RigFile) -> list[float]:
    """Payloads that may be asked for, whole kilograms."""
    return sorted({float(max(round(share * rig.mass.m), 1)) for share in PAYLOADS})


def recorded(
    sketch: Sketch, rig: RigFile, signals: Sequence[str], rng: np.random.Generator
) -> list[Stretch]:
    """The stretches that a recording of `sketch` would be, with zeros for what is measured.

    Setpoints go out as the bus sends them; each of `signals` is answered as often as the rig's schedule asks.
    """
    manipulator, bus = Manipulator(rig), rig.bus
    path = CubicSpline(sketch.trajectory.t_s, sketch.trajectory.poses, axis=0)
    cycles = np.arange(int(sketch.trajectory.duration_s / bus.cycle))
    sent = cycles * bus.cycle + rng.uniform(0.0, max(bus.jitter, 1e-9), len(cycles))
    rho = np.array([manipulator.inverse(q) for q in path(cycles * bus.cycle)])
    setpoints, samples = {}, {}
    after = slot_offsets(rig) - bus.setpoint_delay
    for i, a in enumerate(rig.actuator_names):
        slot = sent + after[i]
        setpoints[a] = (slot, rho[:, i])
        for quantity in ("position", "velocity", "force", "current"):
            if f"{a}.{quantity}" not in signals:
                continue
            asked = np.ones(len(cycles), dtype=bool)
            if bus.schedule == "parameter" and quantity in bus.pattern:
                turns = [k for k, q in enumerate(bus.pattern) if q == quantity]
                asked = np.isin(cycles % len(bus.pattern), turns)
            t = slot[asked] + bus.answer_delay
            samples[f"{a}.{quantity}"] = (t, np.zeros(len(t)))
    if rig.imu is not None:
        t = np.arange(0.05, sketch.trajectory.duration_s, 1.0 / rig.imu.rate)
        samples |= {s: (t, np.zeros(len(t))) for s in signals if s.startswith("imu.")}
    plain = Stretch("next", setpoints, samples)
    if not sketch.payload_kg:
        return [plain]
    payload = Payload(sketch.payload_kg, rig.mass.cog)
    return [plain, Stretch("next, weighed", setpoints, samples, payload=payload)]


def split_of(
    sketch: Sketch,
    rig: RigFile,
    candidates: Sequence[Candidate],
    shared: Mapping[str, float],
    signals: Sequence[str],
    seed: int = 0,
) -> Split | None:
    """What `sketch` would tell; None where a candidate's twin cannot ride it, or not with its payload."""
    rng = np.random.default_rng(seed)
    problem = Problem(rig, recorded(sketch, rig, signals, rng))
    vectors = [vector_of(c, shared, problem.base, problem.table) for c in candidates]
    answers = problem.answers(np.array(vectors))
    if not np.all(np.isfinite(answers)) or (sketch.payload_kg and _strains(problem, vectors)):
        return None
    noise = find_noise(problem, vectors[0], rng, count=2)
    nuisances = default_nuisances(rig, problem.signals)
    return split_between(problem, noise, nuisances, candidates, vectors, answers)


def _strains(problem: Problem, vectors: Sequence[Array]) -> bool:
    """Whether a candidate takes more force than is left for the unforeseen, recorded or not."""
    return any(
        float(np.max(np.abs(moved[f"{a.name}.force"]))) > STRONG * a.force_max
        for vector in vectors
        for moved in problem.motion(vector)
        for a in problem.rig.actuators
    )


def split_between(
    problem: Problem,
    noise: NoiseModel,
    nuisances: Sequence[Nuisance],
    candidates: Sequence[Candidate],
    vectors: Sequence[Array],
    answers: Array,
) -> Split:
    """The split of a motion that is a `problem`: `answers` (C, N) of each candidate's twin, at `vectors`."""
    white = noise.whiten(problem, answers.T)
    bank = problem.jacobian([n.name for n in nuisances], vectors[0], answers[0])
    A = noise.whiten(problem, bank) * np.array([n.sd for n in nuisances])
    n, counted = len(candidates), problem.discount
    square, freedom = np.zeros((n, n)), np.zeros(n)
    for b, candidate in enumerate(candidates):
        names = list(candidate.values)
        sizes = np.array([_size(problem.table[k], v) for k, v in candidate.values.items()])
        own = problem.jacobian(names, vectors[b], answers[b])
        M = np.hstack([A, noise.whiten(problem, own) * sizes])[problem.kept]
        H = M.T @ M / counted + np.eye(M.shape[1])
        spread = np.sqrt(np.diag(np.linalg.inv(H))[-len(names) :])
        freedom[b] = np.sum(np.log(np.minimum(np.sqrt(2.0 * np.pi) * spread / RANGE, 1.0)))
        for a in range(n):
            if a != b:
                d = (white[:, a] - white[:, b])[problem.kept]
                step = np.linalg.solve(H, M.T @ d / counted)
                left = d - M @ step
                square[a, b] = float(left @ left) / counted + float(step @ step)
    prior = np.array([c.probability for c in candidates])
    log = np.log(prior) - 0.5 * square + freedom
    posterior = np.exp(log - log.max(axis=1, keepdims=True))
    posterior /= posterior.sum(axis=1, keepdims=True)
    return Split(np.sqrt(square), posterior, prior)


def _size(p: Parameter, value: float) -> float:
    """How far a parameter may go in its search coordinate: as far as it stands from no effect."""
    x = p.to_search(value)
    neutral = p.to_search(p.neutral) if np.isfinite(p.neutral) else 0.0
    far = abs(x - neutral) if np.isfinite(neutral) else abs(x)
    return max(far, abs(p.to_search(p.scale)) * 0.1, 1e-12)
