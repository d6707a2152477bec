"""What a check of an imported log found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Verdict = Literal["ok", "note", "warning", "fault"]


@dataclass(frozen=True, slots=True)
class Finding:
    """One check. fault: no run is made of it unless the map allows it; note: said, and that is all."""

    check: str
    """Stable name: duplicate_stamps, nan_block, clipping ..."""
    subject: str
    """The clock or signal."""
    verdict: Verdict
    text: str
    """A sentence; in faults and warnings it says what to do."""
