"""Output error through the twin: what it finds, what it owns up to, and how a payload helps."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from hil.config import RigFile
from hil.configfile import load_rig
from hil.errors import ConfigError, IdentificationError
from hil.identify.estimate.fit_twin import TwinOptions, identify_twin
from hil.identify.estimate.gridsearch import grid_search
from hil.identify.estimate.outputerror import fit, profile
from hil.identify.estimate.twinproblem import TwinProblem
from hil.identify.replay import Stretch
from hil.runs.folder import Payload as OperatorsPayload
from hil.sim.twin import Payload
from tests.identify.estimate_data import as_run, multisine, play

TRUTH = {"mass.m": 104.0, "axis.coulomb": 32.0, "axis.viscous": 170.0}


@pytest.fixture(scope="module")
def axis() -> RigFile:
    return load_rig("axis")


@pytest.fixture(scope="module")
def piece(axis: RigFile) -> Stretch:
    return play(axis, multisine(axis, 5.0, 1, 3.0), truth=TRUTH, seed=2)


@pytest.fixture(scope="module")
def pd() -> RigFile:
    return load_rig("stewart_pd")


@pytest.fixture(scope="module")
def circles(pd: RigFile) -> list[Stretch]:
    """A circle in the horizontal plane that runs up in 1.5 s, without and with a known payload."""
    t = np.arange(0.0, 3.0, pd.bus.cycle)
    u = np.clip(t / 1.5, 0.0, 1.0)
    poses = np.zeros((len(t), 6))
    poses[:, 0] = 0.2 * u**3 * (10 - 15 * u + 6 * u**2) * np.cos(2 * np.pi * t / 3.0)
    poses[:, 1] = 0.2 * u**3 * (10 - 15 * u + 6 * u**2) * np.sin(2 * np.pi * t / 3.0)
    truth = {"mass.m": 495.0, "all.force_gain": 1.1}
    load = Payload(80.0, (0.1, 0.0, 0.2))
    return [
        play(pd, poses, truth=truth, seed=1),
        play(pd, poses, truth=truth, seed=2, payload=load, name="loaded"),
    ]


def test_friction_and_mass_of_the_axis_are_recovered(axis: RigFile, piece: Stretch) -> None:
    options = TwinOptions(tuple(TRUTH), draws=2)
    result = identify_twin([as_run(piece, axis)], axis, options).identification
    for name, true in TRUTH.items():
        assert result[name].identifiable
        assert abs(result[name].value - true) < 3.5 * result[name].std
        assert result[name].value == pytest.approx(true, rel=0.1)


def test_a_delay_is_recovered_to_a_tenth_of_a_millisecond(axis: RigFile) -> None:
    late = play(
        axis, multisine(axis, 5.0, 1, 3.0), effects={"axis.transport_delay.delay": 0.004}, seed=3
    )
    problem = TwinProblem(axis, [late], ["axis.transport_delay.delay"], ("position",))
    assert fit(problem).values[0] == pytest.approx(0.004, abs=3e-4)


def test_positions_alone_do_not_tell_mass_from_gain_and_the_answer_says_how_to(
    pd: RigFile, circles: list[Stretch]
) -> None:
    options = TwinOptions(("mass.m", "all.force_gain"), ("position",), draws=1)
    result = identify_twin([as_run(circles[0], pd)], pd, options).identification
    for name in ("mass.m", "all.force_gain"):
        assert not result[name].identifiable
        assert "weigh the cabin" in result[name].reason
    assert any(n.startswith("mass.m / all.force_gain = 4") for n in result.notes)
    assert "all forces and masses alike" in result.untold[0]


def test_a_known_payload_tells_them_apart(pd: RigFile, circles: list[Stretch]) -> None:
    runs = [as_run(c, pd) for c in circles]
    load = OperatorsPayload(mass=80.0, x=0.1, z=0.2)
    runs[1] = dataclasses.replace(runs[1], meta=runs[1].meta.model_copy(update={"payload": load}))
    options = TwinOptions(("mass.m", "all.force_gain"), ("position",), draws=1)
    result = identify_twin(runs, pd, options).identification
    assert result["mass.m"].identifiable
    assert abs(result["mass.m"].value - 495.0) < 3.5 * result["mass.m"].std
    assert result["mass.m"].value == pytest.approx(495.0, rel=0.06)


def test_scaling_every_force_changes_no_position(pd: RigFile, circles: list[Stretch]) -> None:
    problem = TwinProblem(pd, circles[:1], ["mass.m"], ("position",))
    change = problem.force_scale(problem.start, 1.3) - problem.force_scale(problem.start, 1.0)
    assert np.abs(change).max() < 1e-9


def test_a_grid_finds_the_right_valley_and_shows_the_ridge(
    pd: RigFile, circles: list[Stretch]
) -> None:
    problem = TwinProblem(pd, circles[:1], ["mass.m", "all.force_gain"], ("position",))
    axes = {"mass.m": (300.0, 600.0, 5), "all.force_gain": (0.6, 1.4, 5)}
    found = grid_search(problem, axes, rounds=1, refine=False)
    ratio = found.points[:, 0] / found.points[:, 1]
    order = np.argsort(found.rise)
    assert np.abs(ratio[order[:3]] / 450.0 - 1.0).max() < 0.2


@pytest.mark.parametrize(
    "line",
    [(0.0, math.nan, 5), (-math.inf, 1.0, 5), (9.0, 1.0, 5), (0.0, 1.0, -3), (0.0, 1.0, 0)],
)
def test_a_grid_line_that_is_none_is_refused_by_name(
    axis: RigFile, line: tuple[float, float, int]
) -> None:
    problem = cast(TwinProblem, SimpleNamespace(rig=axis, names=("mass.m", "axis.viscous")))
    axes = {"mass.m": (50.0, 150.0, abs(line[2])), "axis.viscous": line}
    if line[2] < 0:
        axes["mass.m"] = line  # two of them make a size that looks right
    with pytest.raises(ConfigError, match=r"axis: grid over (mass\.m|axis\.viscous): .* one point"):
        grid_search(problem, axes)


def test_the_profile_of_a_told_parameter_rises_on_both_sides(axis: RigFile, piece: Stretch) -> None:
    problem = TwinProblem(axis, [piece], ["mass.m", "axis.coulomb"])
    best = fit(problem)
    sides = best.values[0] + np.array([-6.0, 0.0, 6.0]) * np.sqrt(best.covariance[0, 0])
    rise = profile(problem, best, "mass.m", sides)
    assert rise.rise[0] > 3.84 < rise.rise[2]
    assert abs(rise.rise[1]) < 1.0


def test_names_that_do_not_exist_are_refused_with_the_nearest(
    axis: RigFile, piece: Stretch
) -> None:
    with pytest.raises(ConfigError, match=r"axis\.viscos.*nearest: .*axis\.viscous"):
        TwinProblem(axis, [piece], ["axis.viscos"])


def test_a_run_without_setpoints_cannot_be_replayed(axis: RigFile, piece: Stretch) -> None:
    mute = dataclasses.replace(piece, setpoints={})
    with pytest.raises(IdentificationError, match="no setpoints of every actuator"):
        TwinProblem(axis, [mute], ["mass.m"])
