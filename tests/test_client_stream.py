"""A motion is streamed by the names of its own coordinates, and parks only what still follows."""

from types import SimpleNamespace

import pytest

from hil.client.stream import stream
from hil.errors import CommandRefused
from hil.signals import Cue, TimedPose

CUE = Cue("test", 0, 0.0, 0.0, (TimedPose(0.0, (0.1, 0.2)),))


class Rig:
    """A client of a rig that tells its coordinates in another order."""

    rig, coordinates = "two", ("pitch", "heave")

    def __init__(self, state: str) -> None:
        self.sent, self.commands = [], []
        self._state = SimpleNamespace(state=state, fault="")

    def events(self):
        return SimpleNamespace(waiting=list)

    def state(self):
        return self._state

    def cues(self, poses, t_s):
        self.sent += poses

    def command(self, name):
        self.commands.append(name)


def test_each_number_goes_to_the_coordinate_that_it_was_made_for():
    rig = Rig("engaged")
    stream(rig, [CUE], ("heave", "pitch"))
    assert rig.sent == [{"dt": 0.0, "heave": 0.1, "pitch": 0.2}]
    assert rig.commands == ["park"]


def test_a_rig_that_went_elsewhere_is_left_as_it_is():
    rig = Rig("parking")
    with pytest.raises(CommandRefused, match=r"two went to parking 0\.0 s"):
        stream(rig, [CUE], ("heave", "pitch"))
    assert rig.commands == []
