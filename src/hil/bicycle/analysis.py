"""Takes a ride apart: kinematics, forces and torques, path and drift, and the IMU beside the model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hil.bicycle.checks import check_ride
from hil.bicycle.drift import Drift, find_drift
from hil.bicycle.effects import RideEffects
from hil.bicycle.expected import expected, motion_of
from hil.bicycle.recorded import Ride
from hil.bicycle.sensors import IMU_SIGNALS
from hil.errors import RunError
from hil.rigs.bicycle import (
    Motion,
    Packed,
    Smooth,
    impossible_bodies,
    low_pass,
    pack,
    reduced_inertia,
    smooth,
)
from hil.runs.importing.findings import Finding
from hil.units import quantity_unit

Array = NDArray[np.float64]

ROLLING: Final = 1.0
"""m/s: peaks of friction demand count while the bicycle rolls; at rest a foot holds it."""


@dataclass(frozen=True, slots=True)
class Compared:
    """One IMU signal against the model, raw at the IMU's own instants or both through the same filter."""

    signal: str
    filtered: bool
    rms: float
    """Of the difference, bias taken out, in the signal's unit."""
    bias: float
    spread: float
    """Standard deviation of what was measured."""
    correlation: float
    floor: float
    """Of the difference that the sensors' noise alone leaves."""

    @property
    def unit(self) -> str:
        """Of `rms`, `bias`, `spread` and `floor`."""
        return quantity_unit(self.signal.removeprefix("imu."))

    @property
    def is_quiet(self) -> bool:
        """Whether noise is larger than all that was measured, so that nothing can be said of the model."""
        return self.floor > self.spread

    @property
    def explained(self) -> float:
        """Share of the measured variance that the model explains; may be negative."""
        return 1.0 - (self.rms / self.spread) ** 2 if self.spread > 0.0 else float("nan")

    @property
    def said(self) -> str:
        """`explained` in words, where anything can be said."""
        return "too quiet to judge" if self.is_quiet else f"{100.0 * self.explained:.1f} %"


@dataclass(frozen=True, slots=True)
class Analysis:
    """All that was computed of one ride, with the effects of its rig file."""

    ride: Ride
    bicycle: Packed
    told: Smooth
    motion: Motion
    lean_torque: Array
    """(N,) that nobody explains, the rider's effects among the file's taken out, N m."""
    lean_torque_floor: float
    """Root mean square of it that the sensors' noise alone leaves while the bicycle rolls."""
    measured: dict[str, Array]
    """IMU signals on the ride's grid, as they came."""
    filtered: dict[str, tuple[Array, Array]]
    """IMU signals on the grid through the ride's own low-pass: measured, model."""
    compared: tuple[Compared, ...]
    drift: Drift
    findings: tuple[Finding, ...]

    @property
    def rolls(self) -> NDArray[np.bool_]:
        """(N,) where the bicycle rolls: friction demand and what is left of torques count there."""
        return np.asarray(self.motion.speed > ROLLING)

    @property
    def reduced_torque(self) -> Array:
        """(N,) drive torque as the reduced inertia says, with drag, N m."""
        rig = self.ride.rig
        drag = rig.aero * self.motion.speed * np.abs(self.motion.speed) * rig.geometry.R
        return np.asarray(reduced_inertia(rig) * self.motion.qdd[:, 4] + drag)

    def numbers(self) -> dict[str, Any]:
        """For people and scripts; SI units, angles in rad."""
        m, rig = self.motion, self.ride.rig
        rolls = self.rolls
        demand = np.where(rolls[:, None], m.friction_demand, np.nan)
        both = _rms(m.drive_torque[rolls]) if rolls.any() else float("nan")
        off = _rms((m.drive_torque - self.reduced_torque)[rolls]) if rolls.any() else float("nan")
        return {
            "duration_s": float(m.t_s[-1]),
            "samples": len(m.q),
            "distance_m": float(np.sum(np.abs(m.speed)) * m.dt_s),
            "speed_max": float(m.speed.max()),
            "lean": _range(m.q[:, 3]),
            "steer": _range(m.q[:, 6]),
            "frame_pitch": _range(m.q[:, 5]),
            "end": [float(v) for v in m.q[-1, :3]],
            "drift": self.drift.numbers(),
            "steer_torque": _range(m.steer_torque),
            "drive_torque": _range(m.drive_torque),
            "drive_torque_rms": both,
            "drive_torque_off_reduced_inertia_rms": off,
            "reduced_inertia": reduced_inertia(rig),
            "lean_torque_rms": _rms(self.lean_torque[rolls]) if rolls.any() else float("nan"),
            "lean_torque_noise_rms": self.lean_torque_floor,
            "normal_rear": _range(m.normal[:, 0]),
            "normal_front": {**_range(m.normal[:, 1]), "mean": float(m.normal[:, 1].mean())},
            "friction_demand_rear": _peak(demand[:, 0], m),
            "friction_demand_front": _peak(demand[:, 1], m),
            "imu": [
                {
                    "signal": c.signal,
                    "filtered": c.filtered,
                    "rms": c.rms,
                    "bias": c.bias,
                    "spread": c.spread,
                    "correlation": c.correlation,
                    "noise_rms": c.floor,
                    "explained": c.explained,
                }
                for c in self.compared
            ],
            "findings": [
                {"check": f.check, "subject": f.subject, "verdict": f.verdict, "text": f.text}
                for f in self.findings
            ],
        }


