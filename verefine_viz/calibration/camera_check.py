"""Whether camera, depth, models, ground-truth and initial poses of a frame belong together.

A wrong focal length goes unnoticed where only depth is compared: an object near the image's centre still lies about
right. But it changes how large objects appear and, by the same factor, how far from the centre; models of a wrong size
change the first alone, a wrong depth_scale neither. One focal length alone makes objects wider or higher, and a wrong
cx or cy moves them all beside their models; depth goes with them there, but stays where masks alone are displaced. A
bad mask or a poor estimate is off alone; so objects are taken together. Measured: docs/decisions/data-checks.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from verefine_viz.calibration.outlines import OutlineFit, fit_outline
from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import apply, inverse
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Problem

MOST, SMALLEST_PX = 6, 24
"""Objects of a frame that are compared, the largest first, and the smallest (square root of the mask's area)."""
SURE, SURE_SIDES = 0.05, 0.07
"""Objects whose factor, or width and height, are less certain have masks of another shape, and are passed over."""
FEWEST_SURE, FEWEST_TOGETHER = 1 / 3, 2
"""Share of the objects that must be sure, and number where a single mask may be too narrow or lie beside by chance."""
OFF, MOST_DISSENT = 0.04, 0.25
"""Least share by which factors are off, and share of the objects that may be off by less than half as much."""
MASK_PX, PLAIN_PX = 4, 2
"""All masks may be too wide by less on each side; and what explains places better by less is no better [px]."""
BESIDE, LITTLE = 0.015, 0.25
"""Least displacement (share of the image's width), and least share of its larger side at which the other is named."""
FEW = 3
"""With fewer objects chance may look like a rule."""
OFF_DEPTH, OTHER_UNIT = 0.05, 5.0
"""Estimators' own distances may all be off by this share; what is off by a larger factor is of another unit."""
IN_ORDER = "objects appear as large as their models in their ground-truth poses"


@dataclass(frozen=True)
class CameraVerdict:
    """How sizes and places of objects differ from what their poses say."""

    message: str
    advice: str = ""  # what to do about it; empty = nothing
    cause: str | None = None
    """"focal length", "one focal length", "principal point", "image" (cam_K is of images of another size), "models",
    "focal length or models", "distances" (of the ground-truth poses), "masks", "depth", or nothing is off."""


def outline_fits(
    objects: Sequence[tuple[ObjectModel, Float, Mask]], camera: Camera, depth_m: NDArray[np.float32], object_mask: Mask
) -> list[OutlineFit]:
    """How the largest of these objects (model, T_cam_obj (4, 4), mask (H, W)) lie over their models.

    Those of whose outline too little is seen are left out. ``depth_m`` (H, W) is 0 where nothing was measured, and
    ``object_mask`` (H, W) are the pixels of any object, also of others than these.
    """
    large = [one for one in objects if np.count_nonzero(one[2]) >= SMALLEST_PX**2]
    largest = sorted(large, key=lambda one: -np.count_nonzero(one[2]))[:MOST]
    fits = [fit_outline(model, T, camera, mask, object_mask, depth_m) for model, T, mask in largest]
    return [fit for fit in fits if fit is not None]


def camera_notes(problem: Problem) -> tuple[str, ...]:
    """A note where objects with ground truth do not appear as, and where, it says."""
    seen, instances = problem.observation, problem.instances
    known = [(problem.models[i.obj_id], i.T_cam_obj_gt, i.mask) for i in instances if i.T_cam_obj_gt is not None]
    sizes = verdict(outline_fits(known, seen.camera, seen.depth_m, seen.object_mask))
    return (f"{sizes.message}: {sizes.advice}",) if sizes.advice else ()


def verdict(fits: Sequence[OutlineFit]) -> CameraVerdict:
    """What the outlines of objects of one frame, or of several, show together."""
    if (one_focal_length := _one_focal_length(fits)) is not None:
        return one_focal_length
    sure = [one for one in fits if one.error < SURE]
    if not sure or len(sure) < FEWEST_SURE * len(fits):
        return CameraVerdict(
            "too few masks are large enough, and of the shape of their model's outline, to compare sizes"
        )
    factors, depths = np.array([one.factor for one in sure]), np.array([one.depth for one in sure])
    depth = float(np.median(depths[np.isfinite(depths)])) if np.isfinite(depths).any() else 1.0
    if _are_off(factors, float(np.median([one.error for one in sure]))):
        return _size(sure, float(np.median(factors)), depth)
    if (displaced := _displaced(sure)) is not None:
        return displaced
    # What is off by far more is of another unit, and reported where units are checked.
    if not _are_off(depths, 0.0) or not 0.5 < depth < 2:
        return CameraVerdict(IN_ORDER)
    message = f"{IN_ORDER}, but measured depth is {_percent(depth)} {'larger' if depth > 1 else 'smaller'} than theirs"
    return CameraVerdict(message, f"check depth_scale in scene_camera.json: {_fitting(1 / depth)}", "depth")


def _one_focal_length(fits: Sequence[OutlineFit]) -> CameraVerdict | None:
    """Where objects appear wider or narrower than their models by another factor than higher or lower."""
    sure = [one for one in fits if one.sides_error < SURE_SIDES]
    if len(sure) < max(FEWEST_TOGETHER, FEWEST_SURE * len(fits)):
        return None
    sides, error = np.array([one.sides for one in sure]), float(np.median([one.sides_error for one in sure]))
    # Masks that are too wide make narrow objects wider by more, but each by as many pixels as higher.
    grown_px = (sides - 1) * [one.drawn.box_px for one in sure] / 2
    if abs(np.median(grown_px[:, 0] - grown_px[:, 1])) <= MASK_PX or not _are_off(sides[:, 0] / sides[:, 1], error):
        return None
    times, words = np.median(sides, axis=0).tolist(), (("wider", "narrower", "fx"), ("higher", "lower", "fy"))
    off = [(x, more if x > 1 else less, name) for x, (more, less, name) in zip(times, words, strict=True)]
    off = [one for one in off if abs(np.log(one[0])) > OFF]
    size = " and ".join(f"{_percent(x)} {how}" for x, how, _ in off)
    which = ", and ".join(f"{name} of cam_K looks {_off(x)}" for x, _, name in off)
    advice = f"{which}; check that cam_K belongs to images of this size"
    return CameraVerdict(f"objects appear {size} than their models", advice, "one focal length")


def _size(sure: Sequence[OutlineFit], factor: float, depth: float) -> CameraVerdict:
    """Where objects appear ``factor`` times as large as their models: where they lie shows what makes them so."""
    size, away, near = ("larger", "farther from", "nearer") if factor > 1 else ("smaller", "nearer to", "farther away")
    message, off = (
        f"objects appear {_percent(factor)} {size} than their models in their ground-truth poses",
        _off(factor),
    )

    def misplaced_px(fixed_px: Sequence[Float]) -> float:
        """How far from where they should be objects lie if all were ``factor`` times as far from those points (2,)."""
        expected = [(factor - 1) * (one.drawn.middle_px - fixed) for one, fixed in zip(sure, fixed_px, strict=True)]
        return float(np.median(np.linalg.norm([one.shift_px for one in sure] - np.array(expected), axis=1)))

    of_focal = misplaced_px([one.camera.K[:2, 2] for one in sure])
    of_image = misplaced_px([np.array([-0.5, -0.5])] * len(sure))
    of_models = misplaced_px([one.origin_px for one in sure])
    if _is_better(of_image, min(of_focal, of_models)):
        advice = f"cam_K looks like that of images of another size: fx, fy, cx and cy all look {off}"
        return CameraVerdict(f"{message} and lie {away} the image's upper left corner by as much", advice, "image")
    if _is_better(of_focal, of_models):
        advice = f"fx and fy of cam_K look {off}; check that cam_K belongs to images of this size"
        return CameraVerdict(f"{message} and lie {away} the image's centre by as much", advice, "focal length")
    # Neither cam_K nor the size of models changes how far away objects are.
    if abs(np.log(depth)) > OFF and abs(np.log(depth * factor)) < abs(np.log(depth)):
        advice = f"cam_t_m2c in scene_gt.json looks too {'large' if factor > 1 else 'small'}; check its unit"
        return CameraVerdict(f"{message} and are {near} by as much", advice, "distances")
    # Masks that are too wide leave objects where they are as well.
    if np.median([one.drawn.size_px for one in sure]) * abs(factor - 1) / 2 < MASK_PX:
        wide = "wide" if factor > 1 else "narrow"
        return CameraVerdict(f"{message}, as they do where masks are a few pixels too {wide}", cause="masks")
    if _is_better(of_models, min(of_focal, of_image)):
        advice = f"the models look {off}; check their unit and scale"
        return CameraVerdict(f"{message}, in the right places", advice, "models")
    return CameraVerdict(message, f"either fx and fy of cam_K or the models look {off}", "focal length or models")


def _is_better(misplaced_px: float, other_px: float) -> bool:
    return misplaced_px < other_px / 2 and misplaced_px < other_px - PLAIN_PX


def _displaced(sure: Sequence[OutlineFit]) -> CameraVerdict | None:
    """Where all objects lie beside their models by as much; depth shows whether the camera or the masks are off."""
    shifts_px = np.array([one.shift_px for one in sure])
    middle_px = np.median(shifts_px, axis=0)
    far_px, spread_px = np.linalg.norm(middle_px), np.median(np.linalg.norm(shifts_px - middle_px, axis=1))
    is_common = np.mean(shifts_px @ middle_px < 0.5 * far_px**2) <= MOST_DISSENT
    if len(sure) < FEWEST_TOGETHER or far_px <= BESIDE * sure[0].camera.width + 3 * spread_px or not is_common:
        return None
    words = (("left of", "right of", "cx"), ("above", "below", "cy"))
    off = [(px, *of) for px, of in zip(middle_px.tolist(), words, strict=True)]
    off = [one for one in off if abs(one[0]) > LITTLE * abs(middle_px).max()]
    where = " and ".join(f"{abs(px):.0f} px {more if px > 0 else less}" for px, less, more, _ in off)
    message = f"objects lie {where} where their models are in their ground-truth poses"
    if np.mean([one.gain for one in sure]) <= 0:
        advice = "the masks are displaced: check that they are of these images"
        return CameraVerdict(f"{message}, but depth does not", advice, "masks")
    too = [f"{name} of cam_K looks {abs(px):.0f} px too {'small' if px > 0 else 'large'}" for px, *_, name in off]
    check = "check that cam_K belongs to these images, also if they were cropped, and that depth is registered to"
    advice = f"{' and '.join(too)}; {check} colour if the masks were made from it"
    return CameraVerdict(f"{message}, and so does depth", advice, "principal point")


def _are_off(ratios: Float, error: float) -> bool:
    """Whether ratios differ from 1, most of them in the same way."""
    logs = np.log(ratios[np.isfinite(ratios)])
    middle = float(np.median(logs)) if len(logs) else 0.0
    return abs(middle) > OFF + error and bool(np.mean(logs / middle < 0.5) <= MOST_DISSENT)


def depth_notes(problem: Problem) -> tuple[str, ...]:
    """A note where, without ground truth, all objects are measured nearer or farther away than their initial poses say.

    Estimators that see colour alone place objects by the camera and the size of the models, not by depth.
    """
    if any(i.T_cam_obj_gt is not None for i in problem.instances):
        return ()
    seen = problem.observation
    initial = [(problem.models[i.obj_id], i.hypotheses[0].T_cam_obj, i.mask) for i in problem.instances if i.hypotheses]
    depths = [one.depth for one in outline_fits(initial, seen.camera, seen.depth_m, seen.object_mask)]
    logs = np.log([depth for depth in depths if depth > 0])
    if len(logs) < FEW:
        return ()
    middle = float(np.median(logs))
    # Three times the error of the median, of all but two objects that may agree by chance.
    error = 3 * 1.85 * float(np.median(np.abs(logs - middle))) / np.sqrt(len(logs) - 2)
    if not OFF_DEPTH + error < abs(middle) < np.log(OTHER_UNIT):
        return ()
    ratio = float(np.exp(middle))
    return (
        f"measured depth is {_percent(ratio)} {'larger' if ratio > 1 else 'smaller'} than the initial poses say: check "
        f"depth_scale in scene_camera.json ({_fitting(1 / ratio)}), and that cam_K is that of the camera the poses "
        "were estimated for",
    )


def distance(points_cam: Float, model: ObjectModel, T_cam_obj: Float) -> float:
    """Median distance of observed points (N, 3) [m], N > 0, to a posed model, as a share of its diameter."""
    some = points_cam[:: max(1, len(points_cam) // 100)]  # As many as a median needs.
    return float(np.median(_tree(model).query(apply(inverse(T_cam_obj), some))[0])) / model.diameter_m


@lru_cache(maxsize=64)
def _tree(model: ObjectModel) -> KDTree:
    return KDTree(model.points, balanced_tree=False, compact_nodes=False)


def _fitting(factor: float) -> str:
    return f"about {factor:.2f} times as much would fit"


def _percent(ratio: float) -> str:
    return f"{abs(ratio - 1):.0%}"


def _off(factor: float) -> str:
    return f"too {'small' if factor > 1 else 'large'}, {_fitting(factor)}"
