"""Catalogue: friction and hysteresis of an actuator. All are added to the rig's own."""

from __future__ import annotations

from typing import Any

from benchmarks.third_lab.effect import Effect, Setting, on_plant


def coulomb_friction(s: Setting) -> Effect:
    """More Coulomb friction, alike in both directions."""
    a, own, most = _drawn(s)
    return Effect(
        "coulomb_friction",
        a,
        0.2 * own,
        most,
        on_plant(lambda x, p: p.add(a, coulomb_pos=x, coulomb_neg=x)),
        lambda x: {"force": x},
    )


def viscous_friction(s: Setting) -> Effect:
    """More viscous friction."""
    a = s.actuator()
    own = s.nominal(a).viscous
    return Effect(
        "viscous_friction",
        a,
        0.2 * own,
        15.0 * own,
        on_plant(lambda x, p: p.add(a, viscous=x)),
        lambda x: {"coefficient": x},
        calibrates_away=True,
    )


def stribeck_friction(s: Setting) -> Effect:
    """Friction that falls from `static` to `coulomb` with speed: exponential, of first or second power."""
    a, own, most = _drawn(s)
    share, v, power = (
        s.rng.uniform(0.1, 0.5),
        s.rng.uniform(0.004, 0.025),
        float(s.rng.integers(1, 3)),
    )

    def change(x: float, p: Any) -> Any:
        more = p.add(a, coulomb_pos=share * x, coulomb_neg=share * x)
        return more.set(a, static_extra=(1.0 - share) * x, stribeck_v=v, stribeck_power=power)

    return Effect(
        "stribeck_friction",
        a,
        0.4 * own,
        most,
        on_plant(change),
        lambda x: {"coulomb": share * x, "static": x, "velocity": v},
    )


def asymmetric_friction(s: Setting) -> Effect:
    """More Coulomb friction, in one direction mostly."""
    a, own, most = _drawn(s)
    less = s.rng.uniform(0.0, 0.35)
    up, down = (1.0, less) if s.rng.random() < 0.5 else (less, 1.0)
    return Effect(
        "asymmetric_friction",
        a,
        0.25 * own,
        most,
        on_plant(lambda x, p: p.add(a, coulomb_pos=up * x, coulomb_neg=down * x)),
        lambda x: {"positive": up * x, "negative": down * x},
    )


def load_friction(s: Setting) -> Effect:
    """Friction that grows with the force transmitted; half the time more so against the load than with it."""
    a = s.actuator()
    skew = s.rng.uniform(0.2, 0.6) if s.rng.random() < 0.5 else 0.0
    return Effect(
        "load_friction",
        a,
        0.012,
        s.rng.uniform(0.3, 0.5),
        on_plant(lambda x, p: p.set(a, load_against=x * (1.0 + skew), load_with=x * (1.0 - skew))),
        lambda x: {"coefficient": x},
    )


def hysteresis(s: Setting) -> Effect:
    """An elastic-plastic element beside the drive: Dahl's, or Bouc-Wen's with n = 2."""
    a, own, most = _drawn(s)
    span, power = s.rng.uniform(4e-4, 5e-3), float(s.rng.integers(1, 3))
    return Effect(
        "hysteresis",
        a,
        0.3 * own,
        most,
        on_plant(lambda x, p: p.set(a, hyst_force=x, hyst_d=span, hyst_power=power)),
        lambda x: {"force": x, "displacement": span},
    )


def _drawn(s: Setting) -> tuple[str, float, float]:
    """An actuator, its own Coulomb friction and a twelfth of its drive's force: no rig runs with more, N."""
    a = s.actuator()
    table = s.nominal(a)
    return a, table.coulomb, table.force_max / 12.0


MAKERS = (
    coulomb_friction,
    viscous_friction,
    stribeck_friction,
    asymmetric_friction,
    load_friction,
    hysteresis,
)
