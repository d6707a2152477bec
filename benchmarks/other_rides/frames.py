"""Vectors (3, N) turned about axes, and their rates by central differences."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def turn_x(angle: Array | float, v: Array) -> Array:
    """`v` turned about x by `angle`, rad."""
    c, s = np.cos(angle), np.sin(angle)
    return _rows(v[0], c * v[1] - s * v[2], s * v[1] + c * v[2])


def turn_y(angle: Array | float, v: Array) -> Array:
    """`v` turned about y by `angle`, rad."""
    c, s = np.cos(angle), np.sin(angle)
    return _rows(c * v[0] + s * v[2], v[1], c * v[2] - s * v[0])


def turn_z(angle: Array | float, v: Array) -> Array:
    """`v` turned about z by `angle`, rad."""
    c, s = np.cos(angle), np.sin(angle)
    return _rows(c * v[0] - s * v[1], s * v[0] + c * v[1], v[2])


def cross(a: Array, b: Array) -> Array:
    """a x b."""
    return _rows(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def dot(a: Array, b: Array) -> Array:
    """a . b of each column."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def rate(values: Array, dt_s: float) -> Array:
    """Derivative along the last axis."""
    return np.asarray(np.gradient(values, dt_s, axis=-1, edge_order=2))


def column(x: float, y: float, z: float) -> Array:
    """One vector (3, 1)."""
    return np.array([[x], [y], [z]])


def _rows(*parts: Array | float) -> Array:
    return np.stack(np.broadcast_arrays(*parts))
