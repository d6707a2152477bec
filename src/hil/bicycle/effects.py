"""A bicycle's effects as a ride has them: in its sensors, its wheels, its fork and tyres.

One place for analysis, live view and the gap's twin: what a rig file's `effects` say, or any other values of
the catalogue's parameters, is taken out of lean, wheel and steer, put into the bicycle, and put on what the
model says that the IMU reads.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.signal import lfilter

from hil.bicycle.aside import goes_aside
from hil.bicycle.creep import rolls
from hil.bicycle.sensors import IMU_SIGNALS, Sensor, misaligned
from hil.config import BicycleFile
from hil.config.bicycle import SIGNALS
from hil.rigs.bicycle import Motion, Packed, Smooth, low_pass, ride
from hil.rigs.bicycle.conditioning import central
from hil.rigs.bicycle.parameters import ROLLING
from hil.sim.parameters import ParameterTable

Array = NDArray[np.float64]

UNMOVED: Final = ("imu.", "bicycle.lean_torque.", "bicycle.rider_motion.")
"""How parameters begin that change what is told of a motion, not the motion."""
SPRINGS: Final = ("bicycle.front_suspension.stiffness", "bicycle.tyre_compliance.stiffness")
CREEP: Final = "rear_wheel.drive_slip.per_accel"
ASIDE: Final = "rear_wheel.side_slip.per_accel"
PASSES: Final = 2
"""Of the ride's low-pass over what fork and tyres answer: accelerations are second differences and need as
much."""
SOFTER: Final = 0.3
"""Of the ride's cutoff: what a rider does lies below, and noise of an encoder's second differences above."""


@dataclass(frozen=True, slots=True)
class RideEffects:
    """Parameters of the catalogue by their full names; all of them."""

    values: Mapping[str, float]

    @classmethod
    def of(cls, rig: BicycleFile) -> RideEffects:
        """What the rig file's own effects say; ConfigError where they are not the catalogue's."""
        table = ParameterTable(rig)
        vector = table.from_effects(rig.effects).tolist()
        return cls(dict(zip((p.name for p in table.entries), vector, strict=True)))

    @property
    def moving(self) -> RideEffects:
        """Those that a motion depends on."""
        own = {name: v for name, v in self.values.items() if not name.startswith(UNMOVED)}
        return RideEffects(own)

    def true_angles(self, t_s: Array, told: Array) -> Array:
        """(N, 3) what lean, wheel and steer were where `told` (N, 3) was measured at t_s (N,)."""
        return np.column_stack(
            [Sensor.of(s, self.values).truth(t_s, told[:, k]) for k, s in enumerate(SIGNALS)]
        )

    def bicycle(self, packed: Packed) -> Packed:
        """With its wheels as they are."""
        v = self.values
        return packed.scaled(
            v["rear_wheel.wheel_radius.scale"],
            v["front_wheel.wheel_radius.scale"],
            v["rear_wheel.wheel_slip.coefficient"],
            v["rear_wheel.wheel_radius.frame"],
        )

    def motion(
        self,
        packed: Packed,
        told: Smooth,
        start: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
    ) -> Motion:
        """The ride whose true smooth angles are `told`; KinematicsError as `hil.rigs.bicycle.ride`."""
        v = self.values
        fork, tyre = "bicycle.front_suspension", "bicycle.tyre_compliance"
        tyres = v[f"{tyre}.stiffness"], v[f"{tyre}.damping"]
        springs = (v[f"{fork}.stiffness"], tyres[0], tyres[0])
        dampers = (v[f"{fork}.damping"], tyres[1], tyres[1])
        bicycle = self.bicycle(packed)
        ridden = ride(bicycle, self._rolled(bicycle, told, start), start, springs, dampers)
        return goes_aside(ridden, bicycle, v[ASIDE])

    def _rolled(
        self, bicycle: Packed, told: Smooth, start: tuple[float, float, float, float]
    ) -> Smooth:
        """`told` with the rear wheel as one turns that goes the same way without creeping under what it
        drives and brakes with."""
        creeps = self.values[CREEP]
        if creeps == 0.0:
            return told
        radius_m, mass_kg = float(bicycle.p[ROLLING]), float(np.sum(bicycle.body[:, 0]))
        drive = ride(bicycle, told, start).drive_torque / (radius_m * mass_kg)
        turns, speeds_up = told.rate[:, 1].copy(), told.acceleration[:, 1].copy()
        rolled = rolls(turns, speeds_up, drive, creeps, radius_m, told.dt_s)
        angle, rate, acceleration = (x.copy() for x in (told.angle, told.rate, told.acceleration))
        angle[:, 1] -= cumulative_trapezoid(turns - rolled, dx=told.dt_s, initial=0.0)
        rate[:, 1] = rolled
        acceleration[:, 1] = central(rolled, told.dt_s)
        return Smooth(told.dt_s, angle, rate, acceleration)

    @property
    def gives_way(self) -> bool:
        """Whether fork or tyres move."""
        return any(np.isfinite(self.values[name]) for name in SPRINGS)

    def added(self, packed: Packed, told: Smooth, soft: Smooth) -> Motion:
        """`motion` of `told`, what fork and tyres add computed of `soft` angles.

        Noise of an encoder's second differences shakes a sprung bicycle as no road does; what a rider does
        to springs is slow, and small enough to be added.
        """
        whole = self.rigid.motion(packed, told)
        if not self.gives_way:
            return whole
        stiff, sprung = self.rigid.motion(packed, soft), self.motion(packed, soft)
        parts = {
            f.name: getattr(whole, f.name) + getattr(sprung, f.name) - getattr(stiff, f.name)
            for f in fields(whole)
            if f.name != "dt_s"
        }
        return Motion(whole.dt_s, **parts)

    @property
    def rigid(self) -> RideEffects:
        """The same with fork and tyres that do not give way: what holds for a piece of a ride, whose springs
        nobody knows the state of."""
        return RideEffects({**self.values, **dict.fromkeys(SPRINGS, np.inf)})

    def lean_torque(self, rig: BicycleFile, motion: Motion) -> Array:
        """(N,) lean torque that nobody explains, N m: the model's less that of the rider's body, off by what
        is told of one who sits to one side and of tyres of a round section."""
        aside = self.values["bicycle.lean_torque.sensor_bias.offset"]
        section_m = self.values["bicycle.lean_torque.tyre_section.radius"]
        weight = sum(rig.mass.m) * rig.mass.gravity
        flank = weight * section_m * np.sin(motion.q[:, 3])
        return np.asarray(
            motion.lean_torque - rider_torque(rig, motion, self.values) + aside + flank
        )

    def imu(self, t_s: Array, motion: Motion) -> Array:
        """(N, 6) what the IMU, as it is, answers at t_s (N,), on the run's clock."""
        seen = misaligned(motion.imu, self.values)
        # stamps of a clock that runs fast are later than the truth
        at = t_s / (1.0 + self.values["imu.clock_drift.rate"])
        return np.column_stack(
            [
                Sensor.of(s, self.values).answer(t_s, seen[:, k], at)
                for k, s in enumerate(IMU_SIGNALS)
            ]
        )


