"""`hil experiment`: motions that tell what a rig is like, designed within its limits, played, recorded."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.table import Table

from hil.cli.console import RigArgument, err, out, write_json
from hil.cli.options import ModeOption, SeedOption, profiles_of, rig_with
from hil.cli.plan_options import options_of, values_of
from hil.client import RigClient
from hil.config import Effect, RigFile
from hil.configfile import load_rig, parse_settings
from hil.effectlines import checked
from hil.errors import ConfigError
from hil.identify.experiments import (
    PLANS,
    Custom,
    Design,
    Plan,
    design,
    experiment_of,
    read_experiment,
    write_experiment,
)
from hil.identify.experiments.custom import read_custom
from hil.identify.experiments.limits import Use
from hil.identify.experiments.payload import bolted
from hil.identify.experiments.play import play_on_rig, play_simulated
from hil.runs.folder import Payload, read_meta, write_meta
from hil.sim.parameters import ParameterTable
from hil.ui.experiment import experiment_page

app = typer.Typer(
    help="Experiments: design within a rig's limits, play, record. `hil experiment RIG KIND --help`.",
    no_args_is_help=True,
)
PAGE: Final = "experiment.html"
_PER: Final = {
    "workspace": "", "stroke": "", "velocity": "/s", "speed": "/s", "acceleration": "/s²", "jerk": "/s³",
}  # fmt: skip
"""By rule of a limit: what of m or rad it is."""


@app.callback()
def choose(context: typer.Context, rig: RigArgument) -> None:
    """Play an experiment on a rig: by default on the simulated one, within seconds."""
    context.obj = rig


def _play(
    context: typer.Context,
    plan: Plan,
    *,
    dry_run: Annotated[
        Path | None,
        typer.Option(
            "--dry-run",
            metavar="FOLDER",
            help="Only write motion, description and a page of plots there; play nothing.",
        ),
    ] = None,
    endpoint: Annotated[
        str | None,
        typer.Option(
            "--endpoint", "-e", help="Play through the running daemon there, armed beforehand."
        ),
    ] = None,
    runs: Annotated[
        Path | None,
        typer.Option(
            "--runs",
            help="Folder of run folders; with --endpoint the one into which that daemon records. Default: "
            "the rig file's.",
        ),
    ] = None,
    mode: ModeOption = None,
    seed: SeedOption = 0,
    effect: Annotated[
        list[str] | None,
        typer.Option(
            "--effect",
            metavar="NAME=VALUE",
            help="Hurt the simulated rig: leg1.backlash.gap=0.0005. May be given several times.",
        ),
    ] = None,
    note: Annotated[str, typer.Option(help="Kept in run.toml of a simulated run.")] = "",
    payload: Payload | None = None,
    json: Annotated[bool, typer.Option("--json", help="Write JSON instead of text.")] = False,
) -> None:
    rig, text = rig_with(context.obj, mode=mode)
    motion = None
    if isinstance(plan, Custom):
        plan, motion = read_custom(plan)
    effects = read_effects(rig, effect or [])
    if payload is not None and endpoint is None:
        effects += bolted(rig, payload)
    made = design(plan, rig, motion)
    if not json:
        show(made, rig)
    if dry_run is not None:
        write_experiment(dry_run, made.description, made.trajectory)
        folder = experiment_page(made, rig, dry_run / PAGE).parent
    elif endpoint is not None:
        if effect:
            raise ConfigError("--effect: only a simulated rig can be hurt; leave --endpoint out")
        folder = _on_rig(made, rig, endpoint, runs or Path(rig.recording.folder))
    else:
        started_s = time.monotonic()
        with err.status(f"playing on the simulated {rig.name}"):
            folder = play_simulated(
                made,
                rig,
                text,
                profiles_of(rig, context.obj),
                runs or Path(rig.recording.folder),
                seed=seed,
                effects=effects,
                note=note,
            )
        err.print(
            f"{made.description.duration_s:.1f} s of motion took {time.monotonic() - started_s:.1f} s"
        )
    if payload is not None and dry_run is None:
        write_meta(folder, read_meta(folder).model_copy(update={"payload": payload}))
    if json:
        uses = [
            {
                "rule": u.rule,
                "name": u.name,
                "value": u.value,
                "bound": u.bound,
                "unit": unit_of(u, rig),
            }
            for u in made.uses
        ]
        write_json(
            {
                "folder": str(folder),
                "experiment": (experiment_of(folder) or made.description).model_dump(mode="json"),
                "uses": uses,
                "shaped_deviation": made.shaped.relative,
            }
        )
    else:
        out.print(str(folder), soft_wrap=True)


def read_effects(rig: RigFile, given: list[str]) -> tuple[Effect, ...]:
    """Effects from NAME=VALUE; ConfigError for a name or value that the rig's model has not."""
    values: dict[str, float] = {}
    for item in given:
        name, _, value = item.partition("=")
        try:
            values[name] = float(value)
        except ValueError as error:
            raise ConfigError(
                f"--effect {item}: needs a name, = and a number: leg1.backlash.gap=0.0005"
            ) from error
    table = ParameterTable(rig)
    table.vector(values)
    grouped: dict[tuple[str, str], dict[str, float]] = {}
    for name, number in values.items():
        p = table[name]
        grouped.setdefault((p.effect, p.location), {})[p.parameter] = number
    return tuple(
        Effect(effect=effect, location=location, parameters=parameters)
        for (effect, location), parameters in grouped.items()
    )


