"""Signals in steps: a twin that is off by a part of one is told what steps say on average, no more."""

from types import SimpleNamespace

import numpy as np
import pytest

from hil.gap.fits.facts import left_by, ripple

STEP = 0.5


@pytest.mark.parametrize("blur", [0.1, 0.3, 0.6])
def test_the_mean_of_rounded_values_is_that_of_rounding_many(blur):
    rng = np.random.default_rng(1)
    values = np.linspace(-1.3, 1.3, 27)
    drawn = STEP * np.round((values + blur * STEP * rng.standard_normal((40_000, 1))) / STEP)
    assert values + ripple(values, STEP, blur * STEP) == pytest.approx(drawn.mean(axis=0), abs=6e-3)


def left(off, seed):
    """Root mean squares left of a signal rounded to STEP by a twin that is `off` by so much: as it is, with
    what steps say on average, and rounded itself."""
    rng = np.random.default_rng(seed)
    told = 3.0 * np.sin(0.37 * np.arange(4000))
    measured = STEP * np.round((told + off * rng.standard_normal(4000)) / STEP)
    problem = SimpleNamespace(
        size=4000, series=(SimpleNamespace(signal="axis.force", part=slice(0, 4000)),),
        kept=np.ones(4000, dtype=bool), measured=measured,
        table=SimpleNamespace(index={"axis.force.sensor_quantisation.step": 0}.__getitem__),
        answers=lambda v: (STEP * np.round(told / STEP) if v[0] else told)[None],
    )  # fmt: skip
    fit = SimpleNamespace(
        names=("axis.force.sensor_quantisation.step",),
        values=np.array([STEP]),
        vector=np.array([STEP]),
    )
    seen = np.arange(4000) < 2600
    errors = (measured - told, left_by(problem, fit, seen), measured - problem.answers([STEP])[0])
    return [float(np.sqrt(np.mean(e[~seen] ** 2))) for e in errors]


@pytest.mark.parametrize("off", [0.02, 0.1, 0.3])
def test_steps_help_a_twin_that_knows_the_value_and_harm_none(off):
    plain, told, rounded = left(off, 2)
    assert told < 1.003 * plain
    assert told <= 1.01 * rounded
    if off < 0.2 * STEP:
        assert told < 0.75 * plain
    if off > 0.5 * STEP:
        assert rounded > 1.05 * told
