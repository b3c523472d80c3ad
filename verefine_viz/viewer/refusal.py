"""What is not done before a person has confirmed it."""

from __future__ import annotations

from verefine_viz.core.errors import InputError
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
