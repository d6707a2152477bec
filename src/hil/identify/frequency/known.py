"""Known beforehand of the chain from cue to pose: the daemon's shaping, and the drives by the rig file.

Both stand beside a platform's filter in every measurement of it, and must be taken off to tell it.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.control.setpoints import setpoint_leads
from hil.control.track import CueTrack
from hil.identify.frequency.harmonics import sample_step
from hil.rigs import build_rig
from hil.signals import Cue, TimedPose

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

OFFSETS: Final = 5
"""Places between two poses of the cue at which cycles read it: one place if the clocks agree."""


def drives_response(
    rig: RigFile, coordinate: str, hz: Array, speed_rms: Array | None = None
) -> ComplexArray:
    """Response (F,) of a coordinate to the same coordinate of the setpoints' pose, near neutral.

    Drive by drive its force law (`Actuator.law`), coupled by the platform's mass seen at the actuators;
    friction enters by its viscous part and, where the actuators' root mean square speeds (n,) are given, by
    what Coulomb friction F amounts to under a random motion of that speed: sqrt(2/π) F/speed (Gelb and
    Vander Velde, "Multiple-Input Describing Functions" [M]).
    Setpoints count from the instants at which the drives shall reach them (`channels`), so a line between
    them has no lag of its own, only sinc²(f·cycle); a held setpoint has sinc(f·cycle).
    """
    manipulator = build_rig(rig)
    q = manipulator.neutral
    J = manipulator.jacobian(q)
    back = np.linalg.inv(J)
    mass = back.T @ manipulator.mass_matrix(q) @ back
    index = rig.coordinates.index(coordinate)

    def column(name: str) -> Array:
        return np.array([float(getattr(a, name)) for a in rig.actuators])

    k_p, k_v, k_i = column("position_gain"), column("speed_gain"), column("integral_gain")
    ahead, inertia = column("velocity_ff"), column("acceleration_ff") * column("effective_mass")
    viscous, current_hz = column("viscous"), column("current_hz")
    if speed_rms is not None:
        viscous = viscous + np.sqrt(2.0 / np.pi) * column("coulomb") / speed_rms
    is_pd = np.array([a.law == "pd" for a in rig.actuators])
    hold = np.sinc(hz * rig.bus.cycle) ** (2 if rig.bus.interpolation != "hold" else 1)
    out = np.empty(len(hz), dtype=complex)
    for n, f in enumerate(hz):
        s = 2j * np.pi * f
        speed_loop = k_v + k_i / s
        lag = 1.0 / (1.0 + 1j * f / current_hz)
        forward = np.where(is_pd, k_p + k_v * ahead * s, speed_loop * (k_p + ahead * s))
        forward = lag * (forward + inertia * s * s)
        back_gain = lag * np.where(is_pd, k_p + k_v * s, speed_loop * (k_p + s))
        stiffness = mass * (s * s) + np.diag(viscous * s + back_gain)
        out[n] = (back @ np.linalg.solve(stiffness, forward * J[:, index]))[index] * hold[n]
    return out


def command_response(
    rig: RigFile, coordinate: str, hz: Array, cue_s: Array, cycle_s: Array
) -> ComplexArray:
    """Response (F,) of the setpoints' pose to a cue, the platform's filter left out.

    Shaping passes a cue that keeps the limits and is known ahead; mode "drive" then carries the motion
    on, as a parabola, to the instant at which each drive reaches its setpoint. `cue_s` are the instants of
    the cue's poses, between which the daemon interpolates, `cycle_s` starts of its cycles.
    """
    step_s = sample_step(cue_s)
    ahead = np.mod(cycle_s + rig.bus.cycle - cue_s[0], step_s)
    offsets = np.quantile(ahead, np.linspace(0.0, 1.0, OFFSETS))
    shaped = np.array([_interpolated(f, step_s, offsets) for f in hz])
    if rig.control.mode != "drive":
        return np.asarray(shaped[:, 0])
    manipulator = build_rig(rig)
    J = manipulator.jacobian(manipulator.neutral)
    k = rig.coordinates.index(coordinate)
    share = np.linalg.inv(J)[k] * J[:, k]
    lead = setpoint_leads(rig)
    if rig.control.platform_filter is not None:
        # What comes out of a filter has the very derivatives of its pose, whatever went in.
        omega = 2.0 * np.pi * hz
        shaped = shaped[:, :1] * np.stack([np.ones_like(hz), 1j * omega, -(omega**2)], axis=1)
    carried = shaped @ np.array([np.ones_like(lead), lead, 0.5 * lead**2])
    return np.asarray((carried * np.exp(-2j * np.pi * np.outer(hz, lead))) @ share)


def _interpolated(f: float, step_s: float, offsets_s: Array) -> ComplexArray:
    """Pose, velocity and acceleration (3,) that the daemon reads from a cue exp(2πi f t) which it knows
    every `step_s`, relative to the cue, as a mean over offsets from the knot before."""
    track = CueTrack(np.full(2, np.inf), np.inf)
    knots = step_s * np.arange(-3, 5)
    waves = np.exp(2j * np.pi * f * knots)
    poses = [TimedPose(t, (w.real, w.imag)) for t, w in zip(knots, waves, strict=True)]
    track.add(Cue("wave", 1, 0.0, 0.0, tuple(poses)))
    states = np.array([track.target(t) for t in offsets_s])
    seen = states[:, :, 0] + 1j * states[:, :, 1]
    return np.asarray(np.mean(seen * np.exp(-2j * np.pi * f * offsets_s)[:, None], axis=0))
