"""Effects from outside the catalogue that a case may have: places and numbers, drawn."""

from __future__ import annotations

import math

import numpy as np

from hil.config import AxisGeometry, RigFile
from hil.exam.actuator_menu import Make, sign
from hil.exam.menu import Recipe
from hil.runs.folder import run_mode


def draw_outside(rig: RigFile, kind: str, duration_s: float, rng: np.random.Generator) -> Recipe:
    """Place and numbers of an effect from outside the catalogue."""
    a = rig.actuators[rng.integers(len(rig.actuators))]
    span, top = a.stroke[1] - a.stroke[0], a.force_max
    rigid = rig.mass.m
    along = rng.standard_normal(3)
    if isinstance(rig.geometry, AxisGeometry):
        along = (
            np.array([1.0, 0.0, 0.0])
            if rig.geometry.load != "vertical"
            else np.array([0.0, 0.0, 1.0])
        )
    along /= np.linalg.norm(along)
    u = rng.uniform
    if kind == "cable_drag":
        start = u(-0.05, 0.02) * span
        return _out(
            kind,
            a.name,
            lambda s: {"stiffness": s, "from": start},
            0.1 * top / span,
            5.0 * top / span,
        )
    if kind == "seal_stiction":
        time = u(0.3, 1.5)
        return _out(kind, a.name, lambda s: {"force": s, "time": time}, 0.03 * top, 0.3 * top)
    if kind == "thermal_drift":
        time = u(0.15, 0.35) * duration_s
        return _out(
            kind,
            a.name,
            lambda s: {"coefficient": s, "time": time},
            3.0 * a.viscous,
            0.5 * top / a.velocity_max,
        )
    if kind == "bump":
        at, width = u(-0.05, 0.05) * span, u(0.006, 0.02) * span
        return _out(
            kind, a.name, lambda s: {"force": s, "at": at, "width": width}, 0.03 * top, 0.3 * top
        )
    if kind == "quadratic_drag":
        return _out(
            kind,
            a.name,
            lambda s: {"coefficient": s},
            0.1 * top / a.velocity_max**2,
            top / a.velocity_max**2,
        )
    if kind == "limit_cycle":
        rate = 2.0 * math.pi * u(9.0, 22.0)
        return _out(kind, a.name, lambda s: {"force": s, "rate": rate}, 0.005 * top, 0.1 * top)
    if kind == "swelling_cogging":
        period, zero, length = u(0.02, 0.06) * span, u(-0.1, 0.1) * span, 0.2 * span
        return _out(
            kind, a.name,
            lambda s: {"force": s, "period": period, "zero": zero, "length": length}, 0.01 * top, 0.15 * top,
        )  # fmt: skip
    if kind == "setpoint_rounding":
        return _out(kind, a.name, lambda s: {"step": s}, 2e-4 * span, 0.01 * span)
    if kind == "encoder_slip":
        way, time = sign(rng), u(0.3, 0.6) * duration_s
        return _out(
            kind, a.name, lambda s: {"jump": way * s, "time": time}, 2e-3 * span, 0.05 * span
        )
    if kind == "thermal_derating":
        time = u(3.0, 10.0)
        return _out(kind, a.name, lambda s: {"share": s, "time": time}, 0.1, 1.0)
    if kind == "slosh":
        rate, damping = 2.0 * math.pi * u(0.6, 2.0), u(0.02, 0.08)
        x, y, z = np.array(rig.mass.cog) + np.array([0.0, 0.0, 0.2])
        return _out(
            kind, "platform",
            lambda s: {
                "mass": s, "rate": rate, "damping": damping, "x": float(x), "y": float(y), "z": float(z),
            },
            0.05 * rigid, 0.35 * rigid,
        )  # fmt: skip
    if kind == "soft_base":
        rate, damping = 2.0 * math.pi * u(4.0, 8.0), u(0.02, 0.06)
        return _out(
            kind, "platform", lambda s: {"ratio": s, "rate": rate, "damping": damping}, 0.2, 0.9
        )
    if kind == "failing_counterbalance":
        first, second, phase = u(5.0, 9.0), u(2.3, 4.0), u(0.0, 6.28)
        return _out(
            kind, "platform",
            lambda s: {"force": s, "period": first, "second": second, "phase": phase},
            0.02 * rigid * 9.81, 0.5 * rigid * 9.81,
        )  # fmt: skip
    rate, phase = 2.0 * math.pi * float(np.exp(u(math.log(0.4), math.log(4.0)))), u(0.0, 6.28)
    x, y, z = (float(c) for c in along)
    return _out(
        "periodic_push", "platform",
        lambda s: {"force": s, "rate": rate, "phase": phase, "x": x, "y": y, "z": z},
        0.02 * rigid, 3.0 * rigid,
    )  # fmt: skip


def _out(kind: str, location: str, make: Make, guess: float, largest: float) -> Recipe:
    return Recipe(kind, location, make, guess, largest, is_outside=True)


def outside_of(rig: RigFile, kinds: tuple[str, ...]) -> tuple[str, ...]:
    """Those of the outside kinds that act on this rig: a pendulum feels no force on its pivot, and so on."""
    if run_mode(rig) == "force":
        kinds = tuple(k for k in kinds if k != "setpoint_rounding")  # of positions
    if not isinstance(rig.geometry, AxisGeometry):
        return kinds
    unfelt = {
        "horizontal": {"failing_counterbalance"},
        "vertical": {"soft_base"},
        "pendulum": {"failing_counterbalance", "periodic_push", "soft_base"},
    }
    return tuple(k for k in kinds if k not in unfelt[rig.geometry.load])
