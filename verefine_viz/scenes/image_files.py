"""Images of a data set: colour, 16-bit depth, masks; png, jpg or tif."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import check_intrinsics
from verefine_viz.core.errors import InputError, ShapeError
from verefine_viz.core.json_files import number_of, numbers_of
from verefine_viz.core.paths import atomic, open_input

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
"""Looked for in this order."""
DEEPEST_M = 1e6
"""Largest depth that an image may hold [m]; a 16-bit one holds no more at any depth_scale that is taken."""


def find_image(folder: Path, stem: str) -> Path | None:
    """The image of that name in ``folder``, whatever its format, or None.

    Something of that name that is no file (a pipe, a broken link) is refused when it is read.
    """
    candidates = (folder / f"{stem}{suffix}" for suffix in SUFFIXES)
    return next((path for path in candidates if os.path.lexists(path)), None)


def read_color(path: Path) -> NDArray[np.uint8]:
    """RGB (H, W, 3) of a colour or grey image of 8 or 16 bits.

    Raises:
        InputError: missing, damaged, or no image.
    """
    image = _read(path)
    if image.mode.startswith("I") or image.mode == "F":
        values = np.asarray(image, dtype=np.float64)
        full = 255.0 if values.max(initial=0.0) <= 255 else 65535.0
        grey = np.clip(values / full * 255.0, 0, 255).round().astype(np.uint8)
        return np.repeat(grey[..., None], 3, axis=2)
    return np.asarray(image.convert("RGB"))


def read_depth(path: Path, scale_mm: float) -> NDArray[np.float32]:
    """Depth z (H, W) [m] of a one-channel image whose values times ``scale_mm`` are millimetres; 0 = not measured.

    Raises:
        InputError: missing, damaged, more than one channel, negative or infinite values, or depth beyond ``DEEPEST_M``.
    """
    return (read_steps(path, scale_mm) * (scale_mm * 1e-3)).astype(np.float32)


def read_steps(path: Path, scale_mm: float) -> Float:
    """The values (H, W) of a depth image as the file has them, 0 = not measured.

    Raises:
        InputError: as :func:`read_depth`.
    """
    image = _read(path)
    if image.mode == "P" or len(image.getbands()) != 1:
        raise InputError(f"{path} is a {image.mode} image, expected one channel of 16-bit depth")
    raw = np.asarray(image, dtype=np.float64)
    raw = np.where(np.isnan(raw), 0.0, raw)
    if not np.isfinite(raw).all() or (raw < 0).any():
        raise InputError(f"{path} holds negative or infinite depth, expected values ≥ 0 with 0 = not measured")
    deepest_m = float(raw.max(initial=0.0)) * scale_mm * 1e-3
    if not deepest_m <= DEEPEST_M:
        raise InputError(
            f"{path} holds depth of {deepest_m:.3g} m at {scale_mm:g} mm a step, expected at most {DEEPEST_M:g} m; "
            "check 'depth_scale' in scene_camera.json"
        )
    return raw


def read_mask(path: Path, shape: tuple[int, int]) -> Mask:
    """A mask (H, W) bool, read-only; every value above 0 is inside, of its alpha channel where that holds the mask.

    Raises:
        InputError: missing, damaged, or another size than ``shape`` (height, width).
    """
    image = _read(path)
    values = np.asarray(image.convert("L"))
    if "A" in image.getbands() and np.ptp(alpha := np.asarray(image.getchannel("A"))) > 0:
        values = alpha
    if values.shape != shape:
        raise InputError(f"{path} is {size_text(values.shape)} pixels, expected {size_text(shape)} as the depth image")
    inside = values > 0
    inside.flags.writeable = False  # Else each of thousands is copied when it is frozen.
    return inside


def size_text(shape: tuple[int, ...]) -> str:
    """``640×480`` of (480, 640, …)."""
    return f"{shape[1]}×{shape[0]}"


def write_image(path: Path, pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    """Writes a PNG; it appears under its name only when it is complete.

    Raises:
        InputError: the file cannot be written.
    """
    with atomic(path) as part:
        Image.fromarray(pixels).save(part, format="PNG")


def image_width(path: Path) -> int:
    """The width that an image's header states [px].

    Raises:
        InputError: missing, damaged, or no image.
    """
    try:
        with open_input(path) as file, Image.open(file) as image:
            return image.width
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise InputError(f"{path} is damaged or no image ({error}); fetch it again") from None


def _read(path: Path) -> Image.Image:
    try:
        with open_input(path) as file, Image.open(file) as image:
            image.load()
            return image.copy()
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise InputError(f"{path} is damaged or no image ({error}); fetch it again") from None


# Numbers of scene_camera.json.

DEPTH_SCALE_MM = (1e-6, 1e4)
"""Least and largest depth_scale [mm a step]: data sets have 0.1 to 1, and metres as floats 1000."""


def intrinsics_of(entry: Any, where: str) -> Float:
    """The matrix (3, 3) [px] of an image's entry in scene_camera.json.

    Raises:
        InputError: there is none, the camera is no pinhole camera, or not one by
            :func:`~verefine_viz.core.camera.check_intrinsics`.
    """
    if isinstance(entry, dict) and "cam_K" not in entry and "cam_model" in entry:
        raise InputError(f"{where} has a 'cam_model' (fisheye); only pinhole cameras with 'cam_K' are supported")
    K = numbers_of(entry, "cam_K", 9, where).reshape(3, 3)
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
