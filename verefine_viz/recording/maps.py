"""Score maps as small indexed PNGs, cut out around what is judged, in fixed colours.

Of an iteration two poses side by side; of a pass over several objects the scene.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.colormaps import ANGLE, EMPTY, FIT, Scale, depth_scale, difference_scale, lookup_table
from verefine_viz.core.palette import CLASS_COLORS
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Verifier
from verefine_viz.core.scores import PIXEL_CLASSES, ScoreMaps
from verefine_viz.recording import columns, entities
from verefine_viz.recording.background import png
from verefine_viz.recording.piece import Piece
from verefine_viz.recording.row import Row

TILE_PX = 128
"""Every object is shown this large, whatever its size in the image; together with the pairs this bounds the bytes."""
GAP_PX = 6
MARGIN = 0.25
"""Shown around the mask, as a share of its larger side."""

SCENE_TILE_PX = 224
MAP_NAMES = ("rendered", "difference", "angle", "f_d", "f_n", "classes")
SCENE_MAP_NAMES = ("rendered", "difference", "classes")
OBSERVED = "observed"


class Maps:
    """The score maps of an object's iterations, or of a scene of several."""

    def __init__(self, targets: Sequence[Target], verifier: Verifier, tau_m: float, size_px: int = TILE_PX) -> None:
        self._targets = tuple(targets)
        self._observation = targets[0].observation
        self._verifier = verifier
        mask = np.logical_or.reduce([t.instance.mask for t in targets])
        self._rows, self._columns = _square(mask, size_px)
        measured = self._observation.depth_m[mask & (self._observation.depth_m > 0)]
        near, far = np.percentile(measured, [5, 95]) if len(measured) > 1 else (1.0, 1.0)
        if len(targets) == 1:
            near = far = float(np.median(measured)) if len(measured) else 1.0
        reach = max(t.model.diameter_m for t in targets)
        depth = depth_scale(near - reach, far + reach)
        self._scales = {
            "rendered": depth,
            "difference": difference_scale(tau_m),
            "angle": ANGLE,
            "f_d": FIT,
            "f_n": FIT,
        }

    def observed(self, iteration: int) -> Piece:
        """The same cut-out of what the sensor saw: colour and depth."""
        o = self._observation
        scale = self._scales["rendered"]
        depth = _indexed(_or_nan(self._cut(o.depth_m), self._cut(o.depth_m) > 0), scale)
        right = np.frombuffer(_palette(scale), np.uint8).reshape(256, 3)[depth]
        left = right if o.rgb is None else self._cut(o.rgb)
        gap = np.full((TILE_PX, GAP_PX, 3), EMPTY, np.uint8)
        picture = rr.Image(np.concatenate([left, gap, right], axis=1)).compress(jpeg_quality=85)
        return columns.at(f"{entities.MAPS}/{OBSERVED}", iteration, picture)

    def pair(self, row: Row, placed: Sequence[Placed]) -> Iterator[Piece]:
        """The maps of the two poses that an iteration had to choose from; what is computed, is computed at once."""
        (target,) = self._targets
        made = [self._verifier.maps(target, row.Ts_cam_obj[k], placed) for k in compared(row)]
        gap = np.zeros((TILE_PX, GAP_PX), np.uint8)
        images = {
            name: np.concatenate([self._index_image(name, made[0]), gap, self._index_image(name, made[-1])], axis=1)
            for name in MAP_NAMES
        }
        return self._pictures(entities.MAPS, row.index, images)

    def scene(self, iteration: int, Ts_cam_obj: Float, placed: Sequence[Placed]) -> Iterator[Piece]:
        """The maps of all objects together, at the poses (m, 4, 4)."""
        made = self._verifier.scene_maps(self._targets, Ts_cam_obj, placed)
        images = {name: self._index_image(name, made) for name in SCENE_MAP_NAMES}
        return self._pictures(entities.SCENE_MAPS, iteration, images)

    def _pictures(self, root: str, iteration: int, images: Mapping[str, NDArray[np.uint8]]) -> Iterator[Piece]:
        for name, image in images.items():
            palette = _CLASS_PALETTE if name == "classes" else _palette(self._scales[name])
            picture = rr.EncodedImage(contents=png(image, palette), media_type="image/png")
            yield columns.at(f"{root}/{name}", iteration, picture)

    def _index_image(self, name: str, maps: ScoreMaps) -> NDArray[np.uint8]:
        """Palette indices of one map, cut out. Cut first: most of the image is of no interest."""
        if name == "classes":
            return self._cut(maps.classes)
        if name == "rendered":
            rendered = self._cut(maps.rendered_m)
            values = _or_nan(rendered, rendered > 0)
        elif name == "difference":
            values = 1e3 * self._cut(maps.depth_difference_m)
        elif name == "angle":
            values = np.degrees(self._cut(maps.angle_rad))
        else:
            values = _or_nan(self._cut(maps.f_d if name == "f_d" else maps.f_n), self._cut(maps.counted))
        return _indexed(values, self._scales[name])

    def _cut(self, image: NDArray[Any]) -> NDArray[Any]:
        """The square around the objects; 0, NaN in floats, where it reaches beyond the image."""
        h, w = image.shape[:2]
        tile = image[np.clip(self._rows, 0, h - 1)[:, None], np.clip(self._columns, 0, w - 1)]
        outside = ((self._rows < 0) | (self._rows >= h))[:, None] | (self._columns < 0) | (self._columns >= w)
        tile[outside] = np.nan if np.issubdtype(tile.dtype, np.floating) else 0
        return tile


def compared(row: Row) -> Sequence[int]:
    """Indices of the two stages shown side by side: simulated and refined, else what was there and what came of it."""
    judged = [k for k in range(len(row.stages)) if not np.isnan(row.scores[k, 0])] or [0]
    return judged[-2:] if len(judged) > 1 else [0, judged[0]]


def _square(mask: NDArray[np.bool_], size_px: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns (size_px,) to sample; the whole image where the mask is empty."""
    v, u = np.nonzero(mask)
    if len(v) == 0:
        v, u = np.array([0, mask.shape[0] - 1]), np.array([0, mask.shape[1] - 1])
    side = max(np.ptp(v), np.ptp(u), 8) * (1 + 2 * MARGIN)
    at = (np.arange(size_px) + 0.5) / size_px - 0.5
    rows = np.floor((v.min() + v.max()) / 2 + 0.5 + at * side)
    columns = np.floor((u.min() + u.max()) / 2 + 0.5 + at * side)
    return rows.astype(np.intp), columns.astype(np.intp)


def _or_nan(values: NDArray[Any], known: NDArray[np.bool_]) -> NDArray[Any]:
    return np.where(known, values, np.nan)


def _indexed(values: NDArray[np.floating], scale: Scale) -> NDArray[np.uint8]:
    """Index into the scale's palette: 0 = no value, 1 … 255 from low to high."""
    missing = ~np.isfinite(values)
    share = (np.where(missing, scale.low, values) - scale.low) / (scale.high - scale.low)
    index = np.clip(np.round(share * 254), 0, 254) + 1
    return np.where(missing, 0, index).astype(np.uint8)


def _palette(scale: Scale) -> bytes:
    return bytes(EMPTY) + lookup_table(scale.anchors)[np.linspace(0, 255, 255).round().astype(int)].tobytes()


_CLASS_PALETTE = (bytes(EMPTY) + b"".join(bytes(CLASS_COLORS[name]) for name in PIXEL_CLASSES)).ljust(768, b"\0")
