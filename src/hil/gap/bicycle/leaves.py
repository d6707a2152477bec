"""The candidates of a ride: every effect of the bicycle's part of the catalogue."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from hil.config.bicycle import SIGNALS
from hil.gap.bicycle.twin import LEAN_TORQUE
from hil.gap.record.leaf import Changes, Leaf, Start
from hil.gap.record.problem import Problem

STIFF_FORK: Final = (6e3, 2e4, 6e4)
"""N/m: a mountain bicycle's fork to a road bicycle's."""
STIFF_TYRE: Final = (5e4, 1e5, 2e5)
DELAYS_S: Final = (0.005, 0.01, 0.02, 0.04, 0.08)
RATES: Final = (3e-4, 1e-3, 3e-3, 6e-3)
"""Of a clock, s/s: over a ride even small ones move signals by more than any linear picture holds."""


def ride_leaves(problem: Problem, without: Collection[str] = ()) -> list[Leaf]:
    """Every effect of the bicycle's part of the catalogue that these rides could show."""
    out = [
        _compliant("front_suspension", STIFF_FORK, 400.0),
        _compliant("tyre_compliance", STIFF_TYRE, 250.0),
        _rear_wheel(),
        _leaf("wheel_radius", "front_wheel", ("scale",), [({"scale": 1.01},)]),
        _leaf("wheel_slip", "rear_wheel", ("coefficient",), [({"coefficient": 0.01},)]),
    ]
    if LEAN_TORQUE in problem.signals:
        prefix = "bicycle.rider_motion."
        starts = [Start({}, ({f"{prefix}gain": 0.2},))]
        starts += [
            Start({f"{prefix}damping": 100.0}, ({f"{prefix}stiffness": k},))
            for k in (600.0, 2500.0)
        ]
        names = tuple(f"{prefix}{p}" for p in ("stiffness", "damping", "gain"))
        out.append(Leaf("rider_motion", "bicycle", names, tuple(starts), None))
    for s in SIGNALS:
        out += _sensor(s, 0.01)
    channels = [s for s in problem.signals if s.startswith("imu.")]
    for s in channels:
        out += _sensor(s, problem.table[f"{s}.sensor_bias.offset"].scale)
    if channels:
        out.append(_leaf("sensor_latency", "imu", ("delay",), [({"delay": d},) for d in DELAYS_S]))
        out.append(_leaf("sensor_scale", "imu", ("scale",), [({"scale": 1.02},)]))
        turns: tuple[Changes, ...] = tuple({c: 0.02} for c in "xyz")
        out.append(_leaf("sensor_misalignment", "imu", ("x", "y", "z"), [turns]))
        drifts: list[tuple[Changes, ...]] = [({"rate": w * r},) for r in RATES for w in (1.0, -1.0)]
        out.append(_leaf("clock_drift", "imu", ("rate",), drifts))
    return [leaf for leaf in out if leaf.effect not in without]


def _rear_wheel() -> Leaf:
    """Of another radius, on which the frame stands higher, or which the rig file has wrong."""
    scale, frame = (f"rear_wheel.wheel_radius.{name}" for name in ("scale", "frame"))
    starts = (Start({}, ({scale: 1.01},)), Start({frame: 0.0}, ({scale: 1.01},)))
    return Leaf("wheel_radius", "rear_wheel", (scale, frame), starts, None)


def _compliant(effect: str, stiffness: Collection[float], damping: float) -> Leaf:
    prefix = f"bicycle.{effect}."
    starts = tuple(
        Start({f"{prefix}damping": damping}, ({f"{prefix}stiffness": k},)) for k in stiffness
    )
    return Leaf(effect, "bicycle", (f"{prefix}stiffness", f"{prefix}damping"), starts, None)


def _leaf(
    effect: str, location: str, parameters: tuple[str, ...], starts: list[tuple[Changes, ...]]
) -> Leaf:
    prefix = f"{location}.{effect}."
    made = tuple(
        Start({}, tuple({prefix + k: v for k, v in column.items()} for column in columns))
        for columns in starts
    )
    return Leaf(effect, location, tuple(prefix + p for p in parameters), made, None)


def _sensor(signal: str, size: float) -> list[Leaf]:
    return [
        _leaf("sensor_bias", signal, ("offset",), [({"offset": size},)]),
        _leaf("sensor_scale", signal, ("scale",), [({"scale": 1.02},)]),
        _leaf("sensor_latency", signal, ("delay",), [({"delay": d},) for d in DELAYS_S]),
    ]
