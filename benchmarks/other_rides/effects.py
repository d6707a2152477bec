"""The catalogue's effects on a bicycle, each with a law of its own and bounds of what is sane."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from benchmarks.other_rides.balance import Hold
from benchmarks.other_rides.bicycle import Bicycle, Outing
from benchmarks.other_rides.body import Body
from benchmarks.other_rides.fault import Fault, Parameters, of_body, of_channels
from benchmarks.other_rides.ridden import PLAN_S, ROLLING_N, SLIP_N
from benchmarks.other_rides.sensing import ACCEL, GYRO, IMU, Channel
from hil.config import BicycleFile

Maker = Callable[[str, np.random.Generator], Fault]

FRONT_LOAD_KG: Final = 25.0
"""What a fork's spring carries, roughly."""
TYRE_LOAD_KG: Final = 45.0
BIAS: Final = {
    "lean": (0.004, 0.06), "steer": (0.004, 0.06),
    **dict.fromkeys(GYRO, (0.004, 0.12)), **dict.fromkeys(ACCEL, (0.08, 2.0)),
}  # fmt: skip
SCALE: Final = {
    "lean": (0.03, 0.4), "rear_wheel": (0.01, 0.08), "steer": (0.02, 0.3),
    **dict.fromkeys(GYRO, (0.01, 0.4)), "imu.accel_x": (0.02, 0.4),
    "imu.accel_z": (0.008, 0.2),
}  # fmt: skip
"""Not of `imu.accel_y`: a bicycle in balance feels next to nothing across, whatever the scale."""
LATENCY: Final = {
    "lean": (0.01, 0.25), "rear_wheel": (0.01, 0.15), "steer": (0.006, 0.15), "imu": (0.004, 0.15)
}  # fmt: skip
STEP: Final = {
    "lean": (0.004, 0.035), "rear_wheel": (0.01, 0.2), "steer": (0.008, 0.06),
    **dict.fromkeys(GYRO, (0.01, 0.15)), **dict.fromkeys(ACCEL, (0.15, 1.5)),
}  # fmt: skip
PLACES: Final = {
    "front_suspension": ("bicycle",),
    "tyre_compliance": ("bicycle",),
    "wheel_radius": ("rear_wheel", "front_wheel"),
    "wheel_slip": ("rear_wheel",),
    "rider_motion": ("bicycle",),
    "sensor_bias": tuple(BIAS),
    "sensor_scale": tuple(SCALE),
    "sensor_latency": tuple(LATENCY),
    "sensor_misalignment": ("imu",),
    "sensor_quantisation": tuple(STEP),
    "clock_drift": ("imu",),
}
CALIBRATED: Final = (
    "wheel_radius", "wheel_slip", "sensor_bias", "sensor_scale", "sensor_latency", "sensor_misalignment"
)  # fmt: skip
"""What a calibration on the same ride may take for its own: these need a healthy ride beside."""
PHYSICAL: Final = tuple(PLACES)[:5]
OF_SENSORS: Final = tuple(PLACES)[5:]


def make(effect: str, place: str, rng: np.random.Generator) -> Fault:
    """The fault of a catalogue's effect at a place; `rng` draws signs and what its law leaves open."""
    return _MAKERS[effect](place, rng)


def _front_suspension(place: str, rng: np.random.Generator) -> Fault:
    ratio, friction = float(rng.uniform(0.2, 0.5)), float(rng.uniform(1.0, 4.0))
    progress = float(rng.uniform(3.0, 10.0))

    def law(size: float) -> tuple[float, float]:
        return 1.0 / size, 2.0 * ratio * float(np.sqrt(FRONT_LOAD_KG / size))

    def on(body: Body, size: float) -> Body:
        stiffness, damping = law(size)
        fork = replace(
            body.springs,
            fork=stiffness,
            fork_damping=damping,
            fork_progress=progress,
            fork_friction=friction,
        )
        return replace(body, springs=fork)

    def parameters(size: float, *_: object) -> Parameters:
        return dict(zip(("stiffness", "damping"), law(size), strict=True))

    note = f"stick friction {friction:.2f} N, stiffness grows by {progress:.2f} /m of travel"
    return Fault("front_suspension", place, 1 / 5e4, 1 / 3e3, of_body(on), parameters, note)


def _tyre_compliance(place: str, rng: np.random.Generator) -> Fault:
    ratio, progress = float(rng.uniform(0.06, 0.12)), float(rng.uniform(8.0, 20.0))

    def law(size: float) -> tuple[float, float]:
        return 1.0 / size, 2.0 * ratio * float(np.sqrt(TYRE_LOAD_KG / size))

    def on(body: Body, size: float) -> Body:
        stiffness, damping = law(size)
        soft = replace(body.springs, tyre=stiffness, tyre_damping=damping, tyre_progress=progress)
        return replace(body, springs=soft)

    def parameters(size: float, *_: object) -> Parameters:
        return dict(zip(("stiffness", "damping"), law(size), strict=True))

    note = f"both tyres; stiffness grows by {progress:.1f} /m of squash"
    return Fault("tyre_compliance", place, 1 / 7e4, 1 / 2e4, of_body(on), parameters, note)


