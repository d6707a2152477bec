"""The bicycle meets the published benchmarks of its model, linear and nonlinear."""

import numpy as np
import pytest

from hil.configfile import load_bicycle
from hil.rigs.bicycle import Whipple, canonical, linearise, pack
from tests.shared_data import shared

# Meijaard, Papadopoulos, Ruina, Schwab 2007, equations (6.1) and (6.2) and table 2.
M = [[80.81722, 2.31941332208709], [2.31941332208709, 0.29784188199686]]
C1 = [[0.0, 33.86641391492494], [-0.85035641456978, 1.68540397397560]]
K0 = [[-80.95, -2.59951685249872], [-2.59951685249872, -0.80329488458618]]
K2 = [[0.0, 76.59734589573222], [0.0, 2.65431523794604]]
EIGENVALUES = {
    0: [-5.530943717653896, -3.1316432479065557, 3.1316432479065535, 5.53094371765389],
    1: [-7.110080146374341, -3.1342312506657866,
        3.5269617099006854 - 0.807740275199315j, 3.5269617099006854 + 0.807740275199315j],
    5: [-14.07838969279806, -0.7753418821958107 - 4.46486771378819j,
        -0.7753418821958107 + 4.46486771378819j, -0.3228664290041071],
    10: [-24.62459635017364, -3.720168404372825 - 10.906811394762823j,
         -3.720168404372825 + 10.906811394762823j, 0.16105338653171064],
}  # fmt: skip


@pytest.fixture(scope="module")
def published():
    return pack(load_bicycle("bicycle_benchmark"))


def test_canonical_matrices_are_the_published_ones(published):
    found = canonical(published)
    for ours, theirs in zip((found.M, found.C1, found.K0, found.K2), (M, C1, K0, K2), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=2e-13)


@pytest.mark.parametrize("speed", range(11))
def test_state_matrix_of_the_nonlinear_model_is_the_published_one(published, speed):
    lower = -np.linalg.solve(M, 9.81 * np.array(K0) + speed**2 * np.array(K2))
    rates = -np.linalg.solve(M, speed * np.array(C1))
    found, _ = linearise(published, float(speed))
    np.testing.assert_allclose(found[2:], np.hstack([lower, rates]), atol=1e-11)


@pytest.mark.parametrize("speed", EIGENVALUES)
def test_eigenvalues_are_the_published_ones(published, speed):
    found = np.sort_complex(np.linalg.eigvals(linearise(published, float(speed))[0]))
    np.testing.assert_allclose(found, np.sort_complex(np.array(EIGENVALUES[speed])), atol=1e-12)


@pytest.mark.shared
def test_eigenvalues_at_every_speed_of_the_reference(published):
    import json

    table = json.loads(shared("reference.json").read_text())["bicycle"]["eigenvalues_v0_10"]
    for speed, rows in table.items():
        found = canonical(published).eigenvalues(float(speed))[0]
        expected = np.sort_complex(np.array([complex(*row) for row in rows]))
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_the_bicycle_is_stable_between_weave_and_capsize_speed(published):
    low, high = canonical(published).stable_range()
    assert low == pytest.approx(4.29238253634111, abs=1e-11)
    assert high == pytest.approx(6.02426201538837, abs=1e-11)


def test_table_1_with_the_assumed_trail_has_no_stable_range():
    assert canonical(pack(load_bicycle("bicycle_text"))).stable_range() is None


# Basu-Mandal, Chatterjee, Papadopoulos 2007, table 1, in the coordinates of this model.
BASU_STATE = {
    "theta": 0.6206670416476966, "beta": -0.0158853521004, "gamma": 0.2311385135743,
    "rates": (-0.6068425835418, 8.9010711086821, 0.4859824687093),
}  # fmt: skip
BASU_RATES = {2: 0.7830033527065, 5: -0.0119185528069, 7: 8.0133620584155}
BASU_ACCELERATIONS = {
    2: 0.8353281706379, 3: 7.8555281128244, 4: 1.9678098042101,
    5: 0.1205543897884, 6: -4.6198904039403, 7: 2.4548072904550,
}  # fmt: skip


def test_nonlinear_accelerations_are_the_published_ones(published):
    model = Whipple(published)
    q = np.zeros(9)
    q[3], q[6] = BASU_STATE["theta"], BASU_STATE["gamma"]
    q = model.closed(q)
    assert q[5] == pytest.approx(BASU_STATE["beta"], abs=1e-12)
    qd = model.rates(q, *BASU_STATE["rates"])
    for k, rate in BASU_RATES.items():
        assert qd[k] == pytest.approx(rate, abs=1e-12)
    found = model.respond(q, qd)
    for k, acceleration in BASU_ACCELERATIONS.items():
        assert found.qdd[k] == pytest.approx(acceleration, abs=1e-12), k
    assert abs(found.multipliers[1]) < 1e-12
    assert np.abs(found.multipliers[6:]).max() < 1e-11


def test_free_motion_keeps_its_energy(published):
    """Five seconds of a falling, weaving bicycle: nothing drives or brakes it."""
    model = Whipple(published)
    q = np.zeros(9)
    q[3], q[6] = 0.05, 0.02
    q = model.closed(q)
    qd = model.rates(q, 0.0, 5.0 / 0.3, 0.0)
    start, dt = model.energy(q, qd), 0.005

    def slope(y):
        at = model.closed(y[:9])
        rates = model.rates(at, *y[9:])
        return np.concatenate([rates, model.respond(at, rates).qdd[[3, 4, 6]]])

    y = np.concatenate([q, qd[[3, 4, 6]]])
    for _ in range(1000):
        k1 = slope(y)
        k2 = slope(y + 0.5 * dt * k1)
        k3 = slope(y + 0.5 * dt * k2)
        k4 = slope(y + dt * k3)
        y = y + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    q = model.closed(y[:9])
    qd = model.rates(q, *y[9:])
    assert start > 1000.0
    assert abs(y[3]) > 1e-4, "it did not move"
    assert model.energy(q, qd) == pytest.approx(start, abs=1e-6)
    assert np.abs(model.violation(q, qd)).max() < 1e-12


def test_power_of_torques_is_what_energy_gains():
    """Drive and steer torque act inside the bicycle, lean torque from outside, drag takes."""
    model = Whipple(load_bicycle("bicycle"))
    q = np.zeros(9)
    q[3], q[6] = -0.2, 0.15
    q = model.closed(q)
    qd = model.rates(q, 0.3, 12.0, -0.4)
    lean, drive, steer = 11.0, 23.0, -1.7
    qdd = model.respond(q, qd, lean, drive, steer).qdd
    h = 1e-6
    after = model.energy(q + h * qd + 0.5 * h * h * qdd, qd + h * qdd)
    before = model.energy(q - h * qd + 0.5 * h * h * qdd, qd - h * qdd)
    free = model.respond(q, qd).qdd
    idle = (
        model.energy(q + h * qd + 0.5 * h * h * free, qd + h * free)
        - model.energy(q - h * qd + 0.5 * h * h * free, qd - h * free)
    ) / (2.0 * h)
    power = lean * qd[3] + drive * (qd[4] - qd[5]) + steer * qd[6]
    assert (after - before) / (2.0 * h) - idle == pytest.approx(power, rel=1e-5)
    assert idle == pytest.approx(-0.5 * (0.352 * 12.0) ** 3, rel=0.1), "drag takes its power"
