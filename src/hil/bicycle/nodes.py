"""The bicycle's sensor nodes that are not there: a ride's samples as frames, each at its instant."""

from __future__ import annotations

import asyncio
import heapq
from collections.abc import Callable, Iterator
from typing import Final

import pandas as pd

from hil.bicycle.sensors import IMU_SIGNALS
from hil.bus.port import BusPort
from hil.config import BicycleFile
from hil.drives.bicycle_nodes import Button, encode_button, encode_lean, encode_steer, encode_wheel
from hil.drives.imu_node import encode as encode_imu
from hil.errors import BusBusy
from hil.frames import StampedFrame

QUEUED_S: Final = 0.5
"""A frame that the bus does not take waits in its controller's queue for so long; then it is lost."""
AGAIN_S: Final = 0.002


def frames_of(rig: BicycleFile, table: pd.DataFrame) -> Iterator[StampedFrame]:
    """Every frame that the nodes send during the ride in `table`, in order of time, between two buttons."""
    sensors = rig.sensors
    steps = sensors.steps_per_turn
    streams: list[list[StampedFrame]] = []
    for signal in ("lean", "rear_wheel", "steer"):
        rows = table[["t", signal]].dropna().to_numpy()
        stream = []
        for counter, (t, value) in enumerate(rows):
            if signal == "lean":
                full = abs(value) >= sensors.lean_range
                frame = encode_lean(sensors.base_id, value, counter, saturated=full)
            elif signal == "rear_wheel":
                frame = encode_wheel(sensors.base_id, value, steps, counter)
            else:
                frame = encode_steer(sensors.base_id, value, steps, counter)
            stream.append(StampedFrame(float(t), frame))
        streams.append(stream)
    if rig.imu is not None and set(IMU_SIGNALS) <= set(table.columns):
        # a row stands where the value held: the node sends it when its filter has let it through
        late = rig.imu.group_delay_s + rig.imu.delay
        rows = table[["t", *IMU_SIGNALS]].dropna().to_numpy()
        streams.append(
            [
                StampedFrame(float(row[0]) + late, frame)
                for counter, row in enumerate(rows)
                for frame in encode_imu(
                    rig.can.imu_base_id, row[1:4].tolist(), row[4:7].tolist(), counter
                )
            ]
        )
    first, last = float(table["t"].iloc[0]), float(table["t"].iloc[-1])
    yield StampedFrame(first, encode_button(sensors.base_id, Button.START))
    yield from heapq.merge(*streams, key=lambda stamped: stamped.t_s)
    yield StampedFrame(last + 0.02, encode_button(sensors.base_id, Button.STOP))


async def play(frames: Iterator[StampedFrame], port: BusPort, clock: Callable[[], float]) -> int:
    """Send each frame at its instant from now on; how many the bus did not take."""
    begun_s = clock()
    unsent = 0
    for t_s, frame in frames:
        wait_s = t_s - (clock() - begun_s)
        if wait_s > 0.0:
            await asyncio.sleep(wait_s)
        given_up_s = clock() + QUEUED_S
        while True:
            try:
                port.send(frame)
                break
            except BusBusy:
                if clock() > given_up_s:
                    unsent += 1
                    break
                await asyncio.sleep(AGAIN_S)
    return unsent
