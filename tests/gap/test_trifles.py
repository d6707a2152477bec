"""What any healthy bicycle or sensor has of an effect is no finding."""

from types import SimpleNamespace

import pytest

from hil.configfile import load_bicycle
from hil.gap.bicycle.verdict import is_usual

RIG = load_bicycle("bicycle")


def found(*effects):
    def cause(name, location, parameter, value):
        given = {parameter: SimpleNamespace(value=value)}
        return SimpleNamespace(effect=name, location=location, parameters=given)

    return SimpleNamespace(effects=tuple(cause(*x) for x in effects))


@pytest.mark.parametrize(
    ("effect", "usual"),
    [
        (("sensor_scale", "imu.gyro_x", "scale", 0.992), True),
        (("sensor_scale", "imu.gyro_x", "scale", 0.985), False),
        (("sensor_scale", "rear_wheel", "scale", 0.992), False),
        (("sensor_latency", "lean", "delay", 0.0034), True),
        (("sensor_latency", "lean", "delay", 0.006), False),
        (("tyre_compliance", "bicycle", "stiffness", 1.5e5), True),
        (("tyre_compliance", "bicycle", "stiffness", 8e4), False),
        (("sensor_bias", "lean", "offset", 0.001), False),
        (("sensor_bias", "steer", "offset", -0.001), True),  # its encoder's step is 2.6 mrad
        (("sensor_bias", "steer", "offset", 0.002), False),
        (("sensor_bias", "imu.gyro_x", "offset", 1e-4), False),
    ],
)
def test_small_ones_are_no_finding(effect, usual):
    assert is_usual(found(effect), RIG) is usual
    assert not is_usual(found(effect, ("sensor_bias", "lean", "offset", 0.02)), RIG)


def test_nothing_found_is_nothing_usual():
    assert not is_usual(found(), RIG)
