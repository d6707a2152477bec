"""The running whole: a control process that keeps time, and a gateway that talks to the world.

`hil.daemon.core` decides, `hil.daemon.gateway` speaks Zenoh and records; they exchange records.
"""
