"""Masks that hold the pixels of several objects, each under a number of its own: a label image."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.text_format import listed

WHITE = (255, 65535)
"""The largest value of a mask that was drawn in grey, smoothly or not; objects are numbered from 1."""
FEWEST_PX = 10
"""Pixels within an area that make it one of an object: along an edge that was blurred no value has as many."""


def labels_in(values: NDArray[Any]) -> tuple[int, ...]:
    """The labels of an image (H, W) of whole numbers: values other than 0 that fill an area each.

    Values that only lie along an edge, as where a mask was resized, are none, nor are levels of grey.
    """
    some = values.max(initial=0) or values.min(initial=0)
    if ((values == 0) | (values == some)).all():
        return (int(some),) if some else ()
    if some in WHITE:
        return (int(some),)
    middle = values[1:-1, 1:-1]
    beside = (values[:-2, 1:-1], values[2:, 1:-1], values[1:-1, :-2], values[1:-1, 2:])
    is_within = np.logical_and.reduce([middle == other for other in beside]) & (middle != 0)
    labels, counts = np.unique(middle[is_within], return_counts=True)
    return tuple(int(label) for label, count in zip(labels, counts, strict=True) if count >= FEWEST_PX)


def labels_fault(values: NDArray[Any]) -> str:
    """What is wrong with a mask (H, W) of one object whose values are labels of several; empty where they are not."""
    labels = labels_in(values)
    return (
        f"holds {len(labels)} labels ({listed(labels)}), expected the pixels of one object" if len(labels) > 1 else ""
    )
