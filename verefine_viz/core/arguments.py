"""Checks the arguments of the library's calls: type and size, else an error in one line."""

from __future__ import annotations

import operator
import os
from collections.abc import Mapping
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import numpy as np

from verefine_viz.core.errors import ArgumentTypeError, InputError, one_line, quoted

SHOWN = 40
"""Length of a quoted value [characters]."""
LONGEST_PATH, LONGEST_PART = 4000, 255
"""No system takes longer paths [characters], or names of a file or a folder [bytes]."""
LONGEST_NAME = 200
"""No name of an object, a frame or a part is longer [characters]."""


def described(value: object) -> str:
    """A value as a message names it: written out where it is short, else its type."""
    if value is None or isinstance(value, bool | int | float | complex | str):
        return quoted(value, SHOWN)
    if isinstance(value, np.generic):
        return described(value.item()) if value.dtype.kind in "biufcU" else f"a {type(value).__name__}"
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}"
    kind = type(value).__name__
    return f"{'an' if kind[:1].lower() in 'aeiou' else 'a'} {kind}"


def checked_path(value: object, name: str, expected: str) -> Path:
    """A path; InputError where the value is none, as in "out is None, expected the HTML file"."""
    if not isinstance(value, str | os.PathLike) or not isinstance(path := os.fspath(value), str):
        raise ArgumentTypeError(f"{name} is {described(value)}, expected {expected}")
    if not path or "\0" in path:
        raise InputError(f"{name} is {quoted(path, SHOWN)}, expected {expected}")
    try:
        longest = max(len(os.fsencode(part)) for part in path.split("/"))
    except UnicodeEncodeError:
        raise InputError(
            f"{name} is {quoted(path, SHOWN)}, which holds half a character; expected {expected}"
        ) from None
    if longest > LONGEST_PART or len(path) > LONGEST_PATH:
        raise InputError(f"{name} is {quoted(path, SHOWN)}, which is too long for a path; expected {expected}")
    return Path(path)


def checked_text(value: object, name: str, expected: str) -> str:
    """A text, which may be empty; InputError where the value is none, or longer than a name may be."""
    if not isinstance(value, str):
        raise ArgumentTypeError(f"{name} is {described(value)}, expected {expected}")
    if len(value) > LONGEST_NAME:
        raise InputError(f"{name} has {len(value)} characters, expected at most {LONGEST_NAME}")
    return value


def checked_name(value: object, name: str) -> str:
    """A text to show, in one line and not empty; InputError where the value is none."""
    text = one_line(checked_text(value, name, "a text")).strip()
    if not text:
        raise InputError(f"{name} is {described(value)}, expected a text")
    return text


def checked_count(value: Any, name: str, least: int, most: int) -> int:
    """A whole number from ``least`` to ``most``; InputError where the value is none."""
    expected = f"expected a whole number from {least} to {most}"
    try:
        number = operator.index(value)
    except TypeError:
        raise ArgumentTypeError(f"{name} is {described(value)}, {expected}") from None
    if isinstance(value, bool) or not least <= number <= most:
        raise InputError(f"{name} is {described(value)}, {expected}")
    return number


def checked_choice(value: object, name: str, choices: tuple[str, ...]) -> str:
    """One of some words; InputError where the value is none of them."""
    if not isinstance(value, str) or value not in choices:
        raise InputError(f"{name} is {described(value)}, expected {' or '.join(map(repr, choices))}")
    return value


def checked_flag(value: object, name: str) -> bool:
    """True or False; ArgumentTypeError where the value is neither."""
    if not isinstance(value, bool | np.bool_):
        raise ArgumentTypeError(f"{name} is {described(value)}, expected True or False")
    return bool(value)


def plain_value(value: Any) -> Any:
    """A value as settings files have it: of numpy's numbers and arrays Python's, of a path its text."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: plain_value(inner) for key, inner in value.items()}
    if isinstance(value, tuple | list):
        return [plain_value(inner) for inner in value]
    if isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value)
    if isinstance(value, os.PathLike) and isinstance(path := os.fspath(value), str):
        return path
    return value


def checked_mapping(value: object, name: str, expected: str) -> Mapping[str, Any]:
    """A mapping by text; ArgumentTypeError where the value is none."""
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise ArgumentTypeError(f"{name} is {described(value)}, expected {expected}")
    return value
