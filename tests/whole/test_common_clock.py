"""Drives with clocks of their own that begin each cycle together, beside a file whose drives do not."""

import pytest

from hil.config import RigFile
from hil.configfile import load_rig, parse_settings, rig_toml
from hil.control.demo_ride import DemoRide
from hil.control.streaming import cues
from hil.daemon.simulated import record_ride
from hil.drivefiles import load_profiles
from hil.gap.located.habits import TOGETHER
from hil.gap.record.missing import Missing
from hil.gap.rounds.question import Question
from hil.gap.rounds.twins import as_usual
from hil.runs import load_run

SOONER = 0.1


@pytest.mark.parametrize("share", [SOONER, 0.0])
def test_a_platform_whose_drives_begin_together_is_found_and_one_whose_do_not_is_not(
    share: float, tmp_path
):
    nominal = load_rig("stewart_pd")
    tables = nominal.model_dump()
    if share:
        tables["bus"]["clock_wait"] = (1.0 - share) * nominal.bus.cycle
    rig = parse_settings(tables, RigFile, "stewart_pd")
    ride = cues(DemoRide(rig).poses, 0.0, 12.0, "ride")
    made = record_ride(rig, rig_toml(rig, "stewart_pd"), load_profiles(rig), ride, tmp_path / "run")
    q = Question((load_run(made),), (), 0, lambda _: None, Missing())
    located = q.locate(nominal)
    other, habits = as_usual(q, located, may_draw=False)
    found = [part for habit, part in habits if habit is TOGETHER]
    if share:
        # how much sooner all of them are, their delays may stand for as well
        assert len(found) == 1
        assert 0.0 < found[0] < share + 0.035
        before, after = (max(s.ratio for s in x.signals) for x in (located, other))
        assert before > 3.0
        assert after < 0.3 * before
    else:
        assert found == []
