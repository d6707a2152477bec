"""Is each channel what its name says, in its unit, moving, and within its range? Before anything is computed.

What the three measured angles ask of an IMU is known from the model, so that a gyroscope in degrees, an
accelerometer in g, axes that are exchanged or point the other way show as gains and correlations that no
noise makes. Each check wants motion that shows it, and is silent where the ride has none.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.bicycle.recorded import GAP_PERIODS, Ride
from hil.bicycle.sensors import IMU_SIGNALS, noise_of
from hil.errors import KinematicsError
from hil.rigs.bicycle import Smooth, low_pass, pack
from hil.rigs.bicycle import ride as simulate
from hil.runs.importing.findings import Finding

Array = NDArray[np.float64]

CUTOFF_HZ: Final = 2.0
FASTEST_M_S: Final = 25.0
"""No rider is faster; degrees are 57 times as fast."""
DEGREES: Final = (30.0, 100.0)
"""Gains between which a rate is one in degrees."""
FLIPPED: Final = (0.6, 1.6)
"""Times what is wanted, between which what goes against it is an axis that points the other way: what a
bracket that bends turns of gravity may go against a push as well, and is no wrong sign."""
GRAVITY: Final = (0.4, 2.5)
"""Times gravity, between which an accelerometer in m/s² is on average, whatever its scale: a ride ends as it
began."""
RADIUS: Final = 0.15
"""By which what turns ask of the wheel may miss its radius for the wheel's column to be metres."""
AGREES: Final = 0.8
APART: Final = 0.15
"""By which another channel must follow better than the one that bears the name."""
MOVES: Final = {"gyro": 0.05, "accel": 0.2, "lean": 0.03}
"""Spread of the model's signal from which its sensor must follow, and of a lean that turns are told by."""
MOVING_M_S: Final = 1.0
SHORT_OF: Final = 0.02
"""rad: of the inclinometer's zero and its steps, by which what stands at its range may miss it."""
STUCK: Final = 1e-9
PINNED: Final = 5
"""Samples in a row at a sensor's extreme: it can say no more."""
PINNED_S: Final = 0.3
"""As much of an inclinometer, which filters inside and stands still for moments."""


def check_channels(ride: Ride, told: Smooth) -> list[Finding]:
    """Faults of units, axes and dead sensors; warnings of pinned samples and holes of the IMU."""
    out = _wheel(ride, told) + _metres(ride, told) + _dead(ride) + _elsewhere(ride)
    if not out:
        out = _imu(ride, told)
    out += _pinned("lean", *_ridden_lean(ride, told), ride, round(PINNED_S / ride.dt_s))
    told_of: set[float] = set()
    for signal, (t, values) in ride.imu.items():
        out += _pinned(signal, values, t, ride)
        out += _holes(signal, t, told_of)
    return out


def _ridden_lean(ride: Ride, told: Smooth) -> tuple[Array, Array]:
    """Lean and instants while the bicycle moves, short of the range that its file has: that is told of
    already."""
    rows = ride.rig.geometry.R * np.abs(told.rate[:, 1]) > MOVING_M_S
    rows &= np.abs(ride.angles[:, 0]) < ride.rig.sensors.lean_range - SHORT_OF
    return ride.angles[rows, 0], ride.t_s[rows]


def _wheel(ride: Ride, told: Smooth) -> list[Finding]:
    speed = ride.rig.geometry.R * np.abs(told.rate[:, 1])
    fast = float(np.quantile(speed, 0.9))
    if fast < FASTEST_M_S:
        return []
    text = f"the wheel's angle gives {fast:.0f} m/s: are these degrees, or counts?"
    return [Finding("unit", "rear_wheel", "fault", text)]


