"""Whether rides tell thin wheels from tyres, with and without an effect."""

import pytest

from hil.bicycle.recorded import prepare
from hil.exam import Order, load_case, make_exam
from hil.gap.bicycle import diagnose_rides, locate_rides
from hil.gap.bicycle.rolled import rolled
from hil.gap.bicycle.wheels import THIN, TYRES
from tests.whole.test_bicycle_gap import NOMINAL, ROLLS, ridden, short


@pytest.mark.parametrize(
    "effect",
    [
        (),
        ("wheel_radius", "rear_wheel", {"scale": 1.03}),
        ("sensor_scale", "imu.gyro_x", {"scale": 1.05}),
    ],
    ids=["healthy", "wheel", "gyro"],
)
@pytest.mark.parametrize(("does", "wheels"), [((), THIN), (ROLLS, TYRES)], ids=["thin", "tyres"])
def test_rides_tell_what_they_were_ridden_on(does, wheels, effect):
    some = (*does, effect) if effect else does
    assert rolled([prepare(ridden(short(), 24, *some), NOMINAL)], NOMINAL) is wheels


def test_narrower_tolerances_are_told():
    found = locate_rides([ridden(short(), 24)], NOMINAL)
    assert [f.text for f in found.findings if f.subject == "wheels"]
    found = locate_rides([ridden(short(), 24, *ROLLS)], NOMINAL)
    assert not [f.text for f in found.findings if f.subject == "wheels"]


def test_a_small_slip_of_thin_wheels_is_named():
    """Beside tyres it would be one of theirs."""
    slip = ("wheel_slip", "rear_wheel", {"coefficient": 0.02})
    found = diagnose_rides([ridden(short(), 24, slip)], NOMINAL)
    assert found.verdict in ("identified", "ambiguous"), found.sentence
    assert any((x.effect, x.location) == slip[:2] for x in found.causes[:2])
    on_tyres = diagnose_rides([ridden(short(), 24, slip, *ROLLS)], NOMINAL)
    assert on_tyres.verdict == "no_gap", on_tyres.sentence


def test_rides_of_a_world_that_is_no_twin_tell_thin_wheels(tmp_path):
    make_exam(Order(rigs=("bicycle",), seed=1651, kinds=("none",)), 2, tmp_path, jobs=1)
    for folder in sorted((tmp_path / "cases").iterdir()):
        case = load_case(folder)
        assert rolled([prepare(run, case.rig) for run in case.runs], case.rig) is THIN