def analyse(recorded: Ride) -> Analysis:
    """Compute the ride; RunError where its channels contradict each other (`check_ride`)."""
    rig = recorded.rig
    findings = [*recorded.findings, *check_ride(recorded)]
    findings += [Finding("inertia", rig.name, "warning", text) for text in impossible_bodies(rig)]
    faults = [f"{recorded.name}: {f.subject}: {f.text}" for f in findings if f.verdict == "fault"]
    if faults:
        raise RunError("\n".join(faults))
    effects = RideEffects.of(rig)
    bicycle = effects.bicycle(pack(rig))
    how = rig.conditioning
    t = recorded.t_s
    angles = effects.true_angles(t, recorded.angles)
    told = smooth(angles, recorded.dt_s, how.cutoff, how.order)
    motion = motion_of(rig, effects, recorded.dt_s, angles)
    floor = expected(rig, effects, t, angles, motion, motion.speed > ROLLING)
    answers = effects.imu(t, motion)
    measured = {s: np.asarray(np.interp(t, *v)) for s, v in recorded.imu.items()}
    filtered = {}
    compared = []
    for k, signal in enumerate(IMU_SIGNALS):
        if signal not in measured:
            continue
        stamps, values = recorded.imu[signal]
        inside = (stamps >= t[0]) & (stamps <= t[-1])
        model = np.interp(stamps[inside], t, answers[:, k])
        compared.append(_compared(signal, False, values[inside], model, floor.raw[signal]))
        pair = np.column_stack([measured[signal], answers[:, k]])
        soft = low_pass(pair, recorded.dt_s, how.cutoff, how.order)
        filtered[signal] = (soft[:, 0], soft[:, 1])
        compared.append(_compared(signal, True, soft[:, 0], soft[:, 1], floor.filtered[signal]))
    findings += _lifts(motion) + _stands(motion)
    drift = find_drift(bicycle, angles, recorded.dt_s, how.cutoff, how.order, motion)
    return Analysis(
        recorded, bicycle, told, motion, effects.lean_torque(rig, motion),
        floor.lean_torque, measured, filtered, tuple(compared), drift, tuple(findings),
    )  # fmt: skip


def _compared(signal: str, filtered: bool, measured: Array, model: Array, floor: float) -> Compared:
    off = measured - model
    spread = float(measured.std())
    both = spread * float(model.std())
    correlation = (
        float(np.mean((measured - measured.mean()) * (model - model.mean())) / both)
        if both
        else 0.0
    )
    return Compared(
        signal, filtered, float(off.std()), float(off.mean()), spread, correlation, floor
    )


def _lifts(motion: Motion) -> list[Finding]:
    out = []
    for k, wheel in enumerate(("rear wheel", "front wheel")):
        up = motion.normal[:, k] < 0.0
        if up.any():
            text = (
                f"its normal force falls below zero at {motion.t_s[np.argmax(up)]:.2f} s: by the model it "
                "leaves the road there, and what follows from its contact does not hold"
            )
            out.append(Finding("lift", wheel, "warning", text))
    return out


def _stands(motion: Motion) -> list[Finding]:
    fastest = float(motion.speed.max())
    if fastest > ROLLING:
        return []
    text = (
        f"rolls at no more than {fastest:.2f} m/s, and below {ROLLING:g} m/s neither friction demand nor "
        "what is left of torques counts; if the bicycle was ridden, its angle is not in rad, or its encoder "
        "is stuck"
    )
    return [Finding("rest", "rear_wheel", "warning", text)]


def _range(values: Array) -> dict[str, float]:
    return {"lowest": float(values.min()), "highest": float(values.max())}


def _peak(values: Array, motion: Motion) -> dict[str, float]:
    if np.isnan(values).all():
        return {"peak": float("nan"), "t_s": float("nan")}
    k = int(np.nanargmax(values))
    return {"peak": float(values[k]), "t_s": float(motion.t_s[k])}


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
