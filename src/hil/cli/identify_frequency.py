"""`hil identify frf`, `agard`, `agard-steps`: how a rig answers frequency by frequency, and how cleanly."""

from __future__ import annotations

import cmath
import math
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from hil.cli.console import JsonFlag, out, write_json
from hil.cli.outputs import make_ready
from hil.configfile import load_rig
from hil.effectlines import checked
from hil.identify.frequency.agard import AgardAnalysis, agard
from hil.identify.frequency.agard_steps import acceleration_steps
from hil.identify.frequency.frf import FrfAnalysis, analyse
from hil.identify.frequency.results import agard_json, frf_json
from hil.runs import load_run
from hil.runs.cuefile import write_cue_file
from hil.ui.agard_report import agard_page
from hil.ui.frequency_report import frf_page

RunsArgument = Annotated[
    list[Path],
    typer.Argument(metavar="RUN...", help="Run folders or .mcap files of one experiment."),
]
RigOption = Annotated[str, typer.Option("--rig", help="Rig file of the rig that ran, or its name.")]
ReportOption = Annotated[
    Path | None, typer.Option("--report", metavar="OUT.html", help="Write a page with plots.")
]


class Method(StrEnum):
    """How records are treated."""

    auto = "auto"
    periodic = "periodic"
    local = "local"


def frf(
    runs: RunsArgument,
    rig: RigOption,
    input_name: Annotated[
        str | None,
        typer.Option(
            "--input", help="cue.heave, leg1.setpoint ...; default: the cue that moves most."
        ),
    ] = None,
    output_name: Annotated[
        str | None,
        typer.Option(
            "--output",
            help="heave (measured pose), leg1.position, imu.accel_z ...; default: the cue's coordinate.",
        ),
    ] = None,
    period: Annotated[
        float | None,
        typer.Option("--period", help="Period of the cue, s; default: found.", min=0.0),
    ] = None,
    highest: Annotated[
        float | None,
        typer.Option("--highest", help="Highest line, Hz; default: what sampling allows."),
    ] = None,
    method: Annotated[
        Method,
        typer.Option(
            "--method",
            help="periodic: multisines; local: local polynomial method for any other motion.",
        ),
    ] = Method.auto,
    json: JsonFlag = False,
    report: ReportOption = None,
) -> None:
    """Frequency response with uncertainty, nonlinear distortion, and a model with delay.

    Several runs are realisations of one multisine with other phases: nonlinearity is then told from noise.
    """
    make_ready(report)
    rig_file = checked(load_rig(rig), rig)
    analysis = analyse(
        [load_run(run, rig_file) for run in runs],
        rig_file,
        input_name=input_name,
        output_name=output_name,
        period_s=period,
        highest_hz=highest,
        method=method.value,
    )
    if report is not None:
        frf_page(analysis, report)
    if json:
        write_json(frf_json(analysis))
    else:
        _show_frf(analysis)
        _say_report(report)


def agard_command(
    rig: RigOption,
    runs: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[RUN...]", help="Runs of sinusoids or acceleration steps."),
    ] = None,
    json: JsonFlag = False,
    report: ReportOption = None,
) -> None:
    """Measures of AGARD Advisory Report 144: excursion limits, noise, hysteresis, dynamic threshold.

    Each run is a sinusoid (hil experiment RIG heave) or steps of acceleration (hil identify agard-steps) of
    one coordinate. Without runs: the rig's excursion limits.
    """
    make_ready(report)
    rig_file = checked(load_rig(rig), rig)
    analysis = agard([load_run(run, rig_file) for run in runs or []], rig_file)
    if report is not None:
        agard_page(analysis, report)
    if json:
        write_json(agard_json(analysis))
    else:
        _show_agard(analysis)
        _say_report(report)


def agard_steps(
    rig: Annotated[str, typer.Argument(metavar="RIG", help="Rig file, or its name.")],
    file: Annotated[Path, typer.Argument(metavar="OUT.csv", help="The cue file to write.")],
    coordinate: Annotated[str, typer.Option("--coordinate", help="Which one moves.")] = "heave",
    sizes: Annotated[
        str, typer.Option("--sizes", help="Accelerations, m/s² or rad/s², with commas.")
    ] = "0.1,0.2,0.5,1.0",
    repeats: Annotated[int, typer.Option("--repeats", min=2, max=100)] = 4,
) -> None:
    """Write the motion for the dynamic threshold; play it with `hil experiment RIG custom --file OUT.csv`."""
    rig_file = checked(load_rig(rig), rig)
    if coordinate not in rig_file.coordinates:
        raise typer.BadParameter(f"{rig_file.name} has {', '.join(rig_file.coordinates)}")
    try:
        values = tuple(float(x) for x in sizes.split(","))
    except ValueError as error:
        raise typer.BadParameter(f"sizes are numbers with commas between them: {error}") from error
    motion = acceleration_steps(rig_file, coordinate, values, repeats)
    note = f"acceleration steps of {coordinate}: {sizes}, {repeats} of each"
    write_cue_file(file, motion, rig_file.name, [note])
    out.print(f"{file}: {motion.duration_s:.1f} s", soft_wrap=True)


