"""Do the channels mean what their names say? A ride must obey its own mechanics and its own IMU.

In a turn the frame yaws by v γ cos(tilt) / wheelbase and leans against v² γ; its gyroscope feels both.
Whatever contradicts that has a wrong sign, a wrong name or another clock. Each check wants motion that
shows it, and is silent where the ride has none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.bicycle.channels import check_channels
from hil.bicycle.recorded import Ride
from hil.rigs.bicycle import Smooth, low_pass, pack, smooth
from hil.rigs.bicycle import ride as simulate
from hil.runs.importing.findings import Finding

Array = NDArray[np.float64]

CUTOFF_HZ: Final = 2.0
SHORTEST_LAG_S: Final = 0.02
"""Offsets below two samples cannot be told from the sensors' own delays."""
LONGEST_LAG_S: Final = 1.0
TURNED: Final = 0.2
"""rad/s of yaw rate that clocks are compared by."""
SURE: Final = 0.5
"""Correlation from which a sign or a name is believed."""
AGAINST: Final = 0.8
"""Correlation with a gyroscope from which a sign is wrong: another axis' rate only half contradicts."""


@dataclass(frozen=True, slots=True)
class Signs:
    """Correlations of what was measured with what the mechanics ask; NaN where the ride shows nothing."""

    lean_with_turn: float
    """Lean against −v² γ cos(tilt) / (g wheelbase)."""
    roll_with_gyro: float
    """Lean rate and gyro x (with its share of the yaw rate)."""
    yaw_with_gyro: float
    """v γ cos(tilt) / wheelbase and gyro z."""
    swapped: float
    """The first two with lean and steer exchanged, the smaller."""


def check_ride(ride: Ride) -> list[Finding]:
    """Signs, swapped channels, degrees, clocks. Faults are what makes every result wrong."""
    told = smooth(ride.angles, ride.dt_s, CUTOFF_HZ)
    found = check_channels(ride, told)
    faults = [f for f in found if f.verdict == "fault"]
    plain = [f for f in faults if f.check in ("unit", "dead", "clocks")]
    signs = _signs(ride, told)
    # Angles that contradict each other make every axis of the IMU look wrong: they come first. Those that
    # agree are right, or both wrong, and then it is the IMU's axes.
    if signs.lean_with_turn > SURE:
        named = _exchanged(signs) or [*faults, *_check_gyro(signs)]
    else:
        named = _exchanged(signs) or _check_signs(signs) or faults
    return plain or named or [*_clocks(ride, told), *found]


def _exchanged(signs: Signs) -> list[Finding]:
    """Lean and steer under each other's name. They go against each other, so that exchanged ones still fit
    somewhat: the better fit counts."""
    named = min(abs(signs.yaw_with_gyro), abs(signs.roll_with_gyro))
    agree = min(signs.yaw_with_gyro, signs.roll_with_gyro) > SURE
    if agree or not signs.swapped > max(0.8, named):
        return []
    text = "steer turns and lean steers in this ride: the two channels are swapped"
    return [Finding("swapped", "lean, steer", "fault", text)]


def _check_gyro(signs: Signs) -> list[Finding]:
    """Axes of the gyroscope that contradict lean and steer, which agree with each other."""
    if max(signs.roll_with_gyro, signs.yaw_with_gyro) < -AGAINST:
        text = (
            "lean and steer agree with each other and both contradict the gyroscope: its x and z axes point "
            "backward and down; set imu.orientation"
        )
        return [Finding("imu_sign", "imu", "fault", text)]
    out = []
    rates = (("imu.gyro_x", signs.roll_with_gyro), ("imu.gyro_z", signs.yaw_with_gyro))
    for signal, together in rates:
        if together < -AGAINST:
            text = (
                f"contradicts lean and steer, which agree with each other (correlation {together:.2f}): its "
                "axis points the other way (x forward, z up); set imu.orientation"
            )
            out.append(Finding("imu_sign", signal, "fault", text))
    return out


def _check_signs(signs: Signs) -> list[Finding]:
    """Faults of lean and steer alone."""
    out: list[Finding] = []
    if signs.yaw_with_gyro < -AGAINST:
        text = "the frame yaws right where it is steered left: steer to the LEFT is positive"
        out.append(Finding("sign", "steer", "fault", text))
    if signs.roll_with_gyro < -AGAINST:
        text = "the gyroscope rolls left where the lean grows: lean to the RIGHT is positive"
        out.append(Finding("sign", "lean", "fault", text))
    outward = signs.lean_with_turn < -SURE and np.isnan(signs.yaw_with_gyro)
    if outward and signs.roll_with_gyro > SURE:
        text = (
            "the bicycle leans out of its turns while the gyroscope agrees with its lean: steer to the "
            "LEFT is positive"
        )
        out.append(Finding("sign", "steer", "fault", text))
    elif outward and np.isnan(signs.roll_with_gyro):
        text = (
            "the bicycle leans out of its turns: one of the two has the wrong sign (lean to the right and "
            "steer to the left are positive); without a gyroscope nobody can say which"
        )
        out.append(Finding("sign", "lean, steer", "fault", text))
    return out


