"""A client of a daemon that is still starting."""

from __future__ import annotations

import time

from hil.client import RigClient
from hil.errors import RigNotReached


def connected(name: str, endpoint: str, patience_s: float) -> RigClient:
    """A client of the rig `name`; RigNotReached where nobody answers for `patience_s`."""
    deadline_s = time.monotonic() + patience_s
    while True:
        try:
            return RigClient(name, endpoint, name="benchmark").open()
        except RigNotReached:
            if time.monotonic() > deadline_s:
                raise
            time.sleep(0.2)
