"""Score maps as small images of indices into fixed colours, cut out around what is judged.

Of an iteration two poses side by side; of a pass over several objects the scene.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import rerun as rr
from numba import njit
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.palette import ANGLE, CLASS_PALETTE, EMPTY, FIT, Scale, depth_scale, difference_scale, rgb
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Verifier
from verefine_viz.core.records import Iteration, Stage
from verefine_viz.core.scores import PixelGrid, ScoreMaps
from verefine_viz.recording import entities
from verefine_viz.recording.recording_file import RecordingFile

TILE_PX = 128
"""Every object is shown this large, whatever its size in the image; together with the pairs this bounds the bytes."""
GAP_PX = 6
MARGIN = 0.25
"""Shown around the mask, as a share of its larger side."""

SCENE_TILE_PX = 224
MAP_NAMES = ("rendered", "difference", "angle", "f_d", "f_n", "classes")
SCENE_MAP_NAMES = ("rendered", "difference", "classes")
OBSERVED = "observed"


def log_colors(file: RecordingFile) -> None:
    """The colours of all maps."""
    scales = {"rendered": depth_scale(0.0, 1.0), "difference": difference_scale(1.0)}
    scales |= {"angle": ANGLE, "f_d": FIT, "f_n": FIT}
    palettes = {name: scale.palette for name, scale in scales.items()} | {"classes": CLASS_PALETTE}
    opaque = rr.SegmentationImage.from_fields(opacity=1.0)
    for root, names in ((entities.MAPS, MAP_NAMES), (entities.SCENE_MAPS, SCENE_MAP_NAMES)):
        for name in names:
            file.log(f"{root}/{name}", _annotations(palettes[name]), opaque)


@lru_cache(maxsize=16)
def _annotations(palette: bytes) -> rr.AnnotationContext:
    colors = np.frombuffer(palette, np.uint8).reshape(256, 3)
    return rr.AnnotationContext([rr.AnnotationInfo(k, color=color) for k, color in enumerate(colors)])


class PendingMaps:
    """Maps of several iterations, to be sent at once."""

    def __init__(self) -> None:
        self._rows: dict[str, tuple[list[int], list[NDArray[np.uint8]]]] = {}

    def add(self, entity: str, iteration: int, indices: NDArray[np.uint8]) -> None:
        """One more (H, W) of ``entity``, as large as those before."""
        iterations, images = self._rows.setdefault(entity, ([], []))
        iterations.append(iteration)
        images.append(indices)

    def send(self, file: RecordingFile) -> None:
        """All that was added since the last call."""
        for entity, (iterations, images) in self._rows.items():
            height, width = images[0].shape
            size = rr.components.ImageFormat(width=width, height=height, channel_datatype=rr.ChannelDatatype.U8)
            buffers = [image.tobytes() for image in images]
            file.send(entity, iterations, rr.SegmentationImage.columns(buffer=buffers, format=[size] * len(images)))
        self._rows.clear()


class Maps:
    """The score maps of an object's iterations, or of a scene of several."""

    def __init__(self, targets: Sequence[Target], verifier: Verifier, size_px: int = TILE_PX) -> None:
        self._targets = tuple(targets)
        self._observation = targets[0].observation
        self._verifier = verifier
        mask = np.logical_or.reduce([t.instance.mask for t in targets])
        rows, across = _square(mask, size_px)
        h, w = mask.shape
        self._at = PixelGrid(rows.clip(0, h - 1), across.clip(0, w - 1))
        self._outside = ((rows < 0) | (rows >= h))[:, None] | (across < 0) | (across >= w)
        measured = self._observation.depth_m[mask & (self._observation.depth_m > 0)]
        near, far = np.percentile(measured, [5, 95]) if len(measured) > 1 else (1.0, 1.0)
        if len(targets) == 1:
            near = far = float(np.median(measured)) if len(measured) else 1.0
        reach = max(t.model.diameter_m for t in targets)
        depth = depth_scale(near - reach, far + reach)
        self._scales = {
            "rendered": depth,
            "difference": difference_scale(verifier.settings.tau_m),
            "angle": ANGLE,
            "f_d": FIT,
            "f_n": FIT,
        }

    def send_observed(self, file: RecordingFile, iteration: int) -> None:
        """The same cut-out of what the sensor saw: colour and depth."""
        o = self._observation
        scale = self._scales["rendered"]
        depth = self._indexed(self._cut(o.depth_m), scale, only=self._cut(o.depth_m) > 0)
        right = rgb(depth, scale.palette)
        left = right if o.rgb is None else self._cut(o.rgb)
        gap = np.full((TILE_PX, GAP_PX, 3), EMPTY, np.uint8)
        picture = rr.Image(np.concatenate([left, gap, right], axis=1)).compress(jpeg_quality=85)
        row = [rr.ComponentColumn(b.component_descriptor(), b) for b in picture.as_component_batches()]
        file.send(f"{entities.MAPS}/{OBSERVED}", [iteration], row)

    def add_pair(self, pending: PendingMaps, iteration: Iteration, placed: Sequence[Placed]) -> None:
        """The maps of the two poses that an iteration had to choose from."""
        (target,) = self._targets
        made = [self._verifier.maps(target, s.T_cam_obj, placed, self._at) for s in compared(iteration)]
        gap = np.zeros((TILE_PX, GAP_PX), np.uint8)
        for name in MAP_NAMES:
            images = [self._index_image(name, made[0]), gap, self._index_image(name, made[-1])]
            pending.add(f"{entities.MAPS}/{name}", iteration.index, np.concatenate(images, axis=1))

    def add_scene(self, pending: PendingMaps, iteration: int, Ts_cam_obj: Float, placed: Sequence[Placed]) -> None:
        """The maps of all objects together, at the poses (m, 4, 4)."""
        made = self._verifier.scene_maps(self._targets, Ts_cam_obj, placed, at=self._at)
        for name in SCENE_MAP_NAMES:
            pending.add(f"{entities.SCENE_MAPS}/{name}", iteration, self._index_image(name, made))

    def _index_image(self, name: str, maps: ScoreMaps) -> NDArray[np.uint8]:
        """Palette indices of one map."""
        if name == "classes":
            return np.where(self._outside, 0, maps.classes).astype(np.uint8)
        scale = self._scales[name]
        if name == "rendered":
            return self._indexed(maps.rendered_m, scale, only=maps.rendered_m > 0)
        if name == "difference":
            return self._indexed(maps.depth_difference_m, scale, factor=1e3)
        if name == "angle":
            return self._indexed(maps.angle_rad, scale, factor=math.degrees(1))
        return self._indexed(maps.f_d if name == "f_d" else maps.f_n, scale, only=maps.counted)

    def _indexed(
        self, values: NDArray[np.float32], scale: Scale, factor: float = 1.0, only: NDArray[np.bool_] | None = None
    ) -> NDArray[np.uint8]:
        """Index into the scale's palette of ``factor`` times a number: 0 = no value, 1 … 255 from low to high."""
        known = ~self._outside if only is None else only & ~self._outside
        return _indices(values, known, factor, scale.low, scale.high)

    def _cut(self, image: NDArray[Any]) -> NDArray[Any]:
        """The pixels that are looked at; black beyond the image."""
        tile = image[self._at.rows[:, None], self._at.columns]
        tile[self._outside] = 0
        return tile


