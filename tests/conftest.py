"""Each run of the tests tries the same examples; `pytest --hypothesis-profile explore` looks for new ones."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import settings

settings.register_profile("same", derandomize=True)
settings.register_profile("explore", derandomize=False, max_examples=1000)
settings.load_profile("same")

COMPILING = ("tests/sim/test_effects.py", "tests/rigs/test_bicycle_benchmarks.py")
"""What compiles longest, each something else: workers that begin with one of these find what the other made
in the cache."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files in the order in which workers take them: those that compile, then the long ones."""
    count = Counter(_file(item) for item in items)

    def turn(item: pytest.Item) -> tuple[int, int, str]:
        file = _file(item)
        first = COMPILING.index(file) if file in COMPILING else len(COMPILING)
        return first, -count[file], file

    items.sort(key=turn)


def _file(item: pytest.Item) -> str:
    return item.nodeid.partition("::")[0]
