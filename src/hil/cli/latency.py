"""`hil latency`: how late this PC wakes a loop like the daemon's."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from hil.cli.console import JsonFlag, err, out, write_json
from hil.cli.outputs import make_ready
from hil.configfile import load_rig
from hil.daemon.latency import BANDS_US, Latency, measure_latency
from hil.ui.latency_report import BAND_NAMES, figures, latency_report

_BAR = 40


def latency(
    rig: Annotated[
        str | None, typer.Argument(metavar="[RIG]", help="A rig file, for its cycle and bit rate.")
    ] = None,
    seconds: Annotated[
        float, typer.Option(help="How long to measure.", min=0.1, max=86400.0)
    ] = 10.0,
    cycle: Annotated[
        float | None,
        typer.Option(help="Period of the loop, s; 0.01 without a rig.", min=1e-4, max=1.0),
    ] = None,
    can: Annotated[
        str | None,
        typer.Option(
            "--can",
            help="Also measure round trips on this bus: sends frames of the lowest priority. Not in motion.",
        ),
    ] = None,
    html: Annotated[Path | None, typer.Option("--html", help="Write the picture here.")] = None,
    json: JsonFlag = False,
) -> None:
    """Measure how late a loop like the daemon's wakes on this PC, beside the limits that matter.

    Real-time rights are asked for as the daemon does; what was granted is said. Measure under the load
    that the PC will have. Exit code 1 if cycles were missed.
    """
    make_ready(html)
    settings = load_rig(rig) if rig is not None else None
    cycle_s = cycle or (settings.bus.cycle if settings else 0.01)
    bitrate = settings.can.bitrate if settings else 500_000
    with err.status(f"measuring for {seconds:g} s"):
        measured = measure_latency(cycle_s, seconds, can, bitrate)
    if html is not None:
        latency_report(measured, html)
    if json:
        write_json(_as_json(measured))
    else:
        _show(measured, html)
    if measured.overruns:
        raise typer.Exit(1)


def _show(measured: Latency, html: Path | None) -> None:
    for right in measured.rights:
        out.print(right, soft_wrap=True)
    out.print(f"load {measured.load:.2f} a processor")
    _line("loop", f"every {measured.cycle_s * 1e3:g} ms", measured.late_us)
    if measured.round_trip_us.size:
        _line("bus", "round trip", measured.round_trip_us)
    out.print(f"{measured.overruns} of {measured.late_us.size + measured.overruns} cycles missed")
    limits = (*(f"up to {band:g} µs" for band in BANDS_US), f"over {BANDS_US[-1]:g} µs")
    for limit, name, share in zip(limits, BAND_NAMES, measured.shares(), strict=True):
        bar = "█" * round(_BAR * share)
        out.print(f"{limit:<13} {name:<20} {share:8.2%} {bar}", soft_wrap=True)
    if html is not None:
        out.print(f"picture  {html}", soft_wrap=True)


def _line(what: str, how: str, values_us: Any) -> None:
    p50, p99, highest = figures(values_us)
    out.print(
        f"{what:<5} {how}: median {p50:.0f} µs, 99 % {p99:.0f} µs, worst {highest:.0f} µs "
        f"({values_us.size} times)",
        soft_wrap=True,
    )


def _as_json(measured: Latency) -> dict[str, Any]:
    def shown(values_us: Any) -> dict[str, float] | None:
        if not values_us.size:
            return None
        p50, p99, highest = figures(values_us)
        return {"count": values_us.size, "p50_us": p50, "p99_us": p99, "max_us": highest}

    return {
        "cycle": measured.cycle_s,
        "lateness": shown(measured.late_us),
        "overruns": measured.overruns,
        "shares": dict(zip(BAND_NAMES, measured.shares(), strict=True)),
        "round_trip": shown(measured.round_trip_us),
        "rights": measured.rights,
        "load": measured.load,
    }
