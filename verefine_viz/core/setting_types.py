"""What settings are made of: their base, and the kinds of values that they have, as users write them."""

from __future__ import annotations

import json
import sys
from typing import Annotated, Any, Literal, get_args

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field
from pydantic.fields import FieldInfo


class Settings(BaseModel):
    """Base of all settings: immutable, unknown names refused, docstrings become descriptions."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


# Bounds are far beyond sense: they keep a slip of the keyboard from filling the memory or running for ever.
Count = Annotated[int, Field(ge=1, le=10_000)]
"""How many of something: iterations, hypotheses, steps."""
LargeCount = Annotated[int, Field(ge=1, le=1_000_000)]
"""Of what there are thousands: points, bases, bins."""
Index = Annotated[int, Field(ge=0, le=2**31 - 1)]
"""The number of an object, an instance, a hypothesis, an iteration."""
Seed = Annotated[int, Field(ge=0, le=2**32 - 1)]
"""Of a random generator."""
Length = Annotated[float, Field(ge=1e-5, le=10, allow_inf_nan=False)]
"""A distance that something is compared with or divided into [m]."""
LengthOrNone = Annotated[float, Field(ge=0, le=10, allow_inf_nan=False)]
"""The same where 0 switches something off [m]."""
Share = Annotated[float, Field(gt=0, lt=1, allow_inf_nan=False)]
"""A part of a whole, neither none nor all of it."""
Weight = Annotated[float, Field(ge=0, le=1e6, allow_inf_nan=False)]
"""What a term is multiplied by."""


LARGEST = 1e6
"""What no number of a vector of gravity exceeds; all of them together are not below its inverse."""


def _gravity(value: Any) -> Any:
    """The words and vectors that define "up", checked together: pydantic would report what is wrong with both kinds."""
    if value in ("plane", "world"):
        return value
    if not isinstance(value, list | tuple) or len(value) != 3 or not all(map(_is_finite, value)):
        raise ValueError('expected "plane", "world" or three numbers [x, y, z]')
    if not any(value):
        raise ValueError("a direction cannot be (0, 0, 0)")
    if not 1 / LARGEST <= max(map(abs, value)) <= LARGEST:
        raise ValueError(f"expected a vector of 1e-6 to {LARGEST:g} in length")
    return value


def _is_finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def _as_written(value: Any) -> Any:
    """Clusters written on a command line, "[[8, 2], [3]]" or "[8, 2]" "[3]", which come as one cluster of words."""
    if isinstance(value, list | tuple) and len(value) == 1 and isinstance(value[0], list | tuple):
        words = value[0]
        if words and all(isinstance(word, str) and word.lstrip().startswith("[") for word in words):
            try:
                clusters = json.loads(f"[{','.join(words)}]")
            except (ValueError, RecursionError):  # No JSON, numbers of thousands of digits, thousands of brackets.
                raise ValueError('expected clusters of ids, as "[[8, 2], [3]]"') from None
            nested = len(clusters) == 1 and all(isinstance(entry, list) for entry in clusters[0])
            return clusters[0] if nested else clusters
    return value


def _without_nul(text: str) -> str:
    if "\0" in text:
        raise ValueError(r"it holds \0, which no path can")
    return text


InputPath = Annotated[str, AfterValidator(_without_nul)]
"""Where a file or folder lies."""
Gravity = Annotated[Literal["plane", "world"] | tuple[float, float, float], BeforeValidator(_gravity)]
Order = Annotated[tuple[tuple[Index | str, ...], ...], BeforeValidator(_as_written)]


def limits(field: FieldInfo) -> str:
    """The numbers that a field takes, as in "from 1 to 10000" or "above 0 and below 1"; empty without bounds."""
    metadata = list(field.metadata)
    for kind in get_args(field.annotation):  # Of a number or None the bounds are those of the number.
        metadata += [bound for info in getattr(kind, "__metadata__", ()) for bound in getattr(info, "metadata", ())]
    names = ("ge", "gt", "le", "lt")
    bounds = {name: getattr(bound, name) for bound in metadata for name in names if hasattr(bound, name)}
    if not {"le", "lt"} & bounds.keys():
        return ""
    if "ge" in bounds and "le" in bounds:
        return f"from {bounds['ge']:g} to {bounds['le']:.10g}"
    first = f"at least {bounds['ge']:g}" if "ge" in bounds else f"above {bounds['gt']:g}"
    last = f"at most {bounds['le']:.10g}" if "le" in bounds else f"below {bounds['lt']:g}"
    return f"{first} and {last}"
