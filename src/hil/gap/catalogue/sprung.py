"""A healthy rig's transmissions, which no rig file knows: screws and belts give a little."""

from __future__ import annotations

import math
from typing import Final

from hil.config import Effect, RigFile

BEND_HZ: Final = 140.0
"""At which a load swings on its transmission [R: 74 N/µm behind the bench's 95 kg]."""
SOFTER_HZ: Final = 90.0
"""The same of light screws and belts [R: 30 N/µm there]: healthy as they may be, a record tells of them."""
DAMPING: Final = 0.05
"""Of critical [R]."""


def sprung_twin(rig: RigFile, bend_hz: float = BEND_HZ) -> RigFile:
    """`rig` with transmissions on which loads swing at `bend_hz`, where its file says nothing of them."""
    known = {e.location for e in rig.effects if e.effect == "compliance"}
    springs = []
    for a in rig.actuators:
        load = max(a.effective_mass - a.reflected_mass, 0.4 * a.effective_mass)
        stiffness = load * (2.0 * math.pi * bend_hz) ** 2
        values = {"stiffness": stiffness, "damping": 2.0 * DAMPING * math.sqrt(stiffness * load)}
        if a.name not in known:
            springs.append(Effect(effect="compliance", location=a.name, parameters=values))
    return rig.model_copy(update={"effects": (*rig.effects, *springs)})
