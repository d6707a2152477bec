"""What must never happen: the gate that every outgoing frame passes, the rig's states and its reactions.

Pure: time and measurements are handed in. What is a safety function and what is not: docs/safety.md.
"""

from hil.safety.conditions import Command, Request, RigInputs, StateSettings, state_settings
from hil.safety.gate import Gate, Verdict
from hil.safety.monitor import Monitor
from hil.safety.reactions import REACTIONS, Cause, Finding, Reaction, finding_of
from hil.safety.rigstate import MotionGoal, RigState, StateName
from hil.safety.rulenames import Rule
from hil.safety.rules import GateLimits, gate_limits
from hil.safety.states import RigOutputs, RigStateMachine

__all__ = [
    "REACTIONS",
    "Cause",
    "Command",
    "Finding",
    "Gate",
    "GateLimits",
    "Monitor",
    "MotionGoal",
    "Reaction",
    "Request",
    "RigInputs",
    "RigOutputs",
    "RigState",
    "RigStateMachine",
    "Rule",
    "StateName",
    "StateSettings",
    "Verdict",
    "finding_of",
    "gate_limits",
    "state_settings",
]
