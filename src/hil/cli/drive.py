"""`hil drive`: single drives, for commissioning. Beside a daemon objects are read and written through it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from typing import Annotated

import typer
from rich.table import Table

from hil.cli.console import JsonFlag, RigArgument, err, out, write_json
from hil.cli.options import CanOption, profiles_of, rig_with
from hil.client import ENDPOINT, RigClient
from hil.daemon.commission import objects
from hil.daemon.commission.access import Access, ThroughDaemon
from hil.daemon.commission.desk import Desk
from hil.daemon.commission.scan import scan as scan_buses
from hil.errors import CommandRefused, RigInUse, RigNotReached

app = typer.Typer(
    help="Commission single drives, of either family: who is there, read, write, home, jog. "
    "While a daemon runs the rig, info, read and write go through it, the others wait until it has ended; "
    "everything passes the gate.",
    no_args_is_help=True,
)

ActuatorArgument = Annotated[
    str, typer.Argument(metavar="ACTUATOR", help="leg1, slide, axis ...", show_default=False)
]
NameArgument = Annotated[
    str,
    typer.Argument(
        metavar="OBJECT",
        help="CiA 402: 0x6065, 0x1018:2 or its name in the EDS; CANLust: a number or name, as in `info`.",
        show_default=False,
    ),
]
DaemonOption = Annotated[
    str, typer.Option("--endpoint", "-e", help="Zenoh endpoint of the daemon, if one runs the rig.")
]
FreeOption = Annotated[
    bool,
    typer.Option(
        "--free",
        help="The actuator is not coupled to others: on a platform its leg has been taken off.",
    ),
]


@app.command()
def scan(rig: RigArgument, can: CanOption = None, json: JsonFlag = False) -> None:
    """Who is on the rig's buses. Listens, then reads device type and identity of every CANopen node."""
    settings, _ = rig_with(rig, can=can)
    with _no_daemon(), err.status("listening, then asking"):
        found = scan_buses(settings, profiles_of(settings, rig))
    missing = set(settings.actuator_names) - {f.actuator for f in found}
    if json:
        write_json({"found": [asdict(f) for f in found], "missing": sorted(missing)})
    else:
        table = Table("bus", "address", "actuator", "family", "what")
        for f in found:
            table.add_row(str(f.bus), str(f.address), f.actuator or "-", f.family, f.text)
        out.print(table)
        for name in sorted(missing):
            out.print(
                f"{name} is not heard: is it powered, on this bus, at this bit rate and address?"
            )
    if missing:
        raise typer.Exit(1)


@app.command()
def info(
    rig: RigArgument,
    actuator: ActuatorArgument,
    can: CanOption = None,
    endpoint: DaemonOption = ENDPOINT,
    json: JsonFlag = False,
) -> None:
    """What a drive says of itself: identity, state, modes, position; a CANLust drive's parameters."""
    with _objects(rig, actuator, can, endpoint) as drive:
        told = list(objects.info(drive))
    if json:
        write_json(dict(told))
        return
    for name, text in told:
        out.print(f"{name:<28} {text}", soft_wrap=True)


@app.command()
def read(
    rig: RigArgument,
    actuator: ActuatorArgument,
    name: NameArgument,
    can: CanOption = None,
    endpoint: DaemonOption = ENDPOINT,
    json: JsonFlag = False,
) -> None:
    """Read one object or parameter; through the daemon where one runs the rig."""
    with _objects(rig, actuator, can, endpoint) as drive:
        label, value = objects.read(drive, name)
    _show(label, value, json)


@app.command(context_settings={"ignore_unknown_options": True})  # or -5 would be one
def write(
    rig: RigArgument,
    actuator: ActuatorArgument,
    name: NameArgument,
    value: Annotated[
        str, typer.Argument(metavar="VALUE", help="Decimal, 0x... or text.", show_default=False)
    ],
    can: CanOption = None,
    endpoint: DaemonOption = ENDPOINT,
    json: JsonFlag = False,
) -> None:
    """Write one object or parameter and read it back. What moves the drive is never written.

    A daemon that runs the rig refuses while it is armed, and what it writes to the drive itself.
    """
    with _objects(rig, actuator, can, endpoint) as drive:
        label, found = objects.write(drive, name, value)
    _show(label, found, json)


