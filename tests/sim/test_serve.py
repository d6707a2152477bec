"""A simulated rig in real time, on a hub."""

from __future__ import annotations

import asyncio

from hil.bus.hub import Hub
from hil.bus.port import open_port
from hil.configfile import load_drive, load_rig
from hil.drives.lust_cdd3000.codec import frame_ids
from hil.drives.profile import LustProfile
from hil.frames import Frame
from hil.sim.rig import SimulatedRig
from hil.sim.serve import SimulatedRigServer

PROFILE = load_drive("lust_cdd3000", LustProfile)
IDS = frame_ids(PROFILE.ids, 1)


async def until(condition) -> None:
    for _ in range(2000):
        if condition():
            return
        await asyncio.sleep(0.01)
    raise AssertionError("waited in vain")


def test_a_rig_without_imu_waits_in_silence_and_answers_when_spoken_to(tmp_path):
    rig = load_rig("axis").model_copy(update={"imu": None})
    simulated = SimulatedRig(rig, {"lust_cdd3000": PROFILE})
    heard: list[int] = []

    async def session() -> None:
        url = f"hub:{tmp_path / 'bus.sock'}"
        async with Hub(tmp_path / "bus.sock", rig.can.bitrate):
            theirs = open_port(f"{url}?node=rig", bitrate_bps=rig.can.bitrate)
            ours = open_port(f"{url}?node=test", bitrate_bps=rig.can.bitrate)
            serving = asyncio.ensure_future(SimulatedRigServer(simulated, theirs).run())
            loop = asyncio.get_running_loop()
            loop.add_reader(
                ours.fileno(), lambda: heard.extend(f.frame.can_id for f in ours.receive())
            )
            await until(lambda: IDS.log_on in heard)
            for _ in range(2):  # the first ends the log-on: from then on nothing is due by itself
                heard.clear()
                ours.send(Frame(IDS.control, bytes(8)))
                await until(lambda: IDS.status in heard or serving.done())
                await asyncio.sleep(0.3)
                assert not serving.done()
            loop.remove_reader(ours.fileno())
            serving.cancel()
            await asyncio.gather(serving, return_exceptions=True)
            ours.close()
            theirs.close()

    asyncio.run(session())
    assert IDS.log_on not in heard
