"""Images of a data set: colour, 16-bit depth, masks; png, jpg or tif, or arrays of numpy (.npy)."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, BinaryIO

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray
from PIL import Image

from verefine_viz.core.array_cache import NPZ_READING
from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import check_intrinsics
from verefine_viz.core.errors import ContentError, InputError, ShapeError, quoted
from verefine_viz.core.files import Numbers3x3, id_of, read_file, reading
from verefine_viz.core.label_images import labels_fault
from verefine_viz.core.writing import atomic

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".npy", ".exr")
"""Endings of images, in the order of the search. EXR is recognized only to say what to do."""
LOSSY = (".jpg", ".jpeg")
"""Endings of lossy images: their masks also have values near 0 and 255, which are not labels."""
MOST_PIXELS = 89_000_000
DEEPEST_M = 1e6
"""Largest depth that an image may hold [m]; a 16-bit one holds no more at any depth_scale that is taken."""


def find_image(folder: Path, stem: str) -> Path | None:
    """The image of that name in ``folder``, whatever its format, or None.

    Another thing of that name (a pipe, a broken link) is refused when it is read.
    """
    candidates = (folder / f"{stem}{suffix}" for suffix in SUFFIXES)
    return next((path for path in candidates if os.path.lexists(path)), None)


@contextmanager
def open_image(file: BinaryIO) -> Iterator[Image.Image]:
    """An image of at most 89 million pixels; above that Pillow only warns, as it does about damaged EXIF data."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        warnings.simplefilter("error", Image.DecompressionBombWarning)
        with Image.open(file) as image:
            yield image


def read_color(path: Path) -> NDArray[np.uint8]:
    """RGB (H, W, 3) of a colour or grey image of 8 or 16 bits.

    Raises:
        InputError: missing, damaged, or not an image.
    """
    image = _read(path)
    if image.mode.startswith("I") or image.mode == "F":
        values = np.nan_to_num(np.asarray(image, dtype=np.float64))
        full = 255.0 if values.max(initial=0.0) <= 255 else 65535.0
        grey = np.clip(values / full * 255.0, 0, 255).round().astype(np.uint8)
        return np.repeat(grey[..., None], 3, axis=2)
    return np.asarray(image.convert("RGB"))


def color_of(path: Path | None, shape: tuple[int, ...]) -> tuple[NDArray[np.uint8] | None, tuple[str, ...]]:
    """The colour image (H, W, 3) of a frame whose depth has ``shape``, and a note about one that cannot be read.

    None without one: it is optional.

    Raises:
        InputError: it is of another size.
    """
    if path is None:
        return None, ()
    try:
        rgb = read_color(path)
    except InputError as error:
        return None, (f"{error}; the frame is drawn without colour",)
    if rgb.shape[:2] != shape:
        raise InputError(f"{path} is {size_text(rgb.shape)} pixels, but the depth image is {size_text(shape)}")
    return rgb, ()


def read_depth(path: Path, scale_mm: float) -> NDArray[np.float32]:
    """Depth z (H, W) [m] of a one-channel image whose values times ``scale_mm`` are millimetres; 0 = not measured, as
    NaN and infinity are.

    Raises:
        InputError: missing, damaged, more than one channel, negative values, or depth beyond ``DEEPEST_M``.
    """
    return (read_steps(path, scale_mm) * (scale_mm * 1e-3)).astype(np.float32)


def read_steps(path: Path, scale_mm: float) -> Float:
    """The values (H, W) of a depth image as they are in the file, 0 = not measured.

    Raises:
        InputError: as :func:`read_depth`.
    """
    image = _read(path)
    if image.mode == "P" or len(image.getbands()) != 1:
        raise InputError(f"{path} is a {image.mode} image, expected one channel of 16-bit depth")
    raw = np.asarray(image, dtype=np.float64)
    raw = np.where(np.isfinite(raw), raw, 0.0)
    if (raw < 0).any():
        raise InputError(f"{path} holds negative depth, expected values ≥ 0 with 0 = not measured")
    deepest_m = float(raw.max(initial=0.0)) * scale_mm * 1e-3
    if not deepest_m <= DEEPEST_M:
        raise InputError(
            f"{path} holds depth of {deepest_m:.3g} m at {scale_mm:g} mm a step, expected at most {DEEPEST_M:g} m; "
            "check 'depth_scale' in scene_camera.json"
        )
    return raw


