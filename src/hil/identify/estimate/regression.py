"""The linear problem F = W p of a rig: which columns, in whose units, what is known beforehand.

Rows are actuator forces, one a grid instant and actuator, so that each has its own sensor's noise.
Known and taken to the left side: rotor masses, legs' masses, products of inertia where not estimated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from hil.config import RigFile
from hil.identify.estimate.names import number
from hil.identify.estimate.prepare import Mask, Prepared
from hil.rigs.kernel import AXIS, PENDULUM
from hil.rigs.pack import kind_code, pack_reflected

Array = NDArray[np.float64]
BodySet = Literal["principal", "full"]
"""principal: mass and principal moments about the known centre of gravity; full: all ten."""
INERTIA: Final = ("xx", "yy", "zz", "xy", "xz", "yz")
_PLACE: Final = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclass(frozen=True, slots=True)
class Column:
    """One unknown. `scale`: the size at which it matters, for judging how well it is told."""

    name: str
    unit: str
    nominal: float
    scale: float


@dataclass(frozen=True, slots=True)
class Regression:
    """y = W p + noise; stretches one after another."""

    columns: tuple[Column, ...]
    W: Array
    """(N, n, P)"""
    y: Array
    """(N, n) force that the columns have to explain, N."""
    keep: Mask
    """(N, n) rows that count."""
    starts: tuple[int, ...]
    """First row of each stretch, then N: nothing correlates across."""
    cutoff_hz: float
    prepared: tuple[Prepared, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(c.name for c in self.columns)

    @property
    def nominal(self) -> Array:
        """(P,) the rig file's values."""
        return np.array([c.nominal for c in self.columns])

    @property
    def scale(self) -> Array:
        """(P,) size at which each matters."""
        return np.array([c.scale for c in self.columns])

    def weighted(self, sigma_n: Array) -> Regression:
        """Rows of each actuator divided by its noise (n,)."""
        return replace(self, W=self.W / sigma_n[None, :, None], y=self.y / sigma_n)


def regression(
    rig: RigFile,
    prepared: Sequence[Prepared],
    cutoff_hz: float,
    *,
    body: BodySet = "principal",
    offsets: bool = False,
    rotors: bool = False,
) -> Regression:
    """The regression of these stretches. `offsets`: a constant force a drive; `rotors`: rotor masses too."""
    columns, base, known = body_columns(rig, body)
    for name in rig.actuator_names:
        for field in ("viscous", "coulomb", *(("reflected_mass",) if rotors else ())):
            c = number(rig, f"{name}.{field}")
            columns.append(Column(c.name, c.unit, c.value, c.scale))
        if offsets:
            size = 0.01 * max(a.force_max for a in rig.actuators)
            columns.append(Column(offset_name(name), "N", _bias(rig, name), size))
    W, y, keep = [], [], []
    for p in prepared:
        rows, left = _rows(rig, p, base, known, rotors=rotors, offsets=offsets)
        W.append(rows)
        y.append(left)
        keep.append(p.moving)
    starts = np.cumsum([0] + [len(p.t_s) for p in prepared])
    return Regression(
        tuple(columns), np.concatenate(W), np.concatenate(y), np.concatenate(keep),
        tuple(int(s) for s in starts), cutoff_hz, tuple(prepared),
    )  # fmt: skip


def offset_name(actuator: str) -> str:
    """Name of the constant part of an actuator's reported force: the sensor's bias, in the model's names."""
    return f"{actuator}.force.sensor_bias.offset"


def _bias(rig: RigFile, actuator: str) -> float:
    """What the rig file already knows of `offset_name`, N."""
    known = [
        e.parameters.get("offset", 0.0)
        for e in rig.effects
        if e.effect == "sensor_bias" and e.location == f"{actuator}.force"
    ]
    return float(sum(known))


def body_columns(rig: RigFile, body: BodySet) -> tuple[list[Column], Array, Array]:
    """Columns of the platform, and how they make the ten parameters of `body`: base (10, P) p + known (10,).

    What the mechanism cannot show at all has no column: an axis feels only mass, a pendulum only its
    inertia about its axis of rotation and the first moments (full).
    """
    m, cog, inertia = rig.mass.m, np.array(rig.mass.cog), np.array(rig.mass.inertia)
    code = kind_code(rig)
    if body == "full" and code != AXIS:
        moments = inertia + _steiner(m, cog)
        size = float(np.trace(moments)) / 3.0
        columns = [Column("mass.m", "kg", m, m)]
        columns += [
            Column(f"mass.first_moment.{c}", "kg·m", m * cog[i], 0.1 * m)
            for i, c in enumerate("xyz")
        ]
        columns += [
            Column(f"mass.origin_inertia.{k}", "kg·m²", moments[i, j], size)
            for k, (i, j) in zip(INERTIA, _PLACE, strict=True)
        ]
        return columns, np.eye(10), np.zeros(10)
    base, known = np.zeros((10, 4)), np.zeros(10)
    base[0, 0] = 1.0
    base[1:4, 0] = cog
    spread = _steiner(1.0, cog)
    for row, (i, j) in enumerate(_PLACE, start=4):
        base[row, 0] = spread[i, j]
        if i == j:
            base[row, 1 + i] = 1.0
        else:
            known[row] = inertia[i, j]
    names = ("mass.m", "mass.inertia.xx", "mass.inertia.yy", "mass.inertia.zz")
    felt = {AXIS: [0], PENDULUM: [0, 2]}.get(code, [0, 1, 2, 3])
    numbers = [number(rig, names[k]) for k in felt]
    for k in range(1, 4):
        if k not in felt:
            known += base[:, k] * inertia[k - 1, k - 1]
    columns = [Column(c.name, c.unit, c.value, c.scale) for c in numbers]
    return columns, base[:, felt], known


def _steiner(m: float, cog: Array) -> Array:
    moved: Array = m * (cog @ cog * np.eye(3) - np.outer(cog, cog))
    return moved


def _rows(
    rig: RigFile, p: Prepared, base: Array, known: Array, *, rotors: bool, offsets: bool
) -> tuple[Array, Array]:
    n = len(rig.actuators)
    left = p.force - p.own - p.body @ known
    blocks = [p.body @ base]
    if not rotors:
        left = left - pack_reflected(rig) * p.rho_ddot
    for i in range(n):
        own = [p.rho_dot[:, i], p.sign[:, i]]
        if rotors:
            own.append(p.rho_ddot[:, i])
        if offsets:
            own.append(np.ones(len(p.t_s)))
        block = np.zeros((len(p.t_s), n, len(own)))
        block[:, i, :] = np.stack(own, axis=1)
        blocks.append(block)
    return np.concatenate(blocks, axis=2), left
