"""`hil demo`: the whole rig on a desk, from cue to report, with nothing installed but hil."""

from __future__ import annotations

import contextlib
import signal
import socket
import subprocess
import sys
import tempfile
import time
import webbrowser
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.live import Live

from hil.cli.console import err, out
from hil.cli.cue import file_cues, ride_cues
from hil.cli.options import ModeName, ModeOption, SeedOption, profiles_of, rig_with
from hil.client import RigClient
from hil.config import RigFile
from hil.control.demo_ride import DURATION_S
from hil.daemon.leaving import daemon_s
from hil.daemon.simulated import record_ride
from hil.errors import CommandRefused, HilError, RigNotReached, RunError
from hil.runs import load_run
from hil.runs.folder import counted, read_meta, read_rig
from hil.ui.live import LiveView
from hil.ui.report import run_report
from hil.ui.report_summary import summary_lines

START_S = 60.0
"""A fresh checkout compiles the model first, which takes half a minute on a small machine."""
MOVING = ("engaged", "ready", "parking")


def demo(
    rig: Annotated[str, typer.Argument(metavar="[RIG]", help="Which rig to ride.")] = "motorcycle",
    fast: Annotated[
        bool, typer.Option("--fast", help="In simulated time: the same code, within seconds.")
    ] = False,
    seconds: Annotated[
        float, typer.Option(help="How much of the minute's ride.", min=1.0, max=DURATION_S)
    ] = DURATION_S,
    cue: Annotated[
        Path | None, typer.Option("--cue", help="Ride this cue file instead, whole.")
    ] = None,
    mode: ModeOption = None,
    runs: Annotated[Path, typer.Option("--runs", help="Where the run folder is made.")] = Path(
        "runs"
    ),
    seed: SeedOption = 0,
    browser: Annotated[
        bool, typer.Option("--open", help="Open the report in a browser at the end.")
    ] = False,
) -> None:
    """Ride a simulated rig for a minute: no hardware, no root, no server.

    Starts the simulated rig behind a CAN hub, the daemon with both its processes, and a client that streams
    riding cues over Zenoh. Ends parked, with a recording and a page of plots. Ctrl-C (or SIGTERM)
    parks, then leaves; a second one leaves at once.
    The rig waits half a second for a drive or a cue, longer than one with a person on it: desks are busy.
    """
    with ended_as_by_ctrl_c():
        folder = (_ride_fast if fast else _ride)(rig, seconds, cue, mode, runs, seed)
    run = load_run(folder)
    report = run_report(run, folder / "report.html")
    for line in summary_lines(run):
        out.print(line, soft_wrap=True)
    out.print(f"report     {report}", soft_wrap=True)
    if browser:
        webbrowser.open(report.resolve().as_uri())


def _ride_fast(
    name: str, seconds: float, cue: Path | None, mode: ModeName | None, runs: Path, seed: int
) -> Path:
    rig, text = rig_with(name, mode=mode, runs=runs)
    started_s = time.monotonic()
    with err.status(f"riding {rig.name} in simulated time"):
        folder = record_ride(
            rig,
            text,
            profiles_of(rig, name),
            ride_cues(rig, seconds) if cue is None else file_cues(rig, cue),
            runs,
            seed=seed,
            note="hil demo --fast",
        )
    err.print(f"riding took {time.monotonic() - started_s:.1f} s")
    return folder


def _ride(
    name: str, seconds: float, cue: Path | None, mode: ModeName | None, runs: Path, seed: int
) -> Path:
    rig, text = rig_with(name, mode=mode, patient=True)
    profiles_of(rig, name)  # what is wrong with these files is said before anything starts
    if cue is not None:
        file_cues(rig, cue)
    runs.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="hil-demo-") as scratch:
        file = Path(scratch) / f"{rig.name}.toml"
        file.write_text(text)
        with Cast(rig, file, runs, seed) as cast:
            cast.play(
                ["ride", str(file), "--seconds", str(seconds)]
                if cue is None
                else ["play", str(file), str(cue)]
            )
        return cast.recording()


@contextlib.contextmanager
def ended_as_by_ctrl_c() -> Iterator[None]:
    """SIGTERM, and SIGHUP of a terminal that is gone, raise KeyboardInterrupt; an ignored one stays so."""
    kept = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        for number, handler in kept.items():
            if handler is not signal.SIG_IGN:
                signal.signal(number, signal.default_int_handler)
        yield
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)


