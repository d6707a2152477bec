"""One bicycle of the exam as it really is: its file scattered a little everywhere, effects put in, ridden.

The scatter is what a healthy bicycle is off its file by [R]: too little for a finding, enough that no model
is ever right. Tyres always give way a little, riders always sway.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.bicycle.manoeuvres import Manoeuvre
from hil.bicycle.path import SPACING_M, speed_profile
from hil.config import BicycleFile, Effect
from hil.exam.rides.forward import LOCKED, ride_on
from hil.exam.world import Outside, Scatter
from hil.exam.world.play import WorldError
from hil.rigs.bicycle.parameters import ROLLING, Packed, pack, rotation
from hil.rigs.bicycle.ride import static_load

Array = NDArray[np.float64]

STEP_S: Final = 0.001
FIRM_TYRE: Final = (1.2e6, 3000.0)
"""N/m and N s/m of a tyre that is no finding."""
TRAVEL_M: Final = 0.07
"""Over which a fork's stiffness doubles."""
SEAL_N: Final = 6.0
STIFF_BACK: Final = 2e5
"""N m/rad of a rider who leans as told and no further."""
SWAY: Final = 0.5
"""N m of lean torque that a rider's breathing and pedalling make, rms."""
MOVES: Final = frozenset({"front_suspension", "tyre_compliance", "rider_motion", "wheel_radius",
                          "wheel_slip"})  # fmt: skip
"""Effects that change how the bicycle moves; all others are the sensors'."""


