"""The small compiled solvers against numpy."""

from __future__ import annotations

import numpy as np
import pytest

from hil.rigs.linear import solve_positive, solve_square


@pytest.mark.parametrize("n", range(1, 7))
def test_both_solve_what_numpy_solves(n: int) -> None:
    rng = np.random.default_rng(n)
    A, b = rng.normal(size=(n, n)), rng.normal(size=n)
    P = A @ A.T + np.eye(n)
    x, y = b.copy(), b.copy()
    assert solve_square(A.copy(), x)
    assert solve_positive(P.copy(), y)
    np.testing.assert_allclose(x, np.linalg.solve(A, b), rtol=1e-9)
    np.testing.assert_allclose(y, np.linalg.solve(P, b), rtol=1e-9)


def test_rows_are_exchanged_where_a_pivot_vanishes() -> None:
    b = np.array([2.0, 3.0])
    assert solve_square(np.array([[0.0, 1.0], [1.0, 0.0]]), b)
    np.testing.assert_array_equal(b, [3.0, 2.0])


def test_what_cannot_be_solved_is_said() -> None:
    assert not solve_square(np.ones((3, 3)), np.ones(3))
    assert not solve_square(np.full((2, 2), np.nan), np.ones(2))
    assert not solve_positive(np.diag([1.0, -1.0]), np.ones(2))
    assert not solve_positive(np.full((2, 2), np.nan), np.ones(2))
