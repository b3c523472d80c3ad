"""What an option takes, in plain words: tyro answers with the names of its types."""

from __future__ import annotations

import dataclasses
import types
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from verefine_viz.commands.flags import SessionFlags
from verefine_viz.core.errors import quoted

_WORDS = {int: "an integer", float: "a number", bool: "True or False", str: "a word", Path: "a path"}
_MANY = {"an integer": "integers", "a number": "numbers", "a word": "words", "a path": "paths"}


def refusal(command: type, option: str, words: Sequence[str]) -> str | None:
    """``--seeds is 'abc', expected an integer``; None where the command has no such option.

    Args:
        command: the command's dataclass.
        option: as it is written, ``--scene.gravity``.
        words: the command line.
    """
    kind = _kind(command, option)
    if kind is None:
        return None
    return f"{option} is {quoted(' '.join(_written(option, words)))}, expected {in_words(kind)}"


def section_of(option: str) -> str:
    """The section of a setting's option, ``scene`` of ``--scene.gravity``; empty for an option of the command."""
    section, dot, _ = option.removeprefix("--").partition(".")
    return section if dot else ""


def in_words(kind: Any) -> str:
    """What a type takes: ``3 numbers`` of tuple[float, float, float]; what None stands for goes without saying."""
    ways = _ways(kind)
    return f"{', '.join(ways[:-1])} or {ways[-1]}" if len(ways) > 1 else ways[0]


def _ways(kind: Any) -> list[str]:
    """What a type takes, one or the other."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _ways(inner[0])
    if origin in (Union, types.UnionType):
        return [way for part in inner if part is not type(None) for way in _ways(part)]
    if origin is Literal:
        return [str(choice) for choice in inner]
    if origin is not tuple:
        return [_WORDS.get(kind, "something else")]
    if inner[1:] == (...,):
        each = in_words(inner[0])
        return [f"{_MANY.get(each, f'groups of {each}')}, separated by blanks"]
    parts = [in_words(part) for part in inner]
    is_one_kind = len(set(parts)) == 1 and parts[0] in _MANY
    return [f"{len(parts)} {_MANY[parts[0]]}" if is_one_kind else " and ".join(parts)]


def _kind(command: type, option: str) -> Any:
    """The type of an option's value."""
    section, name = section_of(option).replace("-", "_"), option.removeprefix("--").rpartition(".")[2].replace("-", "_")
    if section:
        group = next((f.type for f in dataclasses.fields(SessionFlags) if f.name == section), None)
        fields = {f.name: f.type for f in dataclasses.fields(group)} if isinstance(group, type) else {}
        return fields.get(name)
    return get_type_hints(command, include_extras=True).get(name)


def _written(option: str, words: Sequence[str]) -> list[str]:
    """The words behind an option, as far as the next one."""
    found: list[str] = []
    is_behind = False
    for word in words:
        name, equals, value = word.partition("=")
        if word.startswith("--"):
            is_behind = name.replace("_", "-") == option
            found = [value] if is_behind and equals else [] if is_behind else found
        elif is_behind:
            found.append(word)
    return found