def _say_report(report: Path | None) -> None:
    if report is not None:
        out.print(str(report), soft_wrap=True)


def _show_frf(a: FrfAnalysis) -> None:
    r = a.response
    kind = (
        f"period {a.period_s:g} s, {len(a.periods)} realisation{'s' * (len(a.periods) != 1)} of "
        f"{', '.join(map(str, a.periods))} periods"
        if a.period_s
        else "not periodic: local polynomial method"
    )
    out.print(f"{r.input_name} → {r.output_name}, {r.unit}; {kind}", soft_wrap=True)
    table = Table("Hz", "gain, dB", "±95 %", "phase, deg", "±95 %", "coherence")
    low, high = r.gain_band_db
    left, right = r.phase_band_deg
    step = max(1, len(r.hz) // 40)
    for k in range(0, len(r.hz), step):
        table.add_row(
            f"{r.hz[k]:.3g}",
            f"{r.gain_db[k]:.2f}",
            f"{0.5 * (high[k] - low[k]):.2f}",
            f"{r.phase_deg[k]:.1f}",
            f"{0.5 * (right[k] - left[k]):.1f}",
            f"{r.coherence[k]:.4f}",
        )
    out.print(table)
    _show_fits(a)
    d = a.distortion
    if d is not None:
        scale = float((d.linear**2).mean() ** 0.5)
        for left_out in d.lines:
            said = (
                f"{left_out.distortion:.3g} {d.unit} a line "
                f"({left_out.distortion / scale:.2%} of the linear answer)"
                if left_out.is_seen
                else f"not seen above {left_out.floor:.3g} {d.unit} a line"
            )
            out.print(f"{left_out.kind} distortion: {said}", soft_wrap=True)
    for note in a.notes:
        out.print(f"note: {note}", soft_wrap=True)


def _show_fits(a: FrfAnalysis) -> None:
    if not a.fits:
        return
    table = Table("model", "f, Hz", "damping", "delay, ms", "slow lag, ms", "misfit")
    for name, fit in a.fits.items():
        cells = []
        for parameter, scale in (("frequency", 1.0), ("damping", 1.0), ("delay", 1e3)):
            e = fit.parameters[parameter]
            half = 0.5 * (e.interval[1] - e.interval[0])
            cells.append(f"{scale * e.value:.3g} ± {scale * half:.2g}" if e.is_told else "not told")
        table.add_row(name, *cells, f"{1e3 * fit.low_frequency_delay_s:.1f}", f"{fit.misfit:.1f}")
    out.print(table)


def _show_agard(a: AgardAnalysis) -> None:
    table = Table("coordinate", "travel", "speed", "acceleration", "operational")
    for e in a.excursions:
        table.add_row(
            e.coordinate,
            f"{e.low:.3f} .. {e.high:.3f} {e.unit}",
            f"{e.velocity:.2f} {e.unit}/s",
            f"{e.acceleration:.1f} {e.unit}/s²",
            f"±{e.operational:g} {e.unit}, {e.operational_velocity:g} {e.unit}/s, "
            f"{e.operational_acceleration:g} {e.unit}/s²",
        )
    out.print(table)
    if a.sines:
        table = Table(
            "coordinate", "Hz", "commanded", "gain", "phase", "noise", "bump", "hysteresis"
        )
        for s in a.sines:
            table.add_row(
                s.coordinate,
                f"{s.hz:.3g}",
                f"{s.commanded:.3g} {s.unit}",
                f"{abs(s.describing):.3f}",
                f"{math.degrees(cmath.phase(s.describing)):.1f}°",
                f"{s.noise_ratio:.1%}",
                f"{s.reversal_bump:.2g}",
                f"{s.hysteresis:.1e}",
            )
        out.print(table)
    if a.thresholds:
        table = Table("coordinate", "step", "time to 63 %", "steps")
        for t in a.thresholds:
            table.add_row(
                t.coordinate,
                f"{t.size:.3g} {t.unit}",
                f"{1e3 * t.time_s:.1f} ± {1e3 * t.std_s:.1f} ms",
                str(t.steps),
            )
        out.print(table)
    for note in a.notes:
        out.print(f"note: {note}", soft_wrap=True)