def compared(iteration: Iteration) -> Sequence[Stage]:
    """The two stages shown side by side: simulated and refined, else what was there and what came of it."""
    first = iteration.stages[0]
    judged = [stage for stage in iteration.stages if stage.score is not None] or [first]
    return judged[-2:] if len(judged) > 1 else [first, judged[0]]


def _square(mask: NDArray[np.bool_], size_px: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns (size_px,) to sample; the whole image where the mask is empty."""
    v, u = np.nonzero(mask)
    if len(v) == 0:
        v, u = np.array([0, mask.shape[0] - 1]), np.array([0, mask.shape[1] - 1])
    side = max(np.ptp(v), np.ptp(u), 8) * (1 + 2 * MARGIN)
    at = (np.arange(size_px) + 0.5) / size_px - 0.5
    rows = np.floor((v.min() + v.max()) / 2 + 0.5 + at * side)
    columns = np.floor((u.min() + u.max()) / 2 + 0.5 + at * side)
    return rows.astype(np.int64), columns.astype(np.int64)


@njit(cache=True)
def _indices(
    values: NDArray[np.float32], known: NDArray[np.bool_], factor: float, low: float, high: float
) -> NDArray[np.uint8]:
    out = np.zeros(values.shape, np.uint8)
    for y in range(values.shape[0]):
        for x in range(values.shape[1]):
            value = factor * np.float64(values[y, x])
            if known[y, x] and np.isfinite(value):
                out[y, x] = 1 + np.uint8(min(max(np.rint(254 * (value - low) / (high - low)), 0.0), 254.0))
    return out
