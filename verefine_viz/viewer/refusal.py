"""What is not done before a person has confirmed it, and what could not be done."""

from __future__ import annotations

from verefine_viz.core.errors import InputError
from verefine_viz.refiners.foreign import raised_by_refiner
from verefine_viz.viewer.command import Command


class Unconfirmed(InputError):
    """Something would be lost: nothing was done, and ``command`` does it all the same.

    Args:
        text: what would be lost, and what else can be done; the link ends it.
        label: words of the link.
        command: what the link sends.
    """

    def __init__(self, text: str, label: str, command: Command) -> None:
        super().__init__(text)
        self.label, self.command = label, command


def told(error: Exception) -> str:
    """What the page says of an error that nobody foresaw: a bug, unless a refiner of another program raised it."""
    said = raised_by_refiner(error)
    if not said:
        return f"{type(error).__name__}: {error} (a bug: please report it with the log)"
    return f"{said[0].upper()}{said[1:]}. The run stands before it: mend the refiner, then start the program again."
