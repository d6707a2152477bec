"""`hil demo` as users run it, in real time and in simulated."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from hil.runs import load_run
from tests.daemon.bench import PATIENCE_S

pytestmark = pytest.mark.timeout(240)


def test_the_demo_rides_and_reports(tmp_path):
    asked = subprocess.run(
        [sys.executable, "-m", "hil", "demo", "axis", "--seconds", "3"],
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
        cwd=tmp_path,
        env={**os.environ, "XDG_RUNTIME_DIR": str(tmp_path)},
    )
    assert asked.returncode == 0, asked.stderr
    (folder,) = (tmp_path / "runs").iterdir()
    assert (folder / "report.html").stat().st_size > 10**6
    assert len(asked.stdout.splitlines()) == 11


def test_the_fast_demo_is_the_same_every_time(tmp_path):
    for name in ("a", "b"):
        subprocess.run(
            [
                sys.executable,
                "-m",
                "hil",
                "demo",
                "axis",
                "--fast",
                "--seconds",
                "2",
                "--runs",
                name,
            ],
            check=True,
            timeout=PATIENCE_S,
            capture_output=True,
            cwd=tmp_path,
        )
    (a,), (b,) = (tmp_path / "a").iterdir(), (tmp_path / "b").iterdir()
    assert (a / "can.log").read_text().splitlines() == (b / "can.log").read_text().splitlines()
    assert load_run(a).table.equals(load_run(b).table)
