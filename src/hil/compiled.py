"""The decorator of compiled code, and a disk cache that notices when any compiled source changes.

Numba's cache looks only at the file in which a function stands. After an update that touches a
function called from another file it would go on running the old one: a plant or twin that is
silently not what the sources say. So every cached function of hil is stamped with all of them.
"""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite.binding
import numba
from numba.core import caching

PACKAGE = Path(__file__).parent


@cache
def sources_stamp() -> str:
    """Hash over every source of hil with compiled code, and all beside it: constants are compiled in."""
    digest = hashlib.sha256()
    texts = {path: path.read_bytes() for path in sorted(PACKAGE.rglob("*.py"))}
    homes = {
        p.parent
        for p, t in texts.items()
        if any(m in t for m in (b"@compiled", b"@inner", b"njit"))
    }
    for path, text in texts.items():
        if path.parent in homes:
            digest.update(str(path.relative_to(PACKAGE)).encode() + b"\0" + text)
    return digest.hexdigest()


class _WholePackage:
    """A cache locator for hil's own functions; others fall through to numba's."""

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Any:
        if not Path(py_file).is_relative_to(PACKAGE):
            return None
        return super().from_function(py_func, py_file)  # type: ignore[misc]

    def get_source_stamp(self) -> tuple[Any, str]:
        return super().get_source_stamp(), sources_stamp()  # type: ignore[misc]


class InTree(_WholePackage, caching.InTreeCacheLocator):  # type: ignore[misc]
    """Beside the sources, where that is writable."""


class UserWide(_WholePackage, caching.UserWideCacheLocator):  # type: ignore[misc]
    """In the user's cache folder."""


if not numba.config.CACHE_LOCATOR_CLASSES and not numba.config.CACHE_DIR:
    ours = [f"{__name__}.{c.__name__}" for c in (InTree, UserWide)]
    theirs = [c.__name__ for c in caching.CacheImpl._locator_classes]
    numba.config.CACHE_LOCATOR_CLASSES = ",".join(ours + theirs)

# Loops over a rig's few actuators are unrolled where their number is known as they are compiled, and memory
# is not addressed through one running pointer for each row (decision 5).
for option in ("-unroll-threshold=600", "-disable-lsr"):
    llvmlite.binding.set_option("hil", option)

# Small functions called in every step are inlined: their calls cost more than what they do.
compiled: Any = numba.njit(cache=True, nogil=True, error_model="numpy", forceinline=True)

# What runs in every step works in memory that its caller keeps, so it needs no reference counts. Numba would
# count each view of an array in and out, atomically, which took most of a step (decision 5).
inner: Any = numba.njit(cache=True, nogil=True, error_model="numpy", forceinline=True, _nrt=False)
