"""Every field of a session as a command line option: ``--method.name sir --score.tau-m 0.01``.

The options are made from the settings models, so names, defaults and texts are written once. Values are only parsed
here; they are checked together with the session file, by the same rules and with the same messages.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Annotated, Any

import tyro
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from verefine_viz.core.fields import limits
from verefine_viz.core.settings import Session

NOT_OPTIONS = ("edits", "changes", "waiting")
"""What the page saves: lists of tables, too long to type, and numbers that only wait there."""


def _flags_of(model: type[BaseModel]) -> Any:
    """A plain dataclass with the fields, defaults and texts of a settings model, without its checks."""
    fields: list[tuple[str, Any, Any]] = []
    for name, info in model.model_fields.items():
        if name in NOT_OPTIONS:
            continue
        if isinstance(info.default, BaseModel):
            group = _flags_of(type(info.default))
            fields.append((name, group, dataclasses.field(default_factory=group)))
        else:
            kind = Annotated[info.annotation, tyro.conf.arg(help=_help(info))]
            fields.append((name, kind, dataclasses.field(default=info.default)))
    flags = dataclasses.make_dataclass(model.__name__, fields, frozen=True)
    flags.__doc__ = model.__doc__
    return flags


def _help(info: FieldInfo) -> str:
    """What ``--help-settings`` says of a field: its text, and the numbers that it takes."""
    bounds = limits(info)
    return f"{info.description or ''}{f' {bounds[0].upper()}{bounds[1:]}.' if bounds else ''}"


SessionFlags: Any = _flags_of(Session)
"""Dataclass of all options of a session; only those that were written on the command line count."""

AnySettings = Annotated[Any, tyro.conf.arg(name="", constructor=SessionFlags), tyro.conf.FlagConversionOff]
"""The type of a command's field that takes all of them."""


def given(flags: Any, arguments: Sequence[str]) -> dict[str, Any]:
    """The options that were written on the command line, nested as in a session file.

    Which ones were written is read from the arguments themselves: an option that repeats a default is still explicit,
    and wins over a preset.
    """
    written = {a.split("=", 1)[0].replace("_", "-") for a in arguments if a.startswith("--")}
    return _given(flags, "--", written)


def _given(flags: Any, prefix: str, written: set[str]) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for field in dataclasses.fields(flags):
        value = getattr(flags, field.name)
        flag = prefix + field.name.replace("_", "-")
        if dataclasses.is_dataclass(value):
            inner = _given(value, f"{flag}.", written)
            if inner:
                out[field.name] = inner
        elif flag in written:
            out[field.name] = value
    return out
