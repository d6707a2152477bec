"""A trail forgets what is old and tells the travel between two instants, ends included."""

from __future__ import annotations

import random

from hil.safety.trail import SPARE, Trail


def test_travel_is_that_of_the_points_between_the_instants():
    trail = Trail(0.5)
    rng, points = random.Random(1), []
    for k in range(3 * SPARE):
        t_s, value = 0.001 * k, rng.uniform(-1.0, 1.0)
        points.append((t_s, value))
        trail.add(t_s, value)
        for low, high in ((t_s - 0.4, t_s - 0.1), (t_s - 0.5, t_s)):
            inside = [v for t, v in points if low <= t <= high]
            assert trail.travel(low, high) == (max(inside) - min(inside) if inside else 0.0)


def test_it_keeps_little_more_than_it_needs_and_never_nothing():
    trail = Trail(0.1)
    for k in range(10 * SPARE):
        trail.add(0.001 * k, 0.0)
        assert len(trail.times) == len(trail.values) <= 101 + SPARE + 1
    trail.add(1000.0, 2.0)
    assert (trail.times[-1], trail.values[-1]) == (1000.0, 2.0)
    trail.clear()
    assert trail.travel(0.0) == 0.0
