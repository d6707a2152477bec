"""The pure core of the control process: frames, cues, commands and time in; frames and records out.

`RigCore` joins drivers, gate, rig states, shaping, observer and controller. It holds no socket, file or
clock, so that the daemon, the deterministic world and a replay run the very same code.
"""

from hil.daemon.core.rigcore import RigCore

__all__ = ["RigCore"]
