"""The reset of a drive's fault: a rising edge of the reset bit, and a status from after it."""

from __future__ import annotations

from hil.drives.power import PowerCommand


class FaultReset:
    """A reset under way since `since_s`: the bit low for `hold_s`, then high, and again.

    So it has an edge whatever the bit was before.
    """

    def __init__(self, since_s: float, hold_s: float) -> None:
        self._since_s, self._hold_s = since_s, hold_s
        self._edge_s: float | None = None

    def command(self, now_s: float) -> PowerCommand:
        """The command of this slot."""
        if (now_s - self._since_s) % (2.0 * self._hold_s) < self._hold_s:
            return PowerCommand.DISABLE
        if self._edge_s is None:
            self._edge_s = now_s
        return PowerCommand.RESET

    def is_answered(self, status_s: float) -> bool:
        """Whether a status received at `status_s` was sent after the first edge."""
        return self._edge_s is not None and status_s > self._edge_s
