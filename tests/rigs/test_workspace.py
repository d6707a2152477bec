"""Strokes and ranges: what a pose asks of the actuators."""

from __future__ import annotations

import numpy as np
import pytest

from hil.config.rig import RigFile
from hil.configfile import load_rig
from hil.rigs import build_rig, single_axis_ranges, stroke_violations


def test_the_neutral_pose_keeps_all_strokes(heavy_file: RigFile) -> None:
    rig = build_rig(heavy_file)
    homes = [a.home for a in heavy_file.actuators]
    assert stroke_violations(rig, rig.neutral) == ()
    np.testing.assert_allclose(rig.inverse(rig.neutral), homes, atol=1e-3)


def test_a_pose_too_high_names_every_leg_with_its_bound(stewart_file: RigFile) -> None:
    rig = build_rig(stewart_file)
    found = stroke_violations(rig, [0, 0, 0.3, 0, 0, 0])
    assert [v.actuator for v in found] == list(rig.actuators)
    assert str(found[0]).startswith("leg1 at 1.3")
    assert str(found[0]).endswith("lies outside 0.825..1.275")


def test_a_margin_is_kept_at_both_ends() -> None:
    rig = build_rig(load_rig("axis"))
    for end in (-0.25, 0.25):
        assert not stroke_violations(rig, [end])
        assert not stroke_violations(rig, [end * 0.98], margin=0.004)
        (violation,) = stroke_violations(rig, [end * 0.99], margin=0.004)
        assert (violation.low, violation.high) == (-0.25, 0.25)


def test_a_pose_that_is_no_number_keeps_no_stroke() -> None:
    rig = build_rig(load_rig("motorcycle"))
    assert len(stroke_violations(rig, [np.nan, 0.0, 0.0])) == 3


@pytest.mark.parametrize("name", ["axis", "motorcycle", "stewart", "stewart_pd", "simona"])
def test_every_shipped_rig_reaches_its_limits_one_axis_at_a_time(name: str) -> None:
    rig = build_rig(load_rig(name))
    ranges = single_axis_ranges(rig, resolution=1e-4)
    assert np.all(ranges[:, 0] <= -rig.limits)
    assert np.all(ranges[:, 1] >= rig.limits)


@pytest.mark.parametrize("name", ["stewart", "stewart_pd", "simona"])
def test_cue_limits_of_shipped_hexapods_never_ask_more_speed_than_the_actuators_have(
    name: str,
) -> None:
    file = load_rig(name)
    rig, (velocity, _, _) = build_rig(file), file.cue_limits()
    fastest = [a.velocity_max for a in file.actuators]
    for share in np.random.default_rng(3).uniform(-1, 1, (500, rig.n)):
        worst = np.abs(rig.jacobian(share * rig.limits)) @ velocity
        assert np.all(worst <= fastest)


@pytest.mark.parametrize("name", ["axis", "motorcycle", "stewart", "simona"])
def test_shipped_actuators_carry_their_platform_with_force_to_spare(name: str) -> None:
    file = load_rig(name)
    rig = build_rig(file)
    strongest = np.array([a.force_max for a in file.actuators])
    for share in np.random.default_rng(4).uniform(-1, 1, (200, rig.n)):
        assert np.all(np.abs(rig.static_forces(share * rig.limits)) < strongest / 1.5)
