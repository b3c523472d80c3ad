"""What settings are made of: their base, and the kinds of values that they have, read as people write them."""

from __future__ import annotations

import json
import sys
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field


class Settings(BaseModel):
    """Base of all settings: immutable, unknown names refused, docstrings kept."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1)]
Seed = Annotated[int, Field(ge=0)]


def _gravity(value: Any) -> Any:
    """The words and vectors that tell where "up" is: a field of two kinds would say what is wrong with both."""
    is_vector = isinstance(value, list | tuple) and len(value) == 3 and all(map(_is_finite, value))
    if not is_vector and value not in ("plane", "world"):
        raise ValueError('expected "plane", "world" or three numbers [x, y, z]')
    if is_vector and not any(value):
        raise ValueError("a direction cannot be (0, 0, 0)")
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
            except json.JSONDecodeError:
                raise ValueError('expected clusters of ids, as "[[8, 2], [3]]"') from None
            nested = len(clusters) == 1 and all(isinstance(entry, list) for entry in clusters[0])
            return clusters[0] if nested else clusters
    return value


Gravity = Annotated[Literal["plane", "world"] | tuple[float, float, float], BeforeValidator(_gravity)]
Order = Annotated[tuple[tuple[int | str, ...], ...], BeforeValidator(_as_written)]
