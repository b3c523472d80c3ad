"""Bit-for-bit comparison of records, timings left out: what "the same run" means."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Difference:
    """A field in which two records differ."""

    words: str
    """Which field, and how: ``stages[1].T_cam_obj[0, 3]: 0.5 against 0.5000000000000001, by 1.1e-16``."""
    size: float
    """How far its numbers are apart, as a share of the larger one where that is above 1; infinite where it does not
    hold floating-point numbers, as many in both."""


def first_difference(a: Any, b: Any, path: str = "") -> str | None:
    """The path of the first field in which two records differ (``stages[1].T_cam_obj``), or None if they are the same.

    Arrays are compared bit by bit (NaN equals NaN), floats by equality; fields marked as timing are left out.
    """
    return next((found.words for found in differences(a, b, path)), None)


def differences(a: Any, b: Any, path: str = "") -> Iterator[Difference]:
    """All fields in which two records differ, as :func:`first_difference` compares them, in the order of the fields."""
    if type(a) is not type(b):
        yield Difference(f"{path or 'record'}: {type(a).__name__} against {type(b).__name__}", math.inf)
    elif is_dataclass(a):
        for f in fields(a):
            if not f.metadata.get("timing"):
                inner = f"{path}.{f.name}" if path else f.name
                yield from differences(getattr(a, f.name), getattr(b, f.name), inner)
    elif isinstance(a, np.ndarray):
        if a.shape != b.shape or a.dtype != b.dtype:
            yield Difference(f"{path}: {a.dtype} {a.shape} against {b.dtype} {b.shape}", math.inf)
        elif a.tobytes() != b.tobytes():
            yield _of_arrays(a, b, path)
    elif isinstance(a, tuple | list):
        if len(a) != len(b):
            yield Difference(f"{path}: {len(a)} entries against {len(b)}", math.inf)
        else:
            for i, (x, y) in enumerate(zip(a, b, strict=True)):
                yield from differences(x, y, f"{path}[{i}]")
    elif a != b and not (isinstance(a, float) and a != a and b != b):
        yield _of_values(a, b, path)


def _of_arrays(a: np.ndarray, b: np.ndarray, path: str) -> Difference:
    """The furthest apart of the entries of two arrays of the same shape and type that are not the same bits."""
    values_a, values_b = a.ravel().tolist(), b.ravel().tolist()
    bits_a, bits_b = (np.ascontiguousarray(x).view(np.uint8).reshape(a.size, -1) for x in (a, b))
    differing = np.flatnonzero((bits_a != bits_b).any(axis=1)).tolist()
    sizes = {k: _size(values_a[k], values_b[k]) for k in differing}
    k = max(differing, key=lambda k: sizes[k])
    place = ", ".join(str(i) for i in np.unravel_index(k, a.shape))
    found = _of_values(values_a[k], values_b[k], f"{path}[{place}]")
    more = f", the largest of {len(differing)} differences in it" if len(differing) > 1 else ""
    return Difference(found.words + more, found.size)


def _of_values(a: Any, b: Any, path: str) -> Difference:
    size = _size(a, b)
    if isinstance(a, float):
        a, b = float(a), float(b)  # So that numpy's own are shown as numbers.
    by = f", by {abs(a - b):.2g}" if 0 < size < math.inf else ""
    return Difference(f"{path}: {a!r} against {b!r}{by}", size)


def _size(a: Any, b: Any) -> float:
    if not isinstance(a, float):
        return math.inf
    size = abs(a - b) / max(1.0, abs(a), abs(b))
    return math.inf if math.isnan(size) else size
