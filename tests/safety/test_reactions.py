"""Every cause in every state leads to what the table of reactions says, and docs/safety.md says the same."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from hil.drives.driver import PowerGoal
from hil.safety import REACTIONS, Cause, Finding, MotionGoal, Reaction, Rule, StateName, finding_of
from hil.signals import Event
from tests.safety.rig_bench import Bench

DOCS = Path(__file__).parents[2] / "docs" / "safety.md"
OFFLINE, PREPARING, PARKED, READY, ENGAGED, PARKING, FAULT, EMERGENCY = StateName
N, W, B, P, F, E = Reaction

EXPECTED: dict[Cause, tuple[Reaction, Reaction]] = {
    Cause.CUE_STALE: (P, N),
    Cause.ANSWERS_LOST: (E, F),
    Cause.DRIVE_ERROR: (F, F),
    Cause.ENPO_LOST: (E, B),
    Cause.COURSE_LIMIT: (F, F),
    Cause.OUTSIDE_STROKE: (F, B),
    Cause.OVERSPEED: (E, W),
    Cause.FOLLOWING_ERROR: (E, N),
    Cause.NO_MOTION: (E, N),
    Cause.GATE_REFUSED: (F, W),
    Cause.OVERRUN: (P, W),
    Cause.BUS_OFF: (E, B),
    Cause.BUS_BUSY: (P, W),
    Cause.GATEWAY_GONE: (P, W),
    Cause.WATCHDOG_UNVERIFIED: (F, B),
    Cause.STRIDE_MISMATCH: (E, F),
    Cause.DRIVE_REBOOTED: (E, F),
    Cause.DRIVE_NOT_ENABLED: (E, N),
    Cause.POWER_ON_TIMEOUT: (F, F),
    Cause.RAMP_TIMEOUT: (E, N),
    Cause.LEAVE_TIMEOUT: (E, N),
    Cause.SECOND_MASTER: (F, B),
    Cause.IMU_LOST: (W, W),
}
"""Written down a second time, so that a change of the table is a decision and no slip."""

# Where the rig is after one step, from each place, by the reaction that holds there.
AFTER: dict[str, dict[Reaction, StateName]] = {
    "offline": {N: OFFLINE, W: OFFLINE, B: OFFLINE, F: FAULT},
    "preparing": {N: PREPARING, W: PREPARING, B: PREPARING, F: FAULT},
    "parked": {N: PARKED, W: PARKED, B: PARKED, F: FAULT},
    "ready": {W: READY, P: PARKED, F: FAULT, E: EMERGENCY},
    "engaged": {W: ENGAGED, P: PARKING, F: FAULT, E: EMERGENCY},
    "parking": {W: PARKING, P: PARKING, F: FAULT, E: EMERGENCY},
    "held": {W: PARKING, P: PARKING, F: FAULT, E: EMERGENCY},
    "ramping": {W: FAULT, P: FAULT, F: FAULT, E: EMERGENCY},
    "faulted": {N: FAULT, W: FAULT, B: FAULT, F: FAULT},
    "emergency": {N: EMERGENCY, W: EMERGENCY, B: EMERGENCY, F: EMERGENCY},
}
ARMED = ("ready", "engaged", "parking", "held", "ramping")


def test_the_table_is_the_one_decided() -> None:
    assert {c: (row.armed, row.disarmed) for c, row in REACTIONS.items()} == EXPECTED
    assert set(REACTIONS) == set(Cause)


@pytest.mark.parametrize("way", AFTER)
@pytest.mark.parametrize("cause", Cause, ids=lambda c: c.value)
def test_every_cause_in_every_state(way: str, cause: Cause) -> None:
    bench = Bench()
    getattr(bench, way)()
    had_fault = bench.state.fault
    bench.events.clear()
    out = bench.step(Finding(cause, "because"))
    what = EXPECTED[cause][0 if way in ARMED else 1]
    assert out.state is AFTER[way][what]
    latched = out.state in (FAULT, EMERGENCY)
    assert (out.fault is not None) is latched
    if latched and had_fault is not None:
        assert out.fault is had_fault, "the first fault keeps its name"
    elif latched:
        assert out.fault == (cause, "because")
    if out.state is EMERGENCY:
        assert (out.power, out.motion, out.armed) == (PowerGoal.OFF, MotionGoal.NONE, False)
    if way == "ready" and what is F:
        assert (out.power, out.motion) == (PowerGoal.OFF, MotionGoal.NONE), (
            "it stands there already"
        )
    elif way in ARMED and what is F and way != "held":
        assert (out.power, out.motion) == (PowerGoal.ON, MotionGoal.PARK)
    if way not in ARMED:
        assert out.power is not PowerGoal.ON
    repeated = had_fault is not None and cause is had_fault.cause
    assert (cause.value in bench.events) is (what is not N and not repeated)


@pytest.mark.parametrize("hard", [Cause.BUS_OFF, Cause.FOLLOWING_ERROR])
@pytest.mark.parametrize("first", [True, False])
def test_of_several_causes_the_hardest_is_named(hard: Cause, first: bool) -> None:
    bench = Bench().engaged()
    found = [Finding(hard, "hard"), Finding(Cause.OVERRUN, "soft"), Finding(Cause.DRIVE_ERROR, "f")]
    out = bench.step(*(found if first else reversed(found)))
    assert out.state is EMERGENCY
    assert out.fault == (hard, "hard")


def test_faults_of_drivers_become_their_causes() -> None:
    names = {
        "drive_silent": Cause.ANSWERS_LOST,
        "drive_rebooted": Cause.DRIVE_REBOOTED,
        "enpo_lost": Cause.ENPO_LOST,
        "drive_dropped_out": Cause.DRIVE_NOT_ENABLED,
        "drive_not_enabled": Cause.POWER_ON_TIMEOUT,
        "course_limitation": Cause.COURSE_LIMIT,
        "stride_mismatch": Cause.STRIDE_MISMATCH,
        "drive_error": Cause.DRIVE_ERROR,
        "something_new": Cause.DRIVE_ERROR,
    }
    for name, cause in names.items():
        assert finding_of(Event(1.0, "fault", name, "left")) == (cause, "left")
        assert finding_of(Event(1.0, "warning", name, "left")) is None
        assert finding_of(Event(1.0, "info", name, "left")) is None


def test_the_page_shows_the_table_of_reactions() -> None:
    rows = [
        f"| `{cause.value}` | {row.armed.value} | {row.disarmed.value} | {row.why} |"
        for cause, row in REACTIONS.items()
    ]
    assert table("cause") == rows


def test_the_page_shows_the_table_of_rules() -> None:
    assert table("rule") == [f"| `{rule.value}` | {rule.meaning} |" for rule in Rule]


def table(first_column: str) -> list[str]:
    """Rows of the page's table whose first column has this heading."""
    text = DOCS.read_text(encoding="utf-8")
    found = re.search(rf"^\| {first_column} \|.*\n\|[-| ]+\|\n((?:\|.*\n)+)", text, re.MULTILINE)
    assert found, f"docs/safety.md has no table of {first_column}s"
    return found.group(1).splitlines()
