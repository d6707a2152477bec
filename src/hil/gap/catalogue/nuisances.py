"""Nuisances: what a calibration would set right and no diagnosis should earn by, with how far it may stray.

Each is a parameter of the model that a healthy rig has off its rig file by so much [R]: the standard
deviation is the prior of the refit, LIMIT times that its bound. What is left beyond the bound is gap, and
a nuisance at its bound is an alarm: the rig file is wrong there, or an effect pulls at it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from hil.config import AxisGeometry, RigFile
from hil.gap.record.problem import FORCES, LATENCY
from hil.sim.parameters import ParameterTable

LIMIT: Final = 3.0
"""Bound of a nuisance in standard deviations of its prior."""

MASS: Final = 0.01
"""Of the platform's mass: a scale under the rig [R]."""
COG_M: Final = 0.003
INERTIA: Final = 0.01
"""Of what turns with a pendulum's drive: weights tell a load's mass and place, not its inertia [R]."""
VISCOUS: Final = 0.07
"""Of the rig file's own viscous friction: it follows the oil's temperature [R]."""
COULOMB: Final = 0.06
"""Of the rig file's own Coulomb friction: it follows wear, oil and load [R]."""
DELAY_S: Final = 0.0002
"""A setpoint's way to its drive: mean wait on the bus and phase of the drive's ticks [R]."""
FORCE_DELAY_S: Final = 0.0006
"""The same where setpoints are forces: no tick is read from the record that would tell how long frames wait
for those of other drives [R: up to a millisecond on a simulated bus of six]."""
LATENCY_S: Final = {"position": 0.00015, "velocity": 0.0004, "force": 0.00017, "current": 0.00017}
"""A drive's answers: mean wait of request and answer on the bus, and a tick told one too far; speeds are
what a drive counts in a while and filters; forces swing within each tick, and half of one must be within
their bound (`hil.gap.located.phase`) [R]."""
ZERO: Final = 0.5
"""Of one sample's noise: what is left of a current sensor's zero [R]."""
HOMED: Final = 2.5
"""The same of an encoder's zero, 0.05 mm where its noise is 0.02: a home position repeats within a tenth of a
millimetre [R; healthy rigs of two worlds of others are 0.04 and 0.06 mm off, up to 0.12]."""
FORCE_BIAS: Final = 0.0005
"""Of the largest force: offset of a current sensor [R], where that is more."""
TILT_RAD: Final = 0.002
"""The base against level: a spirit level [R]."""
IMU_BIAS: Final = 0.5
"""Of one sample's noise: what is left after the usual zeroing at rest [R]."""
MISALIGNMENT_RAD: Final = 0.002
"""An IMU against its drawing after a static calibration, a tenth of a degree [R]."""
CRYSTALS: Final = 3e-5
"""s/s: what the clocks of healthy drives and hosts differ by: crystals are within 20 ppm, two of them within
30 most likely [R]. No nuisance: what differs by no more is no finding."""
RATE: Final = ".clock_drift.rate"
WOBBLE_M: Final = 8e-6
"""Amplitude of a lead error that any screw has in each turn, rolled ones too [R]."""
LOOPS: Final = {"position": 0.03, "speed": 0.08, "integral": 0.12}
"""Off 1, within which the gains of any drive's loops seem to be: its filters, the time it computes for and a
current loop that lags change what they do by so much [R]."""
DRIFT: Final = 0.25
"""Of a nuisance's prior: how far a rig drifts between a reference and a run [R]."""
WARMED: Final = 0.5
"""The same of friction, which follows warmth, oil and wear from one day to the next [R; a healthy axis of
others has 10 % less Coulomb friction than its reference; a quarter more is a finding]."""
SWITCHED_ON: Final = 1.0
"""The same of what is new each time a rig is switched on: an IMU's biases [R]."""


