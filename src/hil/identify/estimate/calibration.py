"""What an estimator makes of data whose truth is known: bias and spread of the whole chain, by the twin.

The twin replays the setpoints with the estimate as its truth and goes through the same filter and the same
estimator (indirect inference: Gourieroux, Monfort, Renault 1993 [M]). That shows what no residual shows:
drives are sampled in step with the setpoints, so a force that pulses at every new setpoint is always caught
in the same phase, which looks like friction and inertia that are not there; Coulomb friction has corners;
filters meet nonlinear terms. The twin does not know when exactly a frame got through the bus, so each
replay draws other arrival times, and what they change counts as uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.identify.replay import Series, Stretch, replay_of
from hil.sim.twin import Twin

Array = NDArray[np.float64]
QUEUE_FRAMES: Final = 2.0
"""Frames of others that one of ours may have to wait for: drives' answers and an IMU's two [R]."""
FRAME_BITS: Final = 125
"""A frame of eight bytes with its stuff bits [M]."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """Bias (P,) of the estimator and covariance (P, P) of what the draws changed."""

    bias: Array
    covariance: Array
    draws: int


def calibrate(
    rig: RigFile,
    pieces: Sequence[Stretch],
    truth: Array,
    offsets: Mapping[str, float],
    estimate: Callable[[Sequence[Stretch]], Array],
    draws: int,
    rng: np.random.Generator,
) -> Calibration:
    """Run `estimate` on `draws` noise-free replays by `rig`, whose parameters are `truth` (P,).

    `offsets`: effects of the model by name that belong to the truth (sensors' biases).
    """
    found = np.array([estimate(simulated(rig, pieces, offsets, rng)) for _ in range(draws)])
    error = found - truth
    covariance = np.cov(error, rowvar=False).reshape(len(truth), len(truth))
    return Calibration(error.mean(axis=0), covariance * (1.0 + 1.0 / draws), draws)


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
        told = piece if rng is None else replace(piece, setpoints=_redrawn(rig, piece, rng))
        job = replay_of(twin, told, signals)
        vector = twin.table.vector(effects, twin.parameters)
        out.append(piece.with_samples(job.by_signal(job.run(vector))))
    return out


def _redrawn(rig: RigFile, piece: Stretch, rng: np.random.Generator) -> dict[str, Series]:
    """Setpoints at other instants that the same record could mean."""
    wait_s = QUEUE_FRAMES * FRAME_BITS / rig.can.bitrate
    jitter, queueing = rng.uniform(), rng.uniform()
    out = {}
    for name, (t, value) in piece.setpoints.items():
        k = np.round((t - t[0]) / rig.bus.cycle)
        even = np.polyval(np.polyfit(k, t, 1), k)
        moved = even + jitter * (t - even) + wait_s * rng.uniform()
        moved = moved + wait_s * queueing * (rng.uniform(size=len(t)) - 0.5)
        out[name] = (np.maximum.accumulate(moved), value)
    return out