def softened(rig: BicycleFile, dt_s: float, values: Array, share: float = SOFTER) -> Array:
    """(N, K) through the low-pass of whatever is held against an IMU: the ride's, softer, twice."""
    how = rig.conditioning
    for _ in range(PASSES):
        values = low_pass(values, dt_s, share * how.cutoff, how.order)
    return values


def soft_motion(rig: BicycleFile, dt_s: float, angles: Array, share: float = SOFTER) -> Smooth:
    """(N, 3) true angles softened, with derivatives that no filter touches again."""
    return differenced(dt_s, softened(rig, dt_s, angles, share))


def differenced(dt_s: float, angle: Array) -> Smooth:
    """Smooth angles (N, 3) with their differences, which no filter touches again."""
    rate = central(angle, dt_s)
    return Smooth(dt_s, angle, rate, central(rate, dt_s))


def rider_torque(rig: BicycleFile, motion: Motion, values: Mapping[str, float]) -> Array:
    """(N,) lean torque on the frame by a rider whose upper body leans against it, N m; first order in lean.

    Upper body as a pendulum on the frame: own a'' + c a' + (k - m h g) a = m h across - k gain theta
    - lever theta'', and on the frame m h g a - lever a''. Across: gravity, and what the pivot goes aside
    with: the rear contact and, ahead of that, yaw.
    """
    name = "bicycle.rider_motion"
    stiffness, gain = values[f"{name}.stiffness"], values[f"{name}.gain"]
    m, h = rig.rider.mass, rig.rider.height
    if m == 0.0 or (not np.isfinite(stiffness) and gain == 0.0):
        return np.zeros(len(motion.q))
    g = rig.mass.gravity
    lean, bend = motion.q[:, 3], motion.qdd[:, 3]
    own = rig.rider.inertia + m * h * h
    lever = own + m * h * (rig.rider.pivot[2] + rig.geometry.R)
    if not np.isfinite(stiffness):
        return np.asarray(-gain * (m * h * g * lean - lever * bend))
    ahead = rig.rider.pivot[0] * motion.qdd[:, 2]
    across = g * np.sin(lean) + (motion.speed * motion.qd[:, 2] + ahead) * np.cos(lean)
    load = m * h * across - stiffness * gain * lean - lever * bend
    damping, held = values[f"{name}.damping"], stiffness - m * h * g
    # trapezoidal rule of the pendulum's equation, second order in the step and stable at any stiffness
    w = 2.0 / motion.dt_s
    b = np.array([1.0, 2.0, 1.0])
    a = np.array(
        [
            own * w * w + damping * w + held,
            2.0 * held - 2.0 * own * w * w,
            own * w * w - damping * w + held,
        ]
    )
    alpha = lfilter(b / a[0], a / a[0], load)
    swing = (load - damping * np.gradient(alpha, motion.dt_s) - held * alpha) / own
    return np.asarray(m * h * g * alpha - lever * swing)
