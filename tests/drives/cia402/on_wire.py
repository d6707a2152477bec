"""What the tests on a real bus share, hub or SocketCAN: rig file, their master, their drive as a process."""

from __future__ import annotations

import select
import sys
import time
from pathlib import Path

import can
import canopen
from canopen.profiles.p402 import BaseNode402

from hil.bus.port import open_port
from hil.configfile import data_folder, find_rig_file
from tests.drives.cia402.foreign import ForeignDrive

EDS = str(data_folder("drives") / "cia402" / "device.eds")
BITRATE_BPS = 1_000_000
CYCLE_S = 0.02
CALM = {
    "\ncycle = 0.001\n": f"\ncycle = {CYCLE_S}\n",
    "\nsetpoint_delay = 0.00115 ": f"\nsetpoint_delay = {CYCLE_S + 0.00015} ",
    "bandwidth = 90.0": "bandwidth = 10.0",
    "observer = 400.0": "observer = 60.0",
    "\n[safety]\n": "\n[safety]\nanswer_timeout = 0.45\ndrive_watchdog = 1.0\n",
    "\n[cue]\n": "\n[cue]\nstale = 4.0\n",
}
"""What a busy machine without real-time rights can hold."""


def calm_rig(folder: Path, name: str = "axis_canopen") -> Path:
    """The shipped rig file in `folder`, slower; without IMU, which a drive alone has not."""
    text = find_rig_file(name).read_text()
    for there, slower in CALM.items():
        text = text.replace(there, slower)
    before, _, after = text.partition("\n[imu]\n")
    text = before + "\n" + after[after.index("[noise]") :]
    path = folder / f"{name}.toml"
    path.write_text(text)
    return path


def their_master_moves_it(bus: can.BusABC, node_id: int = 1) -> list[int]:
    """canopen's BaseNode402 brings the drive at `node_id` to force and moves it; where it was on the way."""
    network = canopen.Network(bus)
    network.connect()
    try:
        node = BaseNode402(node_id, EDS)
        network.add_node(node)
        network.sync.start(CYCLE_S)
        deadline_s = time.monotonic() + 120.0
        while True:
            try:
                node.sdo[0x1017].raw = 100
                break
            except canopen.SdoCommunicationError:
                assert time.monotonic() < deadline_s
        node.nmt.state = "PRE-OPERATIONAL"
        node.tpdo.read()
        node.rpdo.read()
        for pdo, variables in ((node.rpdo[1], (0x6040, 0x607A)), (node.tpdo[1], (0x6041, 0x6064))):
            pdo.clear()
            for index in variables:
                pdo.add_variable(index)
            pdo.trans_type = 1
            pdo.enabled = True
            pdo.save()
        node.sdo[0x6060].raw = 8
        node.setup_402_state_machine(read_pdos=False)
        node.nmt.state = "OPERATIONAL"
        node.nmt.wait_for_heartbeat(5.0)
        start = node.sdo[0x6064].raw
        node.rpdo[1][0x607A].raw = start
        node.rpdo[1].start(CYCLE_S)
        node.state = "OPERATION ENABLED"
        seen = [start]
        for k in range(50):
            node.rpdo[1][0x607A].raw = start + 2000 * (k + 1)
            node.rpdo[1].update()
            assert node.tpdo[1].wait_for_reception(5.0) is not None
            seen.append(node.tpdo[1][0x6064].raw)
        time.sleep(0.3)
        assert node.tpdo[1].wait_for_reception(5.0) is not None
        seen.append(node.tpdo[1][0x6064].raw)
        assert node.state == "OPERATION ENABLED"
        node.state = "READY TO SWITCH ON"
        return seen
    finally:
        network.disconnect()


def serve_foreign_drive(url: str, node_id: int = 1) -> None:
    """Be durand's drive on the bus `url` until killed."""
    port = open_port(url, bitrate_bps=BITRATE_BPS)
    start_s = time.monotonic()
    drive = ForeignDrive(node_id)
    while True:
        now_s = time.monotonic() - start_s
        due_s = min(max(drive.next_due_s - now_s, 0.0), 0.1)
        select.select([port], [], [], due_s)
        out = drive.on_time(time.monotonic() - start_s)
        for _, frame in port.receive():
            out += drive.on_frame(time.monotonic() - start_s, frame)
        for _, frame in out:
            port.send(frame)


if __name__ == "__main__":
    serve_foreign_drive(sys.argv[1])
