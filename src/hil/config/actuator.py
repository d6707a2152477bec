"""An actuator, its transmission, its drive's loops and the drive's place on the bus.

Everything is given at the actuator's output: m, m/s, N for a prismatic actuator, rad, rad/s, N·m for
a rotary one. Loop gains follow the drive model: P position loop, PI speed loop, current-loop lag.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from hil.config.base import NonNegative, Positive, Settings, Share


class Screw(Settings):
    """A lead screw on the motor's shaft."""

    type: Literal["screw"] = Field("screw", description="of transmission")
    lead: Positive = Field(description="travel per motor turn, m")
    efficiency: Share = Field(0.9, description="share of the motor's work that reaches the output")


class Rack(Settings):
    """A gearbox and a pinion on a rack."""

    type: Literal["rack"] = Field("rack", description="of transmission")
    gear: Positive = Field(description="motor turns per pinion turn")
    pinion_radius: Positive = Field(description="pinion radius, m")
    efficiency: Share = Field(0.95, description="share of the motor's work that reaches the output")


class Direct(Settings):
    """A motor, geared or not, that turns the load itself."""

    type: Literal["direct"] = Field("direct", description="of transmission")
    gear: Positive = Field(1.0, description="motor turns per output turn")
    efficiency: Share = Field(1.0, description="share of the motor's work that reaches the output")


Transmission = Annotated[Screw | Rack | Direct, Field(discriminator="type")]


class LegMass(Settings):
    """A leg as two slender bodies: one fixed to the base joint, one to the platform joint."""

    lower_mass: NonNegative = Field(0.0, description="part that only turns, kg")
    lower_cog: NonNegative = Field(0.0, description="its centre of gravity from the base joint, m")
    lower_inertia: NonNegative = Field(
        0.0, description="its inertia across the leg, about its cog, kg·m²"
    )
    upper_mass: NonNegative = Field(0.0, description="part that also moves along the leg, kg")
    upper_cog: NonNegative = Field(
        0.0, description="its centre of gravity from the platform joint, m"
    )
    upper_inertia: NonNegative = Field(
        0.0, description="its inertia across the leg, about its cog, kg·m²"
    )
    is_fed: bool = Field(
        True, description="whether the static force that is fed forward reckons with it"
    )


class DriveNode(Settings):
    """Which drive moves the actuator and how it is reached."""

    profile: str = Field(
        "lust_cdd3000", description="folder under drives/ that describes the drive family"
    )
    address: int | None = Field(
        None, ge=0, le=127, description="node address on the bus; default: position in the list + 1"
    )
    bus: Annotated[int, Field(ge=0, le=3)] = Field(
        0, description="which of the rig's buses it is on: 0 is [can], 1 the first of can.further"
    )
    cyclic: Literal["position", "velocity"] = Field(
        "position",
        description="CiA 402, control.mode drive: position: csp, or ip where the drive lacks it, loop in "
        "the drive; velocity: csv, position loop in the daemon by position_gain and velocity_ff",
    )
    counts_per_unit: Positive = Field(
        1.0e6, description="position increments per m (or rad) at the actuator's output"
    )
    force_per_count: Positive = Field(
        1.0,
        description="N (or N·m) per increment of the drive's torque answer and torque reference; CiA 402: "
        "per thousandth of the rated torque",
    )
    current_per_count: Positive = Field(0.01, description="A per increment of the current answer")


class Actuator(Settings):
    """One actuator with its friction, limits and loops, SI at its output."""

    name: str = Field(pattern=r"^[a-z][a-z0-9_]*$", description="leg1, slide, axis ...")
    reflected_mass: NonNegative = Field(description="rotor inertia seen at the output, kg or kg·m²")
    viscous: NonNegative = Field(description="viscous friction, N·s/m")
    coulomb: NonNegative = Field(description="Coulomb friction, N")
    presliding: NonNegative = Field(
        0.0, description="way within which Coulomb friction builds up, m; 0: at once"
    )
    guide_share: NonNegative = Field(
        0.0,
        le=1.0,
        description="share of Coulomb friction that rubs on the load (guides, bearings), not on the motor; "
        "tells where the transmission between them gives",
    )
    velocity_max: Positive = Field(description="fastest the drive moves it, m/s")
    force_max: Positive = Field(description="largest force of the drive, N")
    acceleration_max: Positive = Field(
        20.0, description="largest setpoint acceleration let through, m/s²"
    )
    stroke: tuple[float, float] = Field(description="lower and upper end of travel, m")
    home: float = Field(description="position at the neutral pose, m")
    position_gain: Positive = Field(description='cascade: k_p, 1/s; law "pd": K_p, N/m')
    speed_gain: NonNegative = Field(description='cascade: k_v, N·s/m; law "pd": K_d, N·s/m')
    integral_gain: NonNegative = Field(0.0, description="k_i of the speed loop, N/m")
    velocity_ff: NonNegative = Field(
        0.0, le=2.0, description="k_fv: share of setpoint speed fed forward"
    )
    acceleration_ff: NonNegative = Field(
        0.0, le=2.0, description="k_fa: share of inertia force fed forward"
    )
    friction_ff: NonNegative = Field(
        0.0, le=2.0, description="share of the rig file's own friction that the drive feeds forward"
    )
    effective_mass: Positive = Field(description="inertia the drive's pre-control reckons with, kg")
    current_hz: Positive = Field(1000.0, description="bandwidth of the current loop, Hz")
    static_ff: NonNegative = Field(
        0.0,
        le=2.0,
        description='K_s: share of the static force fed forward in the laws "pd" and "cascade_static"',
    )
    law: Literal["cascade", "cascade_static", "pd"] = Field(
        "cascade",
        description="cascade: P position, PI speed; cascade_static: the same with static_ff of the static "
        "force beside it; pd: force from position and speed error",
    )
    transmission: Transmission | None = Field(None, description="screw, rack or direct gear")
    torque_constant: Positive | None = Field(None, description="motor torque per ampere, N·m/A")
    leg: LegMass = LegMass()
    drive: DriveNode = DriveNode()

    @model_validator(mode="after")
    def _bounds_fit(self) -> Actuator:
        low, high = self.stroke
        if not low < high:
            raise ValueError(f"stroke: lower end {low} is not below upper end {high}")
        if not low <= self.home <= high:
            raise ValueError(f"home {self.home} lies outside stroke {low}..{high}")
        return self

    @property
    def motor_turn(self) -> float | None:
        """Travel in one turn of the motor, m or rad; None where the transmission is not given."""
        tr = self.transmission
        if tr is None:
            return None
        if isinstance(tr, Screw):
            return tr.lead
        return 2.0 * math.pi / tr.gear * (tr.pinion_radius if isinstance(tr, Rack) else 1.0)

    @property
    def force_per_ampere(self) -> float | None:
        """Output force a motor current makes, N/A (or N·m/A); None where the constants are not given."""
        turn = self.motor_turn
        if self.torque_constant is None or self.transmission is None or turn is None:
            return None
        return self.torque_constant * 2.0 * math.pi / turn * self.transmission.efficiency
