"""What the gateway process is told at its start. By itself, so that control need not load the gateway:
that takes seconds (Zenoh, pandas, Arrow), at every start, and memory that would be locked.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class GatewayOptions:
    """What is decided at start and not in the rig file."""

    is_recording: bool = True
    """Record from the start; the command `record` switches it later."""
    runs_folder: Path | None = None
    """Where run folders are made; None: as the rig file says."""
    metrics_port: int | None = None
    """Port on loopback for Prometheus; None: not served, 0: any free one."""
    command_timeout_s: float = 5.0
