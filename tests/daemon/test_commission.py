"""One drive at the desk, over a hub: scan, read, write, jog, home; and what is refused."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from hil.bus.hub import Hub
from hil.bus.port import open_port
from hil.config import RigFile
from hil.daemon.commission import objects
from hil.daemon.commission.access import NoAnswer
from hil.daemon.commission.desk import Desk
from hil.daemon.commission.scan import scan
from hil.daemon.lock import RigLock
from hil.drivefiles import load_profiles
from hil.drives.profiles import Profiles
from hil.errors import ConfigError, DriveError, ProtocolError, RigInUse
from hil.sim.rig import SimulatedRig
from hil.sim.serve import SimulatedRigServer
from tests.daemon.bench import wait_for
from tests.daemon.simulated_rig import rig_file

pytestmark = pytest.mark.timeout(120)


@contextmanager
def served(
    folder: Path, name: str, profiles: Profiles | None = None
) -> Iterator[tuple[RigFile, Profiles, SimulatedRig]]:
    """A simulated rig on a hub, in a thread of its own."""
    rig = rig_file(name, can={"url": f"hub:{folder / 'bus.sock'}"})
    profiles = profiles or load_profiles(rig)
    simulated = SimulatedRig(rig, profiles)
    loop, up = asyncio.new_event_loop(), threading.Event()
    over = asyncio.Event()

    async def serve() -> None:
        async with Hub(folder / "bus.sock", rig.can.bitrate):
            port = open_port(f"{rig.can.url}?node=rig", bitrate_bps=rig.can.bitrate)
            serving = asyncio.ensure_future(SimulatedRigServer(simulated, port).run())
            up.set()
            await over.wait()
            serving.cancel()
            await asyncio.gather(serving, return_exceptions=True)
            port.close()

    thread = threading.Thread(target=loop.run_until_complete, args=(serve(),))
    thread.start()
    try:
        assert up.wait(60.0)
        yield rig, profiles, simulated
    finally:
        loop.call_soon_threadsafe(over.set)
        thread.join()
        loop.close()


def test_a_cia_402_drive_is_found_read_written_and_jogged(tmp_path: Path) -> None:
    with served(tmp_path, "axis_canopen") as (rig, profiles, _):
        (found,) = scan(rig, profiles)
        assert (found.address, found.actuator) == (1, "axis")
        assert found.values == {"vendor": 0xABC, "product": 0x402}
        with Desk(rig, profiles, "axis") as desk:
            assert objects.read(desk.objects, "0x1008")[1] == "Servo drive after CiA 402"
            assert objects.write(desk.objects, "following error window", "0x1000")[1] == 0x1000
            told = dict(objects.info(desk.objects))
            assert told["Supported drive modes"].endswith("(ip, csp, csv, cst)")
            assert "switch on disabled" in told["Statusword"]
            with pytest.raises(DriveError, match="moves the drive"):
                objects.write(desk.objects, "0x6040", "15")
            with pytest.raises(ProtocolError, match="no object 'nonsense'"):
                objects.read(desk.objects, "nonsense")
            with pytest.raises(ProtocolError, match="near: Max torque"):
                objects.read(desk.objects, "max torqe")
            for text, why in (("-5", "within 0..65535"), ("0.1", "no whole number")):
                with pytest.raises(ProtocolError, match=f"Following error time out.*{why}"):
                    objects.write(desk.objects, "0x6066", text)
            assert desk.jog(0.005, 0.03) == pytest.approx(0.005, abs=5e-4)
        with Desk(rig, profiles, "axis") as desk:
            with pytest.raises(ConfigError, match="outside"):
                desk.jog(1.0, 0.01)
            for speed in (0.3, 0.0):
                with pytest.raises(
                    ConfigError, match=rf"more than 0 .*10% of .*, not at {speed:g}"
                ):
                    desk.jog(0.01, speed)


def homed_by(method: int, offset_m: float) -> Profiles:
    """The shipped drive file for a drive that searches its zero, briskly."""
    shipped = load_profiles(rig_file("axis_canopen"))["cia402"]
    search = {"kind": "drive", "method": method, "speed": 0.1, "speed_to_zero": 0.02}
    more = {"acceleration": 2.0, "offset": offset_m}
    homing = shipped.homing.model_copy(update={**search, **more})
    return {"cia402": shipped.model_copy(update={"homing": homing})}


@pytest.mark.parametrize(("method", "zero_m"), [(37, 0.0), (17, -0.245)])
def test_a_cia_402_drive_homes_by_its_own_method(
    tmp_path: Path, method: int, zero_m: float
) -> None:
    """Method 17 searches a limit switch; the offset makes its edge what the rig file calls it."""
    with served(tmp_path, "axis_canopen", homed_by(method, zero_m)) as (rig, profiles, simulated):
        (drive,) = simulated.drives
        assert not drive.is_referenced
        with Desk(rig, profiles, "axis") as desk:
            found = desk.home(lambda: objects.set_up_homing(desk) and None, 30.0)
        assert drive.is_referenced
        assert found == pytest.approx(zero_m, abs=2e-3)
        assert simulated.plant.position(0) == pytest.approx(zero_m, abs=2e-3)


def test_a_drive_that_was_homed_before_is_homed_again(tmp_path: Path) -> None:
    """Its status tells the search before until the new one has begun."""
    with served(tmp_path, "axis_canopen", homed_by(17, -0.245)) as (rig, profiles, simulated):
        (drive,) = simulated.drives
        drive._power.homing._bits = 0x1400  # attained, target reached
        with Desk(rig, profiles, "axis") as desk:
            found = desk.home(lambda: objects.set_up_homing(desk) and None, 30.0)
        assert drive.is_referenced
        assert found == pytest.approx(-0.245, abs=2e-3)


def test_a_drive_that_does_not_go_off_after_a_jog_is_named_and_left_to_its_watchdog(
    tmp_path: Path,
) -> None:
    with served(tmp_path, "axis_canopen") as (rig, profiles, simulated):
        (drive,) = simulated.drives
        with Desk(rig, profiles, "axis") as desk:
            desk.prepare()
            desk.enable()
            drive._power.obey = lambda *a: None
            with pytest.raises(DriveError, match="still makes force"):
                desk.disable()
        wait_for(lambda: not drive._power.is_on, 10.0)
        assert drive._power.code == 0x8130, "our heartbeat is gone"


def test_a_lust_drive_is_found_read_written_and_jogged(tmp_path: Path) -> None:
    with served(tmp_path, "axis") as (rig, profiles, _):
        (found,) = scan(rig, profiles)
        assert (found.actuator, found.text) == ("axis", "logs on")
        with Desk(rig, profiles, "axis") as desk:
            assert objects.read(desk.objects, "position gain")[1] == pytest.approx(80.0)
            assert objects.write(desk.objects, "watchdog", "0.2")[1] == pytest.approx(0.2)
            with pytest.raises(DriveError, match="not among the parameters"):
                objects.write(desk.objects, "position gain", "90")
            with pytest.raises(ProtocolError, match="numbers up to 65535"):
                objects.read(desk.objects, "9999999")
            for text, why in (("0.2 s", "no number"), ("nan", "not fit"), ("1e12", "not fit")):
                with pytest.raises(ProtocolError, match=why):
                    objects.write(desk.objects, "watchdog", text)
            assert desk.jog(0.005, 0.03) == pytest.approx(0.005, abs=5e-4)
            with pytest.raises(DriveError, match="no homing over the bus"):
                desk.home(lambda: None, 1.0)


def test_a_drive_that_says_nothing_is_told_once_and_not_for_each_object(tmp_path: Path) -> None:
    with served(tmp_path, "axis") as (rig, _, _):
        other = rig_file("axis_canopen", can={"url": rig.can.url})
        with (
            Desk(other, load_profiles(other), "axis") as desk,
            pytest.raises(NoAnswer, match=r"is it powered, .* of this family\?"),
        ):
            list(objects.info(desk.objects))


def test_beside_a_daemon_nothing_is_said(tmp_path: Path) -> None:
    rig = rig_file("axis_canopen", can={"url": f"hub:{tmp_path / 'bus.sock'}"})
    with (
        RigLock(rig.name, *rig.can.urls),
        pytest.raises(RigInUse),
        Desk(rig, load_profiles(rig), "axis"),
    ):
        pass


def test_an_actuator_that_there_is_not() -> None:
    rig = rig_file("axis_canopen")
    with pytest.raises(ConfigError, match="no actuator 'leg9'"):
        Desk(rig, load_profiles(rig), "leg9")
