"""Rides in which the daemon closes the loops and drives are given forces are diagnosed as all others."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.config import Effect
from hil.gap import diagnose
from tests.gap.twin_runs import effect
from tests.whole.session import ridden


def test_a_platform_that_the_daemon_holds_up_is_no_gap(tmp_path: Path) -> None:
    run, rig = ridden(tmp_path, "motorcycle", "computed_torque")
    assert run.meta.mode == "force"
    found = diagnose(run, rig)
    assert found.verdict == "no_gap", found.sentence


@pytest.mark.parametrize(
    ("mode", "hidden"),
    [
        ("computed_torque", effect("coulomb_friction", force=30.0)),
        ("cascade", effect("transport_delay", delay=0.006)),
        ("cascade", effect("force_ripple", amplitude=25.0, period=0.02, phase=1.0)),
    ],
    ids=["friction", "delay", "ripple"],
)
def test_what_acts_between_the_daemons_loops_and_the_rig_is_found(
    tmp_path: Path, mode: str, hidden: Effect
) -> None:
    run, rig = ridden(tmp_path, "axis", mode, hidden)
    best = diagnose(run, rig).causes[0]
    assert (best.effect, best.location) == (hidden.effect, "axis")
    found = {name: best.parameters[name].value for name in hidden.parameters}
    assert found == pytest.approx(hidden.parameters, rel=0.1)
    assert best.shrink is not None
    assert best.shrink > 0.9
