"""Forces and IMUs that come late: late kicks are no noise, a filter's delay is no gap, refits look about."""

import numpy as np
import pytest

from hil.gap.catalogue.nuisances import LIMIT, default_nuisances
from hil.gap.floor.lateness import without_lateness
from hil.gap.floor.noise import find_noise
from hil.gap.located.locate import locate
from hil.gap.located.phase import begun, settled
from hil.gap.located.residual import refit, total
from tests.gap.twin_runs import AXIS, effect, record

LATE_S = 0.0035


def test_the_floor_of_a_force_that_is_late_is_that_of_its_sensor():
    plain, late = (
        locate(record(*some, duration_s=10.0), AXIS)
        for some in ((), (effect("sensor_latency", "axis.force", delay=LATE_S),))
    )
    floor, other = (x.evidence.noise.floor(x.evidence.problem) for x in (plain, late))
    # with late kicks in it 3.3 times as high
    assert other["axis.force"] < 1.6 * floor["axis.force"]
    assert not plain.is_gap
    assert late.is_gap


def test_a_force_is_set_in_step_only_where_that_takes_much_off():
    plain = locate(record(duration_s=10.0), AXIS).evidence
    same = without_lateness(plain.problem, plain.vector, plain.residual)
    np.testing.assert_array_equal(same, plain.residual)
    late = locate(
        record(effect("sensor_latency", "axis.force", delay=LATE_S), duration_s=10.0), AXIS
    ).evidence
    left = without_lateness(late.problem, late.vector, late.residual)
    for x in late.problem.series:
        is_same = np.array_equal(left[x.part], late.residual[x.part])
        assert is_same == (x.quantity != "force")
        if x.quantity == "force":
            assert np.std(left[x.part]) < 0.6 * np.std(late.residual[x.part])


def test_an_imu_may_be_late_by_its_filter_and_no_more():
    signals = [f"imu.{q}_{c}" for q in ("gyro", "accel") for c in "xyz"]
    by_name = {n.name: n for n in default_nuisances(AXIS, signals)}
    late = by_name["imu.sensor_latency.delay"]
    assert LIMIT * late.sd == pytest.approx(AXIS.imu.group_delay_s)
    slower = AXIS.model_copy(update={"imu": AXIS.imu.model_copy(update={"bandwidth": 75.0})})
    twice = {n.name: n for n in default_nuisances(slower, signals)}[late.name]
    assert twice.sd == pytest.approx(2.0 * late.sd)
    without = default_nuisances(AXIS, ["axis.force"])
    assert all(n.name != late.name for n in without)


@pytest.mark.parametrize(
    ("late_s", "asked_s", "less"), [(4.5e-4, 0.0015, 10.0), (3e-4, 0.0012, 0.0)]
)
def test_a_refit_that_stops_between_two_places_in_the_tick_is_made_from_another(
    late_s, asked_s, less
):
    late = effect("sensor_latency", "axis.force", delay=late_s)
    frame = record(late, duration_s=10.0, asked_s=asked_s, jitter_s=4e-4)
    problem = locate(frame, AXIS).evidence.problem
    noise = find_noise(problem, problem.base, np.random.default_rng(0), count=2)
    asked = default_nuisances(AXIS, problem.signals)

    first = refit(problem, noise, asked, begun(problem, noise, asked))
    least = total(problem, noise, asked, settled(problem, noise, asked))
    assert least <= total(problem, noise, asked, first) - less
