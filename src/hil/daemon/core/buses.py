"""Whether the buses take what is sent: frames refused, controllers that leave the bus and come back."""

from __future__ import annotations

from hil.bus.state import ERR_BUS_OFF, ERR_RESTARTED
from hil.frames import Frame

Said = tuple[str, str]
"""Name and sentence of an event."""


class Buses:
    """Of one rig. `busy_cycles`: in a row in which a frame was refused; `is_off`: a controller has left."""

    def __init__(self) -> None:
        self.busy_cycles = 0
        self.is_off = False
        self._is_again = False
        self._refused_now = False

    def refused(self, *, is_off: bool) -> None:
        """A frame was not taken; `is_off`: because the controller has left the bus."""
        self._refused_now = True
        if is_off:
            self.is_off, self._is_again = True, False

    def heard(self, frame: Frame) -> Said | None:
        """A frame was received; what there is to tell of the controllers."""
        if frame.is_error:
            if frame.can_id & ERR_BUS_OFF:
                self.is_off, self._is_again = True, False
                return "bus_off", "the CAN controller has left the bus"
            is_again = bool(frame.can_id & ERR_RESTARTED)
        else:  # a controller that is off hears nothing: it was restarted by hand
            is_again = self.is_off
        if not is_again or self._is_again:
            return None
        self._is_again = True
        return "bus_on", "the CAN controller is on the bus again"

    def begin_cycle(self) -> None:
        """A cycle begins: count what the one before it brought."""
        self.busy_cycles = self.busy_cycles + 1 if self._refused_now else 0
        self._refused_now = False

    def seen(self) -> None:
        """A cycle has been told that it was off: only now may it be on again."""
        if self._is_again:
            self.is_off = self._is_again = False