class Cast:
    """The processes of the demo. Leaving it ends them, the daemon first: it parks.

    Where leaving is interrupted it kills them.

    Sockets and logs are made beside `file`, the rig file that all of them read.
    """

    def __init__(self, rig: RigFile, file: Path, runs: Path, seed: int) -> None:
        self._rig = rig
        self._scratch = scratch = file.parent
        self._endpoint = f"tcp/127.0.0.1:{free_port()}"
        sockets = [scratch / f"bus{k or ''}.sock" for k in range(len(rig.can.urls))]
        self._runs, self._before = runs, set(runs.iterdir())
        self._urls = tuple(f"hub:{path}" for path in sockets)
        bus = ",".join(self._urls)
        self._simulate = ["simulate", str(file), "--hub", "--can", bus, "--seed", str(seed)]
        self._daemon = ["run", str(file), "--can", bus, "--listen", self._endpoint]
        self._daemon += ["--runs", str(runs.resolve())]
        self._sockets = sockets
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._ends = contextlib.ExitStack()

    def __enter__(self) -> Cast:
        try:
            with err.status("starting rig and daemon (the first time, the model is compiled)"):
                self._start(self._simulate)
                self._wait(lambda: all(s.exists() for s in self._sockets), "the simulated rig")
                self._start(self._daemon)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: Any) -> None:
        self._ends.close()

    def play(self, ride: list[str]) -> None:
        """Arm, ride, park, disarm; Ctrl-C goes straight to parking.

        HilError with what was said where the ride or another process fails, or the rig has a fault.
        """
        with self._client() as client:
            self._until_heard(client)
            view = LiveView(self._rig)
            states, events = client.states(), client.events()
            with _shown(view) as show:
                rider = None
                try:
                    for state in states:
                        view.add_state(state)
                        for event in events.waiting():
                            view.add_event(event)
                        show(_progress(state.state, rider))
                        if rider is None and state.state == "parked":
                            self._command(client, "arm")
                            rider = self._start(["cue", *ride, "-e", self._endpoint])
                        if state.state in ("fault", "emergency"):
                            raise HilError(f"the rig is in {state.state}: {state.fault}")
                        self._check()
                        if _is_over(rider) and state.state not in MOVING:
                            break
                except KeyboardInterrupt:
                    show("told to end: parking")

    def recording(self) -> Path:
        """The run folder that this daemon made: others may record there, on other buses. HilError without."""
        for folder in sorted(set(self._runs.iterdir()) - self._before, key=counted, reverse=True):
            with contextlib.suppress(RunError):
                rig = read_rig(folder, read_meta(folder))
                if rig is not None and rig.can.urls == self._urls:
                    return folder
        raise HilError(
            f"the daemon left no recording in {self._runs}; it said:\n{self._said('run')}"
        )

    def _client(self) -> RigClient:
        deadline_s = time.monotonic() + START_S
        while True:
            try:
                return RigClient(self._rig.name, self._endpoint, name="demo").open()
            except RigNotReached:
                self._check()
                if time.monotonic() > deadline_s:
                    raise
                time.sleep(0.2)

    def _until_heard(self, client: RigClient) -> None:
        """Return once a state came: the daemon answers before its loop, the model compiled, sends any."""
        deadline_s = time.monotonic() + START_S
        while True:
            try:
                next(client.states())
                return
            except RigNotReached:
                self._check()
                if time.monotonic() > deadline_s:
                    raise

    @staticmethod
    def _command(client: RigClient, name: str) -> None:
        reply = client.command(name)
        if not reply.ok:
            raise CommandRefused(f"{name} was refused: {reply.message}")

    def _start(self, arguments: list[str]) -> subprocess.Popen[bytes]:
        name = arguments[0]
        with self._log(name).open("wb") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "hil", *arguments],
                stdout=log,
                stderr=log,
                start_new_session=True,  # Ctrl-C is ours: we park before they go
            )
        self._ends.callback(self._end, process)
        self._processes[name] = process
        return process

    def _end(self, process: subprocess.Popen[bytes]) -> None:
        try:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(daemon_s(self._rig))
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()

    def _log(self, name: str) -> Path:
        return self._scratch / f"{name}.txt"

    def _wait(self, is_there: Any, what: str) -> None:
        deadline_s = time.monotonic() + START_S
        while not is_there():
            self._check()
            if time.monotonic() > deadline_s:
                raise HilError(f"{what} did not come up within {START_S:g} s")
            time.sleep(0.05)

    def _check(self) -> None:
        for name, process in self._processes.items():
            code = process.poll()
            if code not in (None, 0):
                raise HilError(
                    f"`hil {name}` of the demo has ended with exit code {code}; it said:\n{self._said(name)}"
                )

    def _said(self, name: str) -> str:
        return self._log(name).read_text(encoding="utf-8", errors="replace").strip()


@contextlib.contextmanager
def _shown(view: LiveView) -> Iterator[Any]:
    """A function that shows the view: live in a terminal, else a line every five seconds."""
    if out.is_terminal:
        with Live(console=out, auto_refresh=False, transient=True) as live:
            last_s = [0.0]

            def draw(progress: str) -> None:
                now_s = time.monotonic()
                if now_s - last_s[0] > 0.1:
                    last_s[0] = now_s
                    live.update(view.render(progress), refresh=True)

            yield draw
        return
    said = [0.0]

    def say(progress: str) -> None:
        now_s = time.monotonic()
        if now_s - said[0] > 5.0:
            said[0] = now_s
            err.print(f"{progress}: {view.line()}", soft_wrap=True)

    yield say


def _is_over(rider: subprocess.Popen[bytes] | None) -> bool:
    return rider is not None and rider.poll() is not None


def _progress(state: str, rider: subprocess.Popen[bytes] | None) -> str:
    if rider is None:
        return "waiting for the drives"
    return f"ride over, {state}" if _is_over(rider) else "riding"


def free_port() -> int:
    """A TCP port of loopback that nobody uses now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
