"""How hil opens Zenoh: to the endpoints named and to nobody else, and what Zenoh says where it cannot."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import zenoh

from hil.errors import ConfigError


def zenoh_config(
    mode: str,
    listen: Sequence[str] = (),
    connect: Sequence[str] = (),
    file: str | Path | None = None,
    connect_timeout_s: float = 3.0,
) -> zenoh.Config:
    """A Zenoh configuration that scouts nobody: only the endpoints named are opened or called.

    `file` is a Zenoh JSON5 file to start from (TLS, access control). Endpoints in it stand where
    none are given here. ConfigError if the file cannot be read.
    """
    try:
        config = zenoh.Config() if file is None else zenoh.Config.from_file(Path(file))
    except zenoh.ZError as error:
        raise ConfigError(f"{file}: cannot be read as a Zenoh file: {reason(error)}") from error
    settings: dict[str, Any] = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "connect/timeout_ms": round(1000 * connect_timeout_s),
    }
    if listen or file is None:
        settings["listen/endpoints"] = list(listen)
    if connect:
        settings["connect/endpoints"] = list(connect)
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def reason(error: zenoh.ZError) -> str:
    """What Zenoh complains of, without the place in its sources."""
    return str(error).partition(" at /")[0].removesuffix(".")
