"""Looking for a node that is not known yet: listen, then ask now and then, until it says anything."""

from __future__ import annotations

import math

from hil.drives.cia402.codec import NodeIds
from hil.drives.cia402.profile import Timing402
from hil.drives.cia402.sdo import Transfer
from hil.frames import Frame


class Search:
    """For one node. Any frame of its own is a sign of it."""

    def __init__(self, ids: NodeIds, timing: Timing402) -> None:
        self._question = Frame(ids.sdo_request, Transfer(0x1000, 0).request)
        self._timing = timing
        self._since_s: float | None = None
        self._asked_s = -math.inf
        self._is_heard = False

    def heard(self) -> None:
        """It has said something."""
        self._is_heard = True

    def found(self, now_s: float) -> bool:
        """Whether it has said anything since it was last found. Call once a slot."""
        if not self._is_heard or not self._has_listened(now_s):
            return False
        self._is_heard = False
        return True

    def ask(self, now_s: float) -> list[Frame]:
        """The question that every node answers, where one is due."""
        if not self._has_listened(now_s) or now_s - self._asked_s < self._timing.poll:
            return []
        self._asked_s = now_s
        return [self._question]

    def _has_listened(self, now_s: float) -> bool:
        if self._since_s is None:
            self._since_s = now_s
        return now_s - self._since_s >= self._timing.listen
