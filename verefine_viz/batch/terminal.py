"""The terminal, as all commands write to it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rich.console import Console
from rich.segment import Segment
from rich.text import Text

from verefine_viz.core.text_format import plain


class Terminal(Console):
    """A console on which names and notes that come from files are plain text, without control characters."""

    def render_str(self, text: str, **options: Any) -> Text:
        """As its base; colours come from its markup, never from codes in the text."""
        return super().render_str(plain(text), **options)

    def render(self, renderable: Any, options: Any = None) -> Iterable[Segment]:
        """As its base, also of texts that were made elsewhere."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(plain(segment.text), segment.style)
