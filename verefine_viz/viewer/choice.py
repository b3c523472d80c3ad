"""A list of commands to choose from, small enough to stand three in a row."""

from __future__ import annotations

from collections.abc import Sequence

from verefine_viz.viewer.command import Command
from verefine_viz.viewer.command_lines import to_json
from verefine_viz.viewer.markup import text


def choice(title: str, options: Sequence[tuple[str, Command]], now: Command) -> str:
    """A drop-down list of (label, command); ``title`` is said to those who ask, ``now`` is what holds."""
    items = "".join(
        f'<option value="{text(to_json(command))}"{" selected" if command == now else ""}>{text(label)}</option>'
        for label, command in options
    )
    name = text(title)
    return f'<select aria-label="{name}" title="{name}">{items}</select>'
