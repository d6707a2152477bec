"""What sampling, filter and bus make of a force that the linear model does not know, by the twin.

The twin replays the setpoints with the estimate as its truth; its answers go through the same filter, and
what the linear model with that truth leaves of them is an artefact, which is taken off the measured force
(indirect inference in one step: Gourieroux, Monfort, Renault 1993 [M]). No residual shows it: drives are
sampled in step with the setpoints, so a force that pulses at every new setpoint is always caught in the
same phase, which looks like friction and inertia that are not there; Coulomb friction has corners; filters
meet nonlinear terms.

When exactly a frame got through the bus, no record says: stamps of setpoints are of sending, and frames of
others go first. So replays draw other arrival times, each counts by how well its forces fit the measured
ones, and what they change counts as uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.bus.load import RECKONED_BITS
from hil.config import RigFile
from hil.identify.estimate import stamps
from hil.identify.replay import Stretch, replay_of
from hil.sim.twin import Twin

Array = NDArray[np.float64]
QUEUE_FRAMES: Final = 2.0
"""Frames of others that one of ours may have to wait for: drives' answers and an IMU's two [R]."""
ROUNDS: Final = 3
"""Corrections at the recorded arrival times: the artefact depends a little on the truth."""
TRUST: Final = 10.0
"""Independent samples that the fit of a replay is taken for when timings are weighed: few, for a twin that
is wrong elsewhere must not make one timing certain [R]."""


Artefact = Callable[[Array, np.random.Generator | None], tuple[Array, float]]
"""(force (N, n) that the linear model does not know, misfit) of the twin with parameters (P,), at the
recorded arrival times (None) or at drawn ones."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """Force (N, n) to take off the measured one; shift (P,) and covariance (P, P) by arrival times."""

    artefact: Array
    shift: Array
    timing: Array


def calibrate(
    artefact: Artefact, estimate: Callable[[Array], Array], start: Array, draws: int, seed: int
) -> Calibration:
    """Artefact at the truth that `estimate` finds without it; `estimate(artefact)` gives parameters (P,).

    `draws` of the arrival times, the first being the recorded ones; `start` (P,) a first guess.
    """
    truth = start
    for _ in range(ROUNDS):
        best, least = artefact(truth, None)
        truth = estimate(best)
    found, misfits = [truth], [least]
    rng = np.random.default_rng(seed)
    for _ in range(draws - 1):
        drawn, far = artefact(truth, rng)
        found.append(estimate(drawn))
        misfits.append(far)
        if far < least:
            best, least = drawn, far
    mean, timing = weigh(np.array(found), np.array(misfits))
    return Calibration(best, mean - estimate(best), timing)


def weigh(shifts: Array, misfits: Array) -> tuple[Array, Array]:
    """Mean (P,), covariance (P, P) of `shifts` (B, P), each by how well its timing fits: `misfits` (B,)."""
    weight = np.exp(-TRUST * (misfits - misfits.min()))
    weight /= weight.sum()
    mean = weight @ shifts
    apart = shifts - mean
    return mean, (apart * weight[:, None]).T @ apart


def misfit(pieces: Sequence[Stretch], answers: Sequence[Stretch]) -> float:
    """Sum over all force signals of the logarithm of the mean square difference."""
    total: dict[str, list[Array]] = {}
    for piece, answer in zip(pieces, answers, strict=True):
        for signal, (_, value) in piece.samples.items():
            if signal.endswith(".force"):
                total.setdefault(signal, []).append(value - answer.samples[signal][1])
    squares = [float(np.mean(np.concatenate(e) ** 2)) for e in total.values()]
    return float(np.mean(np.log(np.maximum(squares, 1e-12))))


def unexplained(rig: RigFile, pieces: Sequence[Stretch], answers: Sequence[Stretch]) -> float:
    """Share, by power, of the jumps of force between samples that the twin's `answers` do not have, beyond
    sensor noise: about that of frames that came when nobody knows, and of what sampling makes of them."""
    noise = 2.0 * (rig.noise.force**2 + rig.noise.force_step**2 / 12.0)
    left, whole = 0.0, 0.0
    for piece, answer in zip(pieces, answers, strict=True):
        for signal, (_, value) in piece.samples.items():
            if signal.endswith(".force"):
                jumps = np.diff(value - answer.samples[signal][1])
                left += float(np.sum(jumps**2 - noise))
                whole += float(np.sum(np.diff(value) ** 2 - noise))
    return min(max(left, 0.0) / max(whole, 1e-300), 1.0)


def simulated(
    rig: RigFile,
    pieces: Sequence[Stretch],
    effects: Mapping[str, float],
    rng: np.random.Generator | None = None,
) -> list[Stretch]:
    """`pieces` with the twin's answers in place of the drives'; arrival times redrawn if `rng` is given."""
    out = []
    for piece in pieces:
        twin = Twin(rig, payload=piece.payload)
        signals = [
            s for s in piece.samples if s.endswith((".position", ".force")) and s in twin.signals
        ]
        told = piece if rng is None else redrawn(rig, piece, rng)
        job = replay_of(twin, told, signals)
        vector = twin.table.vector(effects, twin.parameters)
        out.append(piece.with_samples(job.by_signal(job.run(vector))))
    return out


def redrawn(rig: RigFile, piece: Stretch, rng: np.random.Generator) -> Stretch:
    """The stretch with setpoints, and samples that waited, at other instants that its record could mean."""
    again = stamps.redrawn(rig, piece, rng)
    if again is not None:
        return again
    wait_s = QUEUE_FRAMES * RECKONED_BITS / rig.can.bitrate
    out = {}
    for name, (t, value) in piece.setpoints.items():
        jitter, queueing = rng.uniform(), rng.uniform()
        k = np.round((t - t[0]) / rig.bus.cycle)
        even = np.polyval(np.polyfit(k, t, 1), k)
        moved = even + jitter * (t - even) + wait_s * rng.uniform()
        moved = moved + wait_s * queueing * (rng.uniform(size=len(t)) - 0.5)
        out[name] = (np.maximum.accumulate(moved), value)
    return replace(piece, setpoints=out)
