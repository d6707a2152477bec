"""Sets the sensors right from stretches at rest: zeros, gyroscope bias, accelerometer, mounting.

Upright and steered straight the inclinometer and the steer encoder give their zeros, the gyroscope its bias.
At rest an accelerometer feels g whatever its pose, so that nine poses or more give bias and scale of each
axis and how square the axes are; fewer give what they can: a prior (0.3 m/s², 3 and 2 percent [M]) keeps the
rest where it was.
The first pose is the upright one; where gravity stands in it says how the sensor is tilted on the frame. Its
turn about the vertical does not show at rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from hil.config import BicycleFile
from hil.config.bicycle import Sensors
from hil.errors import IdentificationError
from hil.rigs.bicycle.parameters import rotation
from hil.runs import Run
from hil.runs.importing.checks import ACCEL_NORM
from hil.signals import IMU_QUANTITIES

Array = NDArray[np.float64]

SHORTEST_S: Final = 1.0
WINDOW_S: Final = 0.25
STILL_GYRO, STILL_ACCEL = 3.0, 5.0
"""Times the sensor's noise: a window that spreads by less is at rest."""
LEAST_GYRO, LEAST_ACCEL = 1e-4, 0.01
"""rad/s, m/s²: noise that any sensor is taken to have there."""
ROLLED, ROLLED_NOISE = 3.0, 8.0
"""Steps of the wheel's encoder, and times its noise, by which it may turn in a pose: a bicycle in a steady
turn looks at rest to a gyroscope that is blamed for it."""
RIDDEN_M_S: Final = 1.0
"""Speed from which a run is a ride and no pose: nobody pushes a bicycle that fast to turn it over."""
LEANT, STEERED = 0.3, 0.6
"""rad beyond which the first pose is not upright and steered straight: more than any zero is off."""
UPRIGHT: Final = 0.35
"""rad that the sensor may stand off what the file says: more, and it is another pose or another mounting."""
NEW_POSE: Final = 0.2
"""rad between two gravity directions from which they are two poses."""
BIAS_PRIOR, SCALE_PRIOR, CROSS_PRIOR = 0.3, 0.03, 0.02
"""m/s² and shares that an accelerometer is off, standard deviations [M]."""
DRIFT, LEAST_DRIFT = 0.1, 1e-3
"""Of the accelerometer's noise, and m/s² at least: what the mean over a pose is off, which does not average
out."""
ENOUGH: Final = 9
"""Poses that bias, scale and squareness of three axes need."""


@dataclass(frozen=True, slots=True)
class Pose:
    """A stretch at rest: means over it."""

    name: str
    start_s: float
    end_s: float
    lean: float
    steer: float
    gyro: Array
    accel: Array
    samples: int


@dataclass(frozen=True, slots=True)
class Calibration:
    """What was found, and how sure it is."""

    sensors: Sensors
    orientation: tuple[float, float, float]
    poses: tuple[Pose, ...]
    accel_sd: tuple[float, ...]
    """Of the three biases (m/s2), scales and cross terms."""
    residual: float
    """Of |a| against g over the poses, m/s2 rms."""
    notes: tuple[str, ...]

    def applied(self, rig: BicycleFile) -> BicycleFile:
        """`rig` with what was found."""
        imu = rig.imu
        if imu is not None:
            imu = imu.model_copy(update={"orientation": self.orientation})
        return rig.model_copy(update={"sensors": self.sensors, "imu": imu})


