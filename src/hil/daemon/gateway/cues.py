"""Lets cues in: well-formed ones, at a rate that control can take, each under its sender's name.

What a cue asks for is not judged here; limits, order and ownership are control's business.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from hil.daemon.zenoh_session import Arrival
from hil.errors import ProtocolError
from hil.messages import LARGEST_PAYLOAD, decode_cue
from hil.signals import Cue

RATE_HZ: Final = 1000.0
"""Cues a second that one client may send on the long run: ten a cycle of 10 ms."""
BURST: Final = 200.0
MOST_CLIENTS: Final = 16
"""Senders that are told apart; only the first of them within `FORGET_S` get in."""
FORGET_S: Final = 10.0


class CueInlet:
    """Decodes arrivals and bounds their rate; ProtocolError for what is refused."""

    def __init__(self, coordinates: Sequence[str]) -> None:
        self._coordinates = tuple(coordinates)
        self._budgets: dict[str, tuple[float, float]] = {}

    def accept(self, arrival: Arrival) -> Cue:
        """The cue in `arrival`; ProtocolError names what is wrong with it."""
        if arrival.payload is None:
            raise ProtocolError(f"cue: {arrival.size} bytes, at most {LARGEST_PAYLOAD} are read")
        self._spend(arrival.client, arrival.received_s)
        return decode_cue(arrival.payload, self._coordinates, arrival.client, arrival.received_s)

    def _spend(self, client: str, now_s: float) -> None:
        if client not in self._budgets and len(self._budgets) >= MOST_CLIENTS:
            self._budgets = {
                name: budget
                for name, budget in self._budgets.items()
                if now_s - budget[1] < FORGET_S
            }
            if len(self._budgets) >= MOST_CLIENTS:
                raise ProtocolError(f"cue: {MOST_CLIENTS} other clients send cues already")
        left, at_s = self._budgets.get(client, (BURST, now_s))
        left = min(BURST, left + (now_s - at_s) * RATE_HZ)
        is_granted = left >= 1.0
        self._budgets[client] = (left - is_granted, now_s)
        if not is_granted:
            raise ProtocolError(f"cue: more than {RATE_HZ:.0f} a second from one client")
