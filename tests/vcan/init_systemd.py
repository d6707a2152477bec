"""A real systemd as process 1 of a namespace of its own, in the guest: for tests of the installed service.

The guest's own process 1 is its start script. Here the guest's file tree becomes the root of a new mount and
process namespace (not a chroot: in one, systemd could not give services users of their own), and the host
tree's systemd starts in it with next to nothing but what a unit pulls in.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from pathlib import Path

GUEST_ROOT = "/mnt/root"
"""Where init.sh has put the guest's file tree, as seen from the guest's process 1."""
TARGET = "hil-test.target"
HIDDEN = ("/root/", "/home/")
"""Where ProtectHome=yes lets a service see nothing."""
CHECKOUT = Path(__file__).resolve().parents[2]
MASKED = (
    "apt-daily.timer", "apt-daily-upgrade.timer", "cryptsetup.target", "dev-hugepages.mount",
    "dev-mqueue.mount", "local-fs.target", "proc-sys-fs-binfmt_misc.automount", "swap.target",
    "sys-fs-fuse-connections.mount", "sys-kernel-config.mount", "sys-kernel-debug.mount",
    "sys-kernel-tracing.mount", "systemd-binfmt.service", "systemd-firstboot.service",
    "systemd-journal-flush.service", "systemd-modules-load.service", "systemd-random-seed.service",
    "systemd-remount-fs.service", "systemd-sysctl.service", "systemd-sysusers.service",
    "systemd-timesyncd.service", "systemd-tmpfiles-clean.timer", "systemd-tmpfiles-setup.service",
    "systemd-tmpfiles-setup-dev.service", "systemd-udevd.service", "systemd-udev-trigger.service",
    "systemd-udevd-control.socket", "systemd-udevd-kernel.socket", "systemd-update-utmp.service",
)  # fmt: skip
"""Parts of a boot that the guest does not need, or that would empty its folders."""


def in_guest() -> bool:
    """Whether this is the User-mode Linux guest of tests/vcan."""
    return "hil_guest=" in Path("/proc/cmdline").read_text()


class Systemd:
    """One systemd, from construction to `close`."""

    def __init__(self) -> None:
        units = Path("/run/systemd/system")
        units.mkdir(parents=True, exist_ok=True)
        (units / TARGET).write_text("[Unit]\nDefaultDependencies=no\n")
        for name in MASKED:
            (units / name).symlink_to("/dev/null")
        subprocess.run(["mount", "-t", "cgroup2", "cgroup2", "/sys/fs/cgroup"], check=True)
        inside = (
            "mount -t proc proc /proc; exec env container=hil /lib/systemd/systemd --system "
            f"--unit={TARGET} --log-target=kmsg --show-status=no"
        )
        outside = (
            f"mount --make-rprivate / && cd {GUEST_ROOT} && mount -n --move . / && "
            f"exec chroot . sh -c '{inside}'"
        )
        enter = ["nsenter", "--target", "1", "--mount", "--root", "--"]
        namespaces = ["unshare", "--mount", "--pid", "--fork", "--kill-child"]
        self._process = subprocess.Popen([*enter, *namespaces, "sh", "-c", outside])
        self._pid = self._wait_for_pid()
        self._wait_until_up()
        self.run("systemctl", "start", "systemd-journald.service")

    def run(self, *command: str, check: bool = True, timeout_s: float = 300.0) -> str:
        """What a command says beside systemd; with `check` it must succeed."""
        enter = ["nsenter", "--target", str(self._pid), "--mount", "--pid", "--root", "--wd=/"]
        done = subprocess.run(
            [*enter, "--", *command],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=timeout_s,
            check=False,
        )
        assert not check or done.returncode == 0, f"{' '.join(command)}: {done.stdout}"
        return done.stdout

    def shows(self, unit: str, what: str) -> str:
        """A property of a unit."""
        return self.run("systemctl", "show", unit, f"--property={what}", "--value").strip()

    def journal(self, unit: str) -> list[str]:
        """What a unit has said."""
        return self.run("journalctl", "-u", unit, "-o", "cat", "--no-pager").splitlines()

    def close(self) -> None:
        """End it and all that it started."""
        self._process.kill()
        self._process.wait()

    def _wait_for_pid(self) -> int:
        children = Path(f"/proc/{self._process.pid}/task/{self._process.pid}/children")
        end_s = time.monotonic() + 30.0
        while time.monotonic() < end_s:
            pids = children.read_text().split() if children.exists() else []
            if pids and Path(f"/proc/{pids[0]}/comm").read_text().strip() == "systemd":
                return int(pids[0])
            time.sleep(0.1)
        raise AssertionError("systemd did not start")

    def _wait_until_up(self) -> None:
        end_s = time.monotonic() + 60.0
        while "running" not in self.run("systemctl", "is-system-running", check=False):
            assert time.monotonic() < end_s, self.run("systemctl", "list-jobs", check=False)
            time.sleep(0.2)


def service_python(systemd: Systemd, folder: Path) -> Path:
    """A `hil` that a service can reach: this checkout and its packages under a Python outside all homes.

    The service sees no home and has a /tmp of its own, and the checkout may lie in either: it is shown to
    the service a second time, in `folder`.
    """
    own = (Path(sys.executable).parent / "python").resolve()
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    python = Path("/usr/bin") / version if str(own).startswith(HIDDEN) else own
    if not python.exists():
        raise AssertionError(f"{python} is needed: a service cannot see {sys.executable}")
    packages = folder / "lib" / version / "site-packages"
    packages.mkdir(parents=True)
    (folder / "bin").mkdir()
    checkout = folder / "checkout"
    checkout.mkdir()
    systemd.run("mount", "--bind", str(CHECKOUT), str(checkout))
    prefix = Path(sys.prefix)
    if prefix.is_relative_to(CHECKOUT):
        prefix = checkout / prefix.relative_to(CHECKOUT)
    theirs = prefix / "lib" / version / "site-packages"
    (packages / "checkout.pth").write_text(f"{checkout}/src\n{theirs}\n")
    (folder / "bin/python").symlink_to(python)
    (folder / "pyvenv.cfg").write_text(
        f"home = {python.parent}\ninclude-system-site-packages = false\n"
    )
    script = folder / "bin/hil"
    script.write_text(f"#!{folder}/bin/python\nfrom hil.cli import main\nmain()\n")
    script.chmod(0o755)
    return script


def need(*commands: str) -> None:
    """Fail where a command is missing."""
    missing = [name for name in commands if shutil.which(name) is None]
    assert not missing, f"missing: {', '.join(missing)}"
