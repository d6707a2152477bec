"""A healthy rig's transmissions, which no rig file knows: screws and belts give a little."""

from __future__ import annotations

import math
from typing import Final

from hil.config import Actuator, Effect, RigFile

BEND_HZ: Final = 140.0
"""At which a load swings on its transmission [R: 74 N/µm behind the bench's 95 kg]."""
SOFTER_HZ: Final = 90.0
"""The same of light screws and belts [R: 30 N/µm there]: healthy as they may be, a record tells of them."""
BENDS_HZ: Final = (BEND_HZ, SOFTER_HZ, 72.0)
"""Those that are tried in turn, as long as the next explains more [the last R: 19 N/µm there]."""
SOFTEST_HZ: Final = 60.0
"""The same of what is no fault yet [R: 13 N/µm there]."""
DAMPING: Final = 0.05
"""Of critical [R]."""


def sprung_twin(rig: RigFile, bend_hz: float = BEND_HZ) -> RigFile:
    """`rig` with transmissions on which loads swing at `bend_hz`, where its file says nothing of them."""
    known = {e.location for e in rig.effects if e.effect == "compliance"}
    springs = []
    for a in rig.actuators:
        load, stiffness = load_of(a), stiffness_at(a, bend_hz)
        values = {"stiffness": stiffness, "damping": 2.0 * DAMPING * math.sqrt(stiffness * load)}
        if a.name not in known:
            springs.append(Effect(effect="compliance", location=a.name, parameters=values))
    return rig.model_copy(update={"effects": (*rig.effects, *springs)})


def load_of(a: Actuator) -> float:
    """What an actuator moves behind its transmission, kg or kg·m²."""
    return max(a.effective_mass - a.reflected_mass, 0.4 * a.effective_mass)


def stiffness_at(a: Actuator, bend_hz: float) -> float:
    """Of a transmission on which the load swings at `bend_hz`, N/m or N·m/rad."""
    return load_of(a) * (2.0 * math.pi * bend_hz) ** 2
