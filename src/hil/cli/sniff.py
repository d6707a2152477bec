"""`hil sniff`: what is said on a bus, in words; a process that cannot say anything itself."""

from __future__ import annotations

import contextlib
import select
import time
from pathlib import Path
from typing import Annotated, Any

import cantools
import msgspec
import typer
from rich.table import Table

from hil.bus.port import BusPort, open_port
from hil.bus.socketcan import IdFilter, parse_filters
from hil.bus.statistics import BusStatistics
from hil.cli.console import err, out
from hil.cli.options import profiles_of
from hil.config import RigFile
from hil.configfile import load_rig
from hil.drives.describe import Described
from hil.drives.describe_rig import RigDescriber
from hil.errors import ConfigError
from hil.frames import Frame

_SCHEMES = ("socketcan:", "hub:", "python-can:")


def sniff(
    bus: Annotated[
        str,
        typer.Argument(
            metavar="BUS|RIG",
            help="socketcan:can0, hub:SOCKET_PATH, python-can:INTERFACE:CHANNEL, or a rig file for its bus.",
            show_default=False,
        ),
    ],
    rig: Annotated[
        str | None, typer.Option("--rig", help="Rig file that explains the frames.")
    ] = None,
    dbc: Annotated[
        Path | None,
        typer.Option("--dbc", help="DBC file for frames that the rig does not explain."),
    ] = None,
    filters: Annotated[
        str, typer.Option("--filter", help="Only these identifiers, as candump: 371:7ff,520:7f0.")
    ] = "",
    only: Annotated[
        list[str] | None,
        typer.Option(
            "--only", help="Only frames of this actuator, or of this kind: status, imu ..."
        ),
    ] = None,
    seconds: Annotated[float, typer.Option(help="End after so long; 0: at Ctrl-C.", min=0.0)] = 0.0,
    count: Annotated[int, typer.Option(help="End after so many frames; 0: at Ctrl-C.", min=0)] = 0,
    bitrate: Annotated[
        int | None, typer.Option(help="Bit rate, bit/s, where no rig file tells it.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="One JSON object a line.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Only the statistics.")] = False,
) -> None:
    """Show what is said on a bus, decoded, with statistics at the end. Cannot transmit: the kernel refuses.

    Runs beside a daemon and disturbs nobody.
    """
    is_url = bus.startswith(_SCHEMES)
    name = rig if is_url else (rig or bus)
    settings = None if name is None else load_rig(name)
    can = None if is_url else load_rig(bus).can
    url = bus if can is None else can.url
    if can is not None and len(can.urls) > 1:
        others = ", ".join(can.urls[1:])
        err.print(
            f"Listening to {url} alone. {bus} has {others} as well: hil sniff URL --rig {name}"
        )
    rate = bitrate or _bitrate_of(url, settings)
    sniffer = Sniffer(
        Explainer(settings, dbc), BusStatistics(rate), parse_filters(filters) if filters else ()
    )
    sniffer.only = frozenset(only or ())
    sniffer.show = None if quiet else (_json_line if json else _text_line)
    port = open_port(url, bitrate_bps=rate, read_only=True)
    try:
        with contextlib.suppress(KeyboardInterrupt):
            sniffer.listen(port, seconds or float("inf"), count or float("inf"))
    finally:
        port.close()
        if sniffer.only and not sniffer.shown:
            heard = ", ".join(sorted(sniffer.heard)) or "nothing that has a name"
            err.print(f"No frame of {', '.join(sorted(sniffer.only))} was heard, but {heard}.")
        (_json_statistics if json else _show_statistics)(sniffer)


def _bitrate_of(url: str, rig: RigFile | None) -> int:
    """Bit rate of the rig's bus at `url`, bit/s; of its first where none is there."""
    if rig is None:
        return 500_000
    return dict(zip(rig.can.urls, rig.can.bitrates, strict=True)).get(url, rig.can.bitrate)


class Explainer:
    """Words for frames: the rig's own, else those of a DBC file."""

    def __init__(self, rig: RigFile | None, dbc: Path | None) -> None:
        self._describer = None
        if rig is not None:
            self._describer = RigDescriber(rig, profiles_of(rig))
        self._database = None
        if dbc is not None:
            try:
                self._database = cantools.database.load_file(dbc)
            except (OSError, cantools.database.UnsupportedDatabaseFormatError) as error:
                raise ConfigError(f"{dbc}: cannot be read as a DBC file: {error}") from error

    def explain(self, frame: Frame) -> Described:
        """What `frame` says."""
        said = Described("", "unknown", "")
        if self._describer is not None:
            said = self._describer.describe(frame)
        if said.name == "unknown" and self._database is not None and not frame.is_error:
            return self._by_dbc(frame) or said
        return said

    def _by_dbc(self, frame: Frame) -> Described | None:
        assert self._database is not None
        try:
            message = self._database.get_message_by_frame_id(frame.can_id)
            if message.is_extended_frame != frame.is_extended:
                return None
            values = message.decode(frame.data, decode_choices=False)
        except (KeyError, cantools.database.DecodeError, ValueError):
            return None
        text = ", ".join(f"{signal} {value:g}" for signal, value in values.items())
        return Described("", message.name, text, values)


class Sniffer:
    """Listens to one port, counts everything and shows what passes its filters."""

    def __init__(
        self, explainer: Explainer, statistics: BusStatistics, filters: tuple[IdFilter, ...]
    ) -> None:
        self.explainer = explainer
        self.statistics = statistics
        self.only: frozenset[str] = frozenset()
        self.show: Any = None
        self.heard: set[str] = set()
        """Whose frames, and of what kinds, came by."""
        self.shown = 0
        self._filters = filters

    def listen(self, port: BusPort, for_s: float, count: float) -> None:
        """Until time or count have run out; BusError if the bus is lost."""
        start_s = time.monotonic()
        while self.shown < count and (left_s := start_s + for_s - time.monotonic()) > 0.0:
            select.select([port], [], [], min(left_s, 1.0))
            for t_s, frame in port.receive():
                self.statistics.add(t_s, frame)
                if self._passes(frame) and self.shown < count:
                    self._tell(t_s - start_s, frame)

    def _passes(self, frame: Frame) -> bool:
        return not self._filters or any(
            frame.can_id & f.mask == f.can_id & f.mask for f in self._filters
        )

    def _tell(self, t_s: float, frame: Frame) -> None:
        said = self.explainer.explain(frame)
        self.heard.update(filter(None, (said.source, said.name)))
        if self.only and not self.only & {said.source, said.name}:
            return
        self.shown += 1
        if self.show is not None:
            self.show(t_s, frame, said)


def _text_line(t_s: float, frame: Frame, said: Described) -> None:
    words = " ".join(filter(None, (said.source, said.name)))
    typer.echo(f"{t_s:12.6f}  {frame!s:<21} {words:<16} {said.text}")


def _json_line(t_s: float, frame: Frame, said: Described) -> None:
    entry: dict[str, Any] = {
        "t": round(t_s, 6),
        "id": frame.can_id,
        "data": frame.data.hex(),
        "source": said.source,
        "name": said.name,
        "text": said.text,
        "values": said.values,
    }
    flags = {"extended": frame.is_extended, "remote": frame.is_remote, "error": frame.is_error}
    entry.update((name, True) for name, is_set in flags.items() if is_set)
    typer.echo(msgspec.json.encode(entry).decode())


def _json_statistics(sniffer: Sniffer) -> None:
    statistics = sniffer.statistics
    ids = [
        {
            "id": item.can_id,
            "extended": item.is_extended,
            "frames": item.count,
            "rate_hz": item.rate_hz,
            "longest_gap_s": item.longest_gap_s,
        }
        for item in statistics.ids()
    ]
    summary = {
        "frames": statistics.frames,
        "errors": statistics.errors,
        "seconds": statistics.duration_s,
        "load": statistics.load,
        "ids": ids,
    }
    typer.echo(msgspec.json.encode({"summary": summary}).decode())


def _show_statistics(sniffer: Sniffer) -> None:
    statistics = sniffer.statistics
    table = Table("id", "whose", "frames", "rate", "longest gap")
    for item in statistics.ids():
        said = sniffer.explainer.explain(Frame(item.can_id, bytes(8), item.is_extended))
        table.add_row(
            f"{item.can_id:0{8 if item.is_extended else 3}X}",
            " ".join(filter(None, (said.source, said.name))),
            str(item.count),
            f"{item.rate_hz:.1f} Hz",
            f"{item.longest_gap_s * 1e3:.1f} ms",
        )
    (out if out.is_terminal else err).print(table)
    out.print(
        f"{statistics.frames} frames in {statistics.duration_s:.1f} s, {statistics.errors} error frames, "
        f"bus load {statistics.load:.0%} at most",
        soft_wrap=True,
    )
