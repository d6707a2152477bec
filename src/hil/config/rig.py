"""A rig file: everything about one rig. Unknown keys are errors; SI units and radians throughout."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from hil.config.actuator import Actuator
from hil.config.base import Matrix3, NonNegative, Positive, Settings, Vector3
from hil.config.bus import SHORTEST_WAIT, Bus, Can, Imu, Noise
from hil.config.control import Control, CueLimits, Parking, Safety
from hil.config.geometry import AxisGeometry, Geometry

Kind = Literal["axis_1dof", "motorcycle_3dof", "stewart_6dof"]

COORDINATES_OF: dict[str, tuple[str, ...]] = {
    "axis_1dof": ("position",),
    "motorcycle_3dof": ("yaw", "pitch", "roll"),
    "stewart_6dof": ("surge", "sway", "heave", "roll", "pitch", "yaw"),
}
ROTATIONS = ("yaw", "pitch", "roll")


class Body(Settings):
    """The moving platform with what is bolted to it."""

    m: Positive = Field(description="mass, kg")
    cog: Vector3 = Field((0.0, 0.0, 0.0), description="centre of gravity in the platform frame, m")
    inertia: Matrix3 = Field(
        description="inertia about the centre of gravity, platform axes, kg·m²"
    )
    gravity: NonNegative = Field(9.81, description="m/s²")

    @model_validator(mode="after")
    def _inertia_is_physical(self) -> Self:
        rows = self.inertia
        for i in range(3):
            for k in range(i):
                if abs(rows[i][k] - rows[k][i]) > 1e-9 * (1.0 + abs(rows[i][k])):
                    raise ValueError(f"inertia is not symmetric in elements {i}{k} and {k}{i}")
            if rows[i][i] <= 0.0:
                raise ValueError(f"inertia: diagonal element {i} is {rows[i][i]}, must be above 0")
        return self


class Effect(Settings):
    """An effect of the gap catalogue that this rig's model includes: a line in the rig file."""

    effect: str = Field(description="name in the catalogue: backlash, coulomb_friction ...")
    location: str = Field(description="actuator, signal, platform, joint, bus ...")
    parameters: dict[str, float] = Field(
        description="values by the catalogue's parameter names, SI"
    )
    provenance: str = Field("", description="where the values come from: diagnosis file, run, date")


class Recording(Settings):
    """What the daemon keeps of each run."""

    folder: str = Field(
        "runs", description="where run folders are made, relative to the start folder"
    )
    can_log: Literal["candump", "blf", "none"] = Field("candump", description="raw bus log format")


class Zenoh(Settings):
    """How clients reach the rig. Loopback only unless told otherwise; never multicast."""

    listen: tuple[str, ...] = Field(("tcp/127.0.0.1:7447",), description="endpoints to listen on")
    connect: tuple[str, ...] = Field((), description="routers to connect to")
    config: str | None = Field(
        None, description="a Zenoh JSON5 file (mTLS, access control) to start from"
    )
    state_hz: Positive = Field(100.0, description="rate of the published state, Hz")


