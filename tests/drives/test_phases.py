"""The phase machine by itself: ENABLE never goes out without a verified watchdog, whatever else is wrong."""

from __future__ import annotations

import pytest

from hil.drives.driver import DrivePhase, PowerGoal
from hil.drives.lust_cdd3000.codec import Answer, AnswerStatus, Status
from hil.drives.lust_cdd3000.configure import Configuration, gains_of, settings_of
from hil.drives.lust_cdd3000.driver import phase_settings
from hil.drives.phases import PhaseMachine
from hil.drives.power import PowerCommand, PowerState
from tests.drives.exchange import profile_of, rig_of

RIG, PROFILE = rig_of(), profile_of()
ACTUATOR = RIG.actuators[0]


def configuration(*, verified: bool) -> Configuration:
    made = Configuration(
        settings_of(RIG, ACTUATOR, PROFILE, "position"), gains_of(ACTUATOR, PROFILE), barrier=400
    )
    for _ in range(3 if verified else 0):  # write, barrier, read-back
        request = made.request()
        made.answered(request, Answer(request.number, AnswerStatus(0), 100))
    assert made.watchdog_ok == verified
    return made


@pytest.mark.parametrize("phase", list(DrivePhase))
@pytest.mark.parametrize("verified", [True, False])
@pytest.mark.parametrize("started", [True, False])
@pytest.mark.parametrize("goal", list(PowerGoal))
def test_enable_needs_phase_watchdog_start_and_goal(
    phase: DrivePhase, verified: bool, started: bool, goal: PowerGoal
) -> None:
    machine = PhaseMachine(
        "x",
        phase_settings(PROFILE),
        Status(PowerState.NOT_READY, enpo=False),
        configuration(verified=verified),
        ("position",),
        0.1,
    )
    machine.phase, machine.started = phase, started
    machine.took_status(0.0, Status(PowerState.READY_TO_SWITCH_ON, enpo=True, referenced=True))
    machine.wants(0.0, PowerGoal.OFF)
    machine.wants(0.01, goal)
    may = phase in (DrivePhase.READY, DrivePhase.ENABLED)
    expected = may and verified and started and goal is PowerGoal.ON
    assert (machine.command(0.01) is PowerCommand.ENABLE) == expected
