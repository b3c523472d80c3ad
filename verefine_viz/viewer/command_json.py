"""Commands as lines of JSON: in files, in links of the page, and in what a browser sends."""

from __future__ import annotations

import json
import types
from dataclasses import fields
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from verefine_viz.core.errors import InputError, unknown
from verefine_viz.viewer import commands, comparison_commands
from verefine_viz.viewer.commands import Command

COMMANDS: dict[str, type[Command]] = {
    name: kind
    for module in (commands, comparison_commands)
    for name, kind in vars(module).items()
    if isinstance(kind, type) and issubclass(kind, Command) and kind is not Command
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
    if not isinstance(data, dict) or data.get("command") not in COMMANDS:
        name = data.get("command") if isinstance(data, dict) else data
        raise InputError(unknown("command", name, COMMANDS))
    cls = COMMANDS[data.pop("command")]
    hints = get_type_hints(cls)
    for name, value in data.items():
        if name not in {f.name for f in fields(cls)}:
            raise InputError(f"command {cls.__name__} has no field {name!r}")
        data[name] = _tuples(value)
        if not _fits(data[name], hints[name]):
            raise InputError(f"command {cls.__name__}: {name} = {value!r} is not a {hints[name]}")
    try:
        return cls(**data)
    except TypeError as error:
        raise InputError(f"command {cls.__name__}: {error}") from None


def _tuples(value: Any) -> Any:
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value


def _fits(value: Any, hint: Any) -> bool:
    """Whether a JSON value is of the annotated type; only the kinds of annotation that commands have."""
    origin, args = get_origin(hint), get_args(hint)
    if hint is Any:
        return True
    if origin is Literal:
        return value in args
    if origin in (Union, types.UnionType):
        return any(_fits(value, a) for a in args)
    if origin is tuple:
        if not isinstance(value, tuple):
            return False
        if args and args[-1] is Ellipsis:
            return all(_fits(v, args[0]) for v in value)
        return len(value) == len(args) and all(_fits(v, a) for v, a in zip(value, args, strict=True))
    if hint is float:
        return isinstance(value, int | float) and not isinstance(value, bool)
    if hint is int:
        return isinstance(value, int) and not isinstance(value, bool)
    return isinstance(value, hint)
