"""When a value was really sampled and a setpoint really arrived, where frames waited for each other.

In the schedule "parameter" a drive samples when the request of its slot arrives, which is queued with the
setpoint, and answers. On a busy bus request and answer wait, the answer longest: by up to two milliseconds at
six drives and 500 kbit/s [V]. Its receive stamp less the answer delay is that much late, and by how much
depends on whose frames went first. In a stiff drive force jumps at each new setpoint by more than inertia
takes, so half a millisecond there passes for a sixth of a moment of inertia. The traffic of such a run is
played again (`traffic`), and samples and setpoints stand where it has them, if the answers' own stamps bear
it out. So they do on a quiet bus, if answers come when the traffic has them: their stamps hold the jitter of
the replies, and an answer waits for the drive's status, 0.05 ms in the mean, which makes a kilogram on the
axis [V].

A drive takes a setpoint at the first tick of its position loop after it has come, 1 ms apart: of frames that
come near a tick, a few microseconds decide whether they act now or a millisecond later, and a frame's length
alone, by what is in it, differs by 48. A drive with its own clock (`bus.retimed`) starts it when the first
setpoint has come, so what that one frame waited shifts all it does in the run; frames before it, that no
record holds, may have kept it waiting. The jumps of its force tell either: setpoints are taken to come so
late that the twin's jumps fall on the rig's. (Encoders would take friction for a delay.)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.identify.estimate.traffic import Traffic, frame_s, played_again
from hil.identify.jumps import fewest_jumps
from hil.identify.replay import Stretch, replay_of
from hil.sim.twin import Twin

Array = NDArray[np.float64]
WAITED: Final = 2.0
"""Times their jitter that answers must spread behind their slots before they count as having waited, and that
on a quiet bus they may typically be off where the traffic has them [R]."""
BORNE_OUT: Final = 0.8
"""Share of that spread which the traffic must leave at most [R]."""
QUICKEST: Final = 0.01
"""Share of the IMU's frames that counts as not having waited."""

PHASE_S: Final = 1.25e-4
"""Half ticks of 4 kHz."""
PHASES: Final = ((PHASE_S, 4),)
"""Steps, and how many either way, by which a drive's clock may be off what its first frame's wait says."""
LATE: Final = ((0.05, 10), (0.01, 5), (2e-3, 5), (5e-4, 4))
"""The same for frames that come later than their stamps say, in ticks, each about the best before."""
CLEARER: Final = 0.01
"""What moving setpoints must take off a drive's jumps (`fewest_jumps`) to be believed [R]."""


def placed(rig: RigFile, pieces: Sequence[Stretch]) -> list[Stretch]:
    """`pieces` with samples and setpoints where they were sampled and arrived, as far as the record tells."""
    return [_placed(rig, piece) for piece in pieces]


def redrawn(rig: RigFile, piece: Stretch, rng: np.random.Generator) -> Stretch | None:
    """A placed stretch with another draw of what the traffic left to chance; None for one left as stamped.

    Samples are all moved alike, by up to what answers typically come off where the traffic has them: request
    or reply may have taken it.
    """
    if piece.stamped is None:
        return None
    slots = _slots(rig, piece.stamped)
    one_queue = _spread(slots, _traffic(rig, piece.stamped, True)) < _spread(
        slots, _traffic(rig, piece.stamped, False)
    )
    traffic = _traffic(rig, piece.stamped, one_queue, rng)
    again = _later(_by(rig, piece.stamped, slots, traffic), piece.late_s)
    off_s = _level(slots, traffic) * rng.uniform(-1.0, 1.0)
    samples = dict(again.samples)
    for signal in slots:
        t, value = again.samples[signal]
        samples[signal] = (t + off_s, value)
    again = replace(again, samples=samples)
    if not rig.bus.retimed:
        return again
    off = {a: PHASE_S * float(rng.uniform(-1.0, 1.0)) for a in rig.actuator_names}
    return _later(again, off)


def _placed(rig: RigFile, piece: Stretch) -> Stretch:
    if any(not len(piece.setpoints.get(a, ((), ()))[0]) for a in rig.actuator_names):
        return piece
    return _as_late_as_jumps(rig, _by_traffic(rig, piece))


def _by_traffic(rig: RigFile, piece: Stretch) -> Stretch:
    if rig.bus.schedule != "parameter":
        return piece
    slots = _slots(rig, piece)
    if not slots:
        return piece
    usual_s = WAITED * rig.bus.answer_jitter
    best = min(
        (_traffic(rig, piece, one_queue) for one_queue in (False, True)),
        key=lambda t: _spread(slots, t),
    )
    if _spread(slots) < usual_s:
        borne_out = float(np.mean(np.abs(_lateness(slots, best)))) < usual_s
    else:
        borne_out = _spread(slots, best) <= BORNE_OUT * _spread(slots)
    return _by(rig, piece, slots, best) if borne_out else piece


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
    late = _lateness(slots, traffic)
    return float(np.mean(np.abs(late - np.median(late))))


def _level(slots: Slots, traffic: Traffic) -> float:
    """How much later than `traffic` has them answers typically came, s."""
    return float(np.median(_lateness(slots, traffic)))


def _lateness(slots: Slots, traffic: Traffic | None) -> Array:
    return np.concatenate(
        [
            lag if traffic is None else lag - (traffic.answers[i] - traffic.sent[i])[k]
            for i, k, lag in slots.values()
        ]
    )


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


def _as_late_as_jumps(rig: RigFile, piece: Stretch) -> Stretch:
    """`piece` with setpoints as late as the jumps of each drive's force say, where they say it clearly."""
    signals = {a: f"{a}.force" for a in rig.actuator_names if f"{a}.force" in piece.samples}
    if len(signals) < len(rig.actuators) or piece.mode != "position":
        return piece
    turns: tuple[tuple[float, int], ...] = ()
    if rig.bus.retimed:
        turns = PHASES if piece.stamped is not None else ()
    elif rig.bus.position_loop > rig.bus.speed_loop and rig.bus.interpolation != "hold":
        turns = tuple((rig.bus.position_loop * step, most) for step, most in LATE)
    if not turns:
        return piece
    twin = Twin(rig, payload=piece.payload)

    def steps(late_s: Mapping[str, float]) -> dict[str, Array]:
        job = replay_of(twin, _later(piece, late_s), signals.values())
        answers = job.by_signal(job.run())
        return {a: np.abs(np.diff(piece.samples[s][1] - answers[s])) for a, s in signals.items()}

    best, gain = fewest_jumps(
        dict.fromkeys(signals, 0.0), [(most, _step(step_s)) for step_s, most in turns], steps
    )
    found = {a: s for a, s in best.items() if gain[a] > CLEARER}
    return replace(_later(piece, found), late_s=found) if found else piece


def _step(step_s: float) -> Callable[[str, float, int], float]:
    return lambda _, late_s, count: late_s + count * step_s


def _later(piece: Stretch, by_s: Mapping[str, float]) -> Stretch:
    """`piece` with each actuator's setpoints so much later."""
    return replace(
        piece, setpoints={a: (t + by_s.get(a, 0.0), x) for a, (t, x) in piece.setpoints.items()}
    )
