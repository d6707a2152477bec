"""Compiled Kalman filter of one actuator: position, velocity and an unexplained acceleration.

The mean runs on what is known of the actuator. Driven by position setpoints it follows the drive's
loops (P position loop with the speed loop as a lag, or the "pd" law); driven by force it follows the
accelerations the rig's dynamics gave for the forces sent; idle it comes to rest. The third state, a
random walk, takes up what the model does not know.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hil.compiled import compiled

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

IDLE, POSITION, PD, FORCE = 0, 1, 2, 3
"""How the mean is predicted."""

# Columns of the parameter row of an actuator.
K_P, LAG, V_MAX, K_FV, RAMP, NOISE, K_D = 0, 1, 2, 3, 4, 5, 6
PARAMETERS = 7

IDLE_LAG_S = 0.02
STEP_S = 1.0e-3
LONGEST_S = 0.25
"""Without a sample for so long the last state says nothing more about motion."""


@compiled
def reference_at(t: float, arrivals: Vector, values: Vector, ramp: float) -> tuple[float, float]:
    """Setpoint and its rate at time t from the history of arrivals (h,) and values (h,)."""
    k = arrivals.shape[0] - 1
    while k > 0 and arrivals[k] > t:
        k -= 1
    if k == 0 or ramp <= 0.0:
        return values[k], 0.0
    share = (t - arrivals[k]) / ramp
    if share >= 1.0:
        return values[k], 0.0
    rise = values[k] - values[k - 1]
    return values[k - 1] + share * rise, rise / ramp


@compiled
def model(
    t: float, x: Vector, kind: int, par: Vector, arrivals: Vector, values: Vector
) -> tuple[float, float, float]:
    """Acceleration of the mean and its derivatives by position and velocity, at state x (3,)."""
    if kind == FORCE:
        pushed, _ = reference_at(t, arrivals, values, 0.0)
        return pushed + x[2], 0.0, 0.0
    if kind == IDLE:
        return -x[1] / IDLE_LAG_S + x[2], 0.0, -1.0 / IDLE_LAG_S
    wanted, rate = reference_at(t, arrivals, values, par[RAMP])
    if kind == PD:
        push = par[K_P] * (wanted - x[0]) + par[K_D] * (par[K_FV] * rate - x[1])
        return push + x[2], -par[K_P], -par[K_D]
    speed = par[K_P] * (wanted - x[0]) + par[K_FV] * rate
    if abs(speed) > par[V_MAX]:
        speed = np.sign(speed) * par[V_MAX]
        return (speed - x[1]) / par[LAG] + x[2], 0.0, -1.0 / par[LAG]
    return (speed - x[1]) / par[LAG] + x[2], -par[K_P] / par[LAG], -1.0 / par[LAG]


@compiled
def predict(
    x: Vector,
    P: Matrix,
    t0: float,
    t1: float,
    kind: int,
    par: Vector,
    arrivals: Vector,
    values: Vector,
    with_covariance: bool,
) -> float:
    """Carry mean x (3,) and covariance P (3, 3) from t0 to t1 in place; returns the acceleration."""
    span = min(t1 - t0, LONGEST_S)
    acceleration: float
    acceleration, _, slope = model(t0, x, kind, par, arrivals, values)
    if span <= 0.0:
        return acceleration
    steps = int(np.ceil(span * max(1.0 / STEP_S, 2.0 * abs(slope)) - 1.0e-9))
    dt = span / steps
    A = np.eye(3)
    for i in range(steps):
        acceleration, by_p, by_v = model(t0 + i * dt, x, kind, par, arrivals, values)
        # Trapezoid in velocity: exact for constant acceleration.
        x[0] += dt * (x[1] + 0.5 * dt * acceleration)
        x[1] += dt * acceleration
        if with_covariance:
            A[0, 1] = dt
            A[0, 2] = 0.5 * dt * dt
            A[1, 0] = dt * by_p
            A[1, 1] = 1.0 + dt * by_v
            A[1, 2] = dt
            P[:, :] = A @ P @ A.T
            P[2, 2] += par[NOISE] * dt
    acceleration, _, _ = model(t1, x, kind, par, arrivals, values)
    return acceleration


@compiled
def correct(
    x: Vector, P: Matrix, row: int, measured: float, variance: float, gate: float, floor: float
) -> tuple[float, bool]:
    """Take a measurement of state `row`, in place. Returns innovation and whether it was believed."""
    innovation: float = measured - x[row]
    total = P[row, row] + variance
    if abs(innovation) > max(gate * np.sqrt(total), floor):
        return innovation, False
    gain = P[:, row] / total
    x += gain * innovation
    spread = P[row, :].copy()
    for i in range(3):
        for k in range(3):
            P[i, k] -= gain[i] * spread[k]
    for i in range(3):
        for k in range(i):
            mean = 0.5 * (P[i, k] + P[k, i])
            P[i, k] = mean
            P[k, i] = mean
    return innovation, True


@compiled
def predict_all(
    X: Matrix,
    times: Vector,
    now: float,
    kinds: NDArray[np.int64],
    pars: Matrix,
    arrivals: Matrix,
    values: Matrix,
    out: Matrix,
) -> None:
    """Position, velocity, unexplained and whole acceleration of all actuators at `now` into out (n, 4)."""
    P = np.zeros((3, 3))
    for i in range(X.shape[0]):
        x = X[i].copy()
        acceleration = predict(
            x, P, times[i], now, kinds[i], pars[i], arrivals[i], values[i], False
        )
        out[i, 0] = x[0]
        out[i, 1] = x[1]
        out[i, 2] = x[2]
        out[i, 3] = acceleration
