"""``cam_K`` of a BOP file: read with errors that say what is wrong with the matrix, and notes where it looks odd."""

from __future__ import annotations

from typing import Any

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import check_intrinsics
from verefine_viz.core.errors import InputError, ShapeError
from verefine_viz.core.jsonfile import number_of, numbers_of

LAST_ROW = (0.0, 0.0, 1.0)
DEPTH_SCALE_MM = (1e-6, 1e4)
"""Least and largest depth_scale [mm a step]: data sets have 0.1 to 1, and metres as floats 1000."""


def intrinsics_of(entry: Any, where: str) -> Float:
    """The matrix (3, 3) [px] of an image's entry in scene_camera.json.

    Raises:
        InputError: there is none, the camera is no pinhole camera, the last row is not 0 0 1, or a number is out of
            the bounds of :func:`~verefine_viz.core.camera.check_intrinsics`.
    """
    if isinstance(entry, dict) and "cam_K" not in entry and "cam_model" in entry:
        raise InputError(f"{where} has a 'cam_model' (fisheye); only pinhole cameras with 'cam_K' are supported")
    K = numbers_of(entry, "cam_K", 9, where).reshape(3, 3)
    if not np.allclose(K[2], LAST_ROW, rtol=0, atol=1e-6):
        row = " ".join(f"{x:g}" for x in K[2])
        is_turned = np.allclose(K[:, 2], LAST_ROW, rtol=0, atol=1e-6)
        how = "; it looks written column by column: write it row by row, fx 0 cx 0 fy cy 0 0 1" * is_turned
        raise InputError(f"{where}: the last row of 'cam_K' is {row}, expected 0 0 1{how}")
    try:
        check_intrinsics(K)
    except ShapeError as error:
        raise InputError(f"{where}: {error}") from None
    return K


def depth_scale_of(entry: Any, where: str) -> float:
    """Millimetres per step of an image's depth, of its entry in scene_camera.json.

    Raises:
        InputError: there is none, or it is out of ``DEPTH_SCALE_MM``.
    """
    low, high = DEPTH_SCALE_MM
    return number_of(entry, "depth_scale", where, low, high, f"millimetres per step > 0, {low:g} to {high:g}")


def intrinsics_notes(K: Float, shape: tuple[int, ...]) -> tuple[str, ...]:
    """What is odd about a matrix (3, 3) [px] for images of ``shape`` (height, width, …)."""
    height, width = shape[:2]
    notes: tuple[str, ...] = ()
    if K[0, 1] != 0:
        notes += (f"cam_K has a skew of {K[0, 1]:g} px; it is ignored",)
    if not (0 <= K[0, 2] < width and 0 <= K[1, 2] < height):
        notes += (
            f"cx, cy of cam_K are {K[0, 2]:g}, {K[1, 2]:g} px, outside of the image of {width}×{height} px; expected "
            "near its middle: check that cam_K belongs to images of this size",
        )
    return notes
