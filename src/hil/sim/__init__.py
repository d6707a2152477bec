"""The rig that is not there: plant, drive loops and effects in one compiled model, behind frames or alone.

`Plant` is driven by events in injected time and serves simulated drives; `Twin` replays recordings.
"""

from hil.sim.parameters import Parameter, ParameterTable
from hil.sim.plant import Plant
from hil.sim.twin import Payload, Replay, Twin

__all__ = ["Parameter", "ParameterTable", "Payload", "Plant", "Replay", "Twin"]