def _wheel_radius(place: str, rng: np.random.Generator) -> Fault:
    sign, key = _sign(rng), "rear_scale" if place == "rear_wheel" else "front_scale"
    most = 0.08 if place == "rear_wheel" else 0.14

    def on(body: Body, size: float) -> Body:
        return replace(body, **{key: getattr(body, key) * (1.0 + sign * size)})

    def parameters(size: float, *_: object) -> Parameters:
        return {"scale": 1.0 + sign * size}

    return Fault("wheel_radius", place, 0.01, most, of_body(on), parameters)


def _wheel_slip(place: str, _rng: np.random.Generator) -> Fault:
    def on(body: Body, size: float) -> Body:
        return replace(body, slip=size)

    def parameters(
        size: float, rig: BicycleFile, _faulty: Bicycle, outings: list[Outing]
    ) -> Parameters:
        """The share of the rolled distance that was lost."""
        rolled = lost = 0.0
        for outing in outings:
            p = outing.ride.plan
            speed = p.speed[p.t_s >= 0.0]
            push = sum(rig.mass.m) * np.gradient(speed, PLAN_S) + rig.aero * speed**2 + ROLLING_N
            rolled += float(speed.sum())
            lost += float((speed * size * (1.0 + push / SLIP_N)).sum())
        return {"coefficient": lost / rolled}

    note = f"slip = size x (1 + driving force / {SLIP_N:.0f} N)"
    return Fault("wheel_slip", place, 0.01, 0.09, of_body(on), parameters, note)


def _rider_motion(place: str, rng: np.random.Generator) -> Fault:
    stiffness, damping = float(rng.uniform(500.0, 1500.0)), float(rng.uniform(40.0, 120.0))

    def on(body: Body, size: float) -> Body:
        return replace(body, hold=Hold(stiffness, damping, size))

    def parameters(size: float, *_: object) -> Parameters:
        return {"stiffness": stiffness, "damping": damping, "gain": size}

    note = "size is the gain: upper body against the lean"
    return Fault("rider_motion", place, 0.03, 1.0, of_body(on), parameters, note)


def _bias(place: str, rng: np.random.Generator) -> Fault:
    sign = _sign(rng)

    def off(c: Channel, size: float) -> Channel:
        return replace(c, offset=c.offset + sign * size)

    def parameters(size: float, *_: object) -> Parameters:
        return {"offset": sign * size}

    return Fault("sensor_bias", place, *BIAS[place], of_channels((place,), off), parameters)


def _scale(place: str, rng: np.random.Generator) -> Fault:
    sign = _sign(rng)

    def scaled(c: Channel, size: float) -> Channel:
        return replace(c, scale=c.scale * (1.0 + sign * size))

    def parameters(size: float, *_: object) -> Parameters:
        return {"scale": 1.0 + sign * size}

    return Fault("sensor_scale", place, *SCALE[place], of_channels((place,), scaled), parameters)


def _latency(place: str, _rng: np.random.Generator) -> Fault:
    def late(c: Channel, size: float) -> Channel:
        return replace(c, delay_s=c.delay_s + size)

    def parameters(size: float, *_: object) -> Parameters:
        return {"delay": size}

    signals = IMU if place == "imu" else (place,)
    return Fault("sensor_latency", place, *LATENCY[place], of_channels(signals, late), parameters)


def _misalignment(place: str, rng: np.random.Generator) -> Fault:
    direction = rng.standard_normal(3)
    direction /= np.linalg.norm(direction)

    def on(b: Bicycle, size: float) -> Bicycle:
        x, y, z = (size * direction).tolist()
        return replace(b, sensing=replace(b.sensing, misaligned=(x, y, z)))

    def parameters(size: float, *_: object) -> Parameters:
        return dict(zip("xyz", (size * direction).tolist(), strict=True))

    return Fault("sensor_misalignment", place, 0.006, 0.2, on, parameters)


def _quantisation(place: str, _rng: np.random.Generator) -> Fault:
    def coarse(c: Channel, size: float) -> Channel:
        return replace(c, step=size)

    def parameters(size: float, *_: object) -> Parameters:
        return {"step": size}

    return Fault(
        "sensor_quantisation", place, *STEP[place], of_channels((place,), coarse), parameters
    )


def _clock_drift(place: str, rng: np.random.Generator) -> Fault:
    sign = _sign(rng)

    def on(b: Bicycle, size: float) -> Bicycle:
        return replace(b, sensing=replace(b.sensing, clock=b.sensing.clock + sign * size))

    def parameters(size: float, *_: object) -> Parameters:
        return {"rate": sign * size}

    return Fault("clock_drift", place, 1e-4, 6e-3, on, parameters)


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


_MAKERS: Final[dict[str, Maker]] = {
    "front_suspension": _front_suspension,
    "tyre_compliance": _tyre_compliance,
    "wheel_radius": _wheel_radius,
    "wheel_slip": _wheel_slip,
    "rider_motion": _rider_motion,
    "sensor_bias": _bias,
    "sensor_scale": _scale,
    "sensor_latency": _latency,
    "sensor_misalignment": _misalignment,
    "sensor_quantisation": _quantisation,
    "clock_drift": _clock_drift,
}
