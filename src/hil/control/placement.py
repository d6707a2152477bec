"""Gains by pole placement for the error dynamics ë + K_d ė + K_p e = 0."""

from __future__ import annotations


def second_order_gains(bandwidth_rad_s: float, damping: float) -> tuple[float, float]:
    """K_p (1/s²) and K_d (1/s) that give natural frequency `bandwidth_rad_s` and damping ratio `damping`."""
    return bandwidth_rad_s**2, 2.0 * damping * bandwidth_rad_s
