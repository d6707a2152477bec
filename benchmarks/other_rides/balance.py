"""The steer that keeps a ridden bicycle in balance, and how its rider's upper body sways.

A rider who wants a lean has to steer for it. Forces of the road act on the line through both contacts, so
that the moment of all inertia and weight about this line must vanish; the steer is corrected until it
does. The upper body is a pendulum on the frame, held by springs, and may lean against the turn by itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded

from benchmarks.other_rides.frames import column, cross, dot, rate, turn_x
from benchmarks.other_rides.kinematics import UP, Course, Motion, Shape
from hil.config import BicycleFile
from hil.rigs.bicycle import Canonical

Array = NDArray[np.float64]

ROUNDS: Final = 5
"""Corrections; what is left is about 0.01 N m rms of the moments."""


@dataclass(frozen=True, slots=True)
class Hold:
    """How the rider's upper body is held: N m/rad, N m s/rad, and counter-lean over lean."""

    stiffness: float
    damping: float
    gain: float = 0.0


@dataclass(frozen=True, slots=True)
class Balance:
    """Result: steer and the upper body's lean against the frame (right positive), rad; N m left over."""

    steer: Array
    sway: Array
    left_over: Array


def balanced(
    rig: BicycleFile,
    shape: Shape,
    linear: Canonical,
    dt_s: float,
    lean: Array,
    speed: Array,
    hold: Hold,
    restless: Array,
    wind: Array,
) -> Balance:
    """The steer for a lean at a speed.

    `linear` only says which way and how far to correct. `restless`: sway that nothing asks for, rad;
    `wind`: N to the left at the rider's chest.
    """
    steer, sway, moment = np.zeros_like(lean), np.zeros_like(lean), np.zeros_like(lean)
    mass, damping = linear.M[0, 1], speed * linear.C1[0, 1]
    stiffness = linear.g * linear.K0[0, 1] + speed**2 * linear.K2[0, 1]
    stiffness = stiffness + rate(speed, dt_s) * linear.C1[0, 1]
    for _ in range(ROUNDS):
        motion = Motion(shape, Course(dt_s, lean, steer, speed))
        sway = restless + _swaying(rig, motion, hold)
        moment = _moment(rig, motion, sway, wind)
        steer = steer + second_order(dt_s, mass, damping, stiffness, moment)
    return Balance(steer, sway, moment)


def second_order(
    dt_s: float, mass: float, damping: Array | float, stiffness: Array | float, force: Array
) -> Array:
    """y from rest with mass y'' + damping y' + stiffness y = force, coefficients (N,) or numbers."""
    n = len(force)
    b, c = np.broadcast_to(damping, n), np.broadcast_to(stiffness, n)
    bands = np.zeros((3, n))  # main diagonal and the two below: each row gives the next y
    bands[0, 0] = 1.0
    bands[0, 1:] = (mass / dt_s**2 + b / (2.0 * dt_s) + c / 4.0)[:-1]
    bands[1, :-1] = (c / 2.0 - 2.0 * mass / dt_s**2)[:-1]
    bands[2, :-2] = (mass / dt_s**2 - b / (2.0 * dt_s) + c / 4.0)[1:-1]
    return np.asarray(solve_banded((2, 0), bands, np.concatenate([[0.0], force[:-1]])))


def _swaying(rig: BicycleFile, motion: Motion, hold: Hold) -> Array:
    """Lean of the upper body against the frame, to first order in it."""
    r, g = rig.rider, rig.mass.gravity
    arm = motion.frame(column(0.0, 0.0, r.height))
    centre = motion.place(column(*r.pivot)) + arm
    felt = motion.absolute_rate(motion.velocity(centre)) + g * UP
    forward = motion.frame(column(1.0, 0.0, 0.0))
    rolling = dot(forward, motion.absolute_rate(motion.spin()))
    asked = dot(forward, cross(arm, r.mass * felt)) + r.inertia * rolling
    upward = r.mass * dot(arm, felt)
    held = hold.stiffness * hold.gain * motion.course.lean
    return second_order(
        motion.dt_s,
        r.inertia + r.mass * r.height**2,
        hold.damping,
        hold.stiffness - upward,
        -held - asked,
    )


def _moment(rig: BicycleFile, motion: Motion, sway: Array, wind: Array) -> Array:
    """About the line through both contacts, to the right: what would have to hold the bicycle, N m."""
    m, shape = rig.mass, motion.shape
    g4 = shape.head + motion.fork(column(*m.G4) - shape.head)
    places = (
        motion.axle,
        motion.place(column(*m.G3)),
        motion.axle + motion.frame(g4),
        motion.front_axle,
    )
    total = sum(
        _inertial(motion, mass, place) for mass, place in zip(m.m, places, strict=True)
    ) + motion.absolute_rate(_angular_momentum(rig, motion))
    total = total + _swayed(rig, motion, sway)
    body = motion.velocity(places[1])
    drag = -rig.aero * np.sqrt(dot(body, body)) * body
    blown = np.stack([0.0 * wind, wind, 0.0 * wind])
    total = total - cross(places[1], drag + blown)
    line = motion.contact / np.sqrt(dot(motion.contact, motion.contact))
    return dot(line, total)


def _inertial(motion: Motion, mass: float, place: Array) -> Array:
    """Moment about the rear contact of one body's inertia and weight."""
    felt = motion.absolute_rate(motion.velocity(place)) + motion.shape.gravity * UP
    return mass * cross(place, felt)


def _angular_momentum(rig: BicycleFile, motion: Motion) -> Array:
    """Of all bodies about their own centres, (3, N)."""
    m, lean, still = rig.mass, motion.course.lean, 0.0 * motion.yaw_rate
    leaning = np.stack([rate(lean, motion.dt_s), still, motion.yaw_rate])
    wheel = turn_x(-lean, leaning)
    wheel[1] += motion.course.speed / motion.shape.rear_radius
    out = turn_x(lean, column(*m.I2) * wheel)
    out = out + motion.frame(_tensor(m.I3, motion.body(motion.spin())))
    turning = motion.unfork(motion.body(motion.fork_spin()))
    out = out + motion.frame(motion.fork(_tensor(m.I4, turning)))
    turning[1] += motion.front_spin()
    return np.asarray(out + motion.frame(motion.fork(column(*m.I5) * turning)))


def _tensor(elements: tuple[float, ...], v: Array) -> Array:
    xx, yy, zz, xz = elements
    return np.stack([xx * v[0] + xz * v[2], yy * v[1], xz * v[0] + zz * v[2]])


def _swayed(rig: BicycleFile, motion: Motion, sway: Array) -> Array:
    """What the upper body's lean adds to the moments."""
    r = rig.rider
    pivot = motion.place(column(*r.pivot))
    upright = pivot + motion.frame(column(0.0, 0.0, r.height))
    leant = pivot + motion.frame(turn_x(sway, column(0.0, 0.0, r.height)))
    spinning = r.inertia * motion.frame(column(1.0, 0.0, 0.0)) * rate(sway, motion.dt_s)
    moved = _inertial(motion, r.mass, leant) - _inertial(motion, r.mass, upright)
    return np.asarray(moved + motion.absolute_rate(spinning))