def read_mask(path: Path, shape: tuple[int, int], label: Path | None = None) -> Mask:
    """A mask (H, W) bool of one object, read-only: every pixel above 0 is inside, in the alpha channel where that holds
    the mask.

    Args:
        path: the image.
        shape: (height, width) expected.
        label: a text file with the number of the object's pixels, where images hold those of several objects.

    Raises:
        InputError: missing, damaged, of another size, or with the pixels of several objects and no ``label``.
    """
    image = _read(path)
    values = np.asarray(image if len(image.getbands()) == 1 else image.convert("L"))
    if "A" in image.getbands() and np.ptp(alpha := np.asarray(image.getchannel("A"))) > 0:
        values = alpha
    if values.shape != shape:
        raise InputError(f"{path} is {size_text(values.shape)} pixels, expected {size_text(shape)} as the depth image")
    if values.dtype.kind == "f":
        values = np.nan_to_num(values)
        if (shares := values[values % 1 != 0]).size:
            raise InputError(f"{path} holds shares, such as {shares[0]:.3g}; save it as mask > 0.5")
    if label is not None and label.is_file():
        inside = values == _label_in(label)
    elif path.suffix.lower() not in LOSSY and (fault := labels_fault(values)):
        choice = "" if label is None else f"; write the object's label to {label.parent.name}/{label.name}"
        raise InputError(f"{path} {fault}{choice}")
    else:
        inside = np.asarray(image.convert("L")) > 0 if image.mode == "P" else values > 0
    inside.flags.writeable = False  # Otherwise each of thousands of masks would be copied when it is frozen.
    return inside


def _label_in(path: Path) -> int:
    text = read_file(path, most_bytes=100).decode("utf-8", "replace").strip()
    if not (label := id_of(text)):
        raise InputError(f"{path}: {quoted(text)} is no label, expected a whole number above 0")
    return label


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
        InputError: missing, damaged, or not an image.
    """
    if path.suffix.lower() == ".npy":
        return _read(path).width
    with reading(path, "image") as file, open_image(file) as image:
        return image.width


def _read(path: Path) -> Image.Image:
    suffix = path.suffix.lower()
    with reading(path, "array" if suffix == ".npy" else "image") as file:
        if suffix == ".npy":
            return _of_array(file)
        if suffix == ".exr":
            raise ContentError(f"EXR is not read; save its values by numpy.save as {path.stem}.npy")
        with open_image(file) as image:
            image.load()
            has_alphas = image.mode == "P" and isinstance(image.info.get("transparency"), bytes)
            return image.convert("RGBA") if has_alphas else image.copy()


def _of_array(file: BinaryIO) -> Image.Image:
    """The image of an array (H, W), also with a third axis of length 1, or of colours (H, W, 3) of 8 bits."""
    with NPZ_READING:
        given = np.load(file, allow_pickle=False)
    if not isinstance(given, np.ndarray) or given.dtype.kind not in "biuf":
        raise ContentError("expected one array of numbers (.npy)")
    values = given.squeeze()
    is_color = values.ndim == 3 and values.shape[2] == 3 and values.dtype == np.uint8
    if (values.ndim != 2 and not is_color) or values.size > 3 * MOST_PIXELS:
        raise ContentError(f"an array of shape {given.shape}, expected (height, width)")
    if values.dtype.kind in "iu" and not -(2**31) <= int(values.min(initial=0)) <= int(values.max(initial=0)) < 2**31:
        raise ContentError("it holds numbers of more than 32 bits")
    kinds = {"b": np.uint8, "f": np.float32}
    kind = values.dtype if values.dtype in (np.uint8, np.uint16) else kinds.get(values.dtype.kind, np.int32)
    with np.errstate(over="ignore"):  # Larger values count as infinite: not measured.
        return Image.fromarray(np.ascontiguousarray(values, kind))


# Numbers of scene_camera.json.


class CameraEntry(msgspec.Struct, frozen=True):
    """An image's entry in scene_camera.json."""

    cam_K: Numbers3x3 | None = None
    """[px]."""
    depth_scale: Annotated[float, Meta(ge=1e-6, le=1e4)] | None = None
    """Millimetres per step of the depth image: data sets have 0.1 to 1, and metres as floats 1000."""
    cam_R_w2c: Any = None
    """Checked where it is used, as a frame can do without."""
    cam_t_w2c: Any = None
    """[mm]."""
    cam_model: Any = None
    """Parameters of a fisheye camera."""


def intrinsics_of(entry: CameraEntry, where: str) -> Float:
    """The matrix (3, 3) [px] of an image's entry in scene_camera.json.

    Raises:
        InputError: there is no matrix, or it is not that of a pinhole camera
            (:func:`~verefine_viz.core.camera.check_intrinsics`).
    """
    K = entry.cam_K
    if K is None and entry.cam_model is not None:
        why = "only pinhole cameras with 'cam_K' are supported, and depth images are needed"
        raise InputError(f"{where} has a 'cam_model' (fisheye); {why}")  # HOT3D: it has neither.
    if K is None:
        raise InputError(f"{where} has no 'cam_K'")
    try:
        check_intrinsics(K)
    except ShapeError as error:
        raise InputError(f"{where}: {error}") from None
    return K


def depth_scale_of(entry: CameraEntry, where: str) -> float:
    """Millimetres per step of an image's depth; InputError where its entry lacks them."""
    if entry.depth_scale is None:
        raise InputError(f"{where} has no 'depth_scale', expected millimetres per step of the depth image")
    return entry.depth_scale


def intrinsics_notes(K: Float, shape: tuple[int, ...]) -> tuple[str, ...]:
    """A note on what is odd about a matrix (3, 3) [px] for images of ``shape`` (height, width, …)."""
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
