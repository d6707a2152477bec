"""A client of a running rig in a few lines, over Zenoh: cues out, states and events in, commands.

    with RigClient("motorcycle") as rig:
        rig.command("arm")
        for state in rig.states():
            rig.cue(roll=0.05 * math.sin(state.t))

The same over `async with` and `async for`. What goes over the wire is described in docs/zenoh.md;
any Zenoh client in any language can do the same.
"""

from hil.client.feed import Feed
from hil.client.rig import ENDPOINT, RigClient
from hil.client.session import reason, zenoh_config

__all__ = ["ENDPOINT", "Feed", "RigClient", "reason", "zenoh_config"]
