"""Building blocks of settings: their base class, the kinds of their values, and bounds in words."""

from __future__ import annotations

import ast
import inspect
import sys
from functools import cache
from itertools import pairwise
from typing import Annotated, Any, Literal, get_type_hints

import msgspec.inspect as mi
from msgspec import Meta, Struct

from verefine_viz.core.number_kinds import Index


class Settings(Struct, frozen=True, forbid_unknown_fields=True):
    """Base of all settings: immutable, unknown names refused; values are checked where they are read."""


# Bounds are far beyond sense: they keep a slip of the keyboard from filling the memory or running for ever.
Count = Annotated[int, Meta(ge=1, le=10_000)]
"""A count of iterations, hypotheses or steps."""
LargeCount = Annotated[int, Meta(ge=1, le=1_000_000)]
"""A count of points, bases or bins, which may be many thousands."""
Length = Annotated[float, Meta(ge=1e-5, le=10)]
"""A distance used as a threshold or a cell size [m]."""
LengthOrNone = Annotated[float, Meta(ge=0, le=10)]
"""A length, where 0 switches something off [m]."""
Share = Annotated[float, Meta(gt=0, lt=1)]
"""A share, above 0 and below 1."""
Weight = Annotated[float, Meta(ge=0, le=1e6)]
"""Weight of a term."""
InputPath = Annotated[str, Meta(pattern=r"\A[^\0]*\Z")]
"""Path of a file or folder."""
Component = Annotated[float, Meta(ge=-1e6, le=1e6)]
Gravity = Literal["plane", "world"] | tuple[Component, Component, Component]
Order = tuple[tuple[Index | str, ...], ...]
Pose = Annotated[tuple[float, ...], Meta(min_length=16, max_length=16)]
"""A transform, row by row [m]."""


@cache
def fields_of(model: type[Struct]) -> dict[str, mi.Field]:
    """The fields of some settings by name, with their types and defaults."""
    info = mi.type_info(model)
    assert isinstance(info, mi.StructType)
    return {field.name: field for field in info.fields}


@cache
def kinds_of(model: type[Struct]) -> dict[str, Any]:
    """The types of the fields as Python writes them, without bounds."""
    return get_type_hints(model)


@cache
def descriptions(model: type[Struct]) -> dict[str, str]:
    """The docstrings of the fields, which stand below them in the source."""
    texts: dict[str, str] = {}
    for cls in reversed(model.__mro__[: model.__mro__.index(Struct)]):
        for field, text in pairwise(_classes(cls.__module__)[cls.__name__].body):
            match field, text:
                case ast.AnnAssign(target=ast.Name(name)), ast.Expr(ast.Constant(str(words))):
                    texts[name] = inspect.cleandoc(words)
    return texts


@cache
def _classes(module: str) -> dict[str, ast.ClassDef]:
    parts = ast.parse(inspect.getsource(sys.modules[module])).body
    return {part.name: part for part in parts if isinstance(part, ast.ClassDef)}


def limits(kind: mi.Type) -> str:
    """The numbers that a field takes, as in "from 1 to 10000" or "above 0 and below 1"; empty without bounds."""
    if isinstance(kind, mi.UnionType):  # Of a number or None the bounds are those of the number.
        return next(filter(None, map(limits, kind.types)), "")
    if not isinstance(kind, mi.IntType | mi.FloatType) or (kind.le is None and kind.lt is None):
        return ""
    if kind.ge is not None and kind.le is not None:
        return f"from {kind.ge:.10g} to {kind.le:.10g}"
    first = f"above {kind.gt:g}" if kind.ge is None else f"at least {kind.ge:g}"
    last = f"below {kind.lt:g}" if kind.le is None else f"at most {kind.le:.10g}"
    return f"{first} and {last}"
