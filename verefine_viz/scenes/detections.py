"""Masks from a BOP detections file: a JSON list of {scene_id, image_id, category_id, score, bbox, segmentation}."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pycocotools import mask as coco

from verefine_viz.core.arrays import Mask
from verefine_viz.core.errors import InputError, quoted
from verefine_viz.core.json_files import integer_of, number_of, read_json
from verefine_viz.scenes.image_files import size_text


@dataclass(frozen=True, eq=False)
class Detection:
    """One detected object in an image."""

    obj_id: int
    score: float
    mask: Mask
    """(H, W)."""


class DetectionsFile:
    """The detections of many images; masks are decoded when an image is asked for.

    Args:
        path: ``.json`` or ``.json.gz``.

    Raises:
        InputError: the file is missing, damaged, or an entry lacks its ids.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._entries: dict[tuple[int, int], list[tuple[int, dict[str, Any]]]] = {}
        for k, entry in enumerate(read_json(path, list)):
            where = f"{path}, entry {k}"
            image = (integer_of(entry, "scene_id", where), integer_of(entry, "image_id", where))
            integer_of(entry, "category_id", where)
            self._entries.setdefault(image, []).append((k, entry))

    @property
    def images(self) -> tuple[tuple[int, int], ...]:
        """(scene, image) of everything that is in the file, in its order."""
        return tuple(self._entries)

    def obj_ids(self, scene_id: int, im_id: int) -> frozenset[int]:
        """The objects that were detected in an image."""
        return frozenset(int(entry["category_id"]) for _, entry in self._entries.get((scene_id, im_id), ()))

    def of_image(
        self, scene_id: int, im_id: int, shape: tuple[int, int]
    ) -> tuple[tuple[Detection, ...], tuple[str, ...]]:
        """The detections of an image, highest score first, and notes about entries that had to be left out.

        Args:
            scene_id: BOP scene.
            im_id: BOP image.
            shape: (height, width) of the image.

        Raises:
            InputError: an entry's run lengths are damaged, or made for another image size.
        """
        detections: list[Detection] = []
        boxes = 0
        for k, entry in self._entries.get((scene_id, im_id), ()):
            where = f"{self.path}, entry {k}"
            obj_id = integer_of(entry, "category_id", where)
            score = number_of(entry, "score", where) if "score" in entry else 1.0
            segmentation = entry.get("segmentation")
            if not segmentation:
                boxes += 1
                continue
            detections.append(Detection(obj_id, score, decode_rle(segmentation, shape, where)))
        notes = ()
        if boxes:
            notes = (f"{boxes} detections in {self.path.name} have a box but no mask; they are left out",)
        return tuple(sorted(detections, key=lambda d: -d.score)), notes


def decode_rle(segmentation: Any, shape: tuple[int, int], where: str) -> Mask:
    """The mask (H, W) of a run-length encoding, read-only.

    Args:
        segmentation: {"size": [h, w], "counts": list of run lengths, or COCO's compressed string}.
        shape: (height, width) the mask must have.
        where: what to call the entry in an error.

    Raises:
        InputError: another size, or run lengths that do not fill the image.
    """
    if not isinstance(segmentation, dict) or "counts" not in segmentation or "size" not in segmentation:
        raise InputError(f"{where}: 'segmentation' needs 'counts' and 'size' (run-length encoding, no polygons)")
    size, counts = segmentation["size"], segmentation["counts"]
    if not isinstance(size, list) or tuple(size) != shape:
        raise InputError(
            f"{where}: the mask is made for [h, w] = {quoted(size, 40)}, but the image is {size_text(shape)} pixels"
        )
    runs, n_pixels = _runs(counts), shape[0] * shape[1]
    # Checked here because pycocotools leaves memory uninitialised where the runs end early.
    if runs is None or min(runs, default=0) < 0 or sum(runs) != n_pixels:
        raise InputError(
            f"{where}: the mask's run lengths are damaged, expected a sum of {n_pixels} pixels, none below 0"
        )
    uncompressed: Any = {"size": list(shape), "counts": runs}
    rle: Any = coco.frPyObjects(uncompressed, *shape)
    mask = np.ascontiguousarray(coco.decode(rle)).astype(bool)
    mask.flags.writeable = False  # Else each of thousands is copied when it is frozen.
    return mask


def encode_rle(mask: Mask) -> dict[str, Any]:
    """The run-length encoding of a mask (H, W), compressed as COCO does; :func:`decode_rle` gives the mask back."""
    encoded: Any = coco.encode(np.asfortranarray(mask, dtype=np.uint8))
    return {"size": list(mask.shape), "counts": encoded["counts"].decode("ascii")}


def _runs(counts: Any) -> list[int] | None:
    if isinstance(counts, str):
        return _string_runs(counts)
    are_integers = isinstance(counts, list) and all(isinstance(r, int) and not isinstance(r, bool) for r in counts)
    return counts if are_integers else None


def _string_runs(text: str) -> list[int] | None:
    """Run lengths of COCO's compressed string, or None where it is damaged.

    5 bits a character; from the fourth run on, differences to the last but one.

    Source: pycocotools, maskApi (rleFrString).
    """
    runs: list[int] = []
    value = shift = 0
    for character in text:
        bits = ord(character) - 48
        if not 0 <= bits < 64 or shift > 30:
            return None
        value |= (bits & 0x1F) << shift
        shift += 5
        if not bits & 0x20:
            if bits & 0x10:
                value -= 1 << shift
            runs.append(value + (runs[-2] if len(runs) > 2 else 0))
            value = shift = 0
    return None if shift else runs
