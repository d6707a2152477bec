"""`hil bicycle`: an instrumented bicycle, ridden, recorded and understood."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Column, Table

from hil.bicycle.analysis import Analysis, analyse
from hil.bicycle.manoeuvres import MANOEUVRES, manoeuvre
from hil.bicycle.recorded import Ride, prepare
from hil.bicycle.simulated import save
from hil.cli.bicycle_record import (
    calibrate_command,
    nodes_command,
    press_command,
    record_command,
)
from hil.cli.bicycle_weave import weave_command
from hil.cli.console import JsonFlag, err, out, write_json
from hil.cli.outputs import make_ready
from hil.config import BicycleFile
from hil.configfile import find_rig_file, load_bicycle
from hil.effectlines import checked
from hil.errors import ConfigError, RunError
from hil.rigs.bicycle import canonical, impossible_bodies, pack, reduced_inertia
from hil.runs import load_run
from hil.sim.parameters import ParameterTable
from hil.ui.bicycle import ride_page

app = typer.Typer(
    help="An instrumented bicycle: check its file, simulate, record, calibrate, analyse a ride.",
    no_args_is_help=True,
)
app.command("record")(record_command)
app.command("nodes")(nodes_command)
app.command("press")(press_command)
app.command("calibrate")(calibrate_command)
app.command("weave")(weave_command)

RigOption = Annotated[
    str | None,
    typer.Option("--rig", help="The bicycle's file, or its name; default: the run's own."),
]
BicycleArgument = Annotated[
    str, typer.Argument(metavar="RIG", help="A bicycle's file, or its name.")
]


@app.callback()
def group() -> None:
    """An instrumented bicycle."""


@app.command()
def check(rig: BicycleArgument, json: JsonFlag = False) -> None:
    """Read a bicycle's file; say what bodies cannot be, and when it is stable by itself."""
    bicycle = load_bicycle(rig)
    packed = pack(bicycle)
    linear = canonical(packed)
    stable = linear.stable_range()
    doubts = impossible_bodies(bicycle)
    if json:
        answer: dict[str, Any] = {
            "name": bicycle.name,
            "doubts": doubts,
            "stable_range": stable,
            "reduced_inertia": reduced_inertia(bicycle),
            "M": linear.M.tolist(),
            "C1": linear.C1.tolist(),
            "K0": linear.K0.tolist(),
            "K2": linear.K2.tolist(),
        }
        write_json(answer)
        return
    out.print(f"{find_rig_file(rig)}: {bicycle.name}", soft_wrap=True)
    for text in doubts:
        out.print(f"warning: {text}", style="yellow", soft_wrap=True)
    said = (
        "nowhere up to 15 m/s" if stable is None else f"from {stable[0]:.3f} to {stable[1]:.3f} m/s"
    )
    out.print(f"stable by itself {said}; {reduced_inertia(bicycle):.3f} kg·m² at the rear wheel")
    table = Table("speed", "eigenvalues near straight running, 1/s")
    for speed in (1.0, 2.0, 4.0, 5.0, 6.0, 8.0, 10.0):
        values = linear.eigenvalues(speed)[0]
        shown = [
            f"{v.real:.3f} ± {v.imag:.3f}i" if v.imag > 1e-9 else f"{v.real:.3f}"
            for v in values
            if v.imag >= -1e-9
        ]
        table.add_row(f"{speed:g} m/s", ", ".join(shown))
    out.print(table)


@app.command()
def simulate(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="The run folder to make.")],
    rig: Annotated[str, typer.Option("--rig", help="The bicycle's file, or its name.")] = "bicycle",
    track: Annotated[
        str, typer.Option(help=f"What is ridden: {', '.join(m.name for m in MANOEUVRES)}.")
    ] = "u-turns",
    cruise: Annotated[
        float | None, typer.Option(min=2.0, max=9.0, help="Speed on straights, m/s.")
    ] = None,
    turning: Annotated[
        float | None, typer.Option(min=2.0, max=7.0, help="Speed in turns, m/s.")
    ] = None,
    road: Annotated[
        float,
        typer.Option(min=0.0, max=0.02, help="Unevenness of the road, m (standard deviation)."),
    ] = 0.0,
    effect: Annotated[
        list[str] | None,
        typer.Option(
            "--effect",
            help="A gap to put in, location.effect.parameter=value, e.g. "
            "bicycle.front_suspension.stiffness=9000. Repeat for more.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of noise, jitter and rider.")] = 0,
) -> None:
    """Ride a bicycle that is not there, and record it as its sensors would."""
    bicycle = with_effects(checked(load_bicycle(rig), rig), effect or [])
    told = manoeuvre(track)
    way = replace(told, cruise=cruise or told.cruise, turning=turning or told.turning)
    ride = way.ride(bicycle, seed, road_m=road)
    save(ride, folder, f"simulated ride: {track}, seed {seed}")
    err.print(f"{folder}: {ride.truth.t_s[-1]:.1f} s recorded", soft_wrap=True)


