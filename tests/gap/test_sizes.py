"""What an effect's size is measured by suits the actuator: a leg in metres as well as a shaft in radians."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from hil.config import Actuator
from hil.configfile import load_rig
from hil.gap.catalogue.leaves import SWINGS_HZ, spring
from hil.gap.fits.evidence import RANGE, log_freedom
from hil.gap.fits.fit import step_size
from hil.sim.parameters import ParameterTable
from tests.sim.rigs import pendulum

RIGS = {name: load_rig(name) for name in ("axis", "emps", "motorcycle", "stewart", "simona")}
RIGS["pendulum"] = pendulum(
    reflected_mass=0.76, effective_mass=3.2, viscous=1.4, coulomb=2.0, force_max=150.0,
    velocity_max=2.5, stroke=(-1.2, 1.2),
)  # fmt: skip


def of_travel(share: float, a: Actuator) -> float:
    return share * (a.stroke[1] - a.stroke[0])


@pytest.mark.parametrize("name", RIGS)
def test_what_rigs_may_have_costs_little_whatever_their_units(name: str) -> None:
    rig = RIGS[name]
    table = ParameterTable(rig)
    for a in rig.actuators:
        usual = {
            "compliance.stiffness": spring(a, SWINGS_HZ[0])[0],
            "compliance.damping": spring(a, SWINGS_HZ[2])[1],
            "viscous_friction.coefficient": 0.02 * a.force_max / a.velocity_max,
            "position_offset.offset": of_travel(0.02, a),
            "position.sensor_bias.offset": of_travel(0.01, a),
            "lead_error.amplitude": of_travel(5e-4, a),
        }
        for key, value in usual.items():
            p = table[f"{a.name}.{key}"]
            at = p.to_search(value)
            away = abs(at - p.to_search(p.neutral))
            assert p.lower <= value <= p.upper, key
            assert math.isfinite(away), key
            assert math.log1p(0.5 * (away / (RANGE * step_size(p, at))) ** 2) < 0.92, key
            assert away > 0.05 * step_size(p, at), key


def test_an_effect_of_many_times_its_usual_size_is_unlikely_and_not_ruled_out() -> None:
    """A sensor on another range is off by multiples; no square of that may speak against it."""
    c = SimpleNamespace(problem=SimpleNamespace(table=ParameterTable(RIGS["axis"])))

    def cost(scale: float) -> float:
        f = SimpleNamespace(
            names=("axis.force.sensor_scale.scale",), values=np.array([scale]),
            search_sd=np.array([1e-4]), leaves=(None,),
        )  # fmt: skip
        return -log_freedom(c, f, 1.0)

    usual, double, triple = (cost(1.0 + x) - cost(1.0) for x in (0.1, 1.0, 2.0))
    assert 0.0 < usual < 0.5 < double < triple < 5.0
