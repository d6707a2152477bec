"""Runs a command in a User-mode Linux guest: a kernel with SocketCAN where the machine's has none.

    python tests/vcan/guest.py [--timeout SECONDS] COMMAND...

The guest is an ordinary process that boots Debian's kernel (package user-mode-linux; also needed: kmod
and iproute2) over the host's own file tree, so that Python, its virtual environment and its compiled
caches are the host's. It has lo, vcan0 and vcan1, one CPU and no network. What the command writes below
the present folder stays; all else is forgotten. Output is streamed, stdout and stderr as one; the exit
code is the command's, 124 after a time-out and 125 where the guest did not get so far.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import os
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

INIT = Path(__file__).with_name("init.sh").resolve()
KERNEL = "linux.uml"
TIMED_OUT, NOT_RUN = 124, 125
HANDED_ON = ("PATH", "HOME", "LANG", "CI")
HANDED_ON_PREFIXES = ("HIL_", "NUMBA_", "PYTEST_", "PYTHON")


def run_in_guest(command: list[str], *, timeout_s: float, memory: str = "3G") -> int:
    """Run `command` in the present folder, in a guest; returns its exit code (see above)."""
    kernel = shutil.which(KERNEL)
    if kernel is None:
        print(f"there is no {KERNEL}: apt-get install user-mode-linux kmod", file=sys.stderr)
        return NOT_RUN
    with tempfile.TemporaryDirectory(prefix="hil-guest-") as name:
        scratch = Path(name).resolve()
        (scratch / "command").write_text(_script(command))
        log = scratch / "kernel.log"
        output = os.dup(sys.stdout.fileno())
        with log.open("wb") as console, _cpu_without_guests() as cpu:
            guest = subprocess.Popen(
                _arguments(kernel, scratch, memory, output=output),
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=subprocess.STDOUT,
                pass_fds=(output,),
                start_new_session=True,
                preexec_fn=functools.partial(_prefer, cpu),
            )
            try:
                guest.wait(timeout_s)
            except subprocess.TimeoutExpired:
                print(f"the guest was ended after {timeout_s:g} s", file=sys.stderr)
                return TIMED_OUT
            finally:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(guest.pid, signal.SIGKILL)
                guest.wait()
                os.close(output)
        try:
            return int((scratch / "exit").read_text())
        except (FileNotFoundError, ValueError):
            sys.stderr.write(log.read_text(errors="replace")[-4000:])
            print(
                "the guest ended before the command did; its kernel's log is above", file=sys.stderr
            )
            return NOT_RUN


def _arguments(kernel: str, scratch: Path, memory: str, *, output: int) -> list[str]:
    return [
        kernel,
        f"mem={memory}",
        "root=/dev/root",
        "rootfstype=hostfs",
        "rootflags=/",
        "ro",
        f"init={INIT}",
        "con0=null,fd:1",
        f"con1=null,fd:{output}",
        "con=null",
        "ssl=null",
        f"uml_dir={scratch}/",
        "panic=1",
        f"hil_guest={scratch}",
        f"hil_keep={Path.cwd()}",
    ]


def _script(command: list[str]) -> str:
    handed_on = {
        name: value
        for name, value in os.environ.items()
        if name in HANDED_ON or name.startswith(HANDED_ON_PREFIXES)
    }
    handed_on["TERM"] = os.environ.get("TERM", "dumb") if sys.stdout.isatty() else "dumb"
    exports = (f"export {name}={shlex.quote(value)}\n" for name, value in handed_on.items())
    return f"{''.join(exports)}cd {shlex.quote(str(Path.cwd()))}\nexec {shlex.join(command)}\n"


@contextlib.contextmanager
def _cpu_without_guests() -> Iterator[int]:
    """A CPU that no other guest of ours has, if there is one."""
    cpus = sorted(os.sched_getaffinity(0), reverse=True)
    with socket.socket(socket.AF_UNIX) as mark:
        for cpu in cpus:
            with contextlib.suppress(OSError):
                mark.bind(f"\0hil-guest-on-cpu-{cpu}")
                break
        else:
            cpu = cpus[0]
        yield cpu


def _prefer(cpu: int) -> None:
    """On one CPU the guest's switches cost a third less; ahead of all that is not real time, load hurts less.

    A guest that waits for a processor stands still as a whole, its clock goes on: to the daemon in it that
    is an overrun. The kernel leaves others 5 % of that processor at least, and the other processors.
    """
    os.sched_setaffinity(0, {cpu})
    with contextlib.suppress(OSError):  # for root alone
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))


def main() -> int:
    parser = argparse.ArgumentParser(description="Run a command where there are vcan0 and vcan1.")
    parser.add_argument("--timeout", type=float, default=600.0, metavar="SECONDS")
    parser.add_argument("command", nargs=argparse.REMAINDER, metavar="COMMAND...")
    options = parser.parse_args()
    if not options.command:
        parser.error("which command?")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    return run_in_guest(options.command, timeout_s=options.timeout)


if __name__ == "__main__":
    sys.exit(main())
