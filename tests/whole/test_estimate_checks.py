"""Data that cannot be used are refused by a sentence that names the signal and what to do."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from hil.config import RigFile
from hil.configfile import load_rig
from hil.errors import IdentificationError
from hil.identify.estimate.fit import LinearOptions, identify
from hil.identify.estimate.fit_twin import TwinOptions, identify_twin
from hil.identify.replay import Stretch, stretches
from tests.identify.estimate_data import as_run, multisine, play

FAST = LinearOptions(method="wls", draws=0)


@pytest.fixture(scope="module")
def rig() -> RigFile:
    return load_rig("motorcycle")


@pytest.fixture(scope="module")
def piece(rig: RigFile) -> Stretch:
    return play(rig, multisine(rig, 6.0, 1, 3.0))


def test_a_sound_run_passes(rig: RigFile, piece: Stretch) -> None:
    result = identify([as_run(piece, rig)], rig, FAST).identification
    assert result["mass.m"].value == pytest.approx(200.0, rel=0.02)


def test_a_run_of_another_rig(piece: Stretch, rig: RigFile) -> None:
    with pytest.raises(
        IdentificationError, match=r"run of the rig 'motorcycle', not of 'axis'.*--rig"
    ):
        identify([as_run(piece, rig)], load_rig("axis"), FAST)


def test_a_run_recorded_with_another_geometry(piece: Stretch, rig: RigFile) -> None:
    moved = rig.model_copy(update={"geometry": rig.geometry.model_copy(update={"l": 0.4})})
    with pytest.raises(IdentificationError, match="recorded with another geometry"):
        identify([as_run(piece, rig)], moved, FAST)


def test_positions_in_millimetres(piece: Stretch, rig: RigFile) -> None:
    wrong = 1000.0 * piece.samples["leg2.position"][1]
    with pytest.raises(IdentificationError, match=r"leg2\.position .* looks like mm"):
        identify([as_run(piece, rig, leg2__position=wrong)], rig, FAST)


def test_a_force_of_the_wrong_sign(piece: Stretch, rig: RigFile) -> None:
    wrong = -piece.samples["leg1.force"][1]
    with pytest.raises(IdentificationError, match=r"leg1: force and position have opposite signs"):
        identify([as_run(piece, rig, leg1__force=wrong)], rig, FAST)


def test_a_force_in_kilonewtons(piece: Stretch, rig: RigFile) -> None:
    wrong = 1e-3 * piece.samples["leg1.force"][1]
    with pytest.raises(IdentificationError, match=r"leg1\.force is 0\.00\d+ times .* kN"):
        identify([as_run(piece, rig, leg1__force=wrong)], rig, FAST)


@pytest.mark.parametrize(
    ("signal", "factor", "said"),
    [("leg1.force", -1.0, "opposite sign"), ("leg2.force", 1e-3, r"0\.00\d+ times .* SI units")],
)
def test_a_wrong_sign_or_unit_before_the_twin(
    piece: Stretch, rig: RigFile, signal: str, factor: float, said: str
) -> None:
    wrong = {signal.replace(".", "__"): factor * piece.samples[signal][1]}
    with pytest.raises(IdentificationError, match=rf"{signal} .*{said}"):
        identify_twin([as_run(piece, rig, **wrong)], rig, TwinOptions(("mass.m",)))


def test_a_clipped_force(piece: Stretch, rig: RigFile) -> None:
    force = piece.samples["leg1.force"][1]
    with pytest.raises(
        IdentificationError, match=r"leg1\.force is clipped at .* smaller or slower"
    ):
        identify([as_run(piece, rig, leg1__force=np.minimum(force, 560.0))], rig, FAST)


def test_a_drive_at_its_limit(piece: Stretch, rig: RigFile) -> None:
    force = piece.samples["leg1.force"][1].copy()
    force[::20] = 5089.0
    with pytest.raises(IdentificationError, match=r"stands at the drive's limit of 5089 N"):
        identify([as_run(piece, rig, leg1__force=force)], rig, FAST)


def test_a_record_without_forces(piece: Stretch, rig: RigFile) -> None:
    silent = {k: v for k, v in piece.samples.items() if k != "slide.force"}
    run = as_run(dataclasses.replace(piece, samples=silent), rig)
    with pytest.raises(IdentificationError, match=r"no samples of slide\.force.*bus\.pattern"):
        identify([run], rig, FAST)


def test_nothing_moved(rig: RigFile) -> None:
    still = play(rig, np.zeros((400, 3)))
    with pytest.raises(IdentificationError, match=r"too little excitation .*hil experiment"):
        identify([as_run(still, rig)], rig, FAST)


def test_a_motion_of_a_hundredth_of_the_limits(rig: RigFile) -> None:
    still = play(rig, multisine(rig, 6.0, 1, 3.0, share=0.01))
    with pytest.raises(IdentificationError, match=r"no coordinate used 2 % .* --amplitude"):
        identify([as_run(still, rig)], rig, FAST)


def test_too_short_a_record(piece: Stretch, rig: RigFile) -> None:
    run = as_run(piece, rig)
    short = dataclasses.replace(run, table=run.table[run.table["t"] < 1.6])
    with pytest.raises(IdentificationError, match="record a longer motion"):
        stretches(short)


def test_a_coordinate_that_never_moved_is_named_and_its_inertia_not_told(rig: RigFile) -> None:
    poses = multisine(rig, 8.0, 1, 3.0)
    poses[:, 0] = 0.0
    result = identify([as_run(play(rig, poses), rig)], rig, LinearOptions(draws=2)).identification
    assert any("yaw never moved" in n for n in result.notes)
    assert not result["mass.inertia.zz"].identifiable
    assert result["mass.inertia.zz"].reason.startswith("these data")


def test_an_actuator_that_stood_still_says_so(rig: RigFile, piece: Stretch) -> None:
    t, x = piece.samples["slide.position"]
    frozen = dataclasses.replace(
        piece, samples={**piece.samples, "slide.position": (t, np.zeros_like(x))}
    )
    result = identify([as_run(frozen, rig)], rig, FAST).identification
    assert result["slide.coulomb"].reason == "slide never moved: friction there cannot be judged"


def test_a_pause_of_the_setpoints_parts_a_run_in_two(piece: Stretch, rig: RigFile) -> None:
    run = as_run(piece, rig)
    hole = (run.table["t"] > 3.0) & (run.table["t"] < 4.0)
    parted = stretches(dataclasses.replace(run, table=run.table[~hole]))
    assert len(parted) == 2
    assert parted[0].span_s[1] <= 3.0 < 4.0 <= parted[1].span_s[0]
