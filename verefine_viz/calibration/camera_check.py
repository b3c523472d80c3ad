"""Checks whether camera, depth, models, ground-truth and initial poses of a frame belong together.

A wrong focal length goes unnoticed where only depth is compared: an object near the image's centre still lies about
right. But it changes how large objects appear and, by the same factor, how far from the centre they lie; models of a
wrong size change only how large they appear, and a wrong depth_scale changes neither. One wrong focal length makes
objects wider or higher. A wrong cx or cy moves all masks beside their models, and depth with them; where masks alone
are displaced, depth stays in place. A bad mask or a poor estimate concerns one object, so several are judged together.
Measured: docs/decisions/data-checks.md.
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
from verefine_viz.core.data_remedies import of_models
from verefine_viz.core.doubt import Doubt, DoubtKind, times_words
from verefine_viz.core.geometry import apply, inverse
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import DataSettings

MOST, SMALLEST_PX = 6, 24
"""Most objects of a frame that are compared, the largest first; and the smallest object (square root of its area)."""
SURE, SURE_SIDES = 0.05, 0.07
"""Largest error of an object's factor, and of its width and height; above, its mask has another shape: ignored."""
FEWEST_SURE, FEWEST_TOGETHER = 1 / 3, 2
"""Share of the objects that must be sure; and their least number where a single mask may be off by chance."""
OFF, MOST_DISSENT = 0.04, 0.25
"""Least share by which factors are off; and share of the objects that may be off by less than half of the median."""
MASK_PX, PLAIN_PX, ALONE_PX = 4, 2, 20
"""All masks may be too wide by less than the first on each side; an explanation must place objects better than another
one by the second; and a single object nearer to the image's centre than the third does not show whether camera or
models are off [px]."""
BESIDE, LITTLE = 0.015, 0.25
"""Least displacement (share of the image's width); and least share of its larger side at which the other is named."""
FEW = 3
"""Least number of objects: fewer may agree by chance."""
OFF_DEPTH = 0.05
"""Share by which the distances of an estimator may all be off."""
LIKELY = (
    (4.0, "steps of 0.25 mm (RealSense L515) and millimetres"),
    (5.0, "steps of 0.2 mm (TUM) and millimetres"),
    (8.0, "steps of 0.125 mm and millimetres"),
    (10.0, "steps of 0.1 mm (YCB-V, RealSense D405) and millimetres"),
    (39.37, "metres and inches"),
    (1000.0, "metres and millimetres"),
)
"""Factors by which depth is often too large or too small, and the units that were mixed up."""
LIKE = 0.04
"""Factors whose logarithms differ by less count as equal."""
SHARES_M = 0.5
"""A single object must be measured nearer or farther than its pose by at least this share of its size: by less, another
side of it may have been measured."""
SURELY_OFF, SURELY_OFF_ALONE, ALIKE = 0.15, 0.3, 0.1
"""Least share by which initial poses show a camera to be off, for several objects and for one; and how far the
objects' factors may differ."""
SHARE_OF_FACTOR = 0.2
"""A factor is also sure if its error is less than this share of its logarithm. Fewer than half of the objects need be
sure where the factors of the others agree within two errors."""


@dataclass(frozen=True)
class CameraVerdict:
    """How sizes and places of objects in the image differ from what their poses say, and what is off."""

    message: str
    advice: str = ""  # what to do about it; empty = nothing
    cause: str | None = None
    """"focal length", "one focal length", "principal point", "image" (cam_K is of images of another size), "models",
    "focal length or models", "distances" (of the ground-truth poses), "masks", "depth", or nothing is off."""
    remedy: DataSettings | None = None
    """Settings that put the data right; None where none do. For models see ``model_factor``."""
    model_factor: float = 1.0
    """Factor by which the models would have to be larger to fit."""

    def doubt(self, problem: Problem) -> Doubt:
        """The verdict as a doubt about a frame."""
        kind, short = TITLES[self.cause]
        remedy, numbers = self.remedy, {}
        if remedy is not None:
            fx, fy, cx, cy = remedy.camera_times
            numbers = {
                "depth_times": remedy.depth_times,
                "fx_times": fx,
                "fy_times": fy,
                "cx_times": cx,
                "cy_times": cy,
            }
        if self.cause == "models":
            remedy = of_models([*problem.models], self.model_factor)
            numbers = {"model_times": self.model_factor}
        if self.cause == "depth" and remedy is not None:
            short = f"depth {times_words(remedy.depth_times)}"
        numbers = {name: number for name, number in numbers.items() if number != 1}
        return Doubt(kind, f"{self.message}: {self.advice}", short, numbers=numbers, remedy=remedy)