@dataclass(frozen=True, slots=True)
class Nuisance:
    """A parameter by name, with the standard deviation of its prior about the rig file's value."""

    name: str
    sd: float
    unit: str
    mean: float = 0.0
    """Of the prior, from the rig file's value: what a healthy reference was found to have."""
    drift: float = DRIFT
    """Of `sd`: how far a run may stand from a reference."""

    @property
    def delays_a_force(self) -> bool:
        """Whether it is by how much an actuator's force or current is answered later."""
        signal = self.name.removesuffix(LATENCY)
        return signal != self.name and signal.endswith(FORCES)


def default_nuisances(
    rig: RigFile, signals: Iterable[str], *, are_forces: bool = False
) -> tuple[Nuisance, ...]:
    """Mass, its place, a pendulum's inertia, viscous friction, delays, level, offsets of all sensors; and of
    an IMU the delay of its filter, which its stamps may hold or not, and which never changes.

    Only those that the recorded `signals` can feel are given. `are_forces`: setpoints are; a drive's own loop
    hides the slope of an axis but for the force that it reads, which has an offset anyway.
    """
    known, table = set(signals), ParameterTable(rig)
    out: list[Nuisance] = []

    def free(name: str, sd: float, drift: float = DRIFT) -> None:
        out.append(Nuisance(name, sd, table[name].unit, drift=drift))

    free("platform.payload_mass.mass", MASS * rig.mass.m)
    if isinstance(rig.geometry, AxisGeometry):
        if rig.is_rotary:
            for c in "xz":
                free(f"platform.payload_cog.{c}", COG_M)
            free("platform.payload_inertia.yy", INERTIA * rig.actuators[0].effective_mass)
        if are_forces and rig.geometry.load != "vertical":
            free("platform.base_tilt.pitch", TILT_RAD)
    else:
        for c in "xyz":
            free(f"platform.payload_cog.{c}", COG_M)
        for c in ("roll", "pitch"):
            free(f"platform.base_tilt.{c}", TILT_RAD)
    for a in rig.actuators:
        viscous = max(VISCOUS * a.viscous, 1e-3 * a.force_max)
        free(f"{a.name}.viscous_friction.coefficient", viscous, WARMED)
        free(f"{a.name}.coulomb_friction.force", COULOMB * a.coulomb, WARMED)
        if rig.bus.setpoint_delay > 0.0:
            free(f"{a.name}.transport_delay.delay", FORCE_DELAY_S if are_forces else _delay_s(rig))
        for quantity, sd in LATENCY_S.items():
            if f"{a.name}.{quantity}" in known:
                free(f"{a.name}.{quantity}.sensor_latency.delay", sd)
        per_ampere = a.force_per_ampere or math.inf
        for quantity, sd in (
            ("position", HOMED * rig.noise.position),
            ("force", max(ZERO * rig.noise.force, FORCE_BIAS * a.force_max)),
            ("current", max(ZERO * rig.noise.current, FORCE_BIAS * a.force_max / per_ampere)),
        ):
            if f"{a.name}.{quantity}" in known:
                free(f"{a.name}.{quantity}.sensor_bias.offset", sd)
    for signal in sorted(s for s in known if s.startswith("imu.")):
        noise = rig.noise.gyro if signal.startswith("imu.gyro") else rig.noise.accel
        free(f"{signal}.sensor_bias.offset", IMU_BIAS * noise, SWITCHED_ON)
    if rig.imu is not None and any(s.startswith("imu.") for s in known):
        for c in "xyz":
            free(f"imu.sensor_misalignment.{c}", MISALIGNMENT_RAD)
        free("imu.sensor_latency.delay", rig.imu.group_delay_s / LIMIT, drift=0.0)
    return tuple(n for n in out if n.sd > 0.0)


def _delay_s(rig: RigFile) -> float:
    """Of setpoints that are positions: where drives wait for SYNC, the place of their ticks in it is any, and
    always the same."""
    bus = rig.bus
    place = bus.position_loop / math.sqrt(12.0) if bus.schedule == "fast" else 0.0
    return math.hypot(DELAY_S, place)
