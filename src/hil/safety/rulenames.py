"""The names of the gate's rules, each with the sentence that documents it.

They appear in events, counters, metrics and docs/safety.md, so they are stable.
"""

from __future__ import annotations

from enum import Enum, unique


@unique
class Rule(Enum):
    """A rule of the gate; the value is its name, `meaning` what it asks."""

    meaning: str

    def __new__(cls, name: str, meaning: str) -> Rule:
        """A member whose value is its name alone."""
        member = object.__new__(cls)
        member._value_ = name
        member.meaning = meaning
        return member

    READ_ONLY = "read_only", "in read-only mode nothing is transmitted at all"
    FRAME_FORM = "frame_form", "no remote, extended or error frames"
    UNKNOWN_ID = "unknown_id", "only identifiers that the rig's drives listen to"
    LENGTH = "length", "each identifier has its one data length"
    UNKNOWN_MEANING = "unknown_meaning", "a frame must be understood in full"
    RATE = (
        "rate",
        "at most 21 frames of an identifier in 20 bus cycles, setpoints 1.25 cycles ahead of one a cycle",
    )
    DUPLICATE = "duplicate", "the same frame again within a quarter of a bus cycle"
    DISARMED = "disarmed", "power-on control words and setpoints only while armed"
    START_UNARMED = (
        "start_unarmed",
        "while disarmed, System Start only after every drive has been told to be off",
    )
    RESET_ARMED = "reset_armed", "no error reset while armed: a fault is reset by a person"
    NETWORK_ARMED = "network_armed", "no drive is started, stopped or reset as a node while armed"
    WRITE_PARAMETER = (
        "write_parameter",
        "only parameters that the drive's own profile declares writable",
    )
    WRITE_POWERED = "write_powered", "no parameter is written while any drive is powered"
    SETPOINT_KIND = "setpoint_kind", "setpoints are of the kind that the control mode sends"
    NOT_MEASURED = (
        "not_measured",
        "setpoints only with a measured position not older than answer_timeout",
    )
    STROKE = "stroke", "position setpoints inside the stroke less stroke_margin at each end"
    FOLLOWING = "following", "position setpoints within following_error of the measured position"
    SPEED = (
        "speed",
        "change of setpoint over one bus cycle, or speed setpoint, at most 1.05 velocity_max",
    )
    ACCELERATION = (
        "acceleration",
        "change of setpoint speed over one bus cycle at most 1.05 acceleration_max",
    )
    FORCE = "force", "force setpoints within force_max"
