"""A simulated CiA 402 drive searches its zero: on the plant, by the speeds it was given, to a switch."""

from __future__ import annotations

import numpy as np
import pytest

from hil.config import RigFile
from hil.configfile import load_rig
from hil.drivefiles import load_profile
from hil.drives.cia402.profile import Cia402Profile
from hil.drives.power import PowerState
from hil.sim.cia402.drive import SimulatedCia402
from hil.sim.plant import Plant

RIG: RigFile = load_rig("axis_canopen")
LOW, HIGH = RIG.actuators[0].stroke
COUNTS = RIG.actuators[0].drive.counts_per_unit
SPEED, SLOW, RATE, OFFSET, SWITCH = 0.1, 0.02, 2.0, -0.1, 0.005
ATTAINED, ERROR = 0x1400, 0x2000


class Searching:
    """One drive that lost its zero, in homing mode, enabled."""

    def __init__(self, method: int, **objects: int) -> None:
        shipped = load_profile("cia402")
        assert isinstance(shipped, Cia402Profile)
        homing = shipped.homing.model_copy(update={"kind": "drive"})
        self.plant = Plant(RIG)
        self.drive = SimulatedCia402(
            RIG,
            0,
            self.plant,
            shipped.model_copy(update={"homing": homing}),
            np.random.default_rng(1),
        )
        self.now_s = 0.0
        self.path: list[tuple[float, float, float]] = []
        self.run(0.5)
        for key, value in {
            (0x6060, 0): 6,
            (0x6098, 0): method,
            (0x6099, 1): round(SPEED * COUNTS),
            (0x6099, 2): round(SLOW * COUNTS),
            (0x609A, 0): round(RATE * COUNTS),
            (0x607C, 0): round(OFFSET * COUNTS),
            **{(int(name, 16), 0): value for name, value in objects.items()},
        }.items():
            self.drive.objects.put(key, value)
        for word in (0x06, 0x07, 0x0F, 0x1F):
            self.tell(word)
            self.run(0.01)

    def tell(self, word: int) -> None:
        self.drive.objects.before_write((0x6040, 0), word)

    def run(self, seconds: float) -> None:
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            self.now_s = min(max(self.drive.next_due_s, self.now_s + 1e-4), end_s)
            self.drive.on_time(self.now_s)
            self.plant.advance(self.now_s)
            self.path.append((self.now_s, self.plant.position(0), self.plant.velocity(0)))

    def until_it_ends(self) -> int:
        for _ in range(100):
            self.run(0.1)
            if self.drive.status_word & (ATTAINED | ERROR):
                break
        return self.drive.status_word

    def reading(self) -> float:
        return int.from_bytes(self.drive.objects.read(0x6064, 0), "little", signed=True) / COUNTS


@pytest.mark.parametrize(("method", "edge"), [(17, LOW + SWITCH), (18, HIGH - SWITCH)])
def test_it_moves_to_the_switch_and_back_to_its_edge_and_counts_from_there(
    method: int, edge: float
):
    x = Searching(method)
    assert not x.drive.is_referenced
    assert x.reading() == pytest.approx(0.0, abs=1e-5), "an incremental encoder begins anywhere"
    assert x.until_it_ends() & ATTAINED == ATTAINED
    x.run(0.2)
    assert x.plant.position(0) == pytest.approx(edge, abs=5e-4)
    assert x.reading() == pytest.approx(OFFSET + x.plant.position(0) - edge, abs=5e-4)
    assert x.drive.is_referenced
    speeds = np.array([v for _, _, v in x.path])
    away = np.sign(edge) * speeds
    assert away.max() == pytest.approx(SPEED, rel=0.1), "0x6099:1 on the way there"
    back = away[away < -0.5 * SLOW]
    assert np.median(back) == pytest.approx(-SLOW, rel=0.1), "0x6099:2 on the way back"
    reached = next(t for t, p, _ in x.path if np.sign(edge) * (p - edge) >= 0.0)
    assert reached > abs(edge) / SPEED, "no faster than asked"


def test_it_keeps_to_the_acceleration_asked_for():
    x = Searching(17)
    start_s = x.now_s
    x.run(0.15)
    t, _, v = np.array([row for row in x.path if row[0] > start_s + 0.015]).T
    slope = np.polyfit(t[t < start_s + 0.05], v[t < start_s + 0.05], 1)[0]
    assert abs(slope) == pytest.approx(RATE, rel=0.3)


@pytest.mark.parametrize("method", [35, 37])
def test_here_is_the_zero(method: int):
    x = Searching(method)
    assert x.drive.status_word & ATTAINED == ATTAINED
    assert x.reading() == pytest.approx(OFFSET, abs=1e-4)
    assert np.ptp([p for _, p, _ in x.path]) < 1e-4


@pytest.mark.parametrize("wrong", [{"6098": 11}, {"609A": 0}, {"6098": 0}])
def test_what_it_cannot_do_is_a_homing_error_and_no_motion(wrong: dict[str, int]):
    x = Searching(17, **wrong)
    assert x.until_it_ends() & ERROR
    assert not x.drive.is_referenced
    assert np.ptp([p for _, p, _ in x.path]) < 1e-4


def test_a_quick_stop_ends_the_search_without_a_zero():
    x = Searching(17)
    x.run(0.2)
    x.tell(0x02)
    assert x.drive.power is PowerState.QUICK_STOP_ACTIVE
    x.run(0.5)
    assert x.drive.power is PowerState.SWITCH_ON_DISABLED
    assert not x.drive.is_referenced
    stood = x.plant.position(0)
    x.run(0.5)
    assert x.plant.position(0) == pytest.approx(stood, abs=1e-4)


def test_switched_off_and_on_it_has_forgotten():
    x = Searching(37)
    assert x.drive.is_referenced
    x.drive.reboot(x.now_s)
    assert not x.drive.is_referenced
