"""The seam between whoever speaks on the bus and what carries it: `BusPort` and `open_port`."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol
from urllib.parse import parse_qsl

from hil.bus.hub.client import open_hub
from hil.bus.socketcan import open_socketcan, parse_filters
from hil.bus.state import BusState, PortCounters
from hil.errors import BusError
from hil.frames import Frame, StampedFrame

__all__ = ["BusPort", "BusState", "PortCounters", "open_port"]


class BusPort(Protocol):
    """A node's access to a bus. Never blocks; `fileno()` is readable when frames wait."""

    name: str
    """Its URL, by which messages name it."""
    read_only: bool
    counters: PortCounters
    state: BusState
    """Of the controller, as its error frames told it (they are among the frames received)."""

    def fileno(self) -> int:
        """The descriptor for `add_reader`; -1 once closed."""

    def receive(self) -> list[StampedFrame]:
        """What has arrived, oldest first, stamped on CLOCK_MONOTONIC; BusError: the bus is lost."""

    def send(self, frame: Frame) -> None:
        """Give a frame to the bus; BusBusy, BusOff or BusError (not sent then)."""

    def close(self) -> None:
        """Leave the bus; closing twice is no error."""


def open_port(url: str, *, bitrate_bps: int, read_only: bool = False) -> BusPort:
    """The port that `url` names; BusError if there is no such bus, with what to do.

    - `socketcan:can0`, or `socketcan:can0?filter=371:7ff,520:7f0` to receive only some identifiers
      (candump's notation). The bit rate is the interface's own.
    - `hub:/path/to.sock`, or `hub:/path/to.sock?node=control` for a name in fault scripts. The
      bit rate is the hub's.
    - `python-can:INTERFACE:CHANNEL`, at `bitrate_bps` bit/s.

    A `read_only` port cannot transmit, neither by `send` nor by writing to its descriptor.
    """
    scheme, _, rest = url.partition(":")
    if scheme == "python-can" and rest:
        from hil.bus.pythoncan import open_python_can  # 0.2 s, needed by few

        interface, _, channel = rest.partition(":")
        return open_python_can(interface, channel, bitrate_bps=bitrate_bps, read_only=read_only)
    target, _, query = rest.partition("?")
    if scheme == "hub" and target:
        options = _options(url, query, "node")
        return open_hub(Path(target), node=options.get("node"), read_only=read_only)
    if scheme == "socketcan" and target:
        options = _options(url, query, "filter")
        filters = parse_filters(options["filter"]) if "filter" in options else ()
        return open_socketcan(target, read_only=read_only, filters=filters)
    raise BusError(
        f"{url!r} names no bus; write socketcan:INTERFACE, hub:SOCKET_PATH or "
        "python-can:INTERFACE:CHANNEL"
    )


def _options(url: str, query: str, known: str) -> dict[str, str]:
    options = dict(parse_qsl(query, keep_blank_values=True))
    if unknown := sorted(options.keys() - {known}):
        raise BusError(f"{url}: {unknown[0]!r} is no option of such a port, only {known!r} is")
    return options