def _signs(ride: Ride, told: Smooth) -> Signs:
    g, mass = ride.rig.geometry, ride.rig.mass
    speed = g.R * told.rate[:, 1]

    def fits(lean: Array, lean_rate: Array, steer: Array) -> tuple[float, float, float]:
        yaw = speed * steer * np.cos(g.tilt) / g.wheelbase
        turn = _correlation(lean, -speed * yaw / mass.gravity, 0.03)
        roll = _gyro(ride, "imu.gyro_x")
        spin = _gyro(ride, "imu.gyro_z")
        return (
            turn,
            float("nan") if roll is None else _correlation(lean_rate, roll, 0.03),
            float("nan") if spin is None else _correlation(yaw, spin, 0.05),
        )

    as_named = fits(told.angle[:, 0], told.rate[:, 0], told.angle[:, 2])
    other = fits(told.angle[:, 2], told.rate[:, 2], told.angle[:, 0])
    return Signs(*as_named, min(other[1:], key=lambda x: -1.0 if np.isnan(x) else x))


def _gyro(ride: Ride, signal: str) -> Array | None:
    if signal not in ride.imu:
        return None
    values = np.interp(ride.t_s, *ride.imu[signal])
    return low_pass(values[:, None], ride.dt_s, CUTOFF_HZ)[:, 0]


def _correlation(a: Array, b: Array, least: float) -> float:
    """Of a with b; NaN where either moves less than `least`."""
    if np.ptp(a) < least or np.ptp(b) < least:
        return float("nan")
    a, b = a - a.mean(), b - b.mean()
    return float(a @ b / np.sqrt((a @ a) * (b @ b)))


def _clocks(ride: Ride, told: Smooth) -> list[Finding]:
    """The IMU's clock against the encoders': offset, and whether it runs at another rate."""
    spin = _gyro(ride, "imu.gyro_z")
    if spin is None:
        return []
    yaw = simulate(pack(ride.rig), told).imu[:, 2]
    whole, fit = _lag(yaw, spin, ride.dt_s)
    if np.ptp(yaw) < TURNED or fit < 0.9:
        return []
    half = len(yaw) // 2
    lags = [_lag(yaw[part], spin[part], ride.dt_s) for part in (slice(0, half), slice(half, None))]
    drift = (lags[1][0] - lags[0][0]) / (half * ride.dt_s)
    sure = min(lag[1] for lag in lags) > 0.9
    if sure and abs(drift) > 2e-3:
        text = (
            f"its clock gains {1e3 * drift:+.1f} ms a second on the encoders': two clocks; compare after the "
            "drift is taken out (clock_drift in the rig file)"
        )
        return [Finding("clocks", "imu", "warning", text)]
    if abs(whole) > SHORTEST_LAG_S:
        text = (
            f"is {1e3 * whole:+.0f} ms late against the encoders: two clocks, or a filter's delay; "
            "set imu.delay"
        )
        return [Finding("clocks", "imu", "warning", text)]
    return []


def _lag(a: Array, b: Array, dt_s: float) -> tuple[float, float]:
    """Seconds by which b comes after a, and their correlation there."""
    a, b = a - a.mean(), b - b.mean()
    size = 2 * len(a)
    cross = np.fft.irfft(np.fft.rfft(b, size) * np.conj(np.fft.rfft(a, size)))
    most = min(int(LONGEST_LAG_S / dt_s), len(a) // 4)
    lags = np.arange(-most, most + 1)
    c = cross[lags]
    k = int(np.argmax(c))
    scale = float(np.sqrt((a @ a) * (b @ b)))
    if scale == 0.0:
        return 0.0, 0.0
    # the sum's length shrinks with the lag, which draws its peak to zero: refine by least squares
    lag, t = float(lags[k]), np.arange(len(a), dtype=float)
    inside = slice(most, len(a) - most)
    for _ in range(4):
        back = np.interp(t + lag, t, b)
        slope = np.gradient(back)[inside]
        power = float(slope @ slope)
        if power == 0.0:
            break
        lag += float(slope @ (a - back)[inside]) / power
    return lag * dt_s, float(c[k] / scale)
