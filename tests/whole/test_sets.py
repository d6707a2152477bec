"""Sets of three of which no part looks like what is there: found in the linear picture of the whole."""

from __future__ import annotations

import pytest

from hil.gap import diagnose
from hil.gap.judged.diagnosis import Diagnosis
from tests.gap.twin_runs import AXIS, effect, record

UPRIGHT = AXIS.model_copy(
    update={"geometry": AXIS.geometry.model_copy(update={"load": "vertical"})}
)


def named(found: Diagnosis) -> set[tuple[str, str]]:
    return {(x.effect, x.location) for x in found.effects}


def value(found: Diagnosis, name: str, parameter: str) -> float:
    return next(x for x in found.effects if x.effect == name).parameters[parameter].value


def test_three_of_which_no_two_explain_enough_to_stand() -> None:
    """Each of two others hides in what the third leaves."""
    run = record(
        effect("sensor_scale", "axis.position", scale=0.993),
        effect("force_constant", scale=0.89),
        effect("force_ripple", amplitude=210.0, period=0.01, phase=2.2),
        rig=UPRIGHT,
    )
    found = diagnose(run, UPRIGHT)
    assert {("sensor_scale", "axis.position"), ("force_ripple", "axis")} < named(found)
    assert value(found, "force_ripple", "amplitude") == pytest.approx(210.0, rel=0.05)
    assert len(found.effects) == 3
    assert any(x.effect == "force_constant" for x in found.causes)


def test_friction_that_another_law_stood_for_while_a_mass_was_not_known() -> None:
    """A hysteresis beside a mass and late answers: without the mass, friction that goes with the load."""
    run = record(
        effect("payload_mass", "platform", mass=8.5),
        effect("hysteresis", force=47.0, displacement=6e-4),
        effect("sensor_latency", "axis.position", delay=3e-3),
        rig=UPRIGHT,
    )
    found = diagnose(run, UPRIGHT)
    assert named(found) == {
        ("payload_mass", "platform"),
        ("hysteresis", "axis"),
        ("sensor_latency", "axis.position"),
    }
