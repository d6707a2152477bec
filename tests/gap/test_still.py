"""A signal that stands on one value throughout: in coarse steps, or stuck where the twin goes further."""

from types import SimpleNamespace

import numpy as np
import pytest

from hil.errors import IdentificationError
from hil.gap.diagnose import diagnose
from hil.gap.floor.rounding import coarse_steps, must_move, step_around
from hil.gap.judged.doubt import STILL
from tests.gap.twin_runs import AXIS, record

HOIST = AXIS.model_copy(update={"geometry": AXIS.geometry.model_copy(update={"load": "vertical"})})
"""The bench on end: its force never comes near zero."""


def held(share, value):
    frame = record(rig=HOIST, share=share, duration_s=8.0)
    column = frame["axis.force"]
    frame["axis.force"] = column.where(column.isna(), column.mean() if value is None else value)
    return frame


def test_the_step_is_the_finest_that_hides_all_that_the_twin_says():
    off = np.array([-0.1, 0.05, 0.1])
    step = step_around(9.9, off, 0.025)
    assert step == pytest.approx(9.9 / 24)
    assert 0.5 * step > 0.1 + 4.0 * 0.025
    assert step_around(-9.9, off, 0.025) == step
    assert step_around(0.3, off, 0.025) is None


@pytest.mark.parametrize(
    ("quantity", "way", "spread", "own", "must"),
    [
        ("force", 0.0, 4.0, 1.0, True),
        ("accel", 0.0, 0.005, 0.02, False),
        ("position", 0.0, 2e-5, 1e-6, False),
        ("position", 0.1, 2e-5, 1e-6, True),
    ],
)
def test_a_quiet_sensor_and_a_position_at_rest_may_stand_still(quantity, way, spread, own, must):
    assert must_move(quantity, np.array([0.0, way]), spread, own) is must


def test_a_quiet_signal_that_stands_still_is_in_no_coarse_steps():
    noise = HOIST.noise.model_copy(update={"force": 0.5})
    quiet = HOIST.model_copy(update={"noise": noise})
    problem = SimpleNamespace(
        rig=quiet, signals=("axis.force",), measured=np.full(40, 930.0), kept=np.ones(40, bool),
        series=(SimpleNamespace(signal="axis.force", part=slice(0, 40)),),
    )  # fmt: skip
    assert coarse_steps(problem, np.full(40, 3.0)) == {}
    problem.rig = HOIST
    assert coarse_steps(problem, np.full(40, 3.0)).keys() == {"axis.force"}


def test_a_force_that_stands_on_one_value_is_in_coarse_steps_and_may_be_stuck():
    answer = diagnose(held(0.02, None), HOIST)
    assert [(x.effect, x.location) for x in answer.effects] == [
        ("sensor_quantisation", "axis.force")
    ]
    assert answer.effects[0].probability <= 1.0 - STILL
    told = [f.text for f in answer.located.findings if f.subject == "axis.force"]
    assert any("a sensor that is stuck there looks the same" in text for text in told)


def test_a_force_that_stands_where_the_twin_moves_is_stuck():
    with pytest.raises(IdentificationError, match=r"axis\.force: stands at 40 .*stuck"):
        diagnose(held(1.0, 40.0), HOIST)


def test_a_force_that_stands_at_zero_is_stuck():
    with pytest.raises(IdentificationError, match="stuck"):
        diagnose(held(0.02, 0.0), HOIST)
