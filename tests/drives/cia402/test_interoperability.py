"""Other people's CANopen: our master with their drive, our drive with their master, in one process."""

from __future__ import annotations

import math

import canopen
import pytest
from canopen.profiles.p402 import BaseNode402, OperationMode

from hil.configfile import data_folder
from hil.drives.driver import DrivePhase, PowerGoal
from hil.drives.power import PowerState
from hil.frames import Frame
from hil.sim.plant import Plant
from tests.drives.cia402.exchange import Exchange, profile_of, rig_of
from tests.drives.cia402.foreign import ENABLED, FAULT, ForeignDrive

EDS = str(data_folder("drives") / "cia402" / "device.eds")
NODE = 1


# our master


def test_our_master_takes_a_drive_of_durands_to_force_and_moves_it():
    drive = ForeignDrive(NODE)
    x = Exchange(nodes=[drive])
    x.enable()
    assert drive.od.read(0x6041, 0) == ENABLED
    assert drive.od.read(0x1016, 1) == 127 << 16 | 100
    assert drive.od.read(0x1017, 0) == 50
    assert drive.node.rpdo[0].mapping == ((0x6040, 0), (0x607A, 0))
    assert drive.node.tpdo[0].mapping == ((0x6041, 0), (0x6064, 0), (0x6077, 0))
    x.samples.clear()
    x.run(0.2, PowerGoal.ON, lambda t: [0.02 * math.sin(30.0 * t)])
    counts = x.rig.actuators[0].drive.counts_per_unit
    positions = [s.value for s in x.samples if s.quantity == "position"]
    assert max(positions) == pytest.approx(0.02, rel=0.01)
    assert drive.position / counts == pytest.approx(
        0.02 * math.sin(30.0 * (x.now_s - 2e-3)), abs=1e-3
    )
    x.run(0.02, PowerGoal.OFF)
    assert drive.od.read(0x6041, 0) != ENABLED


def test_our_master_resets_a_fault_of_durands_drive():
    drive = ForeignDrive(NODE)
    x = Exchange(nodes=[drive])
    x.enable()
    drive.od.write(0x6041, 0, FAULT)
    drive.node.emcy.set(0x4310, 0)
    x.run(0.1, PowerGoal.ON)
    assert "motor too hot" in x.error()
    drive.od.write(0x6041, 0, FAULT)
    x.reach(DrivePhase.READY, PowerGoal.RESET)


def test_our_master_refuses_durands_drive_with_another_identity():
    x = Exchange(nodes=[ForeignDrive(NODE, product=7)])
    x.reach(DrivePhase.FAULT)
    assert x.named("drive_identity")


# their master


class Desk(canopen.Network):
    """canopen's network around our simulated drive: sending lets simulated time go on."""

    STEP_S = 0.0005

    def __init__(self, drive, plant) -> None:
        super().__init__()
        self.drive, self.plant, self.now_s = drive, plant, 0.0

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        self._take(self.drive.on_frame(self.now_s, Frame(can_id, bytes(data))))
        self.pass_time(self.STEP_S)

    def pass_time(self, seconds: float) -> None:
        end_s = self.now_s + seconds
        while self.drive.next_due_s <= end_s:
            self.now_s = max(self.now_s, self.drive.next_due_s)
            self._take(self.drive.on_time(self.now_s))
        self.now_s = end_s
        self.plant.advance(end_s)

    def _take(self, frames) -> None:
        for _, frame in frames:
            self.notify(frame.can_id, bytearray(frame.data), self.now_s)


@pytest.fixture
def desk() -> Desk:
    rig = rig_of()
    plant = Plant(rig)
    x = Exchange(rig, profile_of(), plant=plant)
    network = Desk(x.drives[0], plant)
    network.pass_time(0.5)
    return network


def their_node(network: Desk) -> BaseNode402:
    """Set up as canopen's documentation does, with process data at SYNC."""
    node = BaseNode402(NODE, EDS)
    network.add_node(node)
    node.nmt.state = "PRE-OPERATIONAL"
    node.sdo[0x1017].raw = 50
    node.tpdo.read()
    node.rpdo.read()
    node.rpdo[1].clear()
    node.rpdo[1].add_variable(0x6040)
    node.rpdo[1].add_variable(0x607A)
    node.rpdo[1].trans_type = 1
    node.rpdo[1].enabled = True
    node.rpdo[1].save()
    node.tpdo[1].clear()
    node.tpdo[1].add_variable(0x6041)
    node.tpdo[1].add_variable(0x6064)
    node.tpdo[1].trans_type = 1
    node.tpdo[1].enabled = True
    node.tpdo[1].save()
    node.sdo[0x6060].raw = 8
    node.setup_402_state_machine(read_pdos=False)
    node.nmt.state = "OPERATIONAL"
    return node


def sync(network: Desk, node: BaseNode402, position: int | None = None) -> None:
    """One cycle of their master."""
    if position is not None:
        node.rpdo[1][0x607A].raw = position
    node.rpdo[1].transmit()
    network.sync.transmit()
    network.pass_time(0.001 - 2 * Desk.STEP_S)
    network.pass_time(0.0005)


def test_their_master_takes_our_drive_to_force_and_moves_it(desk):
    node = their_node(desk)
    assert node.is_op_mode_supported("CYCLIC SYNCHRONOUS POSITION")
    assert node.sdo[0x6502].raw & OperationMode.SUPPORTED["CYCLIC SYNCHRONOUS TORQUE"]
    assert node.sdo[0x1008].raw == "Servo drive after CiA 402"
    start = node.sdo[0x6064].raw
    for word in (0x06, 0x07, 0x0F):
        node.rpdo[1][0x6040].raw = word
        for _ in range(3):
            sync(desk, node, start)
    assert node.state == "OPERATION ENABLED"
    assert desk.drive.power is PowerState.OPERATION_ENABLED
    for k in range(400):
        sync(desk, node, start + 250 * min(k, 200))
    assert node.tpdo[1][0x6064].raw == pytest.approx(start + 50_000, abs=200)
    desk.pass_time(0.01)
    node.rpdo[1][0x6040].raw = 0x06
    for _ in range(3):
        sync(desk, node)
    assert node.state == "READY TO SWITCH ON"


def test_their_master_hears_our_emergencies_and_heartbeats(desk):
    node = their_node(desk)
    desk.pass_time(0.2)
    assert node.nmt.state == "OPERATIONAL"
    desk._take(desk.drive.set_fault(0x4310))
    assert [e.code for e in node.emcy.active] == [0x4310]
    sync(desk, node)
    assert node.is_faulted()
    node.rpdo[1][0x6040].raw = 0x80
    sync(desk, node)
    sync(desk, node)
    assert not node.is_faulted()