TITLES: dict[str | None, tuple[DoubtKind, str]] = {
    "focal length": (DoubtKind.CAMERA, ""),
    "one focal length": (DoubtKind.CAMERA, "fx or fy of K off"),
    "principal point": (DoubtKind.CAMERA, "cx, cy of K off"),
    "image": (DoubtKind.CAMERA, "K of another image size"),
    "focal length or models": (DoubtKind.CAMERA, "K or models off"),
    "models": (DoubtKind.MODEL_SCALE, ""),
    "distances": (DoubtKind.POSE_SCALE, ""),
    "masks": (DoubtKind.MASK, "masks displaced"),
    "depth": (DoubtKind.DEPTH_SCALE, ""),
}
"""Kind of doubt for each cause of a verdict, and its words for a badge."""


def outline_fits(
    objects: Sequence[tuple[ObjectModel, Float, Mask]], camera: Camera, depth_m: NDArray[np.float32], object_mask: Mask
) -> list[OutlineFit]:
    """How the masks of the largest of these objects (model, T_cam_obj (4, 4), mask (H, W)) lie over their models.

    Objects are left out where too little of the outline is seen. ``depth_m`` (H, W) is 0 where nothing was measured;
    ``object_mask`` (H, W) are the pixels of all objects of the frame, not of ``objects`` alone.
    """
    large = [one for one in objects if np.count_nonzero(one[2]) >= SMALLEST_PX**2]
    largest = sorted(large, key=lambda one: -np.count_nonzero(one[2]))[:MOST]
    fits = [fit_outline(model, T, camera, mask, object_mask, depth_m) for model, T, mask in largest]
    return [fit for fit in fits if fit is not None]


def camera_doubts(problem: Problem) -> tuple[Doubt, ...]:
    """A doubt where objects with ground truth appear in another size, shape or place than it says."""
    seen, instances = problem.observation, problem.instances
    known = [(problem.models[i.obj_id], i.T_cam_obj_gt, i.mask) for i in instances if i.T_cam_obj_gt is not None]
    sizes = verdict(outline_fits(known, seen.camera, seen.depth_m, seen.object_mask))
    return (sizes.doubt(problem),) if sizes.advice else ()


def verdict(fits: Sequence[OutlineFit], poses: str = "ground-truth poses") -> CameraVerdict:
    """What the outlines of objects show together; ``poses`` names their poses. They may be of several frames."""
    in_order = f"objects appear as large as their models in their {poses}"
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
        return _size(sure, float(np.median(factors)), depth, poses)
    if (displaced := _displaced(sure, poses)) is not None:
        return displaced
    if not _are_off(depths, 0.0):
        return CameraVerdict(in_order)
    message = f"{in_order}, but measured depth is {_larger(depth)} theirs"
    advice = f"check depth_scale in scene_camera.json: {_fitting(1 / depth)}{_likely(depth)}"
    return CameraVerdict(message, advice, "depth", DataSettings(depth_times=_depth_times(depth)))


