"""The layers of the image pane: photo, posed model, score map, contours, and the numbers of every pixel.

All are laid over each other by the browser, in pixels of the camera's image; ``assets/image_pane.js`` zooms them.
"""

from __future__ import annotations

import base64
import io
import json
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image as PilImage

from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.palette import RGB, SIDE_COLORS, STAGE_COLORS
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.scores import ScoreMaps
from verefine_viz.pictures.answer_pictures import camera_image
from verefine_viz.pictures.contours import contour_lines, model_contours, svg_path
from verefine_viz.pictures.map_images import palette_of
from verefine_viz.pictures.surroundings_meshes import DROPPED_COLOR, UNKNOWN_COLOR
from verefine_viz.rendering.rendered_scene import AMBIENT, render_scene
from verefine_viz.viewer.drawing.markup import text
from verefine_viz.viewer.drawing.score_maps import Crop, bounds, crop_around, data_uri, scales_for
from verefine_viz.viewer.snapshot.snapshot import ComparedPose, Snapshot
from verefine_viz.viewer.state.view_options import stage_label

JPEG_QUALITY = 88
MARGIN = 0.35
"""Shown around the object, as a share of its size."""
CROP_ASPECT = 1.2
NUMBERS_PER_M, NUMBERS_PER_MM, NUMBERS_PER_DEG = 10_000, 10, 10
"""What the browser shows of a pixel, in whole numbers: as many digits as a click gives."""
NO_NUMBER = np.iinfo(np.int32).min
_MOST_CONTOURS = 256


@dataclass(frozen=True, eq=False)
class ShownContour:
    """One pose, or those of all objects, whose contours are drawn."""

    key: str
    """What the legend switches: a stage, or the side "A" or "B" of a comparison."""
    label: str
    color: RGB
    poses: tuple[tuple[Target, Float], ...]
    """What is posed, and T_cam_obj (4, 4)."""
    dashed: bool = False
    names: tuple[tuple[str, RGB], ...] = ()
    """Of a contour that several poses share, each with the colour that it has elsewhere on the page."""


def shown_contours(snapshot: Snapshot) -> tuple[ShownContour, ...]:
    """Which contours there are: of two runs that are compared, of the whole scene, or of the object's poses.

    Later ones are drawn over earlier ones: ground truth, shown stage, A, B, answer.
    """
    targets = snapshot.problem.targets if snapshot.is_whole_scene else (snapshot.target,)
    true = tuple((t, t.instance.T_cam_obj_gt) for t in targets if t.instance.T_cam_obj_gt is not None)
    ground_truth = ShownContour("ground truth", "ground truth", STAGE_COLORS["ground truth"], true)
    first = (ground_truth,) if true else ()
    if snapshot.comparison is not None:
        return (*first, *_contours_of_sides(snapshot, targets))
    if snapshot.is_whole_scene:
        return (*first, *_contours_of_scenes(snapshot))
    letters = {s.pose.name: letter for s, letter in ((snapshot.b, "B"), (snapshot.a, "A")) if s is not None}
    names = ["ground truth", _shown_stage(snapshot), *letters, "best"]
    names = list(dict.fromkeys(name for name in names if name in snapshot.poses))
    shown: dict[bytes, ShownContour] = {}
    for name in names:
        label = " ".join(filter(None, (letters.get(name), stage_label(name))))
        T_cam_obj = snapshot.poses[name].T_cam_obj
        under = shown.pop(T_cam_obj.tobytes(), None)  # The same contour: the later one would hide it.
        names = (*(under.names if under is not None else ()), (label, STAGE_COLORS[name]))
        label = " = ".join(own for own, _ in names)
        pose = ((snapshot.target, T_cam_obj),)
        shown[T_cam_obj.tobytes()] = ShownContour(name, label, STAGE_COLORS[name], pose, names=names)
    return tuple(shown.values())


def _shown_stage(snapshot: Snapshot) -> str:
    """The last stage of the iteration that is revealed, or what it accepted."""
    if "accepted" in snapshot.poses or snapshot.shown is None:
        return "accepted" if "accepted" in snapshot.poses else "current"
    return next((s.name for s in reversed(snapshot.shown.stages) if s.name in snapshot.poses), "current")


def _contours_of_sides(snapshot: Snapshot, targets: Sequence[Target]) -> list[ShownContour]:
    sides, shown = snapshot.comparison, []
    assert sides is not None
    for k, (side, name) in enumerate((("A", sides.name_a), ("B", sides.name_b))):
        both = ((t, sides.poses.get(t.instance.instance_id, (None, None))[k]) for t in targets)
        poses = tuple((t, T) for t, T in both if T is not None)
        if poses and side in sides.shown:
            shown.append(ShownContour(side, f"{side} {name}", SIDE_COLORS[side], poses, dashed=side == "B"))
    return shown


