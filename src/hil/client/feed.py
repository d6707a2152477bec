"""Messages as they come from Zenoh's threads, for whoever iterates over them."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator
from threading import Condition
from typing import Generic, TypeVar
from weakref import ReferenceType
from weakref import ref as ref_to

from hil.errors import RigNotReached

T = TypeVar("T")


class Feed(Generic[T]):
    """Messages as they come, for `for` and `async for`; what nobody fetches in time is lost.

    Ends when the client closes; RigNotReached when nothing came for `timeout_s`.
    """

    def __init__(self, what: str, timeout_s: float | None) -> None:
        self._what = what
        self._timeout_s = timeout_s
        self._items: list[T] = []
        self._more = Condition()
        self._is_closed = False

    def put(self, item: T) -> None:
        """Add a message; of more than a thousand that wait, the oldest goes."""
        with self._more:
            self._items.append(item)
            del self._items[:-1000]
            self._more.notify_all()

    def waiting(self) -> list[T]:
        """What has come and nobody has fetched; empty if nothing has."""
        with self._more:
            items, self._items = self._items, []
            return items

    def close(self) -> None:
        """End every iteration."""
        with self._more:
            self._is_closed = True
            self._more.notify_all()

    def __iter__(self) -> Iterator[T]:
        return self

    def __next__(self) -> T:
        with self._more:
            if not self._more.wait_for(lambda: self._items or self._is_closed, self._timeout_s):
                raise RigNotReached(f"{self._what}: nothing came for {self._timeout_s} s")
            if not self._items:
                raise StopIteration
            return self._items.pop(0)

    def __aiter__(self) -> AsyncIterator[T]:
        return self

    async def __anext__(self) -> T:
        end = object()
        item = await asyncio.to_thread(next, self, end)
        if item is end:
            raise StopAsyncIteration
        return item  # type: ignore[return-value]


class Feeds(Generic[T]):
    """The feeds that somebody still holds; the list is replaced, never changed, so threads agree."""

    def __init__(self) -> None:
        self._refs: list[ReferenceType[Feed[T]]] = []

    def new(self, what: str, timeout_s: float | None) -> Feed[T]:
        """A feed of what comes from now on."""
        feed: Feed[T] = Feed(what, timeout_s)
        self._refs = [*(ref for ref in self._refs if ref() is not None), ref_to(feed)]
        return feed

    def put(self, item: T) -> None:
        """Add a message to every feed."""
        for ref in self._refs:
            if (feed := ref()) is not None:
                feed.put(item)

    def close(self) -> None:
        """End every feed."""
        for ref in self._refs:
            if (feed := ref()) is not None:
                feed.close()
