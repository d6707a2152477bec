"""Before it starts, control loads all compiled code that a ride calls: later it would be an overrun."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCRIPT = """
import gc, sys
from numba.core.registry import CPUDispatcher
from hil.configfile import load_rig
from hil.daemon.core.motion import Motion
from hil.rigs import build_rig
from tests.daemon.simulated_rig import Session

def loaded():
    found = (d for d in gc.get_objects() if isinstance(d, CPUDispatcher) and d.signatures)
    names = {f"{d.py_func.__module__}.{d.py_func.__name__}" for d in found}
    return {n for n in names if n.startswith("hil.") and not n.startswith("hil.sim.")}

rig = load_rig(sys.argv[1])
Motion(rig, build_rig(rig), True).rehearse()
before = loaded()
assert "hil.control.interpolation.evaluate" in before
Session(rig).engaged(1.5).leave()
print("loaded late:", *sorted(loaded() - before))
"""


@pytest.mark.parametrize("name", ["motorcycle"])
def test_a_rehearsal_loads_all_that_a_ride_calls(name):
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, name], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "loaded late:"
