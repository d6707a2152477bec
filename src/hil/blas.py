"""Linear algebra on one core."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import threadpool_limits


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Hold BLAS to one thread for as long as this is open, also as a decorator.

    A diagnosis multiplies many slim matrices: the threads of BLAS gain little on an idle machine, wait for
    each other on a busy one, and round differently from machine to machine.
    """
    with threadpool_limits(limits=1, user_api="blas"):
        yield
