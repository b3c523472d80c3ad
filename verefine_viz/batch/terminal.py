"""The terminal, as all commands write to it."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.text import Text


class Terminal(Console):
    """A console on which names and notes that come from files are plain text, without control characters."""

    def render_str(self, text: str, **options: Any) -> Text:
        """As its base; colours come from its markup, never from codes in the text."""
        return super().render_str("".join(c if c.isprintable() or c in "\n\t" else "�" for c in text), **options)