@dataclass(frozen=True, slots=True)
class Bicycle:
    """A nominal file, what is off it, effects and what no catalogue names."""

    rig: BicycleFile
    scatter: Scatter
    effects: tuple[Effect, ...] = ()
    outside: tuple[Outside, ...] = ()

    def values(self, effect: str, location: str) -> dict[str, float]:
        """Parameters of an effect at a place; empty where it has none."""
        out: dict[str, float] = {}
        for e in self.effects:
            if (e.effect, e.location) == (effect, location):
                out.update(e.parameters)
        return out

    def size(self, kind: str) -> Mapping[str, float]:
        """Parameters of an effect from outside the catalogue; empty where it is not there."""
        return next((o.parameters for o in self.outside if o.kind == kind), {})

    @property
    def moving(self) -> Bicycle:
        """The same without what only its sensors have: equal ones ride alike."""
        return Bicycle(
            self.rig, self.scatter, tuple(e for e in self.effects if e.effect in MOVES),
            tuple(o for o in self.outside if o.kind == "side_wind"),
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Ridden:
    """What happened, every STEP_S."""

    t_s: Array
    q: Array
    """(N, 12)."""
    qd: Array
    imu: Array
    """(N, 6) at the sensor as it is mounted, before its filter."""


def ride(bicycle: Bicycle, manoeuvre: Manoeuvre, seed: int) -> Ridden:
    """Ride it; WorldError where it falls. `seed`: of this ride's rider and wind."""
    key = _key(bicycle.moving)
    return _ride(key, bicycle.rig.model_dump_json(), manoeuvre, seed)


def _key(b: Bicycle) -> tuple[Any, ...]:
    lines = [(e.effect, e.location, tuple(sorted(e.parameters.items()))) for e in b.effects]
    odd = [(o.kind, o.location, tuple(sorted(o.parameters.items()))) for o in b.outside]
    return b.scatter, tuple(lines), tuple(odd)


@functools.lru_cache(maxsize=4)
def _ride(key: tuple[Any, ...], rig_json: str, manoeuvre: Manoeuvre, seed: int) -> Ridden:
    """Effects of sensors are tried on one ride after another: it is computed once."""
    scatter, lines, odd = key
    rig = BicycleFile.model_validate_json(rig_json)
    effects = tuple(Effect(effect=e, location=at, parameters=dict(p)) for e, at, p in lines)
    outside = tuple(Outside(kind, at, dict(p)) for kind, at, p in odd)
    bicycle = Bicycle(rig, scatter, effects, outside)
    rng = np.random.default_rng([scatter.seed, 81])
    rider = np.random.default_rng([seed, 82])
    packed = _scattered(rig, rng, scatter.size)
    load = static_load(packed.p, packed.body, packed.extra, False)
    p, slip = _wheels(bicycle, packed.p, rng)
    laws = (*_springs(bicycle, rng), _rider(bicycle, rng))
    path = manoeuvre.path()
    pace = rider.uniform(0.95, 1.05)
    speeds = speed_profile(
        path, STEP_S, pace * manoeuvre.cruise, pace * manoeuvre.turning,
        vigour=manoeuvre.vigour * rider.uniform(0.9, 1.1),
    )  # fmt: skip
    rows = path.rows.copy()
    rows[:, 3] += 0.004 * smooth_noise(rider, len(rows), round(3.0 / SPACING_M))
    pushed = SWAY * smooth_noise(rider, len(speeds), 400)
    if wind := bicycle.size("side_wind"):
        pushed = pushed + wind["torque"] * smooth_noise(
            rider, len(speeds), round(wind["s"] / STEP_S)
        )
    gains = np.array(
        [SPACING_M, 0.01, 0.2, rider.uniform(3.6, 4.4), 60.0 * rider.uniform(0.9, 1.2),
         6.0 * rider.uniform(0.9, 1.2), sum(rig.mass.m) * rig.geometry.R, rider.uniform(0.5, 0.7)]
    )  # fmt: skip
    out = (np.zeros((len(speeds), 12)), np.zeros((len(speeds), 12)), np.zeros((len(speeds), 6)))
    parts = (p, packed.body, packed.extra, packed.sensor)
    fell = ride_on(parts, laws, load, rows, speeds, gains, pushed, slip, STEP_S, out)
    if fell >= 0:
        raise WorldError(f"{rig.name}: the rider of the exam fell after {fell * STEP_S:.1f} s")
    return Ridden(np.asarray(STEP_S * np.arange(len(speeds))), *out)


def _scattered(rig: BicycleFile, rng: np.random.Generator, size: float) -> Packed:
    """The bicycle a little off its file, by up to `size` times as much: masses 0.7 %, places 2 mm, inertia
    2 %, the IMU as it was screwed on."""
    packed = pack(rig)
    p, body, extra = packed.p.copy(), packed.body.copy(), packed.extra.copy()

    def off(spread: float, *shape: int) -> Any:
        return size * spread * rng.uniform(-1.0, 1.0, shape or None)

    p[:2] *= 1.0 + float(off(0.002))
    p[ROLLING] = p[0]
    turn = float(off(0.002))
    p[3], p[4] = np.sin(rig.geometry.tilt + turn), np.cos(rig.geometry.tilt + turn)
    p[7:11] += off(0.002, 4)
    body[:, 0] *= 1.0 + off(0.007, 4)
    body[:, 1:] *= 1.0 + off(0.02, 4, 1)
    extra[1] *= 1.0 + off(0.1)
    extra[2:] += off(0.002, 3)
    sensor = rotation(*off(0.003, 3)).T @ packed.sensor
    return Packed(p, body, extra, np.ascontiguousarray(sensor), packed.encoder_on_frame)


def _wheels(b: Bicycle, p: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Geometry with the wheels as they are, and the slip: share, what of it varies, over how many m; the
    rider's delay stands beside it."""
    p = p.copy()
    p[0] *= b.values("wheel_radius", "rear_wheel").get("scale", 1.0)
    p[1] *= b.values("wheel_radius", "front_wheel").get("scale", 1.0)
    lost = b.values("wheel_slip", "rear_wheel").get("coefficient", 0.0)
    p[ROLLING] = p[0] * (1.0 - lost)
    return p, np.array([lost, rng.uniform(0.1, 0.3), rng.uniform(0.5, 1.5), rng.uniform(0.08, 0.2)])


def _springs(b: Bicycle, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Laws of fork, rear and front tyre."""
    fork = b.values("front_suspension", "bicycle")
    c = fork.get("damping", 500.0)
    skew = rng.uniform(1.1, 1.6)
    law = [
        fork.get("stiffness", 10.0 * LOCKED),
        TRAVEL_M * rng.uniform(0.8, 1.4),
        2.0 * c / (1.0 + skew),
        2.0 * c * skew / (1.0 + skew),
        SEAL_N * rng.uniform(0.5, 1.5),
    ]
    tyre = b.values("tyre_compliance", "bicycle")
    stiff = tyre.get("stiffness", FIRM_TYRE[0] * rng.uniform(0.8, 1.5))
    damping = tyre.get("damping", 200.0) if tyre else FIRM_TYRE[1]
    power = rng.uniform(1.1, 1.4)
    part = rng.uniform(0.95, 1.05)
    rear = np.array([stiff * part, power, damping])
    return np.array(law), rear, np.array([stiff / part, power, damping])


def _rider(b: Bicycle, rng: np.random.Generator) -> Array:
    told = b.values("rider_motion", "bicycle")
    if not told:
        return np.zeros(8)
    r = b.rig.rider
    stiffness = told.get("stiffness", STIFF_BACK)
    return np.array(
        [
            r.mass * (1.0 + 0.03 * rng.uniform(-1.0, 1.0)), r.pivot[2] + b.rig.geometry.R, r.height,
            r.inertia, stiffness if np.isfinite(stiffness) else STIFF_BACK,
            told.get("damping", 100.0), told.get("gain", 0.0), r.pivot[0],
        ]
    )  # fmt: skip


def smooth_noise(rng: np.random.Generator, count: int, width: int) -> Array:
    """Noise of unit variance that changes over `width` samples."""
    window = np.hanning(2 * width + 1)
    noise = np.convolve(rng.standard_normal(count + 2 * width), window, "valid")
    return np.asarray(noise / np.sqrt(np.sum(window**2)))
