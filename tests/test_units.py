"""Units in words: of quantities, of numbers without one, of what a rig that turns leaves free."""

import pytest

from hil.gap.catalogue.nuisances import default_nuisances
from hil.units import quantity_unit, with_unit
from tests.sim.rigs import pendulum


@pytest.mark.parametrize(
    ("quantity", "linear", "rotary"),
    [
        ("position", "m", "rad"), ("setpoint", "m", "rad"), ("velocity", "m/s", "rad/s"),
        ("force", "N", "N·m"), ("force_setpoint", "N", "N·m"), ("current", "A", "A"),
        ("gyro_x", "rad/s", "rad/s"), ("accel_z", "m/s²", "m/s²"),
    ],
)  # fmt: skip
def test_a_quantity_has_its_unit(quantity, linear, rotary):
    assert quantity_unit(quantity) == linear
    assert quantity_unit(quantity, is_rotary=True) == rotary


def test_what_has_no_dimension_has_no_unit():
    assert (with_unit("2", "m"), with_unit("2", "1"), with_unit("2", "")) == ("2 m", "2", "2")


def test_nuisances_of_a_rig_that_turns_are_angles_and_torques():
    rig = pendulum()
    units = {n.name: n.unit for n in default_nuisances(rig, ["axis.position", "axis.force"])}
    assert units["axis.viscous_friction.coefficient"] == "N·m·s/rad"
    assert units["axis.force.sensor_bias.offset"] == "N·m"
