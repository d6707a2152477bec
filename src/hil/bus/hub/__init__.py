"""A CAN bus where the kernel has none: a small server that fans `struct can_frame` records out
between its clients, with the bit time, arbitration and scripted faults of `BitBus`. `Hub` is the
server (also `python -m hil.bus.hub PATH`), `open_hub` a client's port."""

from hil.bus.hub.client import open_hub
from hil.bus.hub.server import ClientCounters, Hub

__all__ = ["ClientCounters", "Hub", "open_hub"]
