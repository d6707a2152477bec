"""`hil command` and `hil watch`: talk to a running rig from another terminal."""

from __future__ import annotations

from contextlib import suppress
from typing import Annotated

import typer
from rich.live import Live

from hil.cli.console import JsonFlag, RigArgument, err, out, write_json
from hil.client import ENDPOINT, RigClient
from hil.configfile import load_any_rig, load_rig
from hil.messages import encode
from hil.ui.live import LiveView

Endpoint = Annotated[
    str, typer.Option("--endpoint", "-e", help="Zenoh endpoint of the daemon.", show_default=True)
]
COMMANDS = ("check", "arm", "disarm", "park", "stop", "reset", "record", "gain")


def command(
    rig: RigArgument,
    name: Annotated[
        str,
        typer.Argument(
            metavar="COMMAND",
            help="check: is it fit to arm; arm; disarm; park: go to the parked pose; stop: come to rest "
            "at once; reset: clear a latched fault; record: start or stop recording; gain: master gain.",
        ),
    ],
    argument: Annotated[str | None, typer.Argument(help="record: on or off; gain: 0 to 1.")] = None,
    endpoint: Endpoint = ENDPOINT,
    json: JsonFlag = False,
) -> None:
    """Give a running rig a command and say what it answered. Exit code 1 if it refused."""
    if name not in COMMANDS:
        raise typer.BadParameter(f"{name!r} is none of {', '.join(COMMANDS)}", param_hint="COMMAND")
    with RigClient(load_any_rig(rig).name, endpoint) as client:
        reply = client.command(name, **_arguments(name, argument))
    if json:
        write_json({"ok": reply.ok, "message": reply.message})
    else:
        (out if reply.ok else err).print(reply.message, style=None if reply.ok else "red")
    if not reply.ok:
        raise typer.Exit(1)


def _arguments(name: str, text: str | None) -> dict[str, float | str | bool]:
    if text is None:
        return {}
    if name == "record" and text in ("on", "off"):
        return {"on": text == "on"}
    if name == "gain":
        with suppress(ValueError):
            return {"value": float(text)}
    wanted = {"record": "on or off", "gain": "a number from 0 to 1"}.get(name, "no argument")
    raise typer.BadParameter(f"{name} takes {wanted}, not {text!r}", param_hint="ARGUMENT")


def watch(
    rig: RigArgument,
    endpoint: Endpoint = ENDPOINT,
    json: Annotated[
        bool, typer.Option("--json", help="One state a line, as it comes, for a script.")
    ] = False,
    seconds: Annotated[
        float | None, typer.Option(help="Leave after so long; otherwise on Ctrl-C.", min=0.1)
    ] = None,
) -> None:
    """Watch a running rig: state, pose, actuators, tracking error, slots, lateness, events."""
    settings = load_rig(rig)
    view = LiveView(settings)
    with RigClient(settings.name, endpoint) as client:
        states, events = client.states(), client.events()
        first_s: float | None = None
        with Live(
            console=out, refresh_per_second=10, transient=json, auto_refresh=not json
        ) as live:
            for state in states:
                first_s = state.t if first_s is None else first_s
                if seconds is not None and state.t - first_s > seconds:
                    break
                if json:
                    typer.echo(encode(state).decode())
                    continue
                view.add_state(state)
                for event in events.waiting():
                    view.add_event(event)
                live.update(view.render())