def calibrate(runs: list[Run], rig: BicycleFile) -> Calibration:
    """From runs at rest, the first upright and steered straight; the bicycle's file says what was so far.

    IdentificationError where nothing rests, or it rests somewhere else than upright.
    """
    if rig.imu is None:
        raise IdentificationError(
            f"{rig.name}: has no imu in its file, so no gravity to calibrate by"
        )
    poses = [p for run in runs for p in _poses(run, rig)]
    if not poses:
        raise IdentificationError(
            f"{', '.join(r.path.name for r in runs)}: the bicycle never rests for {SHORTEST_S:g} s, wheels "
            "and all: hold it still and upright"
        )
    upright = poses[0]
    if abs(upright.lean) > LEANT or abs(upright.steer) > STEERED:
        raise IdentificationError(
            f"{upright.name}: begins with lean {upright.lean:.2f} and steer {upright.steer:.2f} rad: the "
            "first pose must be upright and steered straight"
        )
    notes = [text for run in runs if (text := _ridden(run, rig, poses))]
    distinct = _distinct(poses)
    found, sd, residual = fit_accelerometer(
        np.array([p.accel for p in distinct]), rig.sensors, rig.mass.gravity,
        max(DRIFT * rig.noise.accel, LEAST_DRIFT),
    )  # fmt: skip
    if len(distinct) < ENOUGH:
        notes.append(
            f"{len(distinct)} poses of the {ENOUGH} that bias, scale and squareness need: what they "
            "do not tell stays as it was; lay the bicycle on either side, nose up and down, upside down, and "
            "lean it against things"
        )
    down = straightened(upright.accel[None, :], found)[0]
    orientation, turned = _orientation(down, rig)
    if turned > UPRIGHT:
        raise IdentificationError(
            f"{upright.name}: the sensor stands {np.rad2deg(turned):.0f} degrees off what the file says: the "
            "first run must be upright; if it is, set imu.orientation to how the sensor is mounted"
        )
    notes.append(
        f"the sensor stands {np.rad2deg(turned):.2f} degrees off what the file said; its turn about the "
        "vertical does not show at rest and is left as it was"
    )
    weights = np.array([p.samples for p in poses], dtype=float)
    gyro = np.average([p.gyro for p in poses], axis=0, weights=weights)
    sensors = rig.sensors.model_copy(
        update={
            "lean_zero": upright.lean,
            "steer_zero": upright.steer,
            "gyro_bias": _three(gyro),
            "accel_bias": _three(found[:3]),
            "accel_scale": _three(found[3:6]),
            "accel_cross": _three(found[6:]),
            "provenance": f"hil bicycle calibrate {' '.join(r.path.name for r in runs)}",
        }
    )
    return Calibration(
        sensors, orientation, tuple(poses), tuple(sd.tolist()), residual, tuple(notes)
    )


def _poses(run: Run, rig: BicycleFile) -> list[Pose]:
    """Stretches of `run` in which gyroscope and accelerometer show their noise only, and no wheel turns."""
    columns = ["t", *(f"imu.{q}" for q in IMU_QUANTITIES)]
    missing = [c for c in columns if c not in run.table]
    if missing:
        raise IdentificationError(f"{run.path.name}: holds no {', '.join(missing)}")
    imu = run.table[columns].dropna().to_numpy(dtype=float)
    t, values = imu[:, 0], imu[:, 1:]
    if len(t) < 2:
        raise IdentificationError(
            f"{run.path.name}: holds {len(t)} instants with all of {', '.join(columns[1:])}: were gyroscope "
            "and accelerometer stamped apart?"
        )
    felt = float(np.median(np.linalg.norm(values[:, 3:], axis=1)))
    if not ACCEL_NORM[0] < felt < ACCEL_NORM[1]:
        raise IdentificationError(
            f"{run.path.name}: the accelerometer feels {felt:.4g} m/s² and not gravity: is it in g, or is "
            "gravity taken off?"
        )
    step_s = float(np.median(np.diff(t)))
    width = max(int(WINDOW_S / step_s), 4)
    count = len(t) // width
    if count < 4:
        return []
    blocks = values[: count * width].reshape(count, width, 6)
    gyro = max(np.hypot(rig.noise.gyro, rig.noise.gyro_step / np.sqrt(12.0)), LEAST_GYRO)
    limits = np.repeat([STILL_GYRO * gyro, STILL_ACCEL * max(rig.noise.accel, LEAST_ACCEL)], 3)
    still = (blocks.std(axis=1) < limits).all(axis=1)
    means = blocks.mean(axis=1)
    out: list[Pose] = []
    k = 0
    while k < count:
        end = k
        while end < count and still[end] and _angle(means[end, 3:], means[k, 3:]) < 0.5 * NEW_POSE:
            end += 1
        if (end - k) * width * step_s >= SHORTEST_S:
            part = slice(k * width, end * width)
            span = (float(t[part][0]), float(t[part][-1]))
            mean = values[part].mean(axis=0)
            if not _rolls(run, rig, *span):
                lean, steer = (_mean(run, s, *span) for s in ("lean", "steer"))
                name = f"{run.path.name} at {span[0]:.1f} s"
                size = part.stop - part.start
                out.append(Pose(name, *span, lean, steer, mean[:3], mean[3:], size))
        k = max(end, k + 1)
    return out


def _rolls(run: Run, rig: BicycleFile, start_s: float, end_s: float) -> bool:
    """Whether the rear wheel turns in a stretch; where nobody measured it, it is believed to rest."""
    if "rear_wheel" not in run.table:
        return False
    t = run.table["t"].to_numpy(dtype=float)
    angle = run.table["rear_wheel"].to_numpy(dtype=float)
    inside = angle[(t >= start_s) & (t <= end_s) & ~np.isnan(angle)]
    return bool(inside.size and np.ptp(inside) > _rest(rig))


