"""Bicycles as the tests want them, and short rides of constant motion."""

from __future__ import annotations

import numpy as np

from hil.config import BicycleFile
from hil.configfile import load_bicycle
from hil.rigs.bicycle import Motion, Smooth, pack, ride


def text_bicycle(*, on_frame: bool = True, aero: float = 0.5, trail: float = 0.0736) -> BicycleFile:
    """Table 1 of the text with the trail that the published vectors were made with."""
    rig = load_bicycle("bicycle_text")
    return rig.model_copy(
        update={
            "aero": aero,
            "geometry": rig.geometry.model_copy(update={"trail": trail}),
            "sensors": rig.sensors.model_copy(update={"encoder_on_frame": on_frame}),
        }
    )


def instant(
    rig: BicycleFile,
    angle: tuple[float, float, float],
    rate: tuple[float, float, float],
    acceleration: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Motion:
    """What the model says at lean, wheel and steer with these rates and accelerations."""
    rows = [np.array([v, v], dtype=float) for v in (angle, rate, acceleration)]
    return ride(pack(rig), Smooth(0.01, *rows))
