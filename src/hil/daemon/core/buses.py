"""Whether the buses take what is sent: frames refused, controllers that leave the bus and come back."""

from __future__ import annotations

from hil.bus.state import ERR_BUS_OFF, ERR_RESTARTED
from hil.frames import Frame

Said = tuple[str, str]
"""Name and sentence of an event."""


class Buses:
    """Of one rig. `busy_cycles`: in a row in which a frame was refused."""

    def __init__(self) -> None:
        self.busy_cycles = 0
        self._off: set[int] = set()
        self._again: set[int] = set()
        self._refused_now = False

    @property
    def is_off(self) -> bool:
        """Whether a controller has left its bus."""
        return bool(self._off)

    def refused(self, bus: int, *, is_off: bool) -> None:
        """A frame was not taken; `is_off`: because the controller has left the bus."""
        self._refused_now = True
        if is_off:
            self._left(bus)

    def heard(self, frame: Frame) -> Said | None:
        """A frame was received; what there is to tell of the controller of its bus."""
        bus = frame.bus
        if frame.is_error:
            if frame.can_id & ERR_BUS_OFF:
                self._left(bus)
                return "bus_off", f"the CAN controller of bus {bus} has left it"
            is_again = bool(frame.can_id & ERR_RESTARTED)
        else:  # a controller that is off hears nothing: it was restarted by hand
            is_again = bus in self._off
        if not is_again or bus in self._again:
            return None
        self._again.add(bus)
        return "bus_on", f"the CAN controller of bus {bus} is on it again"

    def begin_cycle(self) -> None:
        """A cycle begins: count what the one before it brought."""
        self.busy_cycles = self.busy_cycles + 1 if self._refused_now else 0
        self._refused_now = False

    def seen(self) -> None:
        """A cycle has been told which were off: only now may they be on again."""
        if self._again:
            self._off -= self._again
            self._again.clear()

    def _left(self, bus: int) -> None:
        self._off.add(bus)
        self._again.discard(bus)
