"""Faults that no catalogue has: in the bicycle, in the way its sensors are fixed, in the world around it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import bilinear, butter, lfilter

from benchmarks.other_rides.bicycle import Bicycle
from benchmarks.other_rides.body import Body
from benchmarks.other_rides.fault import Fault, Parameters, of_body
from benchmarks.other_rides.ridden import FINE_S, Truth
from benchmarks.other_rides.sensing import ACCEL, GYRO, IMU, Signals, turned_back

Array = NDArray[np.float64]
Before = Callable[[Truth, Signals, float], Signals]

BEND_HZ: Final = 6.0
TILT_HZ: Final = 1.5
"""How fast a bent bracket and a damped pendulum follow."""


def _size(size: float, *_: object) -> Parameters:
    return {"size": size}


def _of_body(name: str, least: float, most: float, note: str, field: str) -> Fault:
    """A fault that is one number of the body."""

    def on(body: Body, size: float) -> Body:
        return replace(body, **{field: size})

    return Fault(name, "bicycle", least, most, of_body(on), _size, note)


def _before(
    name: str, place: str, bounds: tuple[float, float], act: Before, note: str = ""
) -> Fault:
    """A fault between the truth and the sampling."""

    def on(b: Bicycle, size: float) -> Bicycle:
        def before(truth: Truth, signals: Signals) -> Signals:
            return act(truth, dict(signals), size)

        return replace(b, sensing=replace(b.sensing, before=before))

    return Fault(name, place, *bounds, on, _size, note)


def _loose_headset(_rng: np.random.Generator) -> Fault:
    note = "rad of play: the front wheel turns and knocks to where its load pushes it"
    return _of_body("loose_headset", 0.004, 0.06, note, "headset_play")


def _loose_rear_wheel(_rng: np.random.Generator) -> Fault:
    note = "rad of play: chain and brake turn the wheel in its dropouts"
    return _of_body("loose_rear_wheel", 0.004, 0.06, note, "axle_play")


def _side_wind(_rng: np.random.Generator) -> Fault:
    return _of_body("side_wind", 4.0, 80.0, "N rms at the chest", "gusts_n")


def _wheel_out_of_round(rng: np.random.Generator) -> Fault:
    rear = bool(rng.random() < 0.5)

    def on(body: Body, size: float) -> Body:
        return replace(body, runout_m=(size, 0.0) if rear else (0.0, size))

    place = "rear_wheel" if rear else "front_wheel"
    return Fault("wheel_out_of_round", place, 3e-4, 0.012, of_body(on), _size, "m, once a turn")


def _side_slip(rng: np.random.Generator) -> Fault:
    share = float(rng.uniform(-0.8, 0.8))

    def on(body: Body, size: float) -> Body:
        rear, front = body.side_slip
        return replace(body, side_slip=(rear + size * (1.0 + share), front + size * (1.0 - share)))

    note = f"rad by m/s2 across; rear {1.0 + share:.2f}, front {1.0 - share:.2f} times"
    return Fault("side_slip", "bicycle", 1.5e-3, 0.04, of_body(on), _size, note)


def _road_slope(rng: np.random.Generator) -> Fault:
    length = float(rng.uniform(30.0, 70.0))

    def on(body: Body, size: float) -> Body:
        return replace(body, slope=(size, length))

    return Fault("road_slope", "road", 0.008, 0.1, of_body(on), _size, f"rad, every {length:.0f} m")


def _coupling_slips(rng: np.random.Generator) -> Fault:
    slips = rng.choice([-1.0, 1.0], 4) * rng.uniform(0.5, 1.5, 4)
    loads = np.sort(rng.uniform(0.1, 0.8, 4))

    def act(truth: Truth, at: Signals, size: float) -> Signals:
        """It lets go where the handlebar has been turned through these shares of all its travel."""
        turned = np.cumsum(np.abs(np.gradient(truth.steer)) * (truth.t_s > 0.0))
        past = turned[:, None] / turned[-1] > loads
        return at | {"steer": at["steer"] + size * (past @ slips)}

    shares, steps = np.round(loads, 2).tolist(), np.round(slips, 2).tolist()
    note = f"rad, at shares {shares} of the handlebar's way, by {steps}"
    return _before("steer_coupling_slips", "steer", (0.004, 0.06), act, note)


def _coupling_play(_rng: np.random.Generator) -> Fault:
    def act(_truth: Truth, at: Signals, size: float) -> Signals:
        read = at["steer"].copy()
        for k in range(1, len(read)):
            read[k] = min(max(read[k - 1], read[k] - 0.5 * size), read[k] + 0.5 * size)
        return at | {"steer": read}

    return _before("steer_coupling_play", "steer", (0.008, 0.09), act, "rad of play")


def _magnet_off_centre(rng: np.random.Generator) -> Fault:
    phase = float(rng.uniform(0.0, 2.0 * np.pi))

    def act(truth: Truth, at: Signals, size: float) -> Signals:
        return at | {"rear_wheel": at["rear_wheel"] + size * np.sin(truth.wheel + phase)}

    return _before("wheel_magnet_off_centre", "rear_wheel", (0.006, 0.15), act, "rad, once a turn")


def _bracket_rings(rng: np.random.Generator) -> Fault:
    hz, damping = float(rng.uniform(6.0, 14.0)), float(rng.uniform(0.03, 0.08))
    axes = (ACCEL[0], GYRO[1]) if rng.random() < 0.5 else (ACCEL[2], GYRO[1])
    w = 2.0 * np.pi * hz
    b, a = bilinear([2.0 * damping * w, w * w], [1.0, 2.0 * damping * w, w * w], 1.0 / FINE_S)

    def act(_truth: Truth, at: Signals, size: float) -> Signals:
        out = {}
        for s in axes:
            still = at[s][0]
            out[s] = at[s] + size * (lfilter(b, a, at[s] - still) + still - at[s])
        return at | out

    note = f"share of {', '.join(axes)} that rings at {hz:.1f} Hz, damping {damping:.3f}"
    return _before("imu_bracket_rings", "imu", (0.1, 1.5), act, note)


def _bracket_bends(rng: np.random.Generator) -> Fault:
    pitch, roll = rng.uniform(0.5, 1.0) * rng.choice([-1.0, 1.0]), rng.uniform(-0.7, 0.7)
    b, a = butter(2, BEND_HZ, fs=1.0 / FINE_S)

    def act(_truth: Truth, at: Signals, size: float) -> Signals:
        ahead, side = (lfilter(b, a, at[s]) for s in ACCEL[:2])
        angles = (size * roll * side, size * pitch * ahead, 0.0)
        out = dict(at)
        for names in (GYRO, ACCEL):
            turned = turned_back(angles, np.stack([at[s] for s in names]))
            out |= dict(zip(names, turned, strict=True))
        return out

    note = f"rad by m/s2: pitch {pitch:.2f} ahead, roll {roll:.2f} across"
    return _before("imu_bracket_bends", "imu", (0.005, 0.2), act, note)


def _warms_up(rng: np.random.Generator) -> Fault:
    names, tau = (GYRO if rng.random() < 0.5 else ACCEL), float(rng.uniform(8.0, 20.0))
    sign, offset = rng.choice([-1.0, 1.0]), rng.uniform(-0.3, 0.3)

    def act(truth: Truth, at: Signals, size: float) -> Signals:
        warm = size * (1.0 - np.exp(-np.maximum(truth.t_s, 0.0) / tau))
        return at | {s: at[s] * (1.0 + sign * warm) + offset * warm for s in names}

    note = f"scale of {names[0][:-2]} changes by {sign:.0f} x size within {tau:.1f} s, offset by {offset:.2f}"
    return _before("imu_warms_up", "imu", (0.008, 0.5), act, note)


def _pendulum(_rng: np.random.Generator) -> Fault:
    b, a = butter(1, TILT_HZ, fs=1.0 / FINE_S)

    def act(_truth: Truth, at: Signals, size: float) -> Signals:
        felt = lfilter(b, a, np.arctan2(at[ACCEL[1]], at[ACCEL[2]]))
        return at | {"lean": (1.0 - size) * at["lean"] + size * felt}

    note = "share of the lean that is read as a pendulum reads it, which curves pull aside"
    return _before("inclinometer_is_pendulum", "lean", (0.03, 1.0), act, note)


def _held(rng: np.random.Generator) -> Fault:
    names = IMU if rng.random() < 0.6 else ("steer",)
    key = int(rng.integers(2**31))

    def on(b: Bicycle, size: float) -> Bicycle:
        def after(signals: Signals) -> Signals:
            return signals | _frozen(signals, names, size, np.random.default_rng(key))

        return replace(b, sensing=replace(b.sensing, after=after))

    place = "imu" if names is IMU else "steer"
    return Fault(
        "held_samples", place, 0.02, 0.6, on, _size, "share of the time, 0.1 to 0.5 s at once"
    )


def _frozen(
    signals: Signals, names: tuple[str, ...], share: float, rng: np.random.Generator
) -> Signals:
    """Copies in which the last sample stands for stretches, all names alike."""
    out = {s: signals[s].copy() for s in names}
    count = len(out[names[0]])
    per_s = 200.0 if len(names) > 1 else 100.0
    at = 0.0
    while True:
        held = rng.uniform(0.1, 0.5) * per_s
        at += held * (1.0 - share) / share * rng.uniform(0.3, 1.7)
        first, last = int(at), int(at + held)
        if last >= count:
            return out
        for s in names:
            out[s][first:last] = out[s][first]
        at += held


MAKERS: Final[tuple[Callable[[np.random.Generator], Fault], ...]] = (
    _loose_headset,
    _loose_rear_wheel,
    _side_wind,
    _wheel_out_of_round,
    _side_slip,
    _road_slope,
    _coupling_slips,
    _coupling_play,
    _magnet_off_centre,
    _bracket_rings,
    _bracket_bends,
    _warms_up,
    _pendulum,
    _held,
)
