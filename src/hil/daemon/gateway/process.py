"""Starts the gateway as a process of its own, and is that process (`python -m hil.daemon.gateway.process`).

The parent hands over one end of the socket pair as an inherited descriptor and the rig on standard input.
"""

from __future__ import annotations

import logging
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec

from hil.config import RigFile
from hil.configfile import parse_settings
from hil.daemon.gateway.options import GatewayOptions
from hil.daemon.log import Log
from hil.daemon.realtime import request_precedence
from hil.errors import HilError


def start_gateway(
    rig: RigFile, rig_text: str, sock: socket.socket, options: GatewayOptions
) -> subprocess.Popen[bytes]:
    """Start the gateway with its end of the socket pair; the caller's copy is closed."""
    folder = options.runs_folder
    handed: dict[str, Any] = {
        "rig": rig.model_dump(mode="json"),
        "text": rig_text,
        "options": {
            "is_recording": options.is_recording,
            "runs_folder": None if folder is None else str(folder),
            "metrics_port": options.metrics_port,
            "command_timeout_s": options.command_timeout_s,
        },
    }
    # The rest of the line is for whoever reads `ps` or the recording's provenance.
    command = [sys.executable, "-m", "hil.daemon.gateway.process", str(sock.fileno()), *sys.argv]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, pass_fds=(sock.fileno(),))
    assert process.stdin is not None
    process.stdin.write(msgspec.json.encode(handed))
    process.stdin.close()
    sock.close()
    return process


def main() -> int:
    """Be the gateway; exit code 2 and one sentence where it cannot start."""
    from hil.daemon.gateway.gateway import run_gateway  # not in the process that starts it

    request_precedence()
    handed = msgspec.json.decode(sys.stdin.buffer.read())
    options = handed["options"]
    if options["runs_folder"] is not None:
        options["runs_folder"] = Path(options["runs_folder"])
    rig = parse_settings(handed["rig"], RigFile, "rig handed to the gateway")
    sock = socket.socket(fileno=int(sys.argv[1]))
    log = Log(rig.name)
    logging.basicConfig(stream=log)  # what asyncio complains of may not block either
    try:
        return run_gateway(rig, handed["text"], sock, log, GatewayOptions(**options))
    except HilError as error:
        log.write(f"{error}\n")
        return 2
    finally:
        log.close()


if __name__ == "__main__":
    sys.exit(main())
