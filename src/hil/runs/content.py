"""Sorts the messages of a recording into signals, states and events."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any, Final

import msgspec

from hil.config.bicycle import SIGNALS
from hil.control.track import HISTORY_S, MERGE_S, MERGE_SHARE
from hil.messages import (
    ActuatorState,
    CueMessage,
    DriveMessage,
    EventMessage,
    ImuMessage,
    RideMessage,
    SetpointMessage,
    StateMessage,
)
from hil.runs.table import TableBuilder
from hil.signals import IMU_QUANTITIES

_DRIVE_QUANTITIES: Final = ("position", "velocity", "force", "current")
_SETPOINT_COLUMN: Final = {"position": "setpoint", "force": "force_setpoint"}
_STATE_NUMBERS: Final = (
    "tracking_error",
    "lateness_s",
    "period_s",
    "overruns",
    "slot_use",
    "bus_load",
)


class Content:
    """What the messages of one recording say; times as they stand there, on the rig's clock.

    `future_s`: how far ahead the rig takes poses of a cue, s (`cue.future` of its file).
    """

    def __init__(self, future_s: float = float("inf")) -> None:
        self.signals = TableBuilder()
        self.states: list[dict[str, Any]] = []
        self.events: list[EventMessage] = []
        self._unreadable: dict[str, int] = {}
        self._future_s = future_s
        self._cued: deque[tuple[float, dict[str, float]]] = deque()
        self._takers: dict[str, Callable[[bytes, float], None]] = {
            "/imu": self._taker(ImuMessage, self._take_imu),
            "/ride": self._taker(RideMessage, self._take_ride),
            "/setpoint": self._taker(SetpointMessage, self._take_setpoint),
            "/state": self._taker(StateMessage, self._take_state),
            "/event": self._taker(EventMessage, lambda message, _: self.events.append(message)),
            "/cue": self._taker(CueMessage, self._take_cue),
        }

    def take(self, topic: str, data: bytes, t_s: float) -> None:
        """One message that was logged at `t_s`; topics of others are passed over."""
        taker = self._takers.get(topic)
        if taker is None:
            if not topic.startswith("/drive/"):
                return
            taker = self._takers[topic] = self._drive_taker(topic.removeprefix("/drive/"))
        try:
            taker(data, t_s)
        except (msgspec.DecodeError, UnicodeDecodeError):
            self._unreadable[topic] = self._unreadable.get(topic, 0) + 1

    def finish(self) -> None:
        """No message follows: what the last cues asked for stands."""
        self._settle_cues(float("inf"))

    def damage(self) -> str | None:
        """A sentence on messages that could not be decoded, or None."""
        if not self._unreadable:
            return None
        parts = ", ".join(f"{n} of {topic}" for topic, n in sorted(self._unreadable.items()))
        return f"messages that are not what their topic promises: {parts}"

    @staticmethod
    def _taker(
        kind: type[Any], use: Callable[[Any, float], None]
    ) -> Callable[[bytes, float], None]:
        decode = msgspec.json.Decoder(kind).decode
        return lambda data, t_s: use(decode(data), t_s)

    def _drive_taker(self, actuator: str) -> Callable[[bytes, float], None]:
        columns = [(q, f"{actuator}.{q}") for q in _DRIVE_QUANTITIES]

        def use(message: DriveMessage, _: float) -> None:
            for quantity, column in columns:
                value = getattr(message, quantity)
                if value is not None:
                    self.signals.add(column, message.t, value)

        return self._taker(DriveMessage, use)

    def _take_imu(self, message: ImuMessage, _: float) -> None:
        """Rows stand where the values held: the sensor's filter delay is taken out, as everywhere."""
        held = message.t if message.sampled is None else message.sampled
        for quantity in IMU_QUANTITIES:
            value = getattr(message, quantity)
            if value is not None:
                self.signals.add(f"imu.{quantity}", held, value)

    def _take_ride(self, message: RideMessage, _: float) -> None:
        held = message.t if message.sampled is None else message.sampled
        for signal in SIGNALS:
            value = getattr(message, signal)
            if value is not None:
                self.signals.add(signal, held, value)

    def _take_setpoint(self, message: SetpointMessage, _: float) -> None:
        column = _SETPOINT_COLUMN.get(message.kind)
        if column is None:
            raise msgspec.ValidationError(f"kind {message.kind!r} is no kind of setpoint")
        for actuator, value in message.values.items():
            self.signals.add(f"{actuator}.{column}", message.t, value)

    def _take_state(self, message: StateMessage, _: float) -> None:
        row: dict[str, Any] = {"t": message.t, "state": message.state, "fault": message.fault}
        row.update((f"pose.{c}", v) for c, v in message.pose.items())
        row.update((f"setpoint.{c}", v) for c, v in message.setpoint.items())
        row.update((name, getattr(message, name)) for name in _STATE_NUMBERS)
        row["age_s"] = _oldest(message.actuators)
        self.states.append(row)

    def _take_cue(self, message: CueMessage, t_s: float) -> None:
        """A cue's poses count from its receipt on until a later cue's first pose replaces them.

        As in the daemon, that replaces what stands just before it, too: the same pose, a rounding or
        the network's jitter away. Poses too far ahead are dropped there, and here.
        """
        if not all("dt" in pose for pose in message.poses):
            raise msgspec.ValidationError("a pose of a cue has no dt")
        poses = [pose for pose in message.poses if pose["dt"] <= self._future_s]
        if not poses:
            return
        step = poses[1]["dt"] - poses[0]["dt"] if len(poses) > 1 else 0.0
        replaced_s = t_s + poses[0]["dt"] - max(MERGE_S, MERGE_SHARE * step)
        while self._cued and self._cued[-1][0] >= replaced_s:
            self._cued.pop()
        self._settle_cues(t_s - HISTORY_S)
        self._cued.extend((t_s + pose["dt"], pose) for pose in poses)

    def _settle_cues(self, until_s: float) -> None:
        """What was asked for before `until_s` is replaced no more."""
        while self._cued and self._cued[0][0] < until_s:
            t, pose = self._cued.popleft()
            for coordinate, value in pose.items():
                if coordinate != "dt":
                    self.signals.add(f"cue.{coordinate}", t, value)


def _oldest(actuators: dict[str, ActuatorState]) -> float:
    ages = [a.age_s for a in actuators.values() if a.age_s is not None]
    return max(ages, default=float("nan"))