def posed_objects(snapshot: Snapshot, side: ComparedPose) -> tuple[tuple[Target, Float], ...]:
    """What a side of the comparison of poses shows: the object in focus, or all of the scene; with T_cam_obj (4, 4)."""
    if not snapshot.is_whole_scene:
        return ((snapshot.target, side.pose.T_cam_obj),)
    known = [o.target for o in snapshot.scene.objects if o.T_cam_obj is not None and o.answer is not None]
    return tuple(zip(known, side.pose.T_cam_obj, strict=True))


def _contours_of_scenes(snapshot: Snapshot) -> list[ShownContour]:
    """Of all objects as both combinations of poses have them."""
    shown = []
    for side, letter in ((snapshot.a, "A"), (snapshot.b, "B")):
        if side is not None:
            color = STAGE_COLORS["best" if side.pose.name == "best" else "current"]
            label = f"{letter} {side.pose.label}"
            shown.append(ShownContour(letter, label, color, posed_objects(snapshot, side)))
    return shown


def contours_svg(snapshot: Snapshot, contours: Sequence[ShownContour]) -> str:
    """The contours as an SVG in pixels of the image."""
    camera = snapshot.problem.observation.camera
    paths = "".join(
        f'<g data-contour="{one.key}" class="{"dashed" if one.dashed else ""}">'
        f'<defs><path id="contour-{k}" d="{way}"/></defs>'
        f'<use class="rim" href="#contour-{k}"/><use href="#contour-{k}" stroke="rgb{one.color}"/></g>'
        for k, one in enumerate(contours)
        for way in ("".join(_way(t.model, T.tobytes(), camera) for t, T in one.poses),)
    )
    paths = f"{_unknown_objects(snapshot.problem.observation)}{paths}"
    size = f'viewBox="0 0 {camera.width} {camera.height}" width="{camera.width}" height="{camera.height}"'
    return f'<svg class="image-canvas" {size}>{paths}</svg>'


@lru_cache(maxsize=4)
def _unknown_objects(observation: Observation) -> str:
    """Unknown objects of the surroundings, hatched and numbered; dropped ones grey."""
    around = observation.support.surroundings if observation.support is not None else None
    parts = []
    for one in around.unknown if around is not None else ():
        color, way = DROPPED_COLOR if one.is_dropped else UNKNOWN_COLOR, svg_path(contour_lines(one.mask))
        hatch = f"hatch-{one.number}"
        title = f"unknown object {one.number}{', dropped' if one.is_dropped else ''}"
        v, u = np.argwhere(one.mask).mean(axis=0)
        parts.append(
            f'<g data-unknown="{one.number}"><title>{title}</title><defs><pattern id="{hatch}" width="7" height="7" '
            f'patternUnits="userSpaceOnUse" patternTransform="rotate(45)"><path d="M0 0v7" stroke="rgb{color}" '
            f'stroke-width="2"/></pattern></defs><path d="{way}" fill="url(#{hatch})" stroke="rgb{color}" '
            f'stroke-width="1.5"/><text x="{u:.0f}" y="{v:.0f}">{one.number}</text></g>'
        )
    return "".join(parts)


@lru_cache(maxsize=_MOST_CONTOURS)
def _way(model: ObjectModel, T_cam_obj: bytes, camera: Camera) -> str:
    return svg_path(model_contours(model, np.frombuffer(T_cam_obj).reshape(4, 4), camera))


# Photo and observed depth, once per frame


def photo_html(observation: Observation) -> str:
    """The camera's image, or the coloured depth image, with the depth of its pixels."""
    out = io.BytesIO()
    PilImage.fromarray(camera_image(observation)).save(out, "JPEG", quality=JPEG_QUALITY)
    uri = f"data:image/jpeg;base64,{base64.b64encode(out.getvalue()).decode('ascii')}"
    camera = observation.camera
    whole = Crop(0, 0, camera.width, camera.height)
    observed = _rounded(np.where(observation.depth_m > 0, observation.depth_m, np.nan), NUMBERS_PER_M)
    return f'{_image(uri, whole)}<i data-depth="{_packed([observed])}"></i>'


# What needs the score maps of the pose: its rendering, one map, and all numbers


def shown_side(snapshot: Snapshot) -> ComparedPose | None:
    """The pose that is rendered over the photo, and whose numbers a pixel has: B, as everywhere."""
    return snapshot.b or snapshot.a


