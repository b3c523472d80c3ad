"""Score maps as small indexed PNGs: two poses side by side, cut out around the object, in fixed colours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from verefine_viz.core.colormaps import ANGLE, EMPTY, FIT, Scale, depth_scale, difference_scale, lookup_table
from verefine_viz.core.palette import CLASS_COLORS
from verefine_viz.core.problem import Target
from verefine_viz.core.protocols import Verifier
from verefine_viz.core.scores import PIXEL_CLASSES, ScoreMaps
from verefine_viz.recording import entities
from verefine_viz.recording.background import png
from verefine_viz.recording.row import Row

TILE_PX = 128
"""Every object is shown this large, whatever its size in the image; together with the pairs this bounds the bytes."""
GAP_PX = 6
MARGIN = 0.25
"""Shown around the mask, as a share of its larger side."""

MAP_NAMES = ("rendered", "difference", "angle", "f_d", "f_n", "classes")
OBSERVED = "observed"


class Maps:
    """Logs the score maps of one object's iterations."""

    def __init__(self, target: Target, verifier: Verifier, tau_m: float) -> None:
        self._target = target
        self._verifier = verifier
        mask, depth = target.instance.mask, target.observation.depth_m
        self._rows, self._columns = _square(mask)
        measured = depth[mask & (depth > 0)]
        middle = float(np.median(measured)) if len(measured) else 1.0
        near = depth_scale(middle - target.model.diameter_m, middle + target.model.diameter_m)
        self._scales = {"rendered": near, "difference": difference_scale(tau_m), "angle": ANGLE, "f_d": FIT, "f_n": FIT}

    def log_observed(self, rec: rr.RecordingStream) -> None:
        """The same cut-out of what the sensor saw: colour and depth."""
        o = self._target.observation
        scale = self._scales["rendered"]
        depth = _indexed(_or_nan(self._cut(o.depth_m), self._cut(o.depth_m) > 0), scale)
        right = np.frombuffer(_palette(scale), np.uint8).reshape(256, 3)[depth]
        left = right if o.rgb is None else self._cut(o.rgb)
        gap = np.full((TILE_PX, GAP_PX, 3), EMPTY, np.uint8)
        picture = rr.Image(np.concatenate([left, gap, right], axis=1)).compress(jpeg_quality=85)
        rec.log(f"{entities.MAPS}/{OBSERVED}", picture)

    def log(self, rec: rr.RecordingStream, row: Row) -> None:
        """The maps of the two poses that this iteration had to choose from, at the stream's current time."""
        made = [self._verifier.maps(self._target, row.Ts_cam_obj[k]) for k in compared(row)]
        for name in MAP_NAMES:
            tiles = [self._index_image(name, maps) for maps in made]
            gap = np.zeros((TILE_PX, GAP_PX), np.uint8)
            joined = np.concatenate([tiles[0], gap, tiles[-1]], axis=1)
            palette = _CLASS_PALETTE if name == "classes" else _palette(self._scales[name])
            rec.log(f"{entities.MAPS}/{name}", rr.EncodedImage(contents=png(joined, palette), media_type="image/png"))

    def _index_image(self, name: str, maps: ScoreMaps) -> NDArray[np.uint8]:
        """Palette indices (TILE_PX, TILE_PX) of one map. Cut first: most of the image is of no interest."""
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
        """The square around the object, (TILE_PX, TILE_PX, …); 0, NaN in floats, where it reaches beyond the image."""
        h, w = image.shape[:2]
        tile = image[np.clip(self._rows, 0, h - 1)[:, None], np.clip(self._columns, 0, w - 1)]
        outside = ((self._rows < 0) | (self._rows >= h))[:, None] | (self._columns < 0) | (self._columns >= w)
        tile[outside] = np.nan if np.issubdtype(tile.dtype, np.floating) else 0
        return tile


def compared(row: Row) -> Sequence[int]:
    """Indices of the two stages shown side by side: simulated and refined, else what was there and what came of it."""
    judged = [k for k in range(len(row.stages)) if not np.isnan(row.scores[k, 0])] or [0]
    return judged[-2:] if len(judged) > 1 else [0, judged[0]]


def _square(mask: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns (TILE_PX,) to sample; the whole image where the mask is empty."""
    v, u = np.nonzero(mask)
    if len(v) == 0:
        v, u = np.array([0, mask.shape[0] - 1]), np.array([0, mask.shape[1] - 1])
    side = max(np.ptp(v), np.ptp(u), 8) * (1 + 2 * MARGIN)
    at = (np.arange(TILE_PX) + 0.5) / TILE_PX - 0.5
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
