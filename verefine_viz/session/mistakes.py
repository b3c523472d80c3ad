"""What is wrong with a field of a session, and who wrote it, in one line."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, get_args, get_origin

from pydantic import ValidationError

from verefine_viz.core.errors import meant, quoted
from verefine_viz.core.settings import Session
from verefine_viz.session.sources import Layer


def written_in(layers: Sequence[Layer], error: ValidationError) -> str:
    """The layer that has what is wrong: the last in which the field stands."""
    location = error.errors()[0]["loc"]
    return max(reversed(layers), key=lambda layer: _depth(layer[1], location))[0]


def _depth(raw: Any, location: tuple[int | str, ...]) -> int:
    """How many steps towards a field the settings have."""
    for k, part in enumerate(location):
        if not isinstance(raw, Mapping) or part not in raw:
            return k
        raw = raw[part]
    return len(location)


def first_mistake(error: ValidationError) -> str:
    """The first thing that is wrong, in one line."""
    detail = error.errors()[0]
    field = _field(detail["loc"])
    if detail["type"] == "extra_forbidden":
        names = _siblings(detail["loc"])
        return f"unknown field {field!r}; {meant(detail['loc'][-1], names)}available: {', '.join(names)}"
    if detail["type"] == "tuple_type":
        return f"{field} = {quoted(detail['input'])}: expected a list{_example(detail['loc'], detail['input'])}"
    if detail["type"] == "model_type":
        return f"{field} = {quoted(detail['input'])}: expected a section, [{field}]"
    # A field of several kinds (a word or a vector) fails once for each of them.
    ways = [d["msg"].lower().removeprefix("value error, ") for d in error.errors() if _field(d["loc"]) == field]
    if detail["loc"][:2] == ("scene", "objects"):
        ways = ["expected the id of an object, as 5 for obj_000005.ply"]
    return f"{field} = {quoted(detail['input'])}: {', or '.join(dict.fromkeys(ways))}{_unit(field)}"


def _field(location: tuple[int | str, ...]) -> str:
    """``scene.gravity`` of ("scene", "gravity", "literal['plane','world']")."""
    return ".".join(str(part) for part in location if not (isinstance(part, str) and _KIND.search(part)))


_KIND = re.compile(r"[\[(]|^(constrained-int|int|str)$")
"""One of the kinds that a field may be of; pydantic appends it to the field."""


def _unit(field: str) -> str:
    unit = _UNITS.get(field.rpartition("_")[2])
    return f", in {unit}" if unit else ""


_UNITS = {"m": "metres", "mm": "millimetres", "deg": "degrees"}


def _example(location: tuple[int | str, ...], value: Any) -> str:
    """The list that somebody meant who wrote its only entry, or nothing."""
    if value == "":
        return ", []"
    model: Any = Session
    for part in location:
        model = getattr(getattr(model, "model_fields", {}).get(part), "annotation", None)
    kind = next(iter(get_args(model)), None)
    if get_origin(kind) is Annotated:
        kind = get_args(kind)[0]
    is_only_entry = get_origin(model) is tuple and kind is type(value)
    return f", {json.dumps([value], ensure_ascii=False)}" if is_only_entry else ""


def _siblings(location: tuple[int | str, ...]) -> list[str]:
    model: Any = Session
    for part in location[:-1]:
        model = getattr(model.model_fields.get(part), "annotation", None)
        if not hasattr(model, "model_fields"):
            return []
    return sorted(model.model_fields)
