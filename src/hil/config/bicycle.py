"""A bicycle's rig file: a bicycle has no drives, it is ridden and recorded. SI units, radians.

Places count from the centre of the rear wheel with the bicycle upright and steered straight: x forward,
z up. `m` and the bodies' numbers follow the text: 2 rear wheel, 3 rear frame with rider, 4 handlebar and
fork, 5 front wheel. Inertias are elements of the tensor about the body's centre of gravity in z-up axes,
so that a rider's usual xz element is negative.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from hil.config.base import NonNegative, Positive, Settings, Vector3
from hil.config.bus import Can, Imu
from hil.config.rig import Effect, Recording, Zenoh

Vector4 = tuple[float, float, float, float]

BICYCLE: Final = "bicycle"
"""Kind of the rigs that are ridden, not driven, and source of their samples."""

SIGNALS: Final = ("lean", "rear_wheel", "steer")
"""What the bicycle measures of its coordinates, rad."""


class BicycleGeometry(Settings):
    """Wheels and steer axis."""

    wheelbase: Positive = Field(description="distance of the wheels' contact points, upright, m")
    trail: float = Field(
        description="front contact point behind the steer axis' point on the ground, m",
        ge=-1.0,
        le=1.0,
    )
    tilt: float = Field(description="steer axis from the vertical, rad", gt=-1.2, lt=1.2)
    R: Positive = Field(
        description="radius of the rear wheel, and of the front where it has no own, m"
    )
    R_front: Positive | None = Field(None, description="radius of the front wheel, m")

    @property
    def front_radius(self) -> float:
        """Radius of the front wheel, m."""
        return self.R if self.R_front is None else self.R_front

    @model_validator(mode="after")
    def _tilt_is_from_vertical(self) -> Self:
        if abs(self.tilt) > 0.79:
            raise ValueError(
                f"tilt is {self.tilt:.3f} rad from the VERTICAL: a head angle of 71 degrees is a tilt of "
                "19 degrees, 0.332 rad"
            )
        return self


class BicycleMass(Settings):
    """The four bodies. I2 and I5 are [xx, yy, zz], I3 and I4 [xx, yy, zz, xz], kg·m²."""

    m: tuple[Positive, Positive, Positive, Positive] = Field(description="bodies 2, 3, 4, 5, kg")
    G3: Vector3 = Field(description="centre of gravity of body 3, m; y must be 0")
    G4: Vector3 = Field(description="centre of gravity of body 4, steered straight, m; y must be 0")
    I2: tuple[Positive, Positive, Positive] = Field(description="rear wheel")
    I3: Vector4 = Field(description="rear frame and rider")
    I4: Vector4 = Field(description="handlebar and fork")
    I5: tuple[Positive, Positive, Positive] = Field(description="front wheel")
    gravity: Positive = Field(9.81, description="m/s²")

    @model_validator(mode="after")
    def _bodies_are_symmetric(self) -> Self:
        for name, wheel in (("I2", self.I2), ("I5", self.I5)):
            if abs(wheel[0] - wheel[2]) > 1e-9 * wheel[0]:
                raise ValueError(f"{name}: a wheel has the same inertia about x and z, not {wheel}")
        for name, place in (("G3", self.G3), ("G4", self.G4)):
            if place[1] != 0.0:
                raise ValueError(f"{name}: lies {place[1]} m off the plane of symmetry")
        for name, body in (("I3", self.I3), ("I4", self.I4)):
            if min(body[:3]) <= 0.0:
                raise ValueError(f"{name}: elements xx, yy and zz must be above 0, not {body[:3]}")
        return self


class Rider(Settings):
    """The part of body 3 that can lean against the frame: the rider's upper body."""

    mass: NonNegative = Field(
        0.0, description="kg, part of body 3's mass; 0: the rider never leans"
    )
    pivot: Vector3 = Field((0.0, 0.0, 0.55), description="point of the lean axis (forward), m")
    height: Positive = Field(0.35, description="its centre of gravity above the pivot, m")
    inertia: NonNegative = Field(
        2.0, description="about its own centre of gravity, forward axis, kg·m²"
    )


