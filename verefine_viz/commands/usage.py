"""What is wrong with words that make no command, in one line: tyro says it in a box of a dozen."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from verefine_viz.commands.expected import refusal, section_of

_ROW = re.compile(r"(?:│ |  )(.*?)\s*│?")
"""A line of a box, in UTF-8 or where the terminal has none; its title is on another."""
_RULE = re.compile(r"[─-]+")
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_UNPARSED = re.compile(r"Error parsing (--[\w.-]+):")
_HELP = " " * 8
"""What the text of an option begins with, below its name; ``--help`` says it."""


def one_line(box: str, program: str, command: type | None, words: Sequence[str]) -> str:
    """What a box of tyro's says, without its frame and the texts of options.

    Args:
        box: as it was printed.
        program: the words whose ``--help`` says more.
        command: the command's dataclass, if the words name one.
        words: the command line.
    """
    first, *others = _sections(_COLOUR.sub("", box)) or [[]]
    said = _joined(line for line in first if not line.startswith(_HELP)) or _joined(box.splitlines())
    refused = _UNPARSED.match(said)
    if command and refused and (why := refusal(command, refused.group(1), words)):
        section = section_of(refused.group(1))
        return f"{why}; see {program} {f'--help-settings {section}' if section else '--help'}"
    parts = [said[:1].lower() + said[1:].removesuffix(".")]
    for section in others:
        if section[0].startswith(("Perhaps you meant", "Arguments similar to")):
            names = [line.split()[0] for line in section[1:] if re.match(r" {4}--", line)]
            parts.append(f"{section[0].removesuffix(':').lower()} {' or '.join(names)}")
        elif section[0].startswith(("Available subcommands", "Unrecognized options")):
            text = _joined(section)
            parts.append(text[:1].lower() + text[1:])
    return "; ".join([*parts, f"see {program} --help"])


def _sections(box: str) -> list[list[str]]:
    """The rows between its rules."""
    sections: list[list[str]] = [[]]
    for row in _rows(box):
        if _RULE.fullmatch(row):
            sections.append([])
        elif row.strip():
            sections[-1].append(row)
    return [section for section in sections if section]


def _rows(box: str) -> Iterator[str]:
    for line in box.splitlines():
        if found := _ROW.fullmatch(line.rstrip()):
            yield found.group(1)


def _joined(lines: Iterator[str] | list[str]) -> str:
    return " ".join(" ".join(lines).split())
