"""What a fit would leave beside further things, in the linear picture."""

import numpy as np
import pytest

from hil.gap.bicycle.beside import beside


def test_a_step_that_was_there_is_found_and_a_column_that_changes_nothing_takes_none():
    rng = np.random.default_rng(4)
    column, nuisance = rng.standard_normal((2, 400))
    rest = 3.0 * column + 0.5 * nuisance + 0.1 * rng.standard_normal(400)
    free = np.column_stack([column, np.zeros(400)])
    left, step = beside(rest, free, nuisance[:, None], np.zeros(1), 1.0)
    assert step == pytest.approx([3.0, 0.0], abs=0.05)
    alone, _ = beside(rest, free[:, 1:], nuisance[:, None], np.zeros(1), 1.0)
    assert left < 0.1 * alone