class BicycleNoise(Settings):
    """Noise (standard deviation) and quantisation of the sensors, as simulated and as expected."""

    lean: NonNegative = Field(0.002, description="rad")
    rear_wheel: NonNegative = Field(0.002, description="rad")
    steer: NonNegative = Field(0.001, description="rad")
    gyro: NonNegative = Field(0.004, description="rad/s")
    accel: NonNegative = Field(0.08, description="m/s²")
    lean_step: NonNegative = Field(0.0005, description="12-bit inclinometer, rad")
    rear_wheel_step: NonNegative = Field(0.0026179938779914945, description="2400 a turn, rad")
    steer_step: NonNegative = Field(0.0026179938779914945, description="2400 a turn, rad")
    gyro_step: NonNegative = Field(0.0005, description="rad/s")
    accel_step: NonNegative = Field(0.01, description="m/s²")


class Conditioning(Settings):
    """How measured angles become smooth: zero-phase Butterworth, then central differences in stages."""

    cutoff: Positive = Field(5.0, description="of the low-pass, Hz")
    order: Annotated[int, Field(ge=1, le=6)] = Field(
        2, description="of one pass; it runs both ways"
    )


class Sensors(Settings):
    """The sensor nodes: ranges and what the wheel's encoder is fixed to."""

    lean_range: Positive = Field(
        0.3490658503988659, description="the inclinometer's, ±20 degrees, rad"
    )
    lean_delay: NonNegative = Field(0.0, description="delay of the inclinometer, s")
    encoder_on_frame: bool = Field(
        True, description="rear wheel's encoder sits on the frame: it reads psi - beta, not psi"
    )
    steps_per_turn: Annotated[int, Field(ge=4, le=1_000_000)] = Field(
        2400, description="of wheel and steer encoder"
    )
    base_id: Annotated[int, Field(ge=0x001, le=0x7F0)] = Field(
        0x0B0, description="CAN identifier of the lean node; wheel, steer and status follow"
    )
    lean_zero: float = Field(0.0, description="inclinometer's answer upright, rad")
    steer_zero: float = Field(0.0, description="encoder's answer steered straight, rad")
    gyro_bias: Vector3 = Field((0.0, 0.0, 0.0), description="of the IMU at rest, rad/s")
    accel_bias: Vector3 = Field((0.0, 0.0, 0.0), description="of the IMU, m/s²")
    accel_scale: tuple[Positive, Positive, Positive] = Field(
        (1.0, 1.0, 1.0), description="of the IMU"
    )
    accel_cross: Vector3 = Field(
        (0.0, 0.0, 0.0),
        description="axes not square: x += cross[0] y + cross[1] z, y += cross[2] z, after bias and scale",
    )
    provenance: str = Field("", description="where zeros, biases and scales come from")


class BicycleBus(Settings):
    """Timing of the sensors."""

    jitter: NonNegative = Field(0.0003, description="standard deviation of sample instants, s")


class BicycleFile(Settings):
    """One bicycle."""

    format: Literal["hil-rig/1"] = Field("hil-rig/1", description="of this file")
    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")] = Field(
        description="used in Zenoh keys"
    )
    kind: Literal["bicycle"] = Field(description="of rig")
    note: str = Field("", description="free text: sources and marks of the numbers")
    geometry: BicycleGeometry
    mass: BicycleMass
    aero: NonNegative = Field(0.0, description="c_v: drag is c_v v² at body 3, kg/m")
    rate: Positive = Field(100.0, description="samples a second of lean, wheel and steer, Hz")
    actuators: tuple[()] = ()
    coordinates: tuple[()] = ()
    rider: Rider = Rider()
    bus: BicycleBus = BicycleBus()
    imu: Imu | None = None
    noise: BicycleNoise = BicycleNoise()
    sensors: Sensors = Sensors()
    conditioning: Conditioning = Conditioning()
    can: Can = Can()
    recording: Recording = Recording()
    zenoh: Zenoh = Zenoh()
    effects: tuple[Effect, ...] = Field(
        (), description="found on the real rig and not in the ideal model: see `hil gap apply`"
    )

    @property
    def actuator_names(self) -> tuple[str, ...]:
        """None: nothing drives it but its rider."""
        return ()

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.rider.mass >= self.mass.m[1]:
            raise ValueError(
                f"rider.mass: the upper body, {self.rider.mass} kg, is part of body 3, {self.mass.m[1]} kg"
            )
        if self.conditioning.cutoff >= 0.4 * self.rate:
            raise ValueError(
                f"conditioning.cutoff: {self.conditioning.cutoff} Hz is too near half the rate"
            )
        return self
