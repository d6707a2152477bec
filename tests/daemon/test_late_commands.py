"""Which commands are not done any more once they have waited."""

import pytest

from hil.daemon.gateway.commands import COMMANDS
from hil.daemon.late_commands import CALMING, OLD_S, too_late
from hil.daemon.records import CommandRecord


def test_commands_that_calm_a_rig_are_commands():
    assert set(COMMANDS) >= CALMING


@pytest.mark.parametrize("name", sorted(set(COMMANDS) - CALMING))
def test_what_waited_too_long_is_refused_and_said(name):
    command = CommandRecord(7, name)
    assert too_late(command, 100.0, 100.1 - OLD_S) is None
    told = too_late(command, 103.5, 100.0)
    assert told is not None
    event, reply = told
    assert (event.severity, event.name) == ("warning", "command_late")
    assert (reply.command_id, reply.ok) == (7, False)
    assert f"{name} came 3.5 s late" in reply.text


@pytest.mark.parametrize("name", sorted(CALMING))
def test_what_calms_a_rig_is_never_too_late(name):
    assert too_late(CommandRecord(7, name), 1000.0, 0.0) is None
