"""Sizes that hardly any rig has: most likely mm or degrees, where a rig file is in m and rad."""

from __future__ import annotations

import math
from typing import Final

from hil.config.rig import RigFile

FARTHEST_M: Final = 10.0
WIDEST_RAD: Final = 2.0 * math.pi


def odd_sizes(rig: RigFile) -> list[str]:
    """A sentence, from the key on, for each stroke and limit of the pose that reaches beyond the usual."""
    sizes = [
        (f"actuators[{k}] ({a.name}).stroke", max(map(abs, a.stroke)), rig.is_rotary)
        for k, a in enumerate(rig.actuators)
    ]
    sizes += [
        (f"limits[{k}] ({name})", limit, rig.rotates(name))
        for k, (name, limit) in enumerate(zip(rig.coordinates, rig.limits, strict=True))
    ]
    return [_sentence(*size) for size in sizes if size[1] > (WIDEST_RAD if size[2] else FARTHEST_M)]


def _sentence(key: str, value: float, is_angle: bool) -> str:
    bound, unit, other = (
        (WIDEST_RAD, "rad", "degrees") if is_angle else (FARTHEST_M, "m", "millimetres")
    )
    return f"{key}: {value:g} {unit} is beyond {bound:.3g} {unit}: are these {other}?"
