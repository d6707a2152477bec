"""One simulated ride, and a short one, for all tests of rides."""

from __future__ import annotations

import pytest

from hil.bicycle.path import slalom
from hil.bicycle.simulated import SimulatedRide, simulate_ride
from hil.configfile import load_bicycle


@pytest.fixture(scope="session")
def round_trip() -> SimulatedRide:
    """Out, a U-turn, back, another: the ride of the text."""
    return simulate_ride(load_bicycle("bicycle"), seed=4)


@pytest.fixture(scope="session")
def weaving() -> SimulatedRide:
    """A slalom: other motion than the round trip's."""
    return simulate_ride(load_bicycle("bicycle"), slalom(70.0), seed=5)
