"""Arrays of numbers in a MATLAB file, version 5 to 7.

SciPy's reader takes the types that a damaged file names for addresses, and ends the process.
Source: MathWorks, MAT-File Format, "Level 5 MAT-File Format".
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.errors import ContentError
from verefine_viz.core.files import reading

MOST_BYTES = 50_000_000
"""Largest file, and largest array as it is unpacked."""
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Types of elements by the format's number."""
_MATRIX, _COMPRESSED = 14, 15
_CLASSES = range(6, 16)
"""Classes of matrices: double, single, and whole numbers."""
_HEAD_BYTES = 128


def mat_arrays(path: Path, *names: str) -> dict[str, NDArray[np.float64]]:
    """The arrays of a MATLAB file that it has, of the given names.

    Raises:
        InputError: it is damaged, of version 7.3, or one of them does not hold real numbers.
    """
    with reading(path, most_bytes=MOST_BYTES) as file:
        content = file.read()
        order = {b"IM": "<", b"MI": ">"}.get(content[126:_HEAD_BYTES])
        if order is None or not content.startswith(b"MATLAB 5.0"):
            is_later = content.startswith(b"MATLAB 7.3")
            raise ContentError("MATLAB 7.3 is not read; save it with -v7" if is_later else "it is no MATLAB file")
        arrays: dict[str, NDArray[np.float64]] = {}
        for kind, body in _elements(content[_HEAD_BYTES:], order):
            if kind == _COMPRESSED:
                kind, body = _unpacked(body, order)
            if kind == _MATRIX:
                arrays |= _array(body, order, names)
        return arrays


def _unpacked(body: bytes, order: str) -> tuple[int, bytes]:
    decoder = zlib.decompressobj()
    raw = decoder.decompress(body, MOST_BYTES)
    if decoder.unconsumed_tail:
        raise ContentError(f"an array of it unpacks to more than {MOST_BYTES / 1e6:g} MB")
    if not decoder.eof:
        raise ContentError("its data end before the end of an array; fetch it again")
    return next(_elements(raw, order), (0, b""))


def _elements(content: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Type and content of what follows one another; up to four bytes stand within the head."""
    at = 0
    while at + 8 <= len(content):
        kind, n = struct.unpack_from(f"{order}II", content, at)
        if kind >> 16:
            kind, n, start, at = kind & 0xFFFF, kind >> 16, at + 4, at + 8
        else:
            start, at = at + 8, at + 8 + (n if kind == _COMPRESSED else -(-n // 8) * 8)
        if start + n > len(content):
            raise ContentError("its data end before the end of an array; fetch it again")
        yield kind, content[start : start + n]


def _array(body: bytes, order: str, names: Collection[str]) -> dict[str, NDArray[np.float64]]:
    """A matrix by its name, where it is one of ``names``."""
    flags, dimensions, name, *numbers = [*_elements(body, order), *[(0, b"")] * 3]
    called = name[1].decode("latin-1")
    if called not in names:
        return {}
    what = int.from_bytes(flags[1][:4], "little" if order == "<" else "big")
    is_complex, kind = bool(what & 0x800), what & 0xFF
    dtype = _NUMBERS.get(numbers[0][0])
    if kind not in _CLASSES or is_complex or dtype is None or dimensions[0] != 5:
        raise ContentError(f"{called!r} holds no real numbers")
    shape = np.frombuffer(dimensions[1][: len(dimensions[1]) // 4 * 4], f"{order}i4").tolist()
    data = numbers[0][1]
    if min(shape, default=-1) < 0 or math.prod(shape) * np.dtype(dtype).itemsize != len(data):
        raise ContentError(f"{called!r} of shape {tuple(shape)} has {len(data)} bytes; fetch it again")
    return {called: np.frombuffer(data, order + dtype).astype(np.float64).reshape(shape, order="F")}