@app.command()
def home(
    rig: RigArgument,
    actuator: ActuatorArgument,
    can: CanOption = None,
    free: FreeOption = False,
    json: JsonFlag = False,
) -> None:
    """Let a CiA 402 drive search its zero by the method of its drive file. It MOVES: nobody on the rig."""
    with _desk(rig, actuator, can, free=free) as desk:
        timeout_s = getattr(getattr(desk.profile, "homing", None), "timeout", 60.0)
        with err.status(f"{actuator} searches its zero"):
            position = desk.home(lambda: _set_up(desk), timeout_s)
    _stands(actuator, "is homed, at", position, json)


@app.command(context_settings={"ignore_unknown_options": True})
def jog(
    rig: RigArgument,
    actuator: ActuatorArgument,
    distance: Annotated[
        float,
        typer.Argument(
            metavar="DISTANCE", help="How far, m or rad; negative: back.", show_default=False
        ),
    ],
    speed: Annotated[float, typer.Option(help="Fastest, m/s or rad/s.")] = 0.01,
    can: CanOption = None,
    free: FreeOption = False,
    json: JsonFlag = False,
) -> None:
    """Move one drive a little, slowly, inside its stroke. It MOVES: nobody on the rig."""
    with _desk(rig, actuator, can, free=free) as desk, err.status(f"{actuator} moves"):
        position = desk.jog(distance, speed)
    _stands(actuator, "stands at", position, json)


@contextmanager
def _objects(rig: str, actuator: str, can: str | None, endpoint: str) -> Iterator[Access]:
    """The drive over the bus, or through the daemon that has it."""
    settings, _ = rig_with(rig, can=can)
    profiles = profiles_of(settings, rig)
    with ExitStack() as stack:
        drive: Access
        try:
            drive = stack.enter_context(Desk(settings, profiles, actuator)).objects
        except RigInUse as in_use:
            try:
                client = stack.enter_context(RigClient(settings.name, endpoint))
            except RigNotReached as error:
                raise RigInUse(f"{in_use}; and no daemon is reached: {error}") from None
            drive = ThroughDaemon(client, settings, profiles, actuator)
        yield drive


@contextmanager
def _desk(rig: str, actuator: str, can: str | None, *, free: bool) -> Iterator[Desk]:
    settings, _ = rig_with(rig, can=can)
    if not free and len(settings.actuators) > 1:
        raise CommandRefused(
            f"{settings.name}: its {len(settings.actuators)} actuators hang on one platform, and {actuator} "
            "would push against the others' brakes. Take it off and say --free, or move the whole rig with "
            "the daemon"
        )
    with _no_daemon(), Desk(settings, profiles_of(settings, rig), actuator) as desk:
        yield desk


@contextmanager
def _no_daemon() -> Iterator[None]:
    try:
        yield
    except RigInUse as error:
        raise RigInUse(f"{error}; beside a daemon drives are read and written only") from None


def _set_up(desk: Desk) -> None:
    objects.set_up_homing(desk)


def _stands(actuator: str, how: str, position: float, json: bool) -> None:
    if json:
        write_json({"actuator": actuator, "position": position})
    else:
        out.print(f"{actuator} {how} {position:.6f}")


def _show(label: str, value: objects.Value, json: bool) -> None:
    plain = value.hex() if isinstance(value, bytes) else value
    if json:
        write_json({"name": label, "value": plain})
    elif isinstance(plain, int):
        out.print(f"{label} = {plain} ({plain:#x})", soft_wrap=True)
    else:
        out.print(f"{label} = {plain}", soft_wrap=True)
