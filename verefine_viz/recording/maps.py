"""The score maps of a recording: small tiles cut out around what is scored, with the numbers themselves.

Of an iteration two poses, an entity each; of a pass over several objects the scene.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from PIL import Image

from verefine_viz.core.arrays import Float
from verefine_viz.core.palette import CLASS_COLORS, EMPTY, depth_scale, rgb
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.protocols import Verifier
from verefine_viz.core.records import Iteration, Stage
from verefine_viz.core.refiner_steps import LearnedRefiner
from verefine_viz.core.scores import PIXEL_CLASSES, MapName, PixelGrid, ScoreMaps
from verefine_viz.pictures.map_images import depth_indices
from verefine_viz.pictures.refiner_crops import start_words, step_picture, step_words
from verefine_viz.recording import entities
from verefine_viz.recording.recording_file import RecordingFile

TILE_PX = 128
"""Every object is shown this large, whatever its size in the image; together with the pairs this bounds the bytes."""
GAP_PX = 6
MARGIN = 0.25
"""Shown around the mask, as a share of its larger side."""
SCENE_TILE_PX = 224
JPEG_QUALITY, STEPS_QUALITY = 85, 70

MAP_NAMES: tuple[MapName, ...] = ("rendered", "difference", "angle", "f_d", "f_n", "classes")
SCENE_MAP_NAMES: tuple[MapName, ...] = ("rendered", "difference", "classes")
COLOUR_NAMES: tuple[MapName, ...] = ("rendered_colour", "correlation")
"""With the colour term; what the image shows is in ``observed``."""
DIFFERENCE_MM = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)
"""Where the scale of the depth difference may end."""
NO_VALUE = 0.15
"""A scale begins so much of its length below its lowest number: pixels without one take its first colour."""

Image8 = NDArray[np.uint8]


@dataclass(frozen=True)
class FloatMap:
    """How a map of numbers is drawn."""

    values: Callable[[ScoreMaps], NDArray[np.floating]]
    """(H, W) in its unit; NaN = none."""
    colormap: Literal["viridis", "inferno", "turbo"]
    per_m: float = 1.0
    """Units in a metre, for maps of lengths."""
    limits: tuple[float, float] | None = None
    """From where to where its scale goes; None = it follows the data."""


FLOAT_MAPS: dict[MapName, FloatMap] = {
    "rendered": FloatMap(lambda maps: np.where(maps.rendered_m > 0, maps.rendered_m, np.nan), "viridis"),
    "difference": FloatMap(lambda maps: 1e3 * maps.depth_difference_m, "turbo", per_m=1e3),
    "angle": FloatMap(lambda maps: math.degrees(1) * maps.angle_rad, "inferno", limits=(0.0, 90.0)),
    "f_d": FloatMap(lambda maps: np.where(maps.counted, maps.f_d, np.nan), "viridis", limits=(0.0, 1.0)),
    "f_n": FloatMap(lambda maps: np.where(maps.counted, maps.f_n, np.nan), "viridis", limits=(0.0, 1.0)),
    "correlation": FloatMap(lambda maps: _no_value_outside(maps.correlation, maps), "turbo", limits=(-2.0, 2.0)),
}


def _no_value_outside(values: NDArray[np.float32] | None, maps: ScoreMaps) -> NDArray[np.floating]:
    return np.full(maps.classes.shape, np.nan) if values is None else values


def log_colors(file: RecordingFile, colour: bool) -> None:
    """Scales and colours of all maps, those of the colour term if it counts."""
    more = COLOUR_NAMES if colour else ()
    drawn = [entities.pose_map(name, when) for name in (*MAP_NAMES, *more) for when in entities.COMPARED]
    drawn += [entities.scene_map(name) for name in (*SCENE_MAP_NAMES, *more)]
    for entity in drawn:
        name = next(part for part in entity.split("/") if part in FLOAT_MAPS or part in ("classes", "rendered_colour"))
        if name == "classes":
            classes = [rr.AnnotationInfo(0, color=EMPTY)]
            classes += [rr.AnnotationInfo(k, one, CLASS_COLORS[one]) for k, one in enumerate(PIXEL_CLASSES, 1)]
            file.log(entity, rr.AnnotationContext(classes), rr.SegmentationImage.from_fields(opacity=1.0))
        elif name in FLOAT_MAPS:
            style = FLOAT_MAPS[name]
            limits = None if style.limits is None else _with_no_value(style.limits)
            file.log(
                entity,
                rr.DepthImage.from_fields(meter=style.per_m, colormap=style.colormap, depth_range=limits),
            )


def _with_no_value(limits: tuple[float, float]) -> tuple[float, float]:
    """Where a scale begins and ends; one around 0 stays around it."""
    low, high = limits
    below = NO_VALUE * (high - low)
    return low - below, high + (below if low == -high else 0.0)


class PendingMaps:
    """Maps of several iterations, to be sent at once."""

    def __init__(self) -> None:
        self._rows: dict[str, list[tuple[int, NDArray[Any], tuple[float, float] | None]]] = {}

    def add(self, entity: str, iteration: int, image: NDArray[Any], limits: tuple[float, float] | None = None) -> None:
        """One more of ``entity``, as large as those before: numbers (H, W) float16 with the limits of their scale where
        it has none yet, classes (H, W) uint8, or colours (H, W, 3).
        """
        self._rows.setdefault(entity, []).append((iteration, image, limits))

    def send(self, file: RecordingFile) -> None:
        """All that was added since the last call."""
        for entity, rows in self._rows.items():
            iterations, images, limits = zip(*rows, strict=True)
            file.send(entity, iterations, _columns(images, limits))
        self._rows.clear()


def _columns(
    images: Sequence[NDArray[Any]], limits: Sequence[tuple[float, float] | None]
) -> Iterable[rr.ComponentColumn]:
    first = images[0]
    if first.ndim == 3:
        return rr.EncodedImage.columns(blob=[_jpeg(one) for one in images], media_type=["image/jpeg"] * len(images))
    kind = rr.ChannelDatatype.U8 if first.dtype == np.uint8 else rr.ChannelDatatype.F16
    size = rr.components.ImageFormat(width=first.shape[1], height=first.shape[0], channel_datatype=kind)
    buffers, formats = [one.tobytes() for one in images], [size] * len(images)
    if first.dtype == np.uint8:
        return rr.SegmentationImage.columns(buffer=buffers, format=formats)
    ranges = [one for one in limits if one is not None]
    return rr.DepthImage.columns(buffer=buffers, format=formats, depth_range=ranges or None)


def _jpeg(image: Image8) -> bytes:
    out = io.BytesIO()
    Image.fromarray(image).save(out, format="JPEG", quality=JPEG_QUALITY)
    return out.getvalue()


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
        self._depth_m = (float(near - reach), float(far + reach))

    def send_observed(self, file: RecordingFile, iteration: int) -> None:
        """A cut-out of what the sensor saw: colour and depth."""
        photo, pending, scale = self._targets[0].observation.rgb, PendingMaps(), depth_scale(*self._depth_m)
        # As pictures: objects take turns often, and the measured numbers are in the depth image of the frame.
        depth = rgb(depth_indices(self._observed_m, scale), scale.palette)
        pending.add(entities.OBSERVED_COLOUR, iteration, depth if photo is None else self._cut(photo))
        pending.add(entities.OBSERVED_DEPTH, iteration, depth)
        pending.send(file)

    def add_pair(self, pending: PendingMaps, iteration: Iteration, placed: Sequence[Placed]) -> None:
        """The maps of the two poses that an iteration had to choose from; none where the score is not of pixels."""
        (target,) = self._targets
        of_poses = [self._verifier.maps(target, s.T_cam_obj, placed, self._at) for s in compared(iteration)]
        pair = [maps for maps in of_poses if maps is not None]
        if not pair:
            return
        limits = _difference_limits(pair)
        names = MAP_NAMES if pair[0].correlation is None else (*MAP_NAMES, *COLOUR_NAMES)
        for when, maps in zip(entities.COMPARED, pair, strict=True):
            for name in names:
                self._add(pending, entities.pose_map(name, when), iteration.index, name, maps, limits)

    def add_scene(self, pending: PendingMaps, iteration: int, Ts_cam_obj: Float, placed: Sequence[Placed]) -> None:
        """The maps of all objects together, at the poses (m, 4, 4)."""
        maps = self._verifier.scene_maps(self._targets, Ts_cam_obj, placed, at=self._at)
        if maps is None:
            return
        limits = _difference_limits([maps])
        for name in SCENE_MAP_NAMES if maps.correlation is None else (*SCENE_MAP_NAMES, *COLOUR_NAMES):
            self._add(pending, entities.scene_map(name), iteration, name, maps, limits)

    def _add(
        self,
        pending: PendingMaps,
        entity: str,
        iteration: int,
        name: MapName,
        maps: ScoreMaps,
        difference: tuple[float, float],
    ) -> None:
        """Adds one map, without value beyond the image."""
        if name in FLOAT_MAPS:
            values = np.where(self._outside, np.nan, FLOAT_MAPS[name].values(maps)).astype(np.float16)
            limits = {"rendered": self._depth_m, "difference": difference}.get(name)
            pending.add(entity, iteration, values, None if limits is None else _with_no_value(limits))
        elif name == "classes":
            pending.add(entity, iteration, np.where(self._outside, np.uint8(0), maps.classes))
        elif maps.rendered_rgb is not None:
            shown = (maps.rendered_m > 0) & ~self._outside
            pending.add(entity, iteration, np.where(shown[..., None], maps.rendered_rgb, np.array(EMPTY, np.uint8)))

    def _cut(self, image: NDArray[Any]) -> NDArray[Any]:
        """The pixels that are shown; black beyond the image."""
        tile = image[self._at.rows[:, None], self._at.columns]
        tile[self._outside] = 0
        return tile


def _difference_limits(maps: Sequence[ScoreMaps]) -> tuple[float, float]:
    """Ends of the scale of the depth difference [mm] of poses that are compared, beyond nearly all of their pixels."""
    found = [np.abs(one.depth_difference_m[one.counted & np.isfinite(one.depth_difference_m)]) for one in maps]
    most_mm = max((1e3 * float(np.percentile(one, 90)) for one in found if len(one)), default=0.0)
    end = next((mm for mm in DIFFERENCE_MM if mm >= most_mm), DIFFERENCE_MM[-1])
    return -end, end


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
    picture = rr.Image(np.concatenate(parts[:-1], axis=1)).compress(jpeg_quality=STEPS_QUALITY)
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
