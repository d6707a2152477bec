"""Rig files as flat arrays: where each joint stands, and what no rig has."""

from __future__ import annotations

import numpy as np
import pytest

from hil.config.rig import RigFile
from hil.configfile import load_rig
from hil.errors import ConfigError
from hil.rigs import build_rig
from hil.rigs.pack import joint_index, pack_body, pack_geometry
from tests.rigs.conftest import bench


@pytest.mark.parametrize("i", range(6))
def test_stewart_joints_stand_where_joint_index_says(stewart_file: RigFile, i: int) -> None:
    geometry = pack_geometry(stewart_file)
    for end, joints in (("base", "base"), ("platform", "cabin")):
        at = joint_index(stewart_file, f"leg{i + 1}.{end}")
        np.testing.assert_array_equal(
            geometry[at : at + 3], getattr(stewart_file.geometry, joints)[i]
        )
    assert geometry[36] == stewart_file.geometry.height  # type: ignore[union-attr]
    assert geometry.shape == (37,)


@pytest.mark.parametrize(
    ("joint", "place"),
    [
        ("leg1.base", (0.0, 0.0, 0.0)),
        ("leg1.platform", (0.0, 0.35, 0.0)),
        ("leg2.platform", (0.0, -0.35, 0.0)),
        ("slide.base", (-1.0, 0.0, 0.5)),
        ("slide.platform", (-1.0, 0.0, -0.1)),
    ],
)
def test_motorcycle_joints_stand_where_joint_index_says(
    motorcycle_file: RigFile, joint: str, place: tuple[float, float, float]
) -> None:
    at = joint_index(motorcycle_file, joint)
    np.testing.assert_array_equal(pack_geometry(motorcycle_file)[at : at + 3], place)


@pytest.mark.parametrize("joint", ["leg7.base", "leg1", "leg1.middle", "platform", ""])
def test_a_joint_that_is_none_is_named(stewart_file: RigFile, joint: str) -> None:
    with pytest.raises(ConfigError, match=r"is no joint of this rig.*leg1, leg2"):
        joint_index(stewart_file, joint)


def test_an_axis_has_no_joints_to_shift() -> None:
    with pytest.raises(ConfigError, match="is no joint"):
        joint_index(load_rig("axis"), "axis.base")


def test_products_of_inertia_keep_their_places(stewart_file: RigFile) -> None:
    inertia = ((300.0, 1.0, 2.0), (1.0, 310.0, 3.0), (2.0, 3.0, 320.0))
    mass = stewart_file.mass.model_copy(update={"inertia": inertia})
    body = pack_body(stewart_file.model_copy(update={"mass": mass}))
    np.testing.assert_array_equal(body[4:], [300, 310, 320, 1, 2, 3])


def test_a_pendulum_that_would_stand_on_its_head_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"mass\.cog.*z must be below 0"):
        build_rig(bench("pendulum", cog=(0.0, 0.0, 0.1)))


@pytest.mark.parametrize(("load", "force"), [("horizontal", 0.0), ("vertical", 95.0 * 9.81)])
def test_a_bench_axis_carries_gravity_as_it_is_mounted(load: str, force: float) -> None:
    rig = build_rig(bench(load))
    assert rig.static_forces([0.1]) == pytest.approx([force])
    assert rig.inverse_dynamics([0.1], [0.2], [2.0]) == pytest.approx([force + 2.0 * (95 + 40)])


def test_a_pendulum_is_pulled_back_to_hanging() -> None:
    rig = build_rig(bench("pendulum", cog=(0.0, 0.0, -0.4)))
    torque = 95.0 * 9.81 * 0.4 * np.sin(0.3)
    assert rig.static_forces([0.3]) == pytest.approx([torque])
    assert rig.mass_matrix([0.3]) == pytest.approx(np.array([[6.0 + 95.0 * 0.4**2 + 40.0]]))