@app.command("analyse")
def analyse_command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder or .mcap of a ride.")],
    rig: RigOption = None,
    report: Annotated[
        Path | None, typer.Option("--report", help="The page; default ride.html in the run folder.")
    ] = None,
    page: Annotated[bool, typer.Option(help="Write the page.")] = True,
    json: JsonFlag = False,
) -> None:
    """Compute a ride from lean, wheel and steer: path, torques, forces, and the IMU beside the model."""
    make_ready(report)
    analysis = analyse(ride_of(run, rig))
    if json:
        write_json(analysis.numbers())
    else:
        show(analysis)
    if page:
        target = report or (run if run.is_dir() else run.parent) / "ride.html"
        ride_page(analysis, target)
        err.print(f"page: {target}", soft_wrap=True)


def ride_of(path: Path, rig: str | None) -> Ride:
    """The ride in a run, held against the rig file given or kept with it."""
    given = None if rig is None else load_bicycle(rig)
    run = load_run(path, given)
    bicycle = given or run.bicycle
    if bicycle is None:
        raise RunError(f"{path}: keeps no bicycle's file; name one with --rig")
    return prepare(run, bicycle)


def with_effects(bicycle: BicycleFile, lines: list[str]) -> BicycleFile:
    """The bicycle with effects `location.effect.parameter=value`; ConfigError for unknown names."""
    table = ParameterTable(bicycle)
    found: dict[tuple[str, str], dict[str, float]] = {}
    for line in lines:
        name, _, value = line.partition("=")
        p = table[name.strip()]
        try:
            number = float(value)
        except ValueError:
            raise ConfigError(f"--effect {line}: {value!r} is no number") from None
        table.vector({p.name: number})
        found.setdefault((p.location, p.effect), {})[p.parameter] = number
    if not found:
        return bicycle
    tables = bicycle.model_dump()
    tables["effects"] = [
        *tables["effects"],
        *({"effect": e, "location": at, "parameters": v} for (at, e), v in found.items()),
    ]
    return BicycleFile.model_validate(tables)


def show(a: Analysis) -> None:
    """Findings, numbers and the IMU's table on the terminal."""
    n = a.numbers()
    style = {"warning": "yellow", "fault": "red"}
    for f in a.findings:
        out.print(f"{f.subject}: {f.text}", style=style.get(f.verdict, ""), soft_wrap=True)
    drift, front, rear = n["drift"], n["friction_demand_front"], n["friction_demand_rear"]
    lines = [
        f"{n['duration_s']:.1f} s, {n['distance_m']:.1f} m, up to {n['speed_max']:.2f} m/s; ends "
        f"{drift['end_distance_m']:.2f} m from where it began",
        f"of that integration {1e3 * drift['integration_m']:.2g} mm; 0.15° of steer bias would be "
        f"{drift['steer_bias_one_step_m']:.2f} m, 1° of lean {drift['lean_bias_one_degree_m']:.2f} m",
        f"steer torque {_span(n['steer_torque'])} N·m, drive torque {_span(n['drive_torque'])} N·m",
        f"normal force front {_span(n['normal_front'])} N, rear {_span(n['normal_rear'])} N",
    ]
    if a.rolls.any():
        lines += [
            "drive torque off the reduced inertia's by "
            f"{n['drive_torque_off_reduced_inertia_rms']:.2f} N·m rms",
            f"friction demand front {front['peak']:.2f} at {front['t_s']:.1f} s, rear {rear['peak']:.2f} at "
            f"{rear['t_s']:.1f} s; lean torque left {n['lean_torque_rms']:.1f} N·m rms, of which noise alone "
            f"makes {n['lean_torque_noise_rms']:.1f}",
        ]
    for line in lines:
        out.print(line, soft_wrap=True)
    if not a.compared:
        return
    table = Table(
        Column("IMU", no_wrap=True), "model off by, raw", "filtered", "by noise alone",
        "correlation", "explained",
    )  # fmt: skip
    by = {(c.signal, c.filtered): c for c in a.compared}
    for signal in dict.fromkeys(c.signal for c in a.compared):
        raw, soft = by[signal, False], by[signal, True]
        table.add_row(
            signal,
            f"{raw.rms:.4f} {raw.unit}",
            f"{soft.rms:.4f}",
            f"{soft.floor:.4f}",
            f"{soft.correlation:.3f}",
            soft.said,
        )
    out.print(table)


def _span(values: dict[str, float]) -> str:
    return f"{values['lowest']:.1f} … {values['highest']:.1f}"
