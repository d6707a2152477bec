"""The simulated drive's parameter server: every status bit that it can give, and what a write does."""

from __future__ import annotations

import struct

import pytest

from hil.drives.lust_cdd3000.codec import AnswerStatus, from_wire, to_wire
from hil.drives.profile import LustProfile
from hil.sim.lust.parameters import ParameterServer
from hil.sim.plant import Plant
from tests.drives.exchange import profile_of, rig_of

READ, WRITE = 5, 2
OK = AnswerStatus(0)
PROFILE = profile_of()
P = PROFILE.parameters


def server(
    profile: LustProfile = PROFILE, value: float | None = 0.1, **rig: object
) -> ParameterServer:
    made = rig_of(**rig)
    return ParameterServer(made.actuators[0], 0, Plant(made), profile, lambda _: value)


def test_measurements_are_read_in_the_rig_files_scales() -> None:
    s = server(value=0.1)
    m = P.measurements
    assert s.answer(m.position.number, READ, 0, enabled=True) == (OK, 100_000)
    assert s.answer(m.velocity.number, READ, 0, enabled=True) == (OK, 1000)
    assert s.answer(m.force.number, READ, 0, enabled=True) == (OK, 0)
    assert s.answer(m.current.number, READ, 0, enabled=True) == (OK, 10)


@pytest.mark.parametrize("value", [1e30, -1e30])
def test_measurements_saturate(value: float) -> None:
    _, raw = server(value=value).answer(P.measurements.position.number, READ, 0, enabled=True)
    assert raw == (2**31 - 1 if value > 0 else -(2**31))


def test_measurements_cannot_be_written() -> None:
    status, _ = server().answer(P.measurements.position.number, WRITE, 5, enabled=False)
    assert status is AnswerStatus.CHANGE_NOT_PERMITTED


def test_a_lost_answer_is_none() -> None:
    assert server(value=None).answer(P.measurements.position.number, READ, 0, enabled=True) is None


@pytest.mark.parametrize("mode", [0, 1, 3, 11, 12, 13, 255])
def test_other_modes_are_unknown(mode: int) -> None:
    assert server().answer(574, mode, 0, enabled=False) == (AnswerStatus.UNKNOWN_MODE, 0)


@pytest.mark.parametrize("number", [0, 573, 575, 65535])
def test_other_parameters_are_unknown(number: int) -> None:
    for mode in (READ, WRITE):
        assert server().answer(number, mode, 0, enabled=False) == (
            AnswerStatus.UNKNOWN_PARAMETER,
            0,
        )


@pytest.mark.parametrize(
    ("raw", "expected"),
    [
        (-1, AnswerStatus.BAD_VALUE),
        (0, OK),
        (1, OK),
        (65535, OK),
        (65536, AnswerStatus.BAD_VALUE),
    ],
)
def test_the_watchdog_takes_values_within_its_bounds(raw: int, expected: AnswerStatus) -> None:
    s = server()
    assert s.watchdog_s == 0.0
    assert s.answer(574, WRITE, raw, enabled=False) == (expected, raw)
    assert s.watchdog_s == pytest.approx(raw * 0.001 if expected is OK else 0.0)


def test_the_operating_mode_does_not_change_while_enabled() -> None:
    s = server()
    mode = P.operating_mode
    assert s.answer(mode.number, WRITE, mode.force, enabled=True)[0] is (
        AnswerStatus.CHANGE_NOT_PERMITTED
    )
    assert not s.takes_force
    assert s.answer(mode.number, WRITE, mode.force, enabled=False)[0] == OK
    assert s.takes_force


def test_a_written_gain_reaches_the_plant_and_a_restart_takes_it_back() -> None:
    rig = rig_of()
    plant = Plant(rig)
    s = ParameterServer(rig.actuators[0], 0, plant, PROFILE, lambda _: 0.0)
    ahead = P.precontrol.velocity
    before = plant._model.copy()
    s.answer(ahead.number, WRITE, to_wire(ahead.type, 1.0), enabled=False)
    assert (plant._model != before).sum() == 1
    s.restart()
    assert (plant._model == before).all()


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1.0])
def test_a_gain_that_is_no_number_is_a_bad_value(value: float) -> None:
    (raw,) = struct.unpack("<i", struct.pack("<f", value))
    assert server().answer(P.gains.position.number, WRITE, raw, enabled=False)[0] is (
        AnswerStatus.BAD_VALUE
    )


def test_gains_read_back_as_the_loops_have_them() -> None:
    effect = {
        "effect": "loop_gain",
        "location": "axis",
        "parameters": {"position": 0.5},
    }
    for effects, expected in (([], 80.0), ([effect], 40.0)):
        _, raw = server(effects=effects).answer(P.gains.position.number, READ, 0, enabled=True)
        assert from_wire(P.gains.position.type, raw) == pytest.approx(expected)
