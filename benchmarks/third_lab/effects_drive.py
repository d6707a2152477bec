"""Catalogue: transmission, motor and drive of an actuator, and the bus."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.third_lab.effect import Effect, Setting, on_plant, on_sensing


def backlash(s: Setting) -> Effect:
    """Play between motor and load, the whole of it, with flanks that take hold over a tenth."""
    a = s.actuator()
    soft = s.rng.uniform(0.05, 0.2)
    return Effect(
        "backlash",
        a,
        3e-5,
        2e-3,
        on_plant(lambda x, p: p.set(a, gap=x, flank=soft * x)),
        lambda x: {"gap": x},
    )


def compliance(s: Setting) -> Effect:
    """A softer transmission; the encoder sits on the motor. `size` is 1 / stiffness, m/N."""
    a = s.actuator()
    mass, zeta = s.nominal(a).effective_mass, s.rng.uniform(0.02, 0.08)

    def damping(x: float) -> float:
        return float(2.0 * zeta * np.sqrt(mass / x))

    return Effect(
        "compliance",
        a,
        1.0 / 1.5e7,
        1.0 / 1.5e5,
        on_plant(lambda x, p: p.set(a, stiffness=1.0 / x, damping=damping(x))),
        lambda x: {"stiffness": 1.0 / x, "damping": damping(x)},
    )


def actuator_inertia(s: Setting) -> Effect:
    """More mass on the motor's shaft."""
    a = s.actuator()
    moved = s.nominal(a).effective_mass
    return Effect(
        "actuator_inertia",
        a,
        0.03 * moved,
        s.rng.uniform(0.4, 0.6) * moved,
        on_plant(lambda x, p: p.add(a, reflected=x)),
        lambda x: {"mass": x},
        calibrates_away=True,
    )


def force_saturation(s: Setting) -> Effect:
    """The drive gives less than it should; `size` is the share of the healthy excursion cut off."""
    a = s.actuator()
    mean, most = s.force[s.ideal.index(a)]

    def limit(x: float) -> float:
        return float(mean + (most - mean) * (1.0 - x))

    return Effect(
        "force_saturation",
        a,
        0.02,
        0.75,
        on_plant(lambda x, p: p.set(a, force_limit=limit(x))),
        lambda x: {"limit": limit(x)},
    )


def velocity_saturation(s: Setting) -> Effect:
    """The drive goes slower than it should; `size` is the share of the healthy top speed cut off."""
    a = s.actuator()
    most = float(s.speed[s.ideal.index(a)])
    return Effect(
        "velocity_saturation",
        a,
        0.02,
        0.7,
        on_plant(lambda x, p: p.set(a, speed_limit=most * (1.0 - x))),
        lambda x: {"limit": most * (1.0 - x)},
    )


def force_ripple(s: Setting) -> Effect:
    """True force = commanded + amplitude (sin + some of the second harmonic), over the counted position."""
    a = s.actuator()
    period, phase = float(s.rng.uniform(0.003, 0.02)), float(s.rng.uniform(0.0, 2.0 * np.pi))
    second = s.rng.uniform(0.0, 0.25)
    return Effect(
        "force_ripple",
        a,
        3.0,
        200.0,
        on_plant(
            lambda x, p: p.set(
                a, ripple=x, ripple_period=period, ripple_phase=phase, ripple_second=second
            )
        ),
        lambda x: {"amplitude": x, "period": period, "phase": phase},
    )


def force_constant(s: Setting) -> Effect:
    """True force = scale times the reported one."""
    a, side = s.actuator(), s.side()
    return Effect(
        "force_constant",
        a,
        0.025,
        s.rng.uniform(0.25, 0.4),
        on_plant(lambda x, p: p.scale(a, torque=1.0 + side * x)),
        lambda x: {"scale": 1.0 + side * x},
        calibrates_away=True,
    )


def loop_gain(s: Setting) -> Effect:
    """One gain of the drive, or two, are not the rig file's."""
    a = s.actuator()
    which = s.rng.permutation(3)[: s.rng.integers(1, 3)]
    share = np.zeros(3)
    share[which] = s.rng.uniform(0.6, 1.0, len(which)) * s.rng.choice([-1.0, 0.6], len(which))

    def gains(x: float) -> np.ndarray:
        return 1.0 + x * share

    def change(x: float, p: object) -> object:
        g = gains(x)
        return p.scale(a, position_gain=g[0], speed_gain=g[1], integral_gain=g[2])

    return Effect(
        "loop_gain",
        a,
        0.05,
        0.7,
        on_plant(change),
        lambda x: dict(zip(("position", "speed", "integral"), map(float, gains(x)), strict=True)),
    )


def transport_delay(s: Setting) -> Effect:
    """Setpoints reach the drive later."""
    a = s.actuator()
    return Effect(
        "transport_delay",
        a,
        1.5e-3,
        0.025,
        on_plant(lambda x, p: p.add(a, setpoint_delay=x)),
        lambda x: {"delay": x},
        calibrates_away=True,
    )


def lead_error(s: Setting) -> Effect:
    """True travel = scale times counted travel about home, or a periodic error of the screw on top."""
    a, side = s.actuator(), s.side()
    if s.rng.random() < 0.5:
        return Effect(
            "lead_error",
            a,
            0.002,
            0.08,
            on_plant(lambda x, p: p.scale(a, lead=1.0 + side * x)),
            lambda x: {"scale": 1.0 + side * x},
            calibrates_away=True,
        )
    period, phase = float(s.rng.uniform(0.004, 0.03)), float(s.rng.uniform(0.0, 2.0 * np.pi))
    return Effect(
        "lead_error",
        a,
        5e-6,
        0.06 * period,
        on_plant(lambda x, p: p.set(a, lead_amplitude=x, lead_period=period, lead_phase=phase)),
        lambda x: {"scale": 1.0, "amplitude": x, "period": period},
    )


def position_offset(s: Setting) -> Effect:
    """Homing error: true length = counted length + offset."""
    a, side = s.actuator(), s.side()
    return Effect(
        "position_offset",
        a,
        6e-4,
        0.015,
        on_plant(lambda x, p: p.add(a, offset=side * x)),
        lambda x: {"offset": side * x},
        calibrates_away=True,
    )


def lost_frames(s: Setting) -> Effect:
    """Setpoints that never reach their drive, and in half the cases answers that never reach us."""
    share = s.rng.uniform(0.4, 1.0) if s.rng.random() < 0.5 else 0.0
    setpoints = on_plant(lambda x, p: replace(p, lost_setpoints=x))
    answers = on_sensing(lambda x, m: replace(m, lost_answers=share * x))
    return Effect(
        "lost_frames",
        "bus",
        0.01,
        0.4,
        lambda x, world: answers(x, setpoints(x, world)),
        lambda x: {"setpoints": x, "answers": share * x},
    )


MAKERS = (
    backlash,
    compliance,
    actuator_inertia,
    force_saturation,
    velocity_saturation,
    force_ripple,
    force_constant,
    loop_gain,
    transport_delay,
    lead_error,
    position_offset,
    lost_frames,
)
