"""The equations that ship are those that the derivation gives, and sympy agrees at random states."""

import numpy as np
import pytest

from hil.configfile import load_bicycle
from hil.rigs.bicycle import equations as shipped
from hil.rigs.bicycle import pack
from hil.rigs.bicycle.kernel import constraint_rows, evaluate, memory

sympy = pytest.importorskip("sympy")
from hil.rigs.bicycle import derivation  # noqa: E402 - needs sympy


@pytest.fixture(scope="module")
def derived():
    return derivation.derive()


def test_the_shipped_equations_are_those_of_the_derivation():
    written = derivation.write()
    with open(shipped.__file__) as file:  # noqa: PTH123 - the module itself
        assert file.read() == written, (
            "run python -m hil.rigs.bicycle.derivation > src/hil/rigs/bicycle/equations.py"
        )


def test_shipped_equations_give_what_sympy_evaluates_at_random_states(derived):
    p, q, qd = derivation.symbols()
    names = ("J", "j", "A3", "C", "C_dependent", "contact")
    direct = sympy.lambdify([p, q, qd], [derived[n] for n in names], "numpy", cse=False)
    of_body = sympy.lambdify(
        [p, q, qd], [[derived[n][b] for b in range(4)] for n in ("H", "h", "G", "g", "spins", "frames")],
        "numpy", cse=False,
    )  # fmt: skip
    numbers = pack(load_bicycle("bicycle")).p
    rng = np.random.default_rng(7)
    for _ in range(3):
        state = rng.uniform(-0.6, 0.6, 12) * np.array(
            [9, 9, 5, 1, 5, 0.2, 1, 5, 0.3, 0.05, 0.02, 0.02]
        )
        rates = rng.uniform(-3.0, 3.0, 12)
        mem = memory(state)
        evaluate(mem, numbers, state, rates)
        c, dc, contact = np.zeros(2), np.zeros((2, 2)), np.zeros(3)
        shipped.closure(numbers, state, c, dc, contact)
        J, j, A3, C, C_dependent, P = (
            np.asarray(m, dtype=float) for m in direct(numbers, state, rates)
        )
        rows = np.zeros((12, 12))
        constraint_rows(numbers, state, 12, False, rows)
        for ours, theirs in ((rows[:6], J), (mem[7], j[:, 0]), (mem[6], A3), (c, C[:, 0]),
                             (dc, C_dependent), (contact, P[:, 0])):  # fmt: skip
            np.testing.assert_allclose(ours, theirs, atol=1e-12)
        for k, quantity in enumerate(of_body(numbers, state, rates)):
            for b, matrix in enumerate(quantity):
                theirs = np.asarray(matrix, dtype=float)
                ours = mem[k][b] if mem[k].ndim == 3 else mem[k][b][:, None]
                np.testing.assert_allclose(ours, theirs, atol=1e-11)


def test_rates_and_accelerations_are_derivatives_of_positions():
    """J and its bias against finite differences of the contact along a motion."""
    numbers = pack(load_bicycle("bicycle")).p
    rng = np.random.default_rng(3)
    q0 = rng.uniform(-0.3, 0.3, 12) * np.array([9, 9, 9, 1, 9, 0.1, 1, 9, 0.2, 0.05, 0.02, 0.02])
    qd0, qdd0 = rng.uniform(-1.0, 1.0, 12), rng.uniform(-2.0, 2.0, 12)

    def at(t):
        return q0 + t * qd0 + 0.5 * t * t * qdd0, qd0 + t * qdd0

    def height(t):
        c, dc, contact = np.zeros(2), np.zeros((2, 2)), np.zeros(3)
        shipped.closure(numbers, at(t)[0], c, dc, contact)
        return c

    mem = memory(q0)
    evaluate(mem, numbers, q0, qd0)
    rows = np.zeros((12, 12))
    constraint_rows(numbers, q0, 12, False, rows)
    h = 1e-4
    speed = (height(h) - height(-h)) / (2.0 * h)
    bend = (height(h) - 2.0 * height(0.0) + height(-h)) / h**2
    np.testing.assert_allclose(rows[:2] @ qd0, speed, atol=1e-7)
    np.testing.assert_allclose(rows[:2] @ qdd0 + mem[7][:2], bend, atol=1e-5)