class RigFile(Settings):
    """One rig."""

    format: Literal["hil-rig/1"] = Field("hil-rig/1", description="of this file")
    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")] = Field(
        description="used in Zenoh keys"
    )
    kind: Kind = Field(description="of rig")
    note: str = Field("", description="free text: sources and marks of the numbers")
    geometry: Geometry
    mass: Body
    actuators: tuple[Actuator, ...] = Field(min_length=1)
    coordinates: tuple[str, ...] = Field(
        (), description="names of the pose's coordinates, in order"
    )
    limits: tuple[Positive, ...] = Field(
        description="workspace: each coordinate stays within ± this"
    )
    bus: Bus = Bus()
    can: Can = Can()
    imu: Imu | None = None
    noise: Noise = Noise()
    control: Control = Control()
    cue: CueLimits = CueLimits()
    parking: Parking = Parking()
    safety: Safety = Safety()
    recording: Recording = Recording()
    zenoh: Zenoh = Zenoh()
    effects: tuple[Effect, ...] = Field(
        (), description="found on the real rig and not in the ideal model: see `hil gap apply`"
    )

    @model_validator(mode="before")
    @classmethod
    def _geometry_by_kind(cls, data: Any) -> Any:
        if isinstance(data, dict) and isinstance(data.get("geometry", {}), dict):
            data = {**data, "geometry": {**data.get("geometry", {}), "kind": data.get("kind")}}
        return data

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        names = [a.name for a in self.actuators]
        expected = COORDINATES_OF[self.kind]
        if self.coordinates and self.coordinates != expected:
            raise ValueError(f"coordinates of a {self.kind} are {list(expected)}, in this order")
        object.__setattr__(self, "coordinates", expected)
        if len(set(names)) != len(names):
            raise ValueError(f"actuators: names are not unique: {names}")
        if len(names) != len(expected):
            raise ValueError(
                f"a {self.kind} has {len(expected)} actuators, the file has {len(names)}"
            )
        for key, value in (
            ("limits", self.limits),
            ("cue.velocity", self.cue.velocity),
            ("cue.acceleration", self.cue.acceleration),
            ("cue.jerk", self.cue.jerk),
            ("parking.pose", self.parking.pose),
        ):
            if len(value) != len(expected) and (key == "limits" or value):
                raise ValueError(
                    f"{key} needs {len(expected)} values, one for each of {list(expected)}"
                )
        for pose, limit, name in zip(self.parked_pose, self.limits, expected, strict=True):
            if abs(pose) > limit:
                raise ValueError(f"parking.pose: {name} = {pose} lies outside ±{limit}")
        addresses = [self.address(i) for i in range(len(names))]
        if len(set(addresses)) != len(addresses):
            raise ValueError(f"actuators: drive addresses are not unique: {addresses}")
        buses = len(self.can.urls)
        for actuator in self.actuators:
            if actuator.drive.bus >= buses:
                raise ValueError(
                    f"actuators: {actuator.name} is on bus {actuator.drive.bus}, but there are {buses}: 0 is "
                    "[can], each [[can.further]] is one more"
                )
        waits_s = self.bus.waits_s(len(names) - 1)
        if self.bus.retimed and waits_s < SHORTEST_WAIT * self.bus.cycle:
            raise ValueError(
                f"bus.clock_wait: the last of {len(names)} drives would wait {1e3 * waits_s:.3g} ms, a "
                f"setpoint needs {1e3 * SHORTEST_WAIT * self.bus.cycle:.3g} ms"
            )
        if len(set(self.can.urls)) != buses:
            raise ValueError(f"can: two buses have the same url: {', '.join(self.can.urls)}")
        return self

    @property
    def is_rotary(self) -> bool:
        """Whether its actuator turns the load: rad and N·m, not m and N."""
        return isinstance(self.geometry, AxisGeometry) and self.geometry.load == "pendulum"

    def rotates(self, coordinate: str) -> bool:
        """Whether a coordinate of the pose is an angle, rad, and no length, m."""
        return self.is_rotary or coordinate in ROTATIONS

    @property
    def actuator_names(self) -> tuple[str, ...]:
        """Names of the actuators, in order."""
        return tuple(a.name for a in self.actuators)

    @property
    def parked_pose(self) -> tuple[float, ...]:
        """The pose in which the rig rests."""
        return self.parking.pose or (0.0,) * len(self.coordinates)

    def address(self, index: int) -> int:
        """Bus address of the drive of actuator `index`."""
        given = self.actuators[index].drive.address
        return index + 1 if given is None else given

    def cue_limits(self) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
        """Velocity, acceleration and jerk limits, one value a coordinate (defaults by kind of motion)."""
        rotary = [self.rotates(c) for c in self.coordinates]
        return (
            self.cue.velocity or tuple(0.35 if r else 0.3 for r in rotary),
            self.cue.acceleration or (4.0,) * len(rotary),
            self.cue.jerk or (80.0,) * len(rotary),
        )
