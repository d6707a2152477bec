"""A read or write of one object or parameter of a drive, asked for by a person while the drive is run.

A driver puts it between its own requests on the one channel there is to its drive.
"""

from __future__ import annotations


class Enquiry:
    """Object `number` (as `Meaning.parameter`); `data` None reads. Once `is_done`: `result` or `error`.

    Whoever asks may give up by `failed`: a driver then withdraws it, and a write that has not gone out yet
    never does.
    """

    def __init__(self, number: int, data: bytes | None = None) -> None:
        self.number, self.data = number, data
        self.result = b""
        self.error: str | None = None
        self.is_done = False

    def answered(self, result: bytes) -> None:
        """The drive has answered; a write was taken."""
        self.result, self.is_done = result, True

    def failed(self, error: str) -> None:
        """It was refused, or nothing came."""
        self.error, self.is_done = error, True