def _metres(ride: Ride, told: Smooth) -> list[Finding]:
    """A wheel's way in place of its angle: the speed is then too small by the radius, and in turns the frame
    yaws faster than that speed and its steer say; without a gyroscope it leans more, by the square."""
    g = ride.rig.geometry
    speed = g.R * told.rate[:, 1]
    yaw = speed * told.angle[:, 2] * np.cos(g.tilt) / g.wheelbase
    if "imu.gyro_z" in ride.imu:
        raw = np.interp(ride.t_s, *ride.imu["imu.gyro_z"])
        seen, power = low_pass(raw[:, None], ride.dt_s, CUTOFF_HZ)[:, 0], 1.0
        least = MOVES["gyro"]
    else:
        yaw = -speed * yaw / ride.rig.mass.gravity
        seen, power = told.angle[:, 0], 2.0
        least = MOVES["lean"]
    if np.std(seen) < least or _together(yaw, seen) < AGREES:
        return []
    factor = _gain(yaw, seen) ** (-1.0 / power)
    if abs(factor / g.R - 1.0) > RADIUS:
        return []
    text = (
        f"looks like metres, not radians: by the turns it is {factor:.2f} of the wheel's angle (the radius "
        f"is {g.R:.3f} m); divide it by the radius"
    )
    return [Finding("unit", "rear_wheel", "fault", text)]


def _dead(ride: Ride) -> list[Finding]:
    """Lean or steer that stands still while the gyroscope turns."""
    spin = [np.interp(ride.t_s, *ride.imu[s]) for s in IMU_SIGNALS[:3] if s in ride.imu]
    if not spin or max(float(np.std(s)) for s in spin) < MOVES["gyro"]:
        return []
    out = []
    for k, signal in ((0, "lean"), (2, "steer")):
        noise, step = noise_of(signal, ride.rig)
        if np.ptp(ride.angles[:, k]) < 0.5 * max(step, noise, 1e-6):
            text = "never changes while the gyroscope turns: stuck, or not connected"
            out.append(Finding("dead", signal, "fault", text))
    return out


def _elsewhere(ride: Ride) -> list[Finding]:
    """An IMU whose stamps lie beside the ride."""
    first, last = ride.t_s[0], ride.t_s[-1]
    for t, _ in ride.imu.values():
        shared = min(float(t[-1]), float(last)) - max(float(t[0]), float(first))
        if shared < 0.5 * (last - first):
            text = (
                f"is stamped from {t[0]:.1f} to {t[-1]:.1f} s, lean, wheel and steer from {first:.1f} to "
                f"{last:.1f} s: two clocks; bring its stamps to theirs"
            )
            return [Finding("clocks", "imu", "fault", text)]
    return []


def _imu(ride: Ride, told: Smooth) -> list[Finding]:
    signals = [s for s in IMU_SIGNALS if s in ride.imu]
    if not signals:
        return []
    try:
        model = simulate(pack(ride.rig), told).imu
    except KinematicsError:  # whoever analyses it says so
        return []
    raw = np.column_stack([np.interp(ride.t_s, *ride.imu[s]) for s in signals])
    seen = dict(zip(signals, low_pass(raw, ride.dt_s, CUTOFF_HZ).T, strict=True))
    wanted = dict(zip(IMU_SIGNALS, low_pass(model, ride.dt_s, CUTOFF_HZ).T, strict=True))
    return _gravity(ride, seen) or _axes(seen, wanted)


def _gravity(ride: Ride, seen: dict[str, Array]) -> list[Finding]:
    """Where gravity stands, and in what unit."""
    accel = [s for s in IMU_SIGNALS[3:] if s in seen]
    if len(accel) < 3:
        return []
    mean = np.array([float(np.mean(seen[s])) for s in accel])
    size, g = float(np.linalg.norm(mean)), ride.rig.mass.gravity
    if 0.7 < size < 1.4:
        text = f"feels {size:.2f} at rest where it should feel {g:.2f} m/s²: are these g?"
        return [Finding("unit", "imu.accel", "fault", text)]
    if not GRAVITY[0] * g < size < GRAVITY[1] * g:
        text = (
            f"feels {size:.3g} m/s² on average, where gravity alone is {g:.2f}: is it in another unit, or is "
            "gravity taken off?"
        )
        return [Finding("unit", "imu.accel", "fault", text)]
    largest = int(np.argmax(np.abs(mean)))
    if abs(mean[largest]) < 0.8 * size:
        return []
    if largest != 2:
        text = (
            f"gravity stands in {accel[largest]}, not in imu.accel_z: axes are exchanged, or the sensor lies "
            "on its side; name them right or set imu.orientation"
        )
        return [Finding("swapped", f"{accel[largest]}, imu.accel_z", "fault", text)]
    if mean[2] < 0.0:
        text = (
            f"reads {mean[2]:.1f} m/s² upright: its z axis points down, or it tells acceleration "
            "where specific force is meant (+g upright); set imu.orientation"
        )
        return [Finding("imu_sign", "imu.accel_z", "fault", text)]
    return []


