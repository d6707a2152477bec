"""Catalogue: the platform, its joints, the ground it stands on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.third_lab.effect import Effect, Setting, on_plant
from benchmarks.third_lab.engine import PLANE


def payload_mass(s: Setting) -> Effect:
    """More mass at the rig file's centre of gravity."""
    own, at = s.ideal.mass, s.ideal.cog
    return Effect(
        "payload_mass",
        "platform",
        0.03 * own,
        s.rng.uniform(0.3, 0.5) * own,
        on_plant(
            lambda x, p: replace(p, mass=p.mass + x, cog=(p.mass * p.cog + x * at) / (p.mass + x))
        ),
        lambda x: {"mass": x},
        calibrates_away=True,
    )


def payload_cog(s: Setting) -> Effect:
    """The centre of gravity lies elsewhere."""
    d = s.direction() * (1.0, 1.0, 0.6)
    d /= np.linalg.norm(d)
    return Effect(
        "payload_cog",
        "platform",
        0.012,
        0.15,
        on_plant(lambda x, p: replace(p, cog=p.cog + x * d)),
        lambda x: _xyz(x * d),
        calibrates_away=True,
    )


def payload_inertia(s: Setting) -> Effect:
    """More moments of inertia, as of one more body that has some about every axis."""
    share = s.rng.uniform(0.4, 1.0, 3)
    share[s.rng.integers(3)] = 1.0
    own = np.diag(s.ideal.inertia) * share
    return Effect(
        "payload_inertia",
        "platform",
        0.08,
        1.0,
        on_plant(lambda x, p: replace(p, inertia=p.inertia + np.diag(x * own))),
        lambda x: dict(zip(("xx", "yy", "zz"), map(float, x * own), strict=True)),
        calibrates_away=True,
    )


def geometry_error(s: Setting) -> Effect:
    """A leg's joint sits elsewhere, on the base or on the platform."""
    legs = [a for a in s.ideal.rig.actuator_names if a.startswith("leg")]
    leg, end = str(s.rng.choice(legs)), str(s.rng.choice(["base", "platform"]))
    m = int(np.flatnonzero(s.ideal.actuated == s.ideal.index(leg))[0])
    free = (1.0, 0.0, 1.0) if s.ideal.kind[m] == PLANE and end == "base" else (1.0, 1.0, 1.0)
    d = s.direction() * free
    d /= np.linalg.norm(d)
    field = "base" if end == "base" else "cabin"

    def moved(joints: np.ndarray, x: float) -> np.ndarray:
        out = joints.copy()
        out[m] += x * d
        return out

    return Effect(
        "geometry_error",
        f"{leg}.{end}",
        8e-4,
        0.025,
        on_plant(lambda x, p: replace(p, **{field: moved(getattr(p, field), x)})),
        lambda x: _xyz(x * d),
        calibrates_away=True,
    )


def base_tilt(s: Setting) -> Effect:
    """The base is not level; an axis that lies along x only feels pitch."""
    angle = s.rng.uniform(0.0, 2.0 * np.pi)
    d = np.array([np.cos(angle), np.sin(angle)])
    if s.ideal.rig.kind == "axis_1dof":
        d = np.array([0.0, s.side()])
    return Effect(
        "base_tilt",
        "platform",
        0.006,
        0.08,
        on_plant(lambda x, p: replace(p, tilt=p.tilt + x * d)),
        lambda x: {"roll": float(x * d[0]), "pitch": float(x * d[1])},
        calibrates_away=True,
    )


def _xyz(v: np.ndarray) -> dict[str, float]:
    return dict(zip("xyz", map(float, v), strict=True))


MAKERS = (payload_mass, payload_cog, payload_inertia, geometry_error, base_tilt)