def _ridden(run: Run, rig: BicycleFile, poses: list[Pose]) -> str:
    """What is to be said of a run that is a ride: its speed and what of it was used; empty if it is none."""
    if "rear_wheel" not in run.table:
        return ""
    rolled = run.table[["t", "rear_wheel"]].dropna().to_numpy(dtype=float)
    t, angle = rolled.T
    seconds = np.arange(t[0], t[-1], SHORTEST_S) if len(t) else t
    if len(seconds) < 2:
        return ""
    fastest = (
        rig.geometry.R * float(np.max(np.abs(np.diff(np.interp(seconds, t, angle))))) / SHORTEST_S
    )
    if fastest < RIDDEN_M_S:
        return ""
    mine = [p for p in poses if p.name.startswith(f"{run.path.name} at ")]
    used = sum(p.end_s - p.start_s for p in mine)
    return (
        f"warning: {run.path.name} is a ride at up to {fastest:.1f} m/s and no static pose: of its "
        f"{t[-1] - t[0]:.0f} s only the {used:.1f} s were used in which it stands; hold it upright and "
        "straight there, or record poses"
    )


def _rest(rig: BicycleFile) -> float:
    """rad by which a wheel at rest seems to turn."""
    return ROLLED * rig.noise.rear_wheel_step + ROLLED_NOISE * rig.noise.rear_wheel


def _mean(run: Run, signal: str, start_s: float, end_s: float) -> float:
    if signal not in run.table:
        raise IdentificationError(f"{run.path.name}: holds no {signal}")
    t = run.table["t"].to_numpy(dtype=float)
    values = run.table[signal].to_numpy(dtype=float)
    inside = (t >= start_s) & (t <= end_s) & ~np.isnan(values)
    if not inside.any():
        raise IdentificationError(
            f"{run.path.name}: holds no {signal} while it rests at {start_s:.1f} s"
        )
    return float(values[inside].mean())


def _distinct(poses: list[Pose]) -> list[Pose]:
    out: list[Pose] = []
    for p in poses:
        if all(_angle(p.accel, o.accel) > NEW_POSE for o in out):
            out.append(p)
    return out


def straightened(accel: Array, z: Array) -> Array:
    """(N, 3) specific forces with bias z[:3], scale z[3:6] and cross terms z[6:] taken out."""
    out = (accel - z[:3]) / z[3:6]
    out[:, 0] += z[6] * out[:, 1] + z[7] * out[:, 2]
    out[:, 1] += z[8] * out[:, 2]
    return np.asarray(out)


def fit_accelerometer(
    accel: Array, start: Sensors, g: float, sigma: float
) -> tuple[Array, Array, float]:
    """Bias, scale, cross terms (9,) of poses (N, 3), their standard deviations, what |a| is off g by.

    `sigma`: of a pose's mean, m/s2; what drifts does not average out. Model: "A Robust and Easy to
    Implement Method for IMU Calibration without External Equipments" (Tedaldi et al. 2014).
    """
    first = np.array([*start.accel_bias, *start.accel_scale, *start.accel_cross])
    prior = np.repeat([BIAS_PRIOR, SCALE_PRIOR, CROSS_PRIOR], 3)

    def off(z: Array) -> Array:
        size = np.linalg.norm(straightened(accel, z), axis=1) - g
        return np.concatenate([size / sigma, (z - first) / prior])

    found = least_squares(off, first, x_scale=prior)
    J = np.asarray(found.jac)
    sd = np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
    left = off(found.x)[: len(accel)] * sigma
    return np.asarray(found.x), np.asarray(sd), float(np.sqrt(np.mean(left**2)))


def _orientation(down: Array, rig: BicycleFile) -> tuple[tuple[float, float, float], float]:
    """Roll, pitch, yaw of the sensor with which upright gravity is where it was felt, and how far it turned.

    The smallest turn from the file's orientation that does it: a turn about the vertical is none.
    """
    assert rig.imu is not None
    R = rotation(*rig.imu.orientation)
    felt = R @ (down / np.linalg.norm(down))  # in the frame's axes, if the file were right
    axis = np.cross(felt, [0.0, 0.0, 1.0])
    size = float(np.linalg.norm(axis))
    turned = float(np.arctan2(size, felt[2]))
    if size > 1e-12:
        x, y, z = axis / size
        K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        R = (np.eye(3) + np.sin(turned) * K + (1.0 - np.cos(turned)) * K @ K) @ R
    roll = float(np.arctan2(R[2, 1], R[2, 2]))
    pitch = float(-np.arcsin(np.clip(R[2, 0], -1.0, 1.0)))
    yaw = float(np.arctan2(R[1, 0], R[0, 0]))
    return (roll, pitch, yaw), turned


def _angle(a: Array, b: Array) -> float:
    cosine = float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _three(values: Array) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z
