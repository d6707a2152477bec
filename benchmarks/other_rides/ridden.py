"""A body ridden along a plan: what is true of lean, wheel, steer and of the motion at the IMU."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from benchmarks.other_rides.balance import Balance, balanced
from benchmarks.other_rides.body import Body
from benchmarks.other_rides.frames import column, turn_x
from benchmarks.other_rides.kinematics import UP, Course, Motion, Shape
from benchmarks.other_rides.plan import LEAD_S, Plan, plan
from benchmarks.other_rides.road import floor, under
from benchmarks.other_rides.travel import deflection
from hil.config import BicycleFile
from hil.rigs.bicycle import canonical, pack

Array = NDArray[np.float64]

PLAN_S: Final = 0.004
FINE_S: Final = 0.002
SLIP_N: Final = 150.0
"""Driving force at which the rear wheel slips twice as much as rolling free, braking not at all."""
ROLLING_N: Final = 5.0
SIDE_M_S2: Final = 0.5
PUSH_N: Final = 40.0
"""Where play of headset or axle has gone to its stop, nearly."""
SWAYS_HZ: Final = (0.1, 0.8)
GUSTS_HZ: Final = (0.05, 0.6)


@dataclass(frozen=True, slots=True)
class Ride:
    """A plan and the chance of this ride: the same for every body that rides it."""

    plan: Plan
    floor: Array
    restless: Array
    """Unit rms, at the plan's instants."""
    gusts: Array
    phase: float

    @property
    def duration_s(self) -> float:
        """Of the record."""
        return float(self.plan.t_s[-1]) - 0.4


@dataclass(frozen=True, slots=True)
class Truth:
    """What holds at t_s (N,): the coordinates, rad, and (6, N) rates and specific force at the IMU."""

    t_s: Array
    lean: Array
    wheel: Array
    """As an encoder on the frame sees it."""
    steer: Array
    imu: Array
    speed: Array
    """Rolling speed on a wheel of the rig file's size, m/s."""


def draw_ride(kind: str, rng: np.random.Generator, rig: BicycleFile, body: Body) -> Ride:
    """One ride of a kind with all its chance."""
    planned = plan(kind, rng, PLAN_S, rig.mass.gravity)
    length = 1.2 * float(planned.speed.sum()) * PLAN_S + 5.0
    heights = floor(rng, length, body.roughness_m3)
    restless = _band(rng, planned.t_s, SWAYS_HZ)
    gusts = _band(rng, planned.t_s, GUSTS_HZ)
    return Ride(planned, heights, restless, gusts, float(rng.uniform(0.0, 2.0 * np.pi)))


def steered(rig: BicycleFile, body: Body, ride: Ride) -> Balance:
    """The steer that this body needs for the planned lean."""
    p = ride.plan
    shape = Shape.of(rig, body.rear_scale, body.front_scale)
    speed = p.speed * body.rear_scale * (1.0 - body.slip)
    restless, wind = body.restless_rad * ride.restless, body.gusts_n * ride.gusts
    linear = canonical(pack(rig))
    return balanced(rig, shape, linear, p.dt_s, p.lean, speed, body.hold, restless, wind)


def ridden(rig: BicycleFile, body: Body, ride: Ride, steer: Array) -> Truth:
    """The truth of a ride whose steer (at the plan's instants) is known."""
    p, g = ride.plan, rig.mass.gravity
    t = np.arange(p.t_s[0], p.t_s[-1], FINE_S)
    lean, angle, rolling = (CubicSpline(p.t_s, v)(t) for v in (p.lean, steer, p.speed))
    shape = Shape.of(rig, body.rear_scale, body.front_scale)
    wheel = np.cumsum(rolling) * FINE_S / rig.geometry.R
    across = -g * np.tan(lean)
    gain = np.gradient(rolling, FINE_S)
    push = sum(rig.mass.m) * gain + rig.aero * rolling**2 + ROLLING_N
    crowned = 1.0 - body.crown_m * (1.0 - np.cos(lean)) / rig.geometry.R
    speed = rolling * body.rear_scale * crowned * (1.0 - body.slip * (1.0 + push / SLIP_N))
    speed = speed * (1.0 + body.runout_m[0] / rig.geometry.R * np.cos(wheel + ride.phase))
    roads = _roads(body, ride, shape, rolling, wheel)
    ahead, weight = _loads(rig, Motion(shape, Course(FINE_S, lean, angle, speed)))
    give = deflection(rig, body.springs, FINE_S, ahead, speed, weight, roads)
    play = -body.headset_play * np.tanh(across / SIDE_M_S2)
    knock = -0.1 * body.headset_play * np.tanh(push / PUSH_N)
    course = Course(
        FINE_S,
        lean,
        angle - body.flex * across + play,
        speed,
        roads[0],
        roads[1],
        give.rear,
        give.front,
        give.travel + knock,
        speed * (body.axle_play * np.tanh(push / PUSH_N) - body.side_slip[0] * across),
        -speed * body.side_slip[1] * across,
    )
    motion = Motion(shape, course)
    return Truth(t, lean, wheel - motion.pitch, angle, motion.imu(), rolling)


def ideal(rig: BicycleFile, truth: Truth, lean_off: float = 0.0, steer_off: float = 0.0) -> Array:
    """(6, N): what the rigid model of the rig file makes of the same coordinates, read with errors."""
    course = Course(FINE_S, truth.lean + lean_off, truth.steer + steer_off, truth.speed)
    return Motion(Shape.of(rig), course).imu()


def _loads(rig: BicycleFile, rigid: Motion) -> tuple[Array, Array]:
    """What presses on tyres and fork, of the body that has nearly all the mass: its acceleration ahead,
    and along the leaning plane what it feels above its weight, m/s2."""
    moving = rigid.velocity(rigid.place(column(*rig.mass.G3)))
    felt = turn_x(-rigid.course.lean, rigid.absolute_rate(moving) + rigid.shape.gravity * UP)
    return felt[0], felt[2] - rigid.shape.gravity


def _roads(
    body: Body, ride: Ride, shape: Shape, rolling: Array, wheel: Array
) -> tuple[Array, Array]:
    """Heights under rear and front wheel: floor, hill, and the wheels' own lack of roundness.

    By the distance rolled on wheels of the rig file's size: a wheel's size does not change what it meets.
    """
    distance = np.cumsum(rolling) * FINE_S
    steep, length = body.slope
    out = []
    for k, ahead in enumerate((0.0, shape.wheelbase)):
        there = distance + ahead
        hill = steep * length / (2.0 * np.pi) * (1.0 - np.cos(2.0 * np.pi * there / length))
        turn = wheel + ride.phase + 1.3 * k
        out.append(under(ride.floor, there) + hill + body.runout_m[k] * np.cos(turn))
    return out[0], out[1]


def _band(rng: np.random.Generator, t_s: Array, hz: tuple[float, float]) -> Array:
    """Noise of unit rms in a band, that fades in while the record has not begun."""
    sections = butter(2, hz, btype="band", fs=1.0 / (t_s[1] - t_s[0]), output="sos")
    out = sosfiltfilt(sections, rng.standard_normal(len(t_s)))
    return np.asarray(out / out.std() * np.clip((t_s - t_s[0]) / (0.5 * LEAD_S), 0.0, 1.0))
