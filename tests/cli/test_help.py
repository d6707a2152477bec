"""`hil --help` says what each command is for, without loading any."""

import subprocess
import sys

import pytest

from hil.cli.lazy import COMMANDS, loaded


@pytest.mark.parametrize("name", COMMANDS)
def test_a_commands_own_help_begins_with_what_hil_says_of_it(name):
    first, _, _ = (loaded(name).help or "").partition("\n\n")
    assert " ".join(first.split()) == COMMANDS[name][1]


def test_help_names_all_commands_and_loads_none():
    code = (
        "import sys; from hil.cli import main; sys.argv = ['hil', '--help']\n"
        "try: main()\n"
        "finally: print('loaded:', [m for m in ('numpy', 'pandas', 'scipy') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert all(f" {name} " in done.stdout for name in COMMANDS)
    assert "loaded: []" in done.stdout
