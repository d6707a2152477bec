"""An accelerometer at rest in many poses: the real one of the record, and one whose errors are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from hil.errors import IdentificationError
from hil.gap.rest import diagnose_at_rest
from hil.runs import Run, RunMeta, load_run
from hil.runs.importing import find_map, import_run
from tests.shared_data import shared

GRAVITY = 9.81744


def lying(rests: int, bias: np.ndarray, scale: np.ndarray, seed: int = 0) -> Run:
    """An accelerometer that lies 3 s in each of so many poses, tumbled in between."""
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(rests):
        down = rng.standard_normal(3)
        felt = scale * GRAVITY * down / np.linalg.norm(down) + bias
        rows += [np.tile(felt, (300, 1)), 8.0 * rng.standard_normal((100, 3))]
    accel = np.vstack(rows) + 0.02 * rng.standard_normal((400 * rests, 3))
    table = pd.DataFrame(accel, columns=[f"imu.accel_{a}" for a in "xyz"])
    table.insert(0, "t", 0.01 * np.arange(len(table)))
    return Run(Path("bench"), RunMeta(rig="bench"), None, table, pd.DataFrame({"t": []}), ())


@pytest.mark.shared
def test_the_real_sensor_has_bias_and_misalignment_and_scale_alone_explains_nothing(
    tmp_path: Path,
) -> None:
    log = shared("data/imu_xsens_calib/xsens_acc.txt.gz")
    import_run(log, find_map("xsens_acc"), tmp_path / "xsens")
    found = diagnose_at_rest(load_run(tmp_path / "xsens"), GRAVITY)
    print(found.sentence)
    assert {"sensor_bias", "sensor_misalignment"} <= set(found.effects)
    assert found.by_set[("sensor_scale",)] > 0.95 * found.before
    assert found.after < 0.003
    without = {s: v for s, v in found.by_set.items() if "sensor_misalignment" not in s}
    assert min(without.values()) > 5.0 * found.after


def test_a_bias_is_found_and_nothing_that_is_not_there() -> None:
    bias = np.array([0.2, -0.1, 0.3])
    found = diagnose_at_rest(lying(40, bias, np.ones(3)), GRAVITY)
    assert found.effects == ("sensor_bias",)
    np.testing.assert_allclose(found.parameters["sensor_bias"], bias, atol=0.005)


def test_a_scale_is_found_where_it_is_one() -> None:
    found = diagnose_at_rest(lying(40, np.zeros(3), np.array([1.02, 0.99, 1.01])), GRAVITY)
    assert found.effects == ("sensor_scale",)
    np.testing.assert_allclose(found.parameters["sensor_scale"], [1.02, 0.99, 1.01], atol=1e-3)


def test_nothing_is_found_on_a_healthy_sensor() -> None:
    assert diagnose_at_rest(lying(40, np.zeros(3), np.ones(3)), GRAVITY).effects == ()


def test_too_few_poses_are_refused() -> None:
    with pytest.raises(IdentificationError, match="different rests"):
        diagnose_at_rest(lying(6, np.zeros(3), np.ones(3)), GRAVITY)
