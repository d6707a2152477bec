"""Roads that rise and fall, and tyres that turn a bicycle a little more and later than thin ones: no gap."""

from dataclasses import replace

import numpy as np
import pytest

from hil.bicycle.path import u_turns
from hil.gap.bicycle import diagnose_rides, locate_rides
from hil.gap.bicycle.diagnose import _road
from tests.whole.test_bicycle_gap import NOMINAL, ridden, short


def filled(table, name):
    """A column at every row."""
    known = table[["t", name]].dropna()
    return np.interp(table["t"], known["t"], known[name])


def tilted(run, slope):
    """The run, its IMU pitched by a road of `slope` (rows,), uphill positive."""
    table = run.table
    turned = {}
    for kind in ("gyro", "accel"):
        along, up = f"imu.{kind}_x", f"imu.{kind}_z"
        turned[along] = table[along] + slope * filled(table, up)
        turned[up] = table[up] - slope * filled(table, along)
    turned["imu.gyro_y"] = table["imu.gyro_y"] - np.gradient(slope, table["t"])
    return replace(run, table=table.assign(**turned))


def heading(run):
    yaw = filled(run.table, "imu.gyro_z")
    return np.concatenate([[0.0], np.cumsum(np.diff(run.table["t"]) * yaw[1:])])


def hills(run):
    return 0.011 * np.sin(2 * np.pi * 0.04 * run.table["t"].to_numpy())


def field(run):
    return 0.008 * np.cos(heading(run) - 1.0)


@pytest.mark.parametrize("slope", [hills, field])
def test_a_road_that_rises_and_falls_is_no_gap_and_is_told(slope):
    level = ridden(u_turns(), 31)
    rise = slope(level)
    found = diagnose_rides([tilted(level, rise)], NOMINAL)
    assert found.verdict == "no_gap", found.sentence
    (road,) = (f for f in found.located.findings if f.subject == "road")
    told = float(road.text.split("falls by ")[1].split()[0])
    assert told == pytest.approx(1e3 * float(np.std(rise)), rel=0.25)


def test_a_level_road_is_level():
    assert not _road(locate_rides([ridden(short(), 32)], NOMINAL), None)


def test_what_an_effect_explains_is_no_hill():
    """A wheel that is larger goes faster, and brakes harder."""
    larger = ("wheel_radius", "rear_wheel", {"scale": 1.05})
    found = diagnose_rides([ridden(short(), 32, larger)], NOMINAL)
    assert [x.effect for x in found.effects] == ["wheel_radius"]
    assert not [f for f in found.located.findings if f.subject == "road"]


def test_a_fork_that_dives_is_no_hill():
    fork = ("front_suspension", "bicycle", {"stiffness": 1.2e4, "damping": 400.0})
    found = diagnose_rides([ridden(u_turns(), 33, fork)], NOMINAL)
    assert [x.effect for x in found.effects] == ["front_suspension"], found.sentence


def test_a_bicycle_that_turns_a_little_more_and_later_than_it_is_steered_is_healthy():
    run = ridden(short(), 34)
    table = run.table
    known = table[["t", "steer"]].dropna()
    early = np.interp(known["t"] + 0.005, known["t"], known["steer"]) / 1.012
    told = table.assign(steer=table["steer"].where(table["steer"].isna(), np.nan))
    told.loc[known.index, "steer"] = early
    found = diagnose_rides([replace(run, table=told)], NOMINAL)
    assert found.verdict == "no_gap", found.sentence
