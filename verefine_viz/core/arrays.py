"""Read-only, shape-checked arrays: what every frozen record holds."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from verefine_viz.core.errors import ContentError, ShapeError

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]


def frozen(value: ArrayLike, name: str, shape: tuple[int | None, ...], dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """A read-only array of ``value``, copied unless it already is one.

    Args:
        value: anything array-like.
        name: what to call it in an error.
        shape: expected shape; ``None`` stands for any length.
        dtype: expected element type; conversion is done.

    Raises:
        ShapeError: the shape differs.
    """
    try:
        if isinstance(value, np.ndarray) and value.dtype.kind not in "biufO":  # numpy drops the imaginary part.
            raise TypeError
        array = np.asarray(value, dtype=dtype)
    except (TypeError, ValueError, OverflowError):
        raise ShapeError(f"{name} is no array of numbers, expected {_shape_text(shape)}") from None
    if array.shape != shape and (
        array.ndim != len(shape) or any(want not in (None, got) for want, got in zip(shape, array.shape, strict=True))
    ):
        raise ShapeError(f"{name} has shape {array.shape}, expected {_shape_text(shape)}")
    if array.flags.writeable:
        array = array.copy()
        array.flags.writeable = False
    return array


def _shape_text(shape: tuple[int | None, ...]) -> str:
    letters = iter("nmkl")
    return "×".join(next(letters) if n is None else str(n) for n in shape)


def set_fields(record: object, **arrays: object) -> None:
    """Put checked arrays into a frozen dataclass: for its ``__post_init__`` only, while nothing else knows it."""
    for name, value in arrays.items():
        object.__setattr__(record, name, value)


def writable(value: ArrayLike) -> Float:
    """Return a plain copy of float64: numba compiles a kernel for read-only arrays once more."""
    return np.array(value, dtype=np.float64, order="C")


def finite(value: ArrayLike, name: str, shape: tuple[int | None, ...]) -> Float:
    """:func:`frozen` float64, and every element finite.

    Raises:
        ShapeError: the shape differs, or an element is NaN or infinite.
    """
    array = frozen(value, name, shape)
    # The squared length is finite unless an element is not, or is huge: one quick test for what is checked most often.
    if not math.isfinite(np.vdot(array, array)) and not np.isfinite(array).all():
        raise ShapeError(f"{name} holds NaN or infinity, expected finite numbers")
    return array


def plain_array(loaded: object, dtype: DTypeLike) -> NDArray[Any]:
    """What ``np.load`` gave as an array of ``dtype``.

    Raises:
        ValueError: it is an archive, or of numbers that are no such (complex ones, text, floats for whole numbers).
    """
    if not isinstance(loaded, np.ndarray):
        raise ContentError("an archive of arrays (.npz), expected one array (.npy)")
    if not np.can_cast(loaded.dtype, dtype, "same_kind"):
        raise ContentError(f"an array of {loaded.dtype}, expected {np.dtype(dtype).name}")
    return loaded.astype(dtype, copy=False)
