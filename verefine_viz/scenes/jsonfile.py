"""JSON files of a data set: read with errors that name the file and the place in it, written whole or not at all."""

from __future__ import annotations

import gzip
import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.atomic import atomic
from verefine_viz.core.errors import InputError


def read_json(path: Path, kind: type[dict] | type[list]) -> Any:
    """The content of ``path`` (``.json`` or ``.json.gz``), whose top level must be of ``kind``.

    Raises:
        InputError: missing, unreadable, not JSON, or another kind of content.
    """
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from None
    try:
        if raw[:2] == b"\x1f\x8b":
            raw = gzip.decompress(raw)
        content = json.loads(raw.decode("utf-8-sig"))
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        raise InputError(f"{path} is a damaged gzip file ({error}); fetch it again") from None
    except json.JSONDecodeError as error:
        raise InputError(f"{path} is not JSON: {error.msg} in line {error.lineno}, column {error.colno}") from None
    except (ValueError, RecursionError) as error:  # no text, numbers of thousands of digits, thousands of brackets
        raise InputError(f"{path} is not JSON: {error}") from None
    if not isinstance(content, kind):
        wanted = "an object {…}" if kind is dict else "a list […]"
        raise InputError(f"{path} holds a JSON {type(content).__name__}, expected {wanted}")
    return content


def write_json(path: Path, content: Any) -> None:
    """Writes ``content``, whole or not at all.

    Raises:
        InputError: the file cannot be written.
    """
    with atomic(path) as part:
        part.write_text(json.dumps(content, indent=1), encoding="utf-8")


def key_of(entry: Any, key: str, where: str) -> Any:
    """``entry[key]``.

    Raises:
        InputError: ``entry`` is no JSON object, or has no such key.
    """
    if not isinstance(entry, dict):
        raise InputError(f"{where} is a JSON {type(entry).__name__}, expected an object with {key!r}")
    if key not in entry:
        raise InputError(f"{where} has no {key!r}; it has {', '.join(map(str, entry)) or 'nothing'}")
    return entry[key]


def integer_of(entry: Any, key: str, where: str) -> int:
    """``entry[key]`` as an integer.

    Raises:
        InputError: missing, or not an integer.
    """
    value = key_of(entry, key, where)
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 2**53 and value == int(value):
        return int(value)
    raise InputError(f"{where}: {key!r} is {_short(value)}, expected an integer")


def number_of(entry: Any, key: str, where: str) -> float:
    """``entry[key]`` as a finite number.

    Raises:
        InputError: missing, not a number, or not finite.
    """
    value = key_of(entry, key, where)
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300:
        return float(value)
    raise InputError(f"{where}: {key!r} is {_short(value)}, expected a finite number")


def numbers_of(entry: Any, key: str, n: int, where: str) -> Float:
    """``entry[key]`` as ``n`` finite numbers, however nested.

    Raises:
        InputError: missing, another count, not numbers, or not finite.
    """
    value = key_of(entry, key, where)
    try:
        numbers = np.asarray(value, dtype=np.float64).ravel()
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{where}: {key!r} does not hold numbers, expected {n}") from None
    if len(numbers) != n:
        raise InputError(f"{where}: {key!r} holds {len(numbers)} numbers, expected {n}")
    if not (np.abs(numbers) < 1e100).all():
        raise InputError(f"{where}: {key!r} holds NaN or infinity, expected finite numbers")
    return numbers


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:40] + "…"
