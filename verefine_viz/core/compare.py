"""Bit-for-bit comparison of records, timings left out: what "the same run" means."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


def first_difference(a: Any, b: Any, path: str = "") -> str | None:
    """The path of the first field in which two records differ (``stages[1].T_cam_obj``), or None if they are the same.

    Arrays are compared bit by bit (NaN equals NaN), floats by equality; fields marked as timing are left out.
    """
    if type(a) is not type(b):
        return f"{path or 'record'}: {type(a).__name__} against {type(b).__name__}"
    if is_dataclass(a):
        for f in fields(a):
            if not f.metadata.get("timing"):
                inner = f"{path}.{f.name}" if path else f.name
                found = first_difference(getattr(a, f.name), getattr(b, f.name), inner)
                if found:
                    return found
        return None
    if isinstance(a, np.ndarray):
        same = a.shape == b.shape and a.dtype == b.dtype and a.tobytes() == b.tobytes()
        return None if same else f"{path}: {_short(a)} against {_short(b)}"
    if isinstance(a, tuple | list):
        if len(a) != len(b):
            return f"{path}: {len(a)} entries against {len(b)}"
        found = (first_difference(x, y, f"{path}[{i}]") for i, (x, y) in enumerate(zip(a, b, strict=True)))
        return next((d for d in found if d), None)
    same = a == b or (isinstance(a, float) and a != a and b != b)
    return None if same else f"{path}: {a!r} against {b!r}"


def _short(array: np.ndarray) -> str:
    return f"{array.shape} {np.array2string(array.ravel()[:4], precision=9)}…"