def _axes(seen: dict[str, Array], wanted: dict[str, Array]) -> list[Finding]:
    """Axes that are stuck, rates in degrees, axes exchanged, axes that point the other way."""
    out = []
    for s in seen:
        kind = s.partition(".")[2].partition("_")[0]
        if np.std(wanted[s]) > 0.4 * MOVES[kind] and np.ptp(seen[s]) < STUCK:
            text = "never changes while the bicycle moves: stuck, or not connected"
            out.append(Finding("dead", s, "fault", text))
    if out:
        return out
    gyro = [s for s in IMU_SIGNALS[:3] if s in seen]
    moving = [s for s in gyro if np.std(wanted[s]) > MOVES["gyro"]]
    for s in moving:
        gain = _gain(wanted[s], seen[s])
        is_told = abs(_together(wanted[s], seen[s])) > AGREES
        if DEGREES[0] < abs(gain) < DEGREES[1] and is_told:
            text = (
                f"turns {abs(gain):.0f} times as fast as the bicycle: are these degrees per second?"
            )
            out.append(Finding("unit", s, "fault", text))
    if out:
        return out
    accel = [s for s in IMU_SIGNALS[3:] if s in seen]
    pushed = [s for s in accel if s.endswith("_x") and np.std(wanted[s]) > MOVES["accel"]]
    for s in (*moving, *pushed):  # across and down, what a rider does is small beside a tilt
        own = abs(_together(wanted[s], seen[s]))
        for other in gyro if s in gyro else accel:
            cross = abs(_together(wanted[s], seen[other]))
            if cross > AGREES and own < cross - APART:
                text = f"what the ride asks of {s} is found in {other}: the two are exchanged"
                return [Finding("swapped", f"{s}, {other}", "fault", text)]
    for s in ("imu.gyro_y", "imu.accel_x"):
        kind = s.partition(".")[2].partition("_")[0]
        if s in seen and np.std(wanted[s]) > MOVES[kind] * (0.4 if kind == "gyro" else 1.0):
            together = _together(wanted[s], seen[s])
            if together < -AGREES and FLIPPED[0] < -_gain(wanted[s], seen[s]) < FLIPPED[1]:
                text = (
                    f"goes against what the ride asks of it (correlation {together:.2f}): its axis points "
                    "the other way (x forward, y to the left, z up)"
                )
                out.append(Finding("imu_sign", s, "fault", text))
    return out


def _gain(wanted: Array, seen: Array) -> float:
    """How much is seen of what is wanted, by least squares about the means."""
    a, b = wanted - wanted.mean(), seen - seen.mean()
    return float(a @ b / (a @ a))


def _together(a: Array, b: Array) -> float:
    """Correlation; 0 where one stands still."""
    a, b = a - a.mean(), b - b.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size else 0.0


def _pinned(signal: str, values: Array, t: Array, ride: Ride, least: int = PINNED) -> list[Finding]:
    """Runs of samples that stand at the largest or smallest value."""
    if not values.size:
        return []
    _, step = noise_of(signal, ride.rig)
    out = []
    for end in (float(values.max()), float(values.min())):
        at = np.abs(values - end) <= 0.01 * step
        longest, run, start = 0, 0, 0
        for k, hit in enumerate(at.tolist()):
            run = run + 1 if hit else 0
            if run > longest:
                longest, start = run, k - run + 1
        if longest >= least and np.ptp(values) > 10.0 * step:
            text = (
                f"{int(at.sum())} samples stand at {end:.4g}, {longest} in a row at {t[start]:.2f} s: "
                "the sensor's range is smaller than the ride"
            )
            out.append(Finding("saturation", signal, "warning", text))
    return out


def _holes(signal: str, t: Array, told_of: set[float]) -> list[Finding]:
    """Gaps of one channel; those that came with another's are told once."""
    steps = np.diff(t)
    holes = np.flatnonzero(steps > max(GAP_PERIODS * float(np.median(steps)), 0.05))
    if not holes.size:
        return []
    k = int(holes[np.argmax(steps[holes])])
    start = float(t[k])
    if start in told_of:
        return []
    told_of.add(start)
    text = f"{holes.size} gaps, the longest {1e3 * steps[k]:.0f} ms at {start:.2f} s"
    return [Finding("gaps", signal, "warning", text)]
