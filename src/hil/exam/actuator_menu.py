"""Effects at an actuator that a case may have: other numbers drawn, one size left open.

Each function gives parameters by size, a first guess, the largest sane size, and the smallest that is no
matter of calibration.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from hil.config import Actuator

Make = Callable[[float], dict[str, float]]
Sizes = tuple[Make, float, float] | tuple[Make, float, float, float]


DELAY_S: Final = 0.0015
"""The smallest delay that is no matter of calibration: seven times what healthy rigs differ by."""


def sign(rng: np.random.Generator) -> float:
    """1 or -1."""
    return 1.0 if rng.random() < 0.5 else -1.0


def _coulomb(a: Actuator, rng: np.random.Generator) -> Sizes:
    return lambda s: {"force": s}, 0.01 * a.force_max, 0.2 * a.force_max, 0.25 * a.coulomb


def _viscous(a: Actuator, rng: np.random.Generator) -> Sizes:
    most = 0.5 * a.force_max / a.velocity_max
    return (
        lambda s: {"coefficient": s},
        2.0 * a.viscous,
        most,
        max(0.4 * a.viscous, 4e-3 * a.force_max),
    )


def _stribeck(a: Actuator, rng: np.random.Generator) -> Sizes:
    ratio = rng.uniform(1.8, 3.5)
    v = float(np.exp(rng.uniform(math.log(0.004), math.log(0.03)))) * a.velocity_max / 0.375
    return (
        lambda s: {"coulomb": s, "static": ratio * s, "velocity": v},
        0.008 * a.force_max,
        0.1 * a.force_max,
    )


def _asymmetric(a: Actuator, rng: np.random.Generator) -> Sizes:
    ratio = rng.uniform(0.1, 0.5)
    if rng.random() < 0.5:
        return (
            lambda s: {"positive": s, "negative": ratio * s},
            0.015 * a.force_max,
            0.2 * a.force_max,
        )
    return lambda s: {"positive": ratio * s, "negative": s}, 0.015 * a.force_max, 0.2 * a.force_max


def _load(a: Actuator, rng: np.random.Generator) -> Sizes:
    way = rng.uniform(-0.3, 0.6)
    return lambda s: {"coefficient": s, "asymmetry": way}, 0.05, 0.5


def _backlash(a: Actuator, rng: np.random.Generator) -> Sizes:
    span = a.stroke[1] - a.stroke[0]
    return lambda s: {"gap": s}, 1e-3 * span, 0.01 * span


def _hysteresis(a: Actuator, rng: np.random.Generator) -> Sizes:
    way = float(np.exp(rng.uniform(math.log(0.001), math.log(0.012)))) * (a.stroke[1] - a.stroke[0])
    return lambda s: {"force": s, "displacement": way}, 0.015 * a.force_max, 0.2 * a.force_max


def _compliance(a: Actuator, rng: np.random.Generator) -> Sizes:
    load = max(a.effective_mass - a.reflected_mass, 0.4 * a.effective_mass)
    stiff = load * (2.0 * math.pi * 25.0) ** 2
    share = rng.uniform(0.03, 0.1)

    def make(s: float) -> dict[str, float]:
        k = stiff / s
        return {"stiffness": k, "damping": 2.0 * share * math.sqrt(k * load)}

    return make, 1.0, 20.0


def _inertia(a: Actuator, rng: np.random.Generator) -> Sizes:
    return lambda s: {"mass": s}, 0.1 * a.effective_mass, a.effective_mass, 0.05 * a.effective_mass


def _ripple(a: Actuator, rng: np.random.Generator) -> Sizes:
    span = a.stroke[1] - a.stroke[0]
    lead = getattr(a.transmission, "lead", None) or 0.02 * span
    period = float(rng.choice([1.0, 1.0, 0.5])) * lead
    phase = rng.uniform(0.0, 6.28)
    return (
        lambda s: {"amplitude": s, "period": period, "phase": phase},
        0.01 * a.force_max,
        0.15 * a.force_max,
    )


def _constant(a: Actuator, rng: np.random.Generator) -> Sizes:
    way = sign(rng)
    return lambda s: {"scale": math.exp(way * s)}, 0.05, 0.5, 0.05


def _gains(a: Actuator, rng: np.random.Generator) -> Sizes:
    keys = ["position", "speed"] + (["integral"] if a.law != "pd" else [])
    key = keys[rng.integers(len(keys))]
    way = -1.0 if rng.random() < 0.7 else 1.0
    smallest = 0.03
    if key == "position" and a.law != "pd":  # what lags is a delay to a calibration
        smallest = max(smallest, DELAY_S * a.position_gain)
    return (
        lambda s: {
            k: math.exp(way * s) if k == key else 1.0 for k in ("position", "speed", "integral")
        },
        0.15,
        0.9 if way < 0.0 else 0.45,
        min(smallest, 0.25),
    )


def _delay(a: Actuator, rng: np.random.Generator) -> Sizes:
    return lambda s: {"delay": s}, 0.002, 0.04, DELAY_S


def _offset(a: Actuator, rng: np.random.Generator) -> Sizes:
    way = sign(rng)
    span = a.stroke[1] - a.stroke[0]
    return lambda s: {"offset": way * s}, 0.003 * span, 0.04 * span


def _lead(a: Actuator, rng: np.random.Generator) -> Sizes:
    if rng.random() < 0.5:
        way = sign(rng)
        return lambda s: {"scale": 1.0 + way * s}, 0.02, 0.15, 0.005
    lead = getattr(a.transmission, "lead", None) or 0.02 * (a.stroke[1] - a.stroke[0])
    return (
        lambda s: {"scale": 1.0, "amplitude": s, "period": lead},
        0.004 * lead,
        0.08 * lead,
    )


def _force_limit(a: Actuator, rng: np.random.Generator) -> Sizes:
    return lambda s: {"limit": a.force_max * math.exp(-s)}, 1.0, 4.5


def _speed_limit(a: Actuator, rng: np.random.Generator) -> Sizes:
    return lambda s: {"limit": a.velocity_max * math.exp(-s)}, 1.0, 4.0


ACTUATOR: Final = {
    "coulomb_friction": _coulomb,
    "viscous_friction": _viscous,
    "stribeck_friction": _stribeck,
    "asymmetric_friction": _asymmetric,
    "load_friction": _load,
    "backlash": _backlash,
    "hysteresis": _hysteresis,
    "compliance": _compliance,
    "actuator_inertia": _inertia,
    "force_saturation": _force_limit,
    "velocity_saturation": _speed_limit,
    "force_ripple": _ripple,
    "force_constant": _constant,
    "loop_gain": _gains,
    "transport_delay": _delay,
    "position_offset": _offset,
    "lead_error": _lead,
}
