"""How frames travel: ports on SocketCAN, on the hub and on any python-can interface, and the
bus itself in injected time (`BitBus`). Every port is one non-blocking descriptor that yields
16-byte `struct can_frame` records (`open_port`)."""

from hil.bus.bitbus import BitBus, Delivery
from hil.bus.port import BusPort, BusState, open_port
from hil.bus.timerfd import Timer

__all__ = ["BitBus", "BusPort", "BusState", "Delivery", "Timer", "open_port"]
