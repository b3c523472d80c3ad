"""The score maps of a recording: small tiles cut out around what is scored.

Of an iteration two poses side by side; of a pass over several objects the scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.palette import EMPTY, depth_scale, rgb
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Verifier
from verefine_viz.core.records import Iteration, Stage
from verefine_viz.core.refiner_steps import LearnedRefiner
from verefine_viz.core.scores import COLOUR_MAPS, MapName, PixelGrid, ScoreMaps
from verefine_viz.pictures.map_images import MapImages, depth_indices, palette_of, scales_of
from verefine_viz.pictures.refiner_crops import start_words, step_picture, step_words
from verefine_viz.recording import entities
from verefine_viz.recording.recording_file import RecordingFile

TILE_PX = 128
"""Every object is shown this large, whatever its size in the image; together with the pairs this bounds the bytes."""
GAP_PX = 6
MARGIN = 0.25
"""Shown around the mask, as a share of its larger side."""

SCENE_TILE_PX = 224
MAP_NAMES: tuple[MapName, ...] = ("rendered", "difference", "angle", "f_d", "f_n", "classes")
SCENE_MAP_NAMES: tuple[MapName, ...] = ("rendered", "difference", "classes")
OBSERVED = "observed"
SCENE_COLOUR_MAPS: tuple[MapName, ...] = ("rendered_colour", "correlation")


def log_colors(file: RecordingFile, colour: bool) -> None:
    """The palettes of all maps, those of the colour term if it counts."""
    scales = scales_of(depth_scale(0.0, 1.0), 1.0)
    opaque = rr.SegmentationImage.from_fields(opacity=1.0)
    scene = (*SCENE_MAP_NAMES, *SCENE_COLOUR_MAPS) if colour else SCENE_MAP_NAMES
    for root, names in (
        (entities.MAPS, (*MAP_NAMES, *COLOUR_MAPS) if colour else MAP_NAMES),
        (entities.SCENE_MAPS, scene),
    ):
        for name in names:
            file.log(f"{root}/{name}", _annotations(palette_of(name, scales)), opaque)


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


class LoggedMaps:
    """The score maps of an object's iterations, or of a scene of several."""

    def __init__(self, targets: Sequence[Target], verifier: Verifier, size_px: int = TILE_PX) -> None:
        self._targets = tuple(targets)
        self._verifier = verifier
        mask = np.logical_or.reduce([t.instance.mask for t in targets])
        rows, columns = _square(mask, size_px)
        h, w = mask.shape
        self._at = PixelGrid(rows.clip(0, h - 1), columns.clip(0, w - 1))
        self._outside = ((rows < 0) | (rows >= h))[:, None] | (columns < 0) | (columns >= w)
        depth_m = targets[0].observation.depth_m
        self._observed_m = self._cut(depth_m)
        measured = depth_m[mask & (depth_m > 0)]
        near, far = np.percentile(measured, [5, 95]) if len(measured) > 1 else (1.0, 1.0)
        if len(targets) == 1:
            near = far = float(np.median(measured)) if len(measured) else 1.0
        reach = max(t.model.diameter_m for t in targets)
        self._scales = scales_of(depth_scale(near - reach, far + reach), verifier.settings.tau_m)

    def send_observed(self, file: RecordingFile, iteration: int) -> None:
        """A cut-out of what the sensor saw: colour and depth."""
        scale, photo = self._scales["observed"], self._targets[0].observation.rgb
        right = rgb(depth_indices(self._observed_m, scale), scale.palette)
        left = right if photo is None else self._cut(photo)
        gap = np.full((TILE_PX, GAP_PX, 3), EMPTY, np.uint8)
        picture = rr.Image(np.concatenate([left, gap, right], axis=1)).compress(jpeg_quality=85)
        row = [rr.ComponentColumn(b.component_descriptor(), b) for b in picture.as_component_batches()]
        file.send(f"{entities.MAPS}/{OBSERVED}", [iteration], row)

    def add_pair(self, pending: PendingMaps, iteration: Iteration, placed: Sequence[Placed]) -> None:
        """The maps of the two poses that an iteration had to choose from; none where the score is not of pixels."""
        (target,) = self._targets
        of_poses = [self._verifier.maps(target, s.T_cam_obj, placed, self._at) for s in compared(iteration)]
        pair = [maps for maps in of_poses if maps is not None]
        if not pair:
            return
        gap = np.zeros((TILE_PX, GAP_PX), np.uint8)
        names = MAP_NAMES if pair[0].correlation is None else (*MAP_NAMES, *COLOUR_MAPS)
        for name in names:
            left, right = (self._indices(name, maps) for maps in pair)
            pending.add(f"{entities.MAPS}/{name}", iteration.index, np.concatenate([left, gap, right], axis=1))

    def add_scene(self, pending: PendingMaps, iteration: int, Ts_cam_obj: Float, placed: Sequence[Placed]) -> None:
        """The maps of all objects together, at the poses (m, 4, 4)."""
        maps = self._verifier.scene_maps(self._targets, Ts_cam_obj, placed, at=self._at)
        if maps is None:
            return
        names = SCENE_MAP_NAMES if maps.correlation is None else (*SCENE_MAP_NAMES, *SCENE_COLOUR_MAPS)
        for name in names:
            pending.add(f"{entities.SCENE_MAPS}/{name}", iteration, self._indices(name, maps))

    def _indices(self, name: MapName, maps: ScoreMaps) -> NDArray[np.uint8]:
        """Without value beyond the image."""
        indices = MapImages(maps, self._observed_m, self._scales).indices(name)
        return np.where(self._outside, np.uint8(0), indices)

    def _cut(self, image: NDArray[Any]) -> NDArray[Any]:
        """The pixels that are shown; black beyond the image."""
        tile = image[self._at.rows[:, None], self._at.columns]
        tile[self._outside] = 0
        return tile


def send_refiner_steps(file: RecordingFile, refiner: LearnedRefiner, target: Target, iteration: Iteration) -> None:
    """What a learned refiner saw and answered in an iteration: a picture of its steps, and the same in numbers."""
    start = iteration.before_refined
    if start is None:
        return
    steps = refiner.explain(target, start.T_cam_obj)
    if not steps:
        return
    pictures = [step_picture(step) for step in steps]
    gap = np.full((pictures[0].shape[0], GAP_PX, 3), EMPTY, np.uint8)
    parts = [part for picture in pictures for part in (picture, gap)]
    picture = rr.Image(np.concatenate(parts[:-1], axis=1)).compress(jpeg_quality=85)
    lines = [f"step {k}: {', '.join(step_words(step))}" for k, step in enumerate(steps, 1)]
    words = rr.TextDocument("\n".join(filter(None, (start_words(refiner, target, start.T_cam_obj), *lines))))
    for entity, archetype in ((entities.REFINER, picture), (entities.REFINER_WORDS, words)):
        row = [rr.ComponentColumn(b.component_descriptor(), b) for b in archetype.as_component_batches()]
        file.send(entity, [iteration.index], row)


def compared(iteration: Iteration) -> tuple[Stage, Stage]:
    """The two stages shown side by side: simulated and refined, else what was there and what came of it."""
    first = iteration.stages[0]
    scored = [stage for stage in iteration.stages if stage.score is not None] or [first]
    return (scored[-2], scored[-1]) if len(scored) > 1 else (first, scored[0])


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
