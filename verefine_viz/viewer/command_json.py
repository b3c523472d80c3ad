"""Commands as lines of JSON: in files, in links of the page, and in what a browser sends."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import Any, get_type_hints

import msgspec

from verefine_viz.core.errors import InputError, unknown
from verefine_viz.viewer import commands, grasp_commands
from verefine_viz.viewer.commands import Command

COMMANDS: dict[str, type[Command]] = {
    name: kind
    for name, kind in (vars(commands) | vars(grasp_commands)).items()
    if isinstance(kind, type) and issubclass(kind, Command) and not kind.__subclasses__()
}
"""Every command by its name."""


def to_json(command: Command) -> str:
    """A command as one line: ``{"command": "Seek", "cursor": 17}``."""
    values = {f.name: getattr(command, f.name) for f in fields(command)}
    return json.dumps({"command": type(command).__name__, **values}, ensure_ascii=False)


def from_json(text: str) -> Command:
    """The command that :func:`to_json` wrote.

    Raises:
        InputError: not a command, or one with fields that it does not have.
    """
    try:
        data = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(f"not a command: {error}") from None
    name = data.pop("command", None) if isinstance(data, dict) else data
    if not isinstance(name, str) or name not in COMMANDS:
        raise InputError(unknown("command", name, COMMANDS))
    cls = COMMANDS[name]
    hints = get_type_hints(cls)
    for field, value in data.items():
        if field not in {f.name for f in fields(cls)}:
            raise InputError(f"command {name} has no field {field!r}")
        data[field] = _tuples(value)
        try:
            msgspec.convert(data[field], hints[field])
        except msgspec.ValidationError as error:
            raise InputError(f"command {name}: {field} = {value!r} is not right: {error}") from None
    try:
        return cls(**data)
    except TypeError as error:
        raise InputError(f"command {name}: {error}") from None


def _tuples(value: Any) -> Any:
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value
