"""JSON files of a data set: read with errors that name the file and the place in it, written whole or not at all."""

from __future__ import annotations

import gzip
import json
import re
import sys
import zlib
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, ShapeError, quoted
from verefine_viz.core.geometry import check_reach
from verefine_viz.core.paths import atomic, read_input

MOST_NESTED = 40
"""Brackets within brackets that are read; the files of a data set have 3 to 6."""
MOST_DIGITS = 100
"""Of an id, with zeros in front."""
_TOO_DEEP = f"its brackets are nested more than {MOST_NESTED} deep"


def read_json(path: Path, kind: type[dict] | type[list]) -> Any:
    """The content of ``path`` (``.json`` or ``.json.gz``), whose top level must be of ``kind``.

    Raises:
        InputError: missing, unreadable, not JSON, nested too deeply, a key twice, or another kind of content.
    """
    content = parse_json(read_input(path), str(path))
    if not isinstance(content, kind):
        wanted = "an object {…}" if kind is dict else "a list […]"
        raise InputError(f"{path} holds a JSON {type(content).__name__}, expected {wanted}")
    return content


def parse_json(raw: bytes, name: str) -> Any:
    """The content of a JSON file, also of a gzipped one, given its bytes; ``name`` is the file's, for messages.

    Raises:
        InputError: they are not JSON, nested deeper than ``MOST_NESTED``, or an object has a key twice.
    """
    try:
        if raw[:2] == b"\x1f\x8b":
            raw = gzip.decompress(raw)
        content = json.loads(raw.decode("utf-8-sig"), object_pairs_hook=_each_once)
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        raise InputError(f"{name} is a damaged gzip file ({error}); fetch it again") from None
    except json.JSONDecodeError as error:
        raise InputError(f"{name} is not JSON: {error.msg} in line {error.lineno}, column {error.colno}") from None
    except RecursionError:
        raise InputError(f"{name} is not JSON that can be read: {_TOO_DEEP}") from None
    except ValueError as error:
        # Python reads no integer of more digits than this, as that takes time with their square.
        is_long = str(error).startswith("Exceeds the limit")
        why = f"a number has more than {sys.get_int_max_str_digits()} digits" if is_long else str(error)
        raise InputError(f"{name} is not JSON that can be read: {why}") from None
    except InputError as error:
        raise InputError(f"{name} {error}") from None
    level = [content] if isinstance(content, dict | list) else []
    for _ in range(MOST_NESTED):
        entries = (entry for one in level for entry in (one.values() if isinstance(one, dict) else one))
        level = [entry for entry in entries if isinstance(entry, dict | list)]
        if not level:
            return content
    raise InputError(f"{name} is not JSON that can be read: {_TOO_DEEP}")


def read_numbered(path: Path, of: str) -> dict[int, Any]:
    """The content of a JSON object whose keys are numbers, such as ids of images; leading zeros count for nothing.

    Args:
        path: as :func:`read_json`.
        of: what the keys number, for messages: "image", "object".

    Raises:
        InputError: as :func:`read_json`, a key is no number, or two keys are the same number.
    """
    written: dict[int, str] = {}
    content = read_json(path, dict)
    for key in content:
        number = id_of(key)
        if number is None:
            raise InputError(f"{path} has {quoted(key, 40)} for an {of}, expected its number, as in {{'0': …, '1': …}}")
        if number in written:
            raise InputError(f"{path} has {written[number]!r} and {key!r} for the same {of}; delete one of them")
        written[number] = key
    return {number: content[key] for number, key in written.items()}


def id_of(text: str) -> int | None:
    """The number that a text is, whatever zeros are in front of it; None where it is none, or has over 18 digits."""
    return int(text) if re.fullmatch(r"0*\d{1,18}", text, re.ASCII) and len(text) <= MOST_DIGITS else None


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
        raise InputError(f"{where} has no {key!r}; it has {', '.join(map(_shown, entry)) or 'nothing'}")
    return entry[key]


def integer_of(entry: Any, key: str, where: str) -> int:
    """``entry[key]`` as an integer.

    Raises:
        InputError: missing, or not an integer.
    """
    value = key_of(entry, key, where)
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 2**53 and value == int(value):
        return int(value)
    raise InputError(f"{where}: {key!r} is {quoted(value, 40)}, expected an integer")


def number_of(
    entry: Any, key: str, where: str, low: float = -1e300, high: float = 1e300, expected: str = "a finite number"
) -> float:
    """``entry[key]`` as a finite number.

    Args:
        entry: the JSON object.
        key: of the number.
        where: what to call the entry in an error.
        low: least value.
        high: largest value.
        expected: unit and bounds, for the message.

    Raises:
        InputError: missing, not a number, not finite, or out of bounds.
    """
    value = key_of(entry, key, where)
    if not isinstance(value, int | float) or isinstance(value, bool) or not abs(value) <= 1e300:
        raise InputError(f"{where}: {key!r} is {quoted(value, 40)}, expected a finite number")
    if not low <= value <= high:
        raise InputError(f"{where}: {key!r} is {quoted(value, 40)}, expected {expected}")
    return float(value)


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


def position_of(entry: Any, key: str, where: str) -> Float:
    """``entry[key]`` as a position (3,) [mm].

    Raises:
        InputError: as :func:`numbers_of`, or it is further away than ``FARTHEST_M``.
    """
    t_mm = numbers_of(entry, key, 3, where)
    try:
        check_reach(t_mm * 1e-3, f"{where}: {key!r}")
    except ShapeError as error:
        raise InputError(str(error)) from None
    return t_mm


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object; of a key that is there twice Python would silently take the last."""
    entry = dict(pairs)
    if len(entry) < len(pairs):
        twice = Counter(key for key, _ in pairs).most_common(1)[0][0]
        raise InputError(f"has the key {quoted(twice, 40)} twice in one object; delete one of them")
    return entry


def _shown(name: object) -> str:
    """A key as it is where that fits a line, else quoted."""
    return str(name) if str(name).isprintable() else quoted(name)