def unit_of(use: Use, rig: RigFile) -> str:
    """The unit of a limit's value and bound."""
    return ("rad" if rig.rotates(use.name) else "m") + _PER[use.rule]


def show(made: Design, rig: RigFile) -> None:
    """What was designed: sizes, lines, and the share of each limit that it uses."""
    d = made.description
    sizes = ", ".join(f"{c} {a:.4g}" for c, a in zip(d.coordinates, d.amplitude, strict=True))
    out.print(f"{d.plan.kind} on {d.rig}: {sizes}; {d.duration_s:.1f} s")
    if d.scaled_because:
        out.print(f"scaled by {d.scale:.3f} to fit: {d.scaled_because}", soft_wrap=True)
    for lines in d.lines:
        first, last = (lines.excited[i] / d.period_s for i in (0, -1))
        out.print(
            f"{lines.coordinate}: {len(lines.excited)} lines, {first:.3g} to {last:.3g} Hz, period "
            f"{d.period_s:g} s",
        )
    if d.detection:
        odd = sum(k % 2 for k in d.detection)
        out.print(f"detection lines: {odd} odd, {len(d.detection) - odd} even")
    table = Table("limit", "most", "bound", "unit", "used")
    table.columns[4].justify = "right"
    for use in sorted(made.uses, key=lambda u: -u.share):
        if use.share > 0.01:
            table.add_row(
                f"{use.rule} of {use.name}",
                f"{use.value:.4g}",
                f"{use.bound:.4g}",
                unit_of(use, rig),
                f"{100.0 * use.share:.0f} %",
            )
    out.print(table)
    out.print(
        f"shaping lets it through within {max(100.0 * made.shaped.relative, 1e-3):.2g} % of its peak"
    )


def _on_rig(made: Design, rig: RigFile, endpoint: str, runs: Path) -> Path:
    with (
        RigClient(rig.name, endpoint, name="experiment") as client,
        err.status(f"playing on {rig.name}") as status,
    ):
        whole_s = made.description.duration_s

        def progress(t_s: float) -> None:
            status.update(f"playing on {rig.name}: {t_s:.0f} of {whole_s:.0f} s")

        return play_on_rig(made, rig, client, runs, endpoint=endpoint, on_progress=progress)


def _command(kind: str, model: type[Plan]) -> Callable[..., None]:
    """The command of a kind: its plan's fields and the options of playing."""

    def plan(context: typer.Context, **given: Any) -> dict[str, Any]:
        whose = f"hil experiment {context.obj} {kind}"
        return {"plan": parse_settings(values_of(model, given), model, whose)}

    return _with_playing(plan, options_of(model), model.__doc__)


def _with_playing(
    plan: Callable[..., dict[str, Any]], own: Iterable[inspect.Parameter], doc: str | None
) -> Callable[..., None]:
    """A command that plays what `plan` makes of its `own` options; with the options of playing."""
    playing = [
        p
        for p in inspect.signature(_play, eval_str=True).parameters.values()
        if p.name not in ("context", "plan", "payload")
    ]
    context = inspect.Parameter(
        "context", inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=typer.Context
    )

    def command(context: typer.Context, **given: Any) -> None:
        options = {p.name: given.pop(p.name) for p in playing}
        _play(context, **plan(context, **given), **options)

    parameters = [context, *own, *playing]
    command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {p.name: p.annotation for p in parameters}
    command.__doc__ = doc
    return command


def _described(
    context: typer.Context,
    *,
    file: Annotated[Path, typer.Argument(metavar="EXPERIMENT.toml")],
    weighed: Annotated[
        bool,
        typer.Option(
            "--weighed", help="With the payload that the experiment asks for: it is bolted on now."
        ),
    ] = False,
) -> dict[str, Any]:
    """The experiment of a file: of `hil gap next`, or what another run was."""
    described = read_experiment(file)
    rig = checked(load_rig(context.obj), context.obj)
    if described.rig != rig.name:
        raise ConfigError(
            f"{file}: is an experiment for the rig {described.rig!r}, not for {rig.name!r}"
        )
    if weighed and described.payload is None:
        raise ConfigError(f"--weighed: {file} asks for no payload")
    plan = described.plan
    if isinstance(plan, Custom):
        plan = plan.model_copy(update={"file": str(file.parent / plan.file)})
    if described.purpose:
        err.print(described.purpose, soft_wrap=True)
    return {"plan": plan, "payload": described.payload if weighed else None}


for _kind, _model in PLANS.items():
    app.command(_kind)(_command(_kind, _model))
_OWN = [
    p
    for p in inspect.signature(_described, eval_str=True).parameters.values()
    if p.name != "context"
]
app.command("play")(_with_playing(_described, _OWN, _described.__doc__))
