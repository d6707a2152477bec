"""A motion is streamed by the names of its own coordinates, and moves nothing that no longer follows it."""

from types import SimpleNamespace

import pytest

from hil.client.stream import stream
from hil.errors import CommandRefused
from hil.messages import CommandReply
from hil.signals import Cue, Event, TimedPose

CUE = Cue("test", 0, 0.0, 0.0, (TimedPose(0.0, (0.1, 0.2)),))


class Rig:
    """A client of a rig that tells its coordinates in another order."""

    rig, coordinates = "two", ("pitch", "heave")

    def __init__(self, state: str, fault: str = "", told: tuple[str, ...] = ()) -> None:
        self.sent, self.commands, self.refused = [], [], ""
        self._state = SimpleNamespace(state=state, fault=fault)
        self._told = [Event(0.0, "fault", "drive_error", text) for text in told]

    def events(self):
        return SimpleNamespace(waiting=lambda: self._told)

    def state(self):
        return self._state

    def cues(self, poses, t_s):
        self.sent += poses

    def command(self, name):
        self.commands.append(name)
        return CommandReply(not self.refused, self.refused)


def test_each_number_goes_to_the_coordinate_that_it_was_made_for():
    rig = Rig("engaged")
    stream(rig, [CUE], ("heave", "pitch"))
    assert rig.sent == [{"dt": 0.0, "heave": 0.1, "pitch": 0.2}]
    assert rig.commands == ["finish"]


def test_a_rig_that_went_elsewhere_ends_the_motion():
    rig = Rig("parking")
    with pytest.raises(CommandRefused, match=r"two went to parking 0\.0 s"):
        stream(rig, [CUE, CUE], ("heave", "pitch"))
    assert (len(rig.sent), rig.commands) == (1, ["finish"])


def test_why_a_rig_went_elsewhere_is_said_once():
    rig = Rig(
        "emergency",
        "drive_error: leg1 is off",
        ("leg1 is off", "too hot", "leg1 is off", "too hot"),
    )
    with pytest.raises(CommandRefused) as refused:
        stream(rig, [CUE], ("heave", "pitch"))
    assert str(refused.value).endswith("into the motion: drive_error: leg1 is off; too hot")


def test_a_rig_that_was_stopped_at_the_very_end_is_said():
    rig = Rig("engaged")
    rig.refused = "the rig was stopped: park or disarm it"
    with pytest.raises(CommandRefused, match="two: the rig was stopped"):
        stream(rig, [CUE], ("heave", "pitch"))