def model_html(snapshot: Snapshot, side: ComparedPose) -> str:
    """The posed model, as if lit from the camera: with its texture, or without one in the colour of its stage."""
    assert side.maps is not None
    posed = posed_objects(snapshot, side)
    if any(target.model.texture is not None for target, _ in posed):
        return _textured(posed, snapshot.problem.observation.camera)
    is_model = side.maps.rendered_m > 0
    part = bounds(is_model)
    if part.height == 0:
        return ""
    light = AMBIENT + (1 - AMBIENT) * _facing(side.maps, part, snapshot.problem.observation.camera)
    indices = np.where(part.of(is_model), 1 + np.rint(254 * light), 0).astype(np.uint8)
    color = np.array(side.pose.color)
    ramp = np.linspace(0, 1, 255)[:, None] * (0.35 * 255 + 0.65 * color)
    palette = bytes(3) + ramp.round().astype(np.uint8).tobytes()
    return _picture(indices, palette, part)


def _textured(posed: Sequence[tuple[Target, Float]], camera: Camera) -> str:
    placed = [Placed(k, target.model, T) for k, (target, T) in enumerate(posed)]
    rendering = render_scene(placed, camera)
    part = bounds(rendering.labels >= 0)
    if part.height == 0:
        return ""
    opaque = np.where(part.of(rendering.labels, -1) >= 0, 255, 0).astype(np.uint8)
    out = io.BytesIO()
    PilImage.fromarray(np.dstack([part.of(rendering.rgb), opaque])).save(out, "png", compress_level=1)
    return _image(data_uri(out.getvalue()), part)


def _facing(maps: ScoreMaps, part: Crop, camera: Camera) -> NDArray[np.floating]:
    """(H, W) how directly the rendered surface faces the camera, in [0, 1]."""
    v, u = np.mgrid[part.v0 : part.v1, part.u0 : part.u1]
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    return np.clip(np.abs((part.of(maps.rendered_normals) * rays).sum(axis=-1)), 0, 1)


def map_html(snapshot: Snapshot, side: ComparedPose) -> str:
    """The chosen score map where the pose is scored, transparent elsewhere."""
    assert side.maps is not None
    name, target, tau_m = snapshot.options.map, snapshot.map_target, snapshot.session.score.tau_m
    part = bounds(side.maps.classes > 0)
    if part.height == 0:
        return ""
    shown = part.images(side.maps, target, tau_m)
    indices = np.where(shown.maps.classes > 0, shown.indices(name), 0)
    return _picture(indices.astype(np.uint8), palette_of(name, scales_for(target, tau_m)), part)


def numbers_html(side: ComparedPose) -> str:
    """Rendered depth, Δ, angle and class of every pixel that the pose covers or is scored at, for the browser."""
    maps = side.maps
    assert maps is not None
    part = bounds((maps.classes > 0) | (maps.rendered_m > 0))
    if part.height == 0:
        return ""
    rendered = part.of(maps.rendered_m)
    numbers = [
        _rounded(np.where(rendered > 0, rendered, np.nan), NUMBERS_PER_M),
        _rounded(1000 * np.where(rendered > 0, part.of(maps.depth_difference_m, np.nan), np.nan), NUMBERS_PER_MM),
        _rounded(np.rad2deg(np.where(rendered > 0, part.of(maps.angle_rad, np.nan), np.nan)), NUMBERS_PER_DEG),
        part.of(maps.classes).astype(np.int32),
    ]
    return f'<i data-area="{_area(part)}" data-numbers="{_packed(numbers)}"></i>'


def object_crop(snapshot: Snapshot) -> Crop:
    """The part of the image that is shown of the object at first: it does not depend on the iteration."""
    crop = crop_around(snapshot.map_target.instance.mask, CROP_ASPECT, MARGIN)
    camera = snapshot.problem.observation.camera
    return Crop(max(crop.u0, 0), max(crop.v0, 0), min(crop.u1, camera.width), min(crop.v1, camera.height))


def _picture(indices: NDArray[np.uint8], palette: bytes, part: Crop) -> str:
    """An image of indices into a palette, of which 0 is transparent, in its place."""
    picture, out = PilImage.fromarray(indices), io.BytesIO()
    picture.putpalette(palette)
    picture.save(out, "png", compress_level=1, transparency=0)
    return _image(data_uri(out.getvalue()), part)


def _image(uri: str, part: Crop) -> str:
    place = f"left:{part.u0}px;top:{part.v0}px;width:{part.width}px;height:{part.height}px"
    return f'<div class="image-canvas"><img src="{uri}" alt="" style="{place}"></div>'


def _area(part: Crop) -> str:
    return text(json.dumps([part.u0, part.v0, part.width, part.height]))


def _rounded(values: NDArray[np.floating], per_unit: int) -> NDArray[np.int32]:
    known = np.isfinite(values)
    return np.where(known, np.rint(np.where(known, values, 0.0) * per_unit), NO_NUMBER).astype(np.int32)


def _packed(numbers: Sequence[NDArray[np.int32]]) -> str:
    """Whole numbers for a browser: little-endian, one image after the other, compressed."""
    content = b"".join(image.astype("<i4").tobytes() for image in numbers)
    return base64.b64encode(zlib.compress(content, 1)).decode("ascii")
