"""Masks from a BOP detections file: a JSON list of {scene_id, image_id, category_id, score, bbox, segmentation}."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from pycocotools import mask as coco

from verefine_viz.core.arrays import Mask
from verefine_viz.core.errors import ContentError, InputError
from verefine_viz.core.files import decoded_json, first_line, read_entries, read_json
from verefine_viz.core.number_kinds import Id, Real
from verefine_viz.core.text_format import listed, unusable
from verefine_viz.scenes.image_files import size_text


class DetectionEntry(msgspec.Struct, frozen=True):
    """One entry of the file; its mask is decoded when its image is asked for."""

    scene_id: Id
    image_id: Id
    category_id: Id
    score: Real = 1.0
    segmentation: msgspec.Raw = msgspec.Raw(b"null")


class RunLengths(msgspec.Struct, frozen=True):
    """A mask in COCO's run-length encoding: a list of runs, or its compressed string."""

    size: tuple[int, int]
    """Height and width."""
    counts: str | list[int]


MOST_PER_PIXEL = 8
"""Bytes of JSON that a run takes; of runs there are no more than pixels."""
EXPECTED = "a list: [{scene_id, image_id, category_id, score, bbox, segmentation}, …]"
NO_MASK = (b"null", b"{}", b"[]", b'""')
"""What stands for a box without a mask."""


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
        InputError: the file is missing or damaged, something else, or no entry can be used.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._entries: dict[tuple[int, int], list[tuple[int, DetectionEntry]]] = {}
        try:
            entries, faults = read_entries(path, DetectionEntry)
        except InputError as error:
            raise InputError(_other_kind(path) or str(error)) from None
        for k, entry in entries:
            self._entries.setdefault((entry.scene_id, entry.image_id), []).append((k, entry))
        if faults and not entries:
            raise InputError(f"{path}: {faults[0]}")
        self.notes: tuple[str, ...] = unusable("entry", path.name, faults)
        """About entries that cannot be used, whatever their image."""

    @property
    def objects(self) -> frozenset[int]:
        """The objects that were detected in any image."""
        return frozenset(entry.category_id for of_image in self._entries.values() for _, entry in of_image)

    @property
    def images(self) -> tuple[tuple[int, int], ...]:
        """(scene, image) of everything that is in the file, in its order."""
        return tuple(self._entries)

    def obj_ids(self, scene_id: int, im_id: int) -> frozenset[int]:
        """The objects that were detected in an image."""
        return frozenset(entry.category_id for _, entry in self._entries.get((scene_id, im_id), ()))

    def of_image(
        self, scene_id: int, im_id: int, shape: tuple[int, int]
    ) -> tuple[tuple[Detection, ...], tuple[str, ...]]:
        """The detections of an image, highest score first, and notes about entries that had to be left out.

        Args:
            scene_id: BOP scene.
            im_id: BOP image.
            shape: (height, width) of the image.
        """
        detections: list[Detection] = []
        faults: list[str] = []
        boxes = 0
        for k, entry in self._entries.get((scene_id, im_id), ()):
            if bytes(entry.segmentation) in NO_MASK:
                boxes += 1
                continue
            try:
                mask = mask_of(entry.segmentation, shape, f"entry {k}")
            except InputError as error:
                faults.append(str(error))
                continue
            detections.append(Detection(entry.category_id, entry.score, mask))
        notes = unusable("detection", str(self.path), faults)
        if boxes:
            have = "detection in {} has" if boxes == 1 else "detections in {} have"
            expected = "'segmentation' in COCO's run lengths"
            notes += (f"{boxes} {have.format(self.path.name)} a box but no mask; expected {expected}",)
        return tuple(sorted(detections, key=lambda d: -d.score)), notes


def _other_kind(path: Path) -> str:
    """What is wrong with a file that holds an object of JSON, as COCO's do, where a list is expected; else empty."""
    try:
        given = read_json(path, dict[str, msgspec.Raw])
    except InputError:
        return ""
    of_coco = " as COCO has them" if "annotations" in given else ""
    return f"{path} holds {listed(given)}{of_coco}; expected BOP's detections, {EXPECTED}"


def mask_of(segmentation: msgspec.Raw, shape: tuple[int, int], where: str) -> Mask:
    """The mask (H, W) of a ``segmentation`` of COCO, read-only; ``where`` names its entry in a message.

    Raises:
        InputError: it is no run-length encoding, damaged, or made for another image size.
    """
    raw = bytes(segmentation)
    if len(raw) > MOST_PER_PIXEL * shape[0] * shape[1] + 1000:
        raise InputError(f"{where}: 'segmentation' is larger than a mask of {size_text(shape)} pixels can be")
    try:
        return decode_rle(decoded_json(raw, RunLengths), shape)
    except (ValueError, RecursionError) as error:
        polygons = "; polygons are not read" * raw.startswith(b"[")
        raise InputError(f"{where}: 'segmentation': {first_line(error)}{polygons}") from None


def decode_rle(encoded: RunLengths, shape: tuple[int, int]) -> Mask:
    """The mask (H, W) of a run-length encoding, read-only.

    Raises:
        ValueError: it is of another size than ``shape`` (height, width), or its runs do not fill the image.
    """
    if encoded.size != shape:
        raise ContentError(
            f"the mask is made for [h, w] = {[*encoded.size]}, but the image is {size_text(shape)} pixels"
        )
    runs = _string_runs(encoded.counts) if isinstance(encoded.counts, str) else encoded.counts
    # Checked here because pycocotools leaves memory uninitialised where the runs end early.
    if runs is None or min(runs, default=0) < 0 or sum(runs) != shape[0] * shape[1]:
        raise ContentError(f"the run lengths are damaged, expected a sum of {shape[0] * shape[1]} pixels, none below 0")
    uncompressed: Any = {"size": list(shape), "counts": runs}
    rle: Any = coco.frPyObjects(uncompressed, *shape)
    mask = np.ascontiguousarray(coco.decode(rle)).astype(bool)
    mask.flags.writeable = False  # Else each of thousands is copied when it is frozen.
    return mask


def encode_rle(mask: Mask) -> dict[str, Any]:
    """The run-length encoding of a mask (H, W), compressed as COCO does; :func:`decode_rle` gives the mask back."""
    encoded: Any = coco.encode(np.asfortranarray(mask, dtype=np.uint8))
    return {"size": list(mask.shape), "counts": encoded["counts"].decode("ascii")}


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
