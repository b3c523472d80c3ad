"""The queue of items that a pool of workers takes from."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator
from typing import Generic, TypeVar

Item = TypeVar("Item", bound=Hashable)


class WorkQueue(Generic[Item]):
    """The items of a work, each given out once, or again where its worker died.

    Args:
        items: taken one by one, when a worker is free.
        line_of: the line that an item waits in: one item of a line is solved at a time; None = the item need not wait.
    """

    def __init__(self, items: Iterable[Item], line_of: Callable[[Item], Hashable]) -> None:
        self._waiting: Iterator[Item] = iter(items)
        self._line_of = line_of
        self._held: deque[Item] = deque()
        """Items that wait until another of their line is done."""
        self._again: deque[Item] = deque()

    def again(self, item: Item) -> None:
        """Put an item back: behind all others, but as the next one of its line."""
        if self._line_of(item) is None:
            self._again.append(item)
        else:
            self._held.appendleft(item)

    def take(self, busy: Collection[Item]) -> Item | None:
        """The next item while ``busy`` are being solved; None where none can be given out now."""
        taken = {self._line_of(item) for item in busy} - {None}
        for item in self._held:
            if self._line_of(item) not in taken:
                self._held.remove(item)
                return item
        taken |= {self._line_of(item) for item in self._held}
        for item in self._waiting:
            if self._line_of(item) not in taken:
                return item
            self._held.append(item)
        return self._again.popleft() if self._again else None
