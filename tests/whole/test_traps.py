"""Costs are rugged in time: what a delay is caught by is no gap, nor an effect that helps out of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hil.gap import diagnose
from hil.gap.catalogue.leaves import find_leaves
from hil.gap.catalogue.nuisances import default_nuisances
from hil.gap.fits.evidence import FAINT
from hil.gap.fits.fit import fit
from hil.gap.fits.heldout import split
from hil.gap.fits.training import begin
from hil.gap.located.locate import locate
from hil.gap.search.candidates import out_of_traps
from tests.gap.twin_runs import AXIS, effect, record

FAST = AXIS.model_copy(
    update={
        "bus": AXIS.bus.model_copy(
            update={
                "schedule": "fast", "cycle": 0.002, "jitter": 5e-5, "setpoint_delay": 3e-4,
                "answer_delay": 4e-4, "answer_jitter": 2e-5,
            }
        )
    }
)  # fmt: skip
RESTING = FAST.model_copy(
    update={"bus": FAST.bus.model_copy(update={"interpolation": "linear_rests"})}
)


@pytest.mark.parametrize("zero_m", [0.0, 2.2e-5])
def test_drives_that_rest_and_are_read_at_one_instant_of_their_swing_leave_no_gap(zero_m):
    """Such a force is off by so much a speed, as drag is; and an encoder's zero is calibrated beside it."""
    what = (effect("sensor_bias", "axis.position", offset=zero_m),) if zero_m else ()
    answer = diagnose(record(*what, rig=RESTING), FAST)
    assert answer.verdict == "no_gap"
    assert max(s.ratio for s in answer.located.signals) < 1.1


def test_a_fit_without_effects_that_was_caught_begins_anew_where_others_ended():
    e = locate(record(), AXIS).evidence
    c, none = begin(
        e, split(e.problem, e.noise, e.residual), default_nuisances(AXIS, e.problem.signals), {}, 0
    )
    name = "axis.viscous_friction"
    leaf = next(x for x in find_leaves(c.problem, none.vector, none.residual, ()) if x.name == name)
    drag = fit(c, [leaf], {f"{name}.coefficient": 5.0})
    assert drag is not None
    assert out_of_traps(c, [none, drag]) == [none, drag]
    k = next(k for k, n in enumerate(c.nuisances) if n.name.endswith("transport_delay.delay"))
    vector, z = np.array(none.vector), np.array(none.z)
    vector[c.problem.table.index(c.nuisances[k].name)] += 2.0 * c.nuisances[k].sd
    z[k] += 2.0
    residual = c.problem.residual(vector)
    caught = replace(
        none, vector=vector, residual=residual, white=c.noise.whiten(c.problem, residual), z=z
    )
    assert caught.total(c) > none.total(c) + FAINT * c.problem.discount
    freed, *_ = out_of_traps(c, [caught, drag])
    assert freed.leaves == ()
    assert freed.total(c) == pytest.approx(none.total(c), abs=2.0 * c.problem.discount)
