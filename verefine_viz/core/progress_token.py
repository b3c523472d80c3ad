"""What takes long says what it is doing, and ends early where nobody waits for it any more."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

from verefine_viz.core.errors import Cancelled

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class ProgressToken:
    """Of whoever waits for something. It changes nothing about what comes out, only whether anything does.

    Whatever takes long asks for it between its natural units (objects, meshes, batches of votes), a few times a second
    where it can, and before it keeps or writes anything; so what is cancelled leaves nothing half done.
    """

    tell: Callable[[str, float | None], None] = lambda doing, share: None
    """Is told, in words, what is being done ("" = the same as before), and how much of it is done [0 to 1], None where
    nobody knows."""
    is_left: Callable[[], bool] = lambda: True
    """Whether somebody still waits."""
    tell_once: Callable[[str], None] = lambda doing: None
    """Is told, in words, what may take a minute, is done once and is kept on disk: where hundreds of frames pass by,
    nothing else is worth a line."""

    def ask(self, doing: str = "", share: float | None = None) -> None:
        """Says what is done next, or how much of it is done, if that is given.

        Raises:
            Cancelled: nobody waits for it any more.
        """
        if not self.is_left():
            raise Cancelled
        if doing or share is not None:
            self.tell(doing, share)

    def once(self, doing: str) -> None:
        """Says that something is done next which may take a minute, once: what comes out is kept on disk.

        Raises:
            Cancelled: nobody waits for it any more.
        """
        self.ask(doing)
        self.tell_once(doing)

    def over(self, items: Sequence[T], doing: str = "") -> Iterator[T]:
        """The items one by one, each asked for before its turn.

        Raises:
            Cancelled: nobody waits for it any more.
        """
        for k, item in enumerate(items):
            self.ask(doing if k == 0 else "", k / len(items))
            yield item


NEVER_CANCELLED = ProgressToken()
"""Of whoever waits until the end and need not be told anything."""
