"""When a value was really sampled and a setpoint really arrived, where frames waited for each other.

In the schedule "parameter" a drive samples when the request of its slot arrives, which is queued with the
setpoint, and answers. On a busy bus request and answer wait, the answer longest: by up to two milliseconds at
six drives and 500 kbit/s [V]. Its receive stamp less the answer delay is that much late, and by how much
depends on whose frames went first. In a stiff drive force jumps at each new setpoint by more than inertia
takes, so half a millisecond there passes for a sixth of a moment of inertia. The traffic of such a run is
played again (`traffic`), and samples and setpoints stand where it has them, if the answers' own stamps bear
it out.

A drive with its own clock (`bus.retimed`) starts it when the first setpoint has come, so what that one frame
waited shifts all it does in the run; frames before it, that no record holds, may have kept it waiting. The
jumps of its force tell: the phase is taken at which the twin's fall on the rig's. (Encoders would take
friction for a delay.)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.identify.estimate.traffic import Traffic, frame_s, played_again
from hil.identify.replay import Stretch, replay_of
from hil.sim.twin import Twin

Array = NDArray[np.float64]
WAITED: Final = 2.0
"""Times their jitter that answers must spread behind their slots before they count as having waited [R]."""
BORNE_OUT: Final = 0.8
"""Share of that spread which the traffic must leave at most [R]."""
QUICKEST: Final = 0.01
"""Share of the IMU's frames that counts as not having waited."""

PHASE_S: Final = 1.25e-4
PHASES_S: Final = tuple(PHASE_S * k for k in (0, -1, 1, -2, 2, -3, 3, -4, 4))
"""By how much a drive's clock may be off what the first frame's wait makes it; half ticks of 4 kHz."""


def placed(rig: RigFile, pieces: Sequence[Stretch]) -> list[Stretch]:
    """`pieces` with samples and setpoints where they were sampled and arrived, as far as the record tells."""
    return [_placed(rig, piece) for piece in pieces]


def redrawn(rig: RigFile, piece: Stretch, rng: np.random.Generator) -> Stretch | None:
    """A placed stretch with another draw of what the traffic left to chance; None for one left as stamped."""
    if piece.stamped is None:
        return None
    slots = _slots(rig, piece.stamped)
    one_queue = _spread(slots, _traffic(rig, piece.stamped, True)) < _spread(
        slots, _traffic(rig, piece.stamped, False)
    )
    again = _by(rig, piece.stamped, slots, _traffic(rig, piece.stamped, one_queue, rng))
    if not rig.bus.retimed:
        return again
    off = {a: PHASE_S * float(rng.uniform(-1.0, 1.0)) for a in rig.actuator_names}
    return replace(again, setpoints=_later(piece, off).setpoints)


def _placed(rig: RigFile, piece: Stretch) -> Stretch:
    if rig.bus.schedule != "parameter" or any(
        not len(piece.setpoints.get(a, ((), ()))[0]) for a in rig.actuator_names
    ):
        return piece
    slots = _slots(rig, piece)
    if not slots or _spread(slots) < WAITED * rig.bus.answer_jitter:
        return piece
    traffics = [_traffic(rig, piece, one_queue) for one_queue in (False, True)]
    best = min(traffics, key=lambda t: _spread(slots, t))
    if _spread(slots, best) > BORNE_OUT * _spread(slots):
        return piece
    return _with_clocks(rig, _by(rig, piece, slots, best))


Slots = dict[str, tuple[int, NDArray[np.int64], Array]]
"""By signal: its drive, the slot of each sample, and how long after the slot's beginning it was received."""


def _slots(rig: RigFile, piece: Stretch) -> Slots:
    out = {}
    for i, a in enumerate(rig.actuator_names):
        sent = piece.setpoints[a][0]
        for signal, (t, _) in piece.samples.items():
            if signal.partition(".")[0] == a and len(t):
                k = np.searchsorted(sent, t - rig.bus.answer_delay, side="right") - 1
                k = np.clip(k, 0, len(sent) - 1)
                out[signal] = (i, k, t - sent[k])
    return out


def _spread(slots: Slots, traffic: Traffic | None = None) -> float:
    """Typical deviation of what answers came later than their slot, or than `traffic` has them, s."""
    late = []
    for i, k, lag in slots.values():
        off = lag if traffic is None else lag - (traffic.answers[i] - traffic.sent[i])[k]
        late.append(off)
    flat = np.concatenate(late)
    return float(np.mean(np.abs(flat - np.median(flat))))


def _traffic(
    rig: RigFile, piece: Stretch, one_queue: bool, rng: np.random.Generator | None = None
) -> Traffic:
    """Its traffic; each reply with its own jitter if `rng` is given."""
    sent = [piece.setpoints[a][0] for a in rig.actuator_names]
    replies = [np.full((2, len(t)), rig.bus.answer_delay) for t in sent]
    if rng is not None:
        replies = [r + rig.bus.answer_jitter * rng.standard_normal(r.shape) for r in replies]
    return played_again(sent, _imu_due(rig, piece), rig.can.bitrate, replies, one_queue=one_queue)


def _imu_due(rig: RigFile, piece: Stretch) -> Array:
    """When the IMU queued its frames, s: as the quickest were received, on its own even clock."""
    if rig.imu is None or "imu.gyro_x" not in piece.samples:
        return np.empty(0)
    t = piece.samples["imu.gyro_x"][0] + rig.imu.group_delay_s
    k = np.round((t - t[0]) * rig.imu.rate)
    even = np.polyval(np.polyfit(k, t, 1), k)
    return np.asarray(even + np.quantile(t - even, QUICKEST) - frame_s(rig.can.bitrate))


def _by(rig: RigFile, piece: Stretch, slots: Slots, traffic: Traffic) -> Stretch:
    samples = dict(piece.samples)
    for signal, (i, k, _) in slots.items():
        taken = traffic.requests[i][k] + rig.bus.answer_delay
        samples[signal] = (np.maximum.accumulate(taken), piece.samples[signal][1])
    setpoints = {
        a: (np.maximum.accumulate(arrived - frame_s(rig.can.bitrate)), piece.setpoints[a][1])
        for a, arrived in zip(rig.actuator_names, traffic.controls, strict=True)
    }
    return replace(piece, setpoints=setpoints, samples=samples, stamped=piece)


def _with_clocks(rig: RigFile, piece: Stretch) -> Stretch:
    """Setpoints moved to where drives with a clock of their own played them, by the jumps of force."""
    signals = {a: f"{a}.force" for a in rig.actuator_names if f"{a}.force" in piece.samples}
    if not rig.bus.retimed or len(signals) < len(rig.actuators) or piece.mode != "position":
        return piece
    twin = Twin(rig, payload=piece.payload)
    jumps: dict[str, list[float]] = {a: [] for a in signals}
    for off_s in PHASES_S:
        job = replay_of(twin, _later(piece, dict.fromkeys(signals, off_s)), signals.values())
        answers = job.by_signal(job.run())
        for a, signal in signals.items():
            jumps[a].append(float(np.std(np.diff(piece.samples[signal][1] - answers[signal]))))
    return _later(piece, {a: PHASES_S[int(np.argmin(x))] for a, x in jumps.items()})


def _later(piece: Stretch, by_s: Mapping[str, float]) -> Stretch:
    """`piece` with each actuator's setpoints so much later."""
    return replace(
        piece, setpoints={a: (t + by_s.get(a, 0.0), x) for a, (t, x) in piece.setpoints.items()}
    )
