"""Whether the objects of a data set appear as large, and as far away, as their models do in their true poses.

A wrong focal length goes unnoticed where only depth is compared: an object near the image's centre still lies about
right. But it changes how large objects appear and, by the same factor, how far from the centre; models of a wrong size
change the first alone, a wrong depth_scale neither. So all objects together tell what is off, and by how much.

One focal length alone makes objects wider or higher, and a wrong cx or cy moves them all beside their models; depth
goes with them there, but stays where masks alone are displaced.

Measured with cam_K multiplied by 0.7 to 1.3, as factors over the one expected then: on eight real frames (YCB-V,
640x480, masks by annotators) 24 of 28 objects are ``SURE``, with 0.956 to 1.045, medians of frames 0.988 to 1.004,
depth 0.998 to 1.004; on the built-in scenes 34 of 39 objects, with 0.990 to 1.006. So a focal length that is off by 10%
is noticed in every real frame, by 5% where masks are exact; a small object alone in the middle of the image says so
from 15% on, as masks may be too wide. fx or fy alone off by 10% to 30% was noticed in 91 of 96 cases on the real
frames, by 5% in 2 of 32; cx or cy off by 20 px and more in all 80, by 12 px in 15 of 16.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Instance
from verefine_viz.scenes.outline_fit import Likeness, likeness
from verefine_viz.scenes.size_words import Cause, Verdict, about_depth, about_place, about_sides, about_size, alike

MOST = 6
"""Objects of a frame that are looked at, the largest first: 4 to 8 ms each."""
SMALLEST_PX = 24
"""Smaller objects (square root of the mask's area) are passed over: a pixel is too much of them."""
SURE = 0.05
"""Objects whose factor is less certain are passed over. It is 0.01 to 0.04 with good masks and 0.15 and more with those
of another shape than the model's outline: a part is missing, a neighbour is in it."""
SURE_SIDES = 0.07
"""The same of an object's width and height, each by itself."""
FEWEST_TOGETHER = 2
"""A single mask may be too narrow or too low by itself, or lie beside its object."""
FEWEST_SURE = 1 / 3
"""Where less of the objects are sure, masks are such that a factor may be chance."""
OFF = 0.04
"""Factors that are off by less than this and what they are uncertain by say nothing."""
MOST_DISSENT = 0.25
"""Share of the objects that may be off by less than half as much."""
MASK_PX = 4
"""Objects that are larger by less than this on each side say nothing of models: all masks of a data set may be too wide
or too narrow. Masks widened or narrowed by up to 3 px on purpose were never taken for another fault [px]."""
BESIDE = 0.015
"""Objects that lie beside their models by less than this share of the image's width say nothing of the camera."""
PLAIN_PX = 2
"""An explanation that places objects better than another one by less than this is no better [px]."""
IMAGE_CORNER_PX = np.array([-0.5, -0.5])
"""What stays in its place where an image is made larger or smaller."""


@dataclass(frozen=True, eq=False)
class Witness:
    """An object in a known pose, and how its mask lies over its model."""

    likeness: Likeness
    camera: Camera
    origin_px: Float
    """(2,) where the model's origin is seen."""


def witnesses(
    objects: Sequence[tuple[ObjectModel, Float, Mask]],
    camera: Camera,
    depth_m: NDArray[np.float32],
    object_mask: Mask,
) -> list[Witness]:
    """The largest objects of a frame, as far as enough is seen of their outlines.

    Args:
        objects: model, T_cam_obj (4, 4) and mask (H, W) of each.
        camera: of the frame.
        depth_m: (H, W) as measured, 0 where nothing was.
        object_mask: (H, W) pixels of any object, also of others than these.
    """
    found: list[Witness] = []
    large = [one for one in objects if np.count_nonzero(one[2]) >= SMALLEST_PX**2]
    for model, T, mask in sorted(large, key=lambda one: -np.count_nonzero(one[2]))[:MOST]:
        alike = likeness(model, T, camera, mask, object_mask, depth_m)
        if alike is not None and T[2, 3] > 0:
            found.append(Witness(alike, camera, camera.project(T[:3, 3])))
    return found


def size_notes(
    instances: Sequence[Instance], models: Mapping[int, ObjectModel], observation: Observation
) -> tuple[str, ...]:
    """A note where the objects of a frame appear larger or smaller, or nearer or farther, than their true poses say.

    Args:
        instances: of the frame.
        models: by obj_id.
        observation: the frame.
    """
    known = [(models[i.obj_id], i.T_cam_obj_gt, i.mask) for i in instances if i.T_cam_obj_gt is not None]
    verdict = size_verdict(witnesses(known, observation.camera, observation.depth_m, observation.object_mask))
    return (f"{verdict.found}: {verdict.advice}",) if verdict.advice else ()


def size_verdict(looked: Sequence[Witness]) -> Verdict:
    """What objects of one frame or several tell together."""
    sides = _off_sides(looked)
    if sides is not None:
        return about_sides(*sides.tolist())
    seen = [one for one in looked if one.likeness.error < SURE]
    if not seen or len(seen) < FEWEST_SURE * len(looked):
        return Verdict("too few masks are large enough, and of the shape of their model's outline, to compare sizes")
    factors = np.array([one.likeness.factor for one in seen])
    depths = np.array([one.likeness.depth for one in seen])
    error = float(np.median([one.likeness.error for one in seen]))
    factor, depth = _median(factors), _median(depths)
    if _is_off(factors, error):
        return about_size(_cause(seen, factor, depth), factor)
    beside_px = _beside_px(seen)
    if beside_px is not None:
        return about_place(beside_px, is_depth_there=float(np.mean([one.likeness.gain for one in seen])) > 0)
    # What is off by far more is of another unit, and said where units are looked at.
    return about_depth(depth) if _is_off(depths, 0.0) and 0.5 < depth < 2 else alike()


def _off_sides(looked: Sequence[Witness]) -> Float | None:
    """(2,) how many times as wide and as high as their models objects appear; None where the two are not far apart."""
    seen = [one.likeness for one in looked if one.likeness.sides_error < SURE_SIDES]
    if len(seen) < max(FEWEST_TOGETHER, FEWEST_SURE * len(looked)):
        return None
    sides, error = np.array([one.sides for one in seen]), float(np.median([one.sides_error for one in seen]))
    # Masks that are too wide make narrow objects wider by more, but each by as many pixels as higher.
    grown_px = (sides - 1) * [one.box_px for one in seen] / 2
    is_plain = abs(np.median(grown_px[:, 0] - grown_px[:, 1])) > MASK_PX
    return np.median(sides, axis=0) if is_plain and _is_off(sides[:, 0] / sides[:, 1], error) else None


def _beside_px(seen: Sequence[Witness]) -> Float | None:
    """(2,) how far beside their models all objects lie; None where they do not, or each lies elsewhere."""
    shifts_px = np.array([one.likeness.shift_px for one in seen])
    if len(seen) < FEWEST_TOGETHER:
        return None
    middle_px = np.median(shifts_px, axis=0)
    far_px = float(np.linalg.norm(middle_px))
    spread_px = float(np.median(np.linalg.norm(shifts_px - middle_px, axis=1)))
    if far_px <= BESIDE * seen[0].camera.width + 3 * spread_px:
        return None
    along = shifts_px @ middle_px / far_px**2
    return middle_px if np.mean(along < 0.5) <= MOST_DISSENT else None


def _cause(seen: Sequence[Witness], factor: float, depth: float) -> Cause:
    """Where objects of another size appear tells what makes them larger or smaller."""
    of_focal = _misplaced_px(seen, factor, [np.array([one.camera.cx, one.camera.cy]) for one in seen])
    of_image = _misplaced_px(seen, factor, [IMAGE_CORNER_PX for _ in seen])
    of_models = _misplaced_px(seen, factor, [one.origin_px for one in seen])
    if _is_plainly_better(of_image, min(of_focal, of_models)):
        return "image"
    if _is_plainly_better(of_focal, of_models):
        return "focal length"
    # Neither cam_K nor the size of models changes how far away objects are.
    if abs(np.log(depth)) > OFF and abs(np.log(depth * factor)) < abs(np.log(depth)):
        return "distances"
    # Masks that are too wide leave objects where they are as well.
    if np.median([one.likeness.size_px for one in seen]) * abs(factor - 1) / 2 < MASK_PX:
        return "masks"
    return "models" if _is_plainly_better(of_models, min(of_focal, of_image)) else "focal length or models"


def _misplaced_px(seen: Sequence[Witness], factor: float, fixed_px: Sequence[Float]) -> float:
    """How far from where they should be objects lie if all were ``factor`` times as far from those points (2,)."""
    alike = [one.likeness for one in seen]
    expected = [(factor - 1) * (one.middle_px - fixed) for one, fixed in zip(alike, fixed_px, strict=True)]
    return _median([float(np.linalg.norm(one.shift_px - shift)) for one, shift in zip(alike, expected, strict=True)])


def _is_plainly_better(misplaced_px: float, other_px: float) -> bool:
    return misplaced_px < other_px / 2 and misplaced_px < other_px - PLAIN_PX


def _is_off(ratios: Float, error: float) -> bool:
    """Whether ratios differ from 1, most of them in the same way."""
    logs = np.log(ratios[np.isfinite(ratios)])
    middle = float(np.median(logs)) if len(logs) else 0.0
    if abs(middle) <= OFF + error:
        return False
    return bool(np.mean(logs / middle < 0.5) <= MOST_DISSENT)


def _median(values: Sequence[float] | Float) -> float:
    """Of those that are finite; 1 without any: a ratio of nothing is not off."""
    known = np.asarray(values)[np.isfinite(values)]
    return float(np.median(known)) if len(known) else 1.0