def _one_focal_length(fits: Sequence[OutlineFit]) -> CameraVerdict | None:
    """The verdict where width and height of objects differ from their models by different factors; else None."""
    sure = [one for one in fits if one.sides_error < SURE_SIDES]
    if len(sure) < max(FEWEST_TOGETHER, FEWEST_SURE * len(fits)):
        return None
    sides, error = np.array([one.sides for one in sure]), float(np.median([one.sides_error for one in sure]))
    # Masks that are too large widen narrow objects by a larger factor, but by as many pixels as they add in height.
    grown_px = (sides - 1) * [one.drawn.box_px for one in sure] / 2
    if abs(np.median(grown_px[:, 0] - grown_px[:, 1])) <= MASK_PX or not _are_off(sides[:, 0] / sides[:, 1], error):
        return None
    times, words = np.median(sides, axis=0).tolist(), (("wider", "narrower", "fx"), ("higher", "lower", "fy"))
    off = [(x, more if x > 1 else less, name) for x, (more, less, name) in zip(times, words, strict=True)]
    off = [one for one in off if abs(np.log(one[0])) > OFF]
    size = " and ".join(f"{_percent(x)} {how}" for x, how, _ in off)
    which = ", and ".join(f"{name} of cam_K looks {_off(x)}" for x, _, name in off)
    advice = f"{which}; check that cam_K belongs to images of this size"
    fx, fy = (x if abs(np.log(x)) > OFF else 1.0 for x in times)
    remedy = DataSettings(camera_times=(fx, fy, 1.0, 1.0))
    return CameraVerdict(f"objects appear {size} than their models", advice, "one focal length", remedy)


def _size(sure: Sequence[OutlineFit], factor: float, depth: float, poses: str) -> CameraVerdict:
    """The verdict where objects appear ``factor`` times as large as their models; where they lie shows the reason."""
    size, away, near = ("larger", "farther from", "nearer") if factor > 1 else ("smaller", "nearer to", "farther away")
    message, off = f"objects appear {_percent(factor)} {size} than their models in their {poses}", _off(factor)

    def misplaced_px(fixed_px: Sequence[Float]) -> float:
        """Median distance of objects from where ``factor`` would move each, away from its fixed point (2,)."""
        expected = [(factor - 1) * (one.drawn.middle_px - fixed) for one, fixed in zip(sure, fixed_px, strict=True)]
        return float(np.median(np.linalg.norm([one.shift_px for one in sure] - np.array(expected), axis=1)))

    of_focal = misplaced_px([one.camera.K[:2, 2] for one in sure])
    of_image = misplaced_px([np.array([-0.5, -0.5])] * len(sure))
    of_models = misplaced_px([one.origin_px for one in sure])
    if _is_better(of_image, min(of_focal, of_models)):
        advice = f"cam_K looks like that of images of another size: fx, fy, cx and cy all look {off}"
        message = f"{message} and lie {away} the image's upper left corner by as much"
        return CameraVerdict(message, advice, "image", DataSettings(camera_times=(factor, factor, factor, factor)))
    shows_place = len(sure) > 1 or max(of_focal, of_models) > ALONE_PX
    if shows_place and _is_better(of_focal, of_models):
        advice = f"fx and fy of cam_K look {off}; check that cam_K belongs to images of this size"
        remedy = DataSettings(camera_times=(factor, factor, 1.0, 1.0))
        return CameraVerdict(f"{message} and lie {away} the image's centre by as much", advice, "focal length", remedy)
    # Neither cam_K nor the size of models changes how far away objects are.
    if abs(np.log(depth)) > OFF and abs(np.log(depth * factor)) < abs(np.log(depth)):
        advice = f"cam_t_m2c in scene_gt.json looks too {'large' if factor > 1 else 'small'}; check its unit"
        return CameraVerdict(f"{message} and are {near} by as much", advice, "distances")
    # Masks that are too wide do not move objects either.
    if np.median([one.drawn.size_px for one in sure]) * abs(factor - 1) / 2 < MASK_PX:
        wide = "wide" if factor > 1 else "narrow"
        return CameraVerdict(f"{message}, as they do where masks are a few pixels too {wide}", cause="masks")
    if shows_place and _is_better(of_models, min(of_focal, of_image)):
        advice = f"the models look {off}; check their unit and scale"
        return CameraVerdict(f"{message}, in the right places", advice, "models", model_factor=factor)
    return CameraVerdict(message, f"either fx and fy of cam_K or the models look {off}", "focal length or models")


