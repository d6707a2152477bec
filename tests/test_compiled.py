"""The cache of compiled code must not outlive any source that went into it."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import hil

PROGRAM = "from hil.outer import outer; print(outer(1.0))"
INNER = "from hil.compiled import compiled\n@compiled\ndef inner(x):\n    return x + {add}\n"
OUTER = (
    "from hil.compiled import compiled\nfrom hil.inner import inner\n"
    "@compiled\ndef outer(x):\n    return inner(x)\n"
)


CONSTANT = (
    "from hil.compiled import compiled\nfrom hil.layout import ADD\n"
    "@compiled\ndef inner(x):\n    return x + ADD\n"
)


def run(folder: Path) -> str:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        cwd=folder,
        env={"PYTHONPATH": str(folder), "PATH": ""},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


def test_a_changed_callee_in_another_file_is_compiled_anew(tmp_path: Path) -> None:
    package = tmp_path / "hil"
    package.mkdir()
    (package / "__init__.py").write_text("")
    shutil.copy(Path(hil.__file__).parent / "compiled.py", package)
    (package / "outer.py").write_text(OUTER)
    (package / "inner.py").write_text(INNER.format(add=10))
    assert run(tmp_path) == "11.0"
    (cached,) = (package / "__pycache__").glob("outer.outer-*.nbi")
    before = cached.stat().st_mtime_ns
    assert run(tmp_path) == "11.0"
    assert cached.stat().st_mtime_ns == before, "an unchanged package is not compiled again"
    (package / "inner.py").write_text(INNER.format(add=20))
    assert run(tmp_path) == "21.0"


def test_so_it_is_where_a_constant_changes_in_a_file_without_compiled_code(tmp_path: Path) -> None:
    package = tmp_path / "hil"
    package.mkdir()
    (package / "__init__.py").write_text("")
    shutil.copy(Path(hil.__file__).parent / "compiled.py", package)
    (package / "outer.py").write_text(OUTER)
    (package / "inner.py").write_text(CONSTANT)
    (package / "layout.py").write_text("ADD = 10\n")
    assert run(tmp_path) == "11.0"
    (package / "layout.py").write_text("ADD = 200\n")
    assert run(tmp_path) == "201.0"
