"""From records to the payloads that clients see; pure."""

from __future__ import annotations

import math

from hil.config import RigFile
from hil.daemon.records import ActuatorState, DriveRecord, SampleRecord, StateRecord
from hil.messages import ActuatorState as ActuatorMessage
from hil.messages import DriveMessage, DriveStatusMessage, StateMessage


def state_message(record: StateRecord, rig: RigFile) -> StateMessage:
    """The state as clients see it; what is not known is left out."""
    actuators = zip(rig.actuator_names, record.actuators, strict=False)
    return StateMessage(
        t=record.t_s,
        state=record.state,
        pose=_known(rig.coordinates, record.pose),
        setpoint=_known(rig.coordinates, record.setpoint),
        actuators={name: _actuator(state) for name, state in actuators},
        tracking_error=_or_zero(record.tracking_error),
        fault=record.fault,
        lateness_s=_or_zero(record.lateness_s),
        period_s=_or_zero(record.period_s),
        overruns=record.overruns,
        slot_use=record.pairs / record.slots if record.slots else 0.0,
        bus_load=_or_zero(record.bus_load),
    )


def drive_message(record: SampleRecord) -> DriveMessage:
    """One answer of a drive."""
    return DriveMessage(
        record.received_s, record.sampled_s, **{record.quantity: _or_none(record.value)}
    )


def status_message(record: DriveRecord) -> DriveStatusMessage:
    """A drive's status when it changed."""
    return DriveStatusMessage(record.t_s, record.phase, record.enabled, record.error)


class Decimator:
    """Lets through what comes at `rate_hz` or slower, and of anything faster that many a second."""

    def __init__(self, rate_hz: float) -> None:
        self._period_s = 1.0 / rate_hz
        self._due_s = -math.inf

    def lets(self, t_s: float) -> bool:
        """Whether the value of `t_s` is due. A quarter of a period early counts: clocks jitter."""
        early_s = self._due_s - t_s
        if 0.25 * self._period_s < early_s <= 2.0 * self._period_s:  # earlier: the clock was set
            return False
        is_on_time = abs(early_s) < self._period_s
        self._due_s = (self._due_s if is_on_time else t_s) + self._period_s
        return True


def _actuator(state: ActuatorState) -> ActuatorMessage:
    return ActuatorMessage(
        _or_none(state.position),
        _or_none(state.velocity),
        _or_none(state.force),
        _or_none(state.age_s),
    )


def _known(names: tuple[str, ...], values: tuple[float, ...]) -> dict[str, float]:
    pairs = zip(names, values, strict=False)
    return {name: value for name, value in pairs if math.isfinite(value)}


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _or_zero(value: float) -> float:
    return value if math.isfinite(value) else 0.0