def _is_better(misplaced_px: float, other_px: float) -> bool:
    return misplaced_px < other_px / 2 and misplaced_px < other_px - PLAIN_PX


def _displaced(sure: Sequence[OutlineFit], poses: str) -> CameraVerdict | None:
    """The verdict where all objects are displaced alike; depth shows whether the camera or the masks are off."""
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
    message = f"objects lie {where} where their models are in their {poses}"
    if np.mean([one.gain for one in sure]) <= 0:
        advice = "the masks are displaced: check that they are of these images"
        return CameraVerdict(f"{message}, but depth does not", advice, "masks")
    too = [f"{name} of cam_K looks {abs(px):.0f} px too {'small' if px > 0 else 'large'}" for px, *_, name in off]
    check = "check that cam_K belongs to these images, also if they were cropped, and that depth is registered to"
    advice = f"{' and '.join(too)}; {check} colour if the masks were made from it"
    camera = sure[0].camera
    cx, cy = ((c + px) / c if c > 0 else 1.0 for c, px in ((camera.cx, middle_px[0]), (camera.cy, middle_px[1])))
    remedy = DataSettings(camera_times=(1.0, 1.0, float(cx), float(cy))) if min(cx, cy) > 0 else None
    return CameraVerdict(f"{message}, and so does depth", advice, "principal point", remedy)


def _are_off(ratios: Float, error: float) -> bool:
    """Whether ratios differ from 1, and most of them in the same direction."""
    logs = np.log(ratios[np.isfinite(ratios)])
    middle = float(np.median(logs)) if len(logs) else 0.0
    return abs(middle) > OFF + error and bool(np.mean(logs / middle < 0.5) <= MOST_DISSENT)


def estimate_doubts(problem: Problem) -> tuple[Doubt, ...]:
    """A doubt where, without ground truth, initial poses agree that depth or the camera is off by one factor.

    Estimators that see colour alone place objects by the camera and the size of the models, not by depth. An error of
    a single pose changes the size in which its model appears and its distance by the same factor, or the shape of its
    outline. So depth is off where outlines fit, and cam_K is off where depth fits.
    """
    if any(i.T_cam_obj_gt is not None for i in problem.instances):
        return ()
    seen = problem.observation
    initial = [(problem.models[i.obj_id], i.hypotheses[0].T_cam_obj, i.mask) for i in problem.instances if i.hypotheses]
    fits = outline_fits(initial, seen.camera, seen.depth_m, seen.object_mask)
    return _depth_by_estimates(fits) or _camera_by_estimates(fits, problem)


def _depth_by_estimates(fits: Sequence[OutlineFit]) -> tuple[Doubt, ...]:
    depths = [one.depth for one in fits]
    logs = np.log([depth for depth in depths if depth > 0])
    middle = float(np.median(logs)) if len(logs) else 0.0
    if len(logs) >= FEW:
        # Three times the error of the median; two of the objects are not counted, as they may agree by chance.
        error = 3 * 1.85 * float(np.median(np.abs(logs - middle))) / np.sqrt(len(logs) - 2)
        is_off = abs(middle) > OFF_DEPTH + error
    else:
        is_off = len(logs) == len(fits) > 0 and all(map(_is_only_depth_off, fits)) and np.ptp(logs) < ALIKE
    if not is_off:
        return ()
    ratio = float(np.exp(middle))
    appear = float(np.median(np.log([one.factor for one in fits if one.error < SURE] or [1.0])))
    if abs(appear + middle) < abs(appear) / 2:  # Where depth alone is off, objects appear as large as their models.
        text = (
            f"objects are {_percent(ratio)} {'nearer' if ratio < 1 else 'farther away'} than the initial poses say "
            f"and appear as much {'larger' if ratio < 1 else 'smaller'}: the translations of the initial poses look "
            f"{_off(ratio)}; check their unit, and that cam_K is that of the camera they were estimated for"
        )
        short, remedy = f"translations {times_words(ratio)}", DataSettings(pose_times=ratio)
        return (Doubt(DoubtKind.POSE_SCALE, text, short, numbers={"pose_times": ratio}, remedy=remedy),)
    return (scaled_depth(ratio, "initial"),)


def scaled_depth(ratio: float, source: str) -> Doubt:
    """A doubt: measured depth is ``ratio`` times as large as the poses of ``source`` say."""
    text = (
        f"measured depth is {_larger(ratio)} the {source} poses say: check depth_scale in scene_camera.json "
        f"({_fitting(1 / ratio)}{_likely(ratio)}), and that cam_K is that of the camera the poses were estimated for"
    )
    times = _depth_times(ratio)
    numbers, remedy = {"depth_times": times}, DataSettings(depth_times=times)
    return Doubt(DoubtKind.DEPTH_SCALE, text, f"depth {times_words(times)}", numbers=numbers, remedy=remedy)


def _is_only_depth_off(one: OutlineFit) -> bool:
    """Whether a model lies on its mask while depth is off by more than another side of the object would explain."""
    is_on_mask = one.error < SURE and abs(np.log(one.factor)) < OFF + PLAIN_PX / one.drawn.size_px
    least = max(SURELY_OFF, SHARES_M * float(one.drawn.box_px.max()) / one.camera.fx)
    return is_on_mask and abs(np.log(one.depth)) > least


def _camera_by_estimates(fits: Sequence[OutlineFit], problem: Problem) -> tuple[Doubt, ...]:
    sure = [one for one in fits if one.error < max(SURE, SHARE_OF_FACTOR * abs(np.log(one.factor)))]
    if not sure:
        return ()
    middle = float(np.median(np.log([one.factor for one in sure])))
    alike = [one for one in fits if one in sure or abs(np.log(one.factor) - middle) < 2 * one.error]
    if 2 * len(sure) < len(fits) and (len(sure) < FEWEST_TOGETHER or len(alike) < len(fits)):
        return ()
    logs, depths = np.log([one.factor for one in sure]), np.log([one.depth for one in sure])
    least = SURELY_OFF if len(sure) > 1 else SURELY_OFF_ALONE
    if abs(np.median(logs)) < least or np.ptp(logs) > ALIKE or not (np.abs(depths) < OFF_DEPTH).all():
        return ()
    found = verdict(sure, "initial poses")
    return (found.doubt(problem),) if found.advice and found.cause != "one focal length" else ()


def relative_distance(points_cam: Float, model: ObjectModel, T_cam_obj: Float) -> float:
    """Median distance of observed points (N, 3) [m], N > 0, to a posed model, as a share of its diameter."""
    some = points_cam[:: max(1, len(points_cam) // 100)]  # Enough for a median.
    return float(np.median(_tree(model).query(apply(inverse(T_cam_obj), some))[0])) / model.diameter_m


@lru_cache(maxsize=64)
def _tree(model: ObjectModel) -> KDTree:
    return KDTree(model.points, balanced_tree=False, compact_nodes=False)


def _fitting(factor: float) -> str:
    return f"about {factor:.{2 if factor > 0.1 else 4}f} times as much would fit"


def _likely(ratio: float) -> str:
    """Words for the units whose mix-up makes about this factor; empty for none."""
    how = [words for factor, words in LIKELY if abs(abs(np.log(ratio)) - np.log(factor)) < LIKE]
    return f", as between {how[0]}" if how else ""


def _depth_times(ratio: float) -> float:
    """Factor that puts depth right which is ``ratio`` times as large: of mixed-up units, else the measured one."""
    for factor, _ in LIKELY:
        if abs(abs(np.log(ratio)) - np.log(factor)) < LIKE:
            return 1 / factor if ratio > 1 else factor
    return 1 / ratio


def _larger(ratio: float) -> str:
    if ratio > 2:
        return f"{ratio:.3g} times as large as"
    return f"{_percent(ratio)} {'larger' if ratio > 1 else 'smaller'} than"


def _percent(ratio: float) -> str:
    return f"{abs(ratio - 1):.0%}"


def _off(factor: float) -> str:
    return f"too {'small' if factor > 1 else 'large'}, {_fitting(factor)}"
