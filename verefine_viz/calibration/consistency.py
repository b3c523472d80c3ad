"""Checks whether depth, masks, models and poses of a frame belong together; if not, finds by trial what would fit.

Evidence comes first. Measurements are checked against themselves: the steps of depth, and masks that cover more than
their model can while depth lies where the model is. Then models are compared with masks and depth, then poses with
both: an object is drawn at its ground-truth pose, or at its first initial pose. Where the drawing does not fit, each
common mistake is undone in turn (another unit, another convention, an inverted mask) and the object is drawn again. A
correction must also leave an object of plausible size and distance, which do not depend on the pose: so a poor pose
accuses no mesh. An initial pose may be off by itself; what initial poses share is doubted only where most of them show
it and none speaks against it. Where nothing would fit, a doubt says what was tried.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal

import numpy as np

from verefine_viz.calibration.camera_check import camera_doubts, estimate_doubts, scaled_depth
from verefine_viz.calibration.depth_shift import depth_shift_doubts
from verefine_viz.calibration.depth_steps import coarse_depth
from verefine_viz.calibration.edges import edge_doubts
from verefine_viz.calibration.seen_object import NEAR, TRUTH, Seen, seen_objects
from verefine_viz.core.arrays import Float
from verefine_viz.core.data_remedies import MADE_FROM_TRUTH, corrected_pose, of_models
from verefine_viz.core.doubt import Doubt, DoubtKind, times_words
from verefine_viz.core.problem import Problem
from verefine_viz.core.settings import DataSettings, PoseConvention
from verefine_viz.core.text_format import listed

MOST_SOURCES = 4
"""Most sources of initial poses that are checked."""
FITS, FITS_INITIAL, OFF = 0.5, 0.35, 0.2
"""Fit (share of pixels) from which an explanation is believed, at a ground-truth pose and at an initial one; and fit
below which a pose is off even without an explanation."""
SUSPECT = 0.6
"""Fit of a ground-truth pose below which explanations are tried: symmetric shapes fit in part whatever is wrong."""
BETTER = 0.3
"""Least gain in fit by an explanation."""
LEAST_SIZE, MOST_SIZE = 0.2, 1.5
"""Length of a mask in diameters of its model: least of an object seen from its end, or partly hidden; most of an object
whose mask is somewhat too wide."""
NEAREST_M, FARTHEST_M = 0.1, 12.0
"""Range of distances in which depth in another unit has to place an object [m]."""
MOST_BORDERS = 2
"""Most borders of the image that a mask may reach if it is to show how large its object is."""
WHOLE, IN_PLACE = 0.9, 0.7
"""Share of the image that no mask of a single object covers; and share of a model's pixels with its depth from which
the model is in the right place."""
LARGE, OTHER = 1.2, 0.15
"""A mask shows several objects if it is longer than the first (in diameters) and the second, a share of it, lies beside
a drawing of the same area: measured at least 0.21 for several objects, at most 0.06 for a wrong camera or model."""
SAME_MASK, BESIDE = 0.9, 0.2
"""Two masks are one if they share this part of their pixels; two objects lie side by side if their drawings overlap by
less than the second. (Where a detector gives one object two names, both are drawn in one place.)"""
STRICTLY, STRICTLY_BETTER, STRICTLY_ALONE, LOSS = 0.6, 0.25, 0.75, 0.15
"""Stricter limits for mistakes that a poor initial pose could look like, with fits measured as for ground truth: least
fit and gain; least fit of a single object, with twice the gain; and the loss of fit that speaks against a turn."""
WELL = 0.8
"""Median fit, measured as for ground truth, above which neither depth nor camera is off: it is at most 0.76 with a
camera that is off by 15 %, and about 0 with depth that is off by 5 %."""
FEW = 2
"""Least number of objects: a single initial pose may be off by itself."""
SCALED, ALIKE = 0.15, 0.03
"""Where outlines are not sure, depth is named only if it is off by more than the first, and by the same factor for all
objects up to the second (logarithms): poses that are off by so much show it in their size."""
UNITS = (10.0, 0.1, 1000.0, 0.001, 100.0, 0.01, 25.4, 1 / 25.4)
"""Factors between units that are mixed up: mm, cm, m and inches."""
UNEXPLAINED = "no other unit or convention would fit"
CURVED, CURVED_M, ASIDE = 0.4, 0.004, 1.03
"""Depth is taken for distances if that leaves less than the first of the error, the error is above the second [m], and
the objects' rays are longer than z by the third: near the image's centre an offset of the sensor looks the same."""


@dataclass(frozen=True)
class Explanation:
    """A common mistake in the data, and how to undo it."""

    words: str
    """What would fit, and what to look at."""
    kind: DoubtKind
    short: str = ""
    """Words for a badge."""
    depth_times: float = 1.0
    model_times: float = 1.0
    pose_times: float = 1.0
    poses: PoseConvention = "given"
    inverts_mask: bool = False
    is_subtle: bool = False
    """Whether a single initial pose, which may be off by tens of degrees, cannot show it."""

    @property
    def of(self) -> Literal["depth", "models", "poses", "masks"]:
        """The data at fault: depth and conventions concern all objects, models and masks one."""
        if self.model_times != 1:
            return "models"
        if self.depth_times != 1:
            return "depth"
        return "masks" if self.inverts_mask else "poses"

    def undo(self, one: Seen) -> Seen:
        """The object with the mistake undone."""
        return replace(
            one,
            T_cam_obj=corrected_pose(one.T_cam_obj, self.remedy(())),
            depth_m=one.depth_m if self.depth_times == 1 else one.depth_m * np.float32(self.depth_times),
            model_times=one.model_times * self.model_times,
            mask=~one.mask if self.inverts_mask else one.mask,
        )

    def remedy(self, obj_ids: Sequence[int]) -> DataSettings:
        """The settings that put the data right; changed models and masks are those of ``obj_ids``."""
        own = () if self.model_times == 1 else of_models(obj_ids, self.model_times).model_times
        masks = tuple(sorted({*obj_ids})) if self.inverts_mask else ()
        return DataSettings(
            depth_times=self.depth_times,
            pose_times=self.pose_times,
            poses=self.poses,
            model_times=own,
            inverted_masks=masks,
        )

    def doubt(self, shown_by: Sequence[Seen], looked_at: Sequence[Seen], obj_ids: Collection[int]) -> Doubt:
        """The doubt that ``shown_by`` raise; where all objects that were looked at do, it concerns all ``obj_ids``."""
        is_of_all = len(shown_by) == len(looked_at) > 1
        # Settings correct initial poses only, never the ground truth.
        is_of_truth = shown_by[0].is_truth and (self.pose_times != 1 or self.poses != "given")
        own = [one.model.obj_id for one in shown_by]
        factors = {"depth_times": self.depth_times, "model_times": self.model_times, "pose_times": self.pose_times}
        found = _doubt(
            self.kind,
            shown_by,
            self.words,
            self.short,
            numbers={name: factor for name, factor in factors.items() if factor != 1},
            remedy=None if is_of_truth else self.remedy([*obj_ids] if is_of_all else own),
        )
        return replace(found, instances=()) if is_of_all else found


def _times(factor: float) -> str:
    return f"{factor:g} times as large" if factor >= 1 else f"{1 / factor:g} times smaller"


def _units() -> Iterator[Explanation]:
    for f in UNITS:
        yield Explanation(
            f"depth that is {_times(f)} would fit: check the unit of the depth images (depth_scale)",
            DoubtKind.DEPTH_SCALE,
            f"depth {times_words(f)}",
            depth_times=f,
        )
    for f in UNITS:
        yield Explanation(
            f"models that are {_times(f)} would fit: check the unit of the meshes",
            DoubtKind.MODEL_SCALE,
            f"model {times_words(f)}",
            model_times=f,
        )
    for f in UNITS:
        yield Explanation(
            f"translations that are {_times(f)} would fit: check the unit of the poses",
            DoubtKind.POSE_SCALE,
            f"translations {times_words(f)}",
            pose_times=f,
        )


def _in_metres() -> Iterator[Explanation]:
    yield Explanation(
        "models and translations that are both 1000 times as large would fit: they look as if they were in metres, "
        "expected millimetres: write both so",
        DoubtKind.IN_METRES,
        "models and poses in metres",
        model_times=1000.0,
        pose_times=1000.0,
    )
    yield Explanation(
        "models, translations and depth that are all 1000 times as large would fit: the whole data set looks as if it "
        "was in metres, expected millimetres: write models and cam_t_m2c so, and 1000 as depth_scale",
        DoubtKind.IN_METRES,
        depth_times=1000.0,
        model_times=1000.0,
        pose_times=1000.0,
    )


TRANSPOSED = Explanation(
    "transposed rotations would fit: the matrices look as if they were written column by column",
    DoubtKind.CONVENTION,
    "rotations transposed",
    poses="transposed",
    is_subtle=True,
)


def _conventions() -> Iterator[Explanation]:
    yield Explanation(
        "the inverse poses would fit: these look like poses of the camera in the object's frame",
        DoubtKind.CONVENTION,
        "poses inverted",
        poses="inverse",
    )
    yield Explanation(
        "poses in OpenGL's camera axes (y up, z backwards) would fit: turn them by diag(1, −1, −1)",
        DoubtKind.CONVENTION,
        "poses in OpenGL axes",
        poses="opengl",
    )
    yield Explanation(
        "inverted masks would fit: the mask covers everything but the object",
        DoubtKind.MASK,
        "mask inverted",
        inverts_mask=True,
    )
    yield TRANSPOSED
    turns: tuple[tuple[PoseConvention, int], ...] = (("x90", 90), ("x-90", -90))
    for convention, deg in turns:
        yield Explanation(
            f"models turned by {deg}° about x would fit: the meshes look as if another axis were up",
            DoubtKind.CONVENTION,
            "meshes with another axis up",
            poses=convention,
            is_subtle=True,
        )


EXPLANATIONS = (*_units(), *_in_metres(), *_conventions())


def data_doubts(problem: Problem) -> tuple[Doubt, ...]:
    """Doubts about a frame: units and conventions, else camera and images, else what no single mistake explains."""
    explained, unexplained = _doubts(problem)
    if explained:
        return explained
    beside = camera_doubts(problem) or depth_shift_doubts(problem) if _has_truth(problem) else ()
    return coarse_depth(problem.observation.depth_m) + (beside or _without_truth(problem) or unexplained)


def doubts(problem: Problem) -> tuple[Doubt, ...]:
    """As :func:`data_doubts`, without the check of the camera by ground truth."""
    explained, unexplained = _doubts(problem)
    if explained:
        return explained
    beside = () if _has_truth(problem) else _without_truth(problem)
    return coarse_depth(problem.observation.depth_m) + (beside or unexplained)


def _has_truth(problem: Problem) -> bool:
    return any(i.T_cam_obj_gt is not None for i in problem.instances)


def _without_truth(problem: Problem) -> tuple[Doubt, ...]:
    return edge_doubts(problem) or (() if _lie_well(problem) else estimate_doubts(problem))


def _lie_well(problem: Problem) -> bool:
    """Whether most initial poses fit as well as true ones, as none do where scale or camera are off by much."""
    poses = {i.instance_id: i.hypotheses[0].T_cam_obj for i in problem.instances if i.hypotheses}
    fits = [replace(one, near=NEAR).fit() for one in seen_objects(problem, poses, "initial poses")]
    return bool(fits) and float(np.median(fits)) > WELL


def _doubts(problem: Problem) -> tuple[tuple[Doubt, ...], tuple[Doubt, ...]]:
    """Doubts with a correction that would fit, and doubts that no correction explains.

    Judged by ground truth; where it fits, or is unknown, by the initial poses of each source.
    """
    truths = {i.instance_id: i.T_cam_obj_gt for i in problem.instances if i.T_cam_obj_gt is not None}
    explained, unexplained = _pose_doubts(seen_objects(problem, truths, TRUTH), problem.models.keys())
    if explained or unexplained:
        return explained, unexplained
    by_source: dict[str, dict[int, Float]] = {}
    for instance in problem.instances:
        for one in instance.hypotheses:
            if not one.source.startswith(MADE_FROM_TRUTH):
                by_source.setdefault(one.source.partition(" #")[0], {}).setdefault(instance.instance_id, one.T_cam_obj)
    sources = [*by_source.items()][:MOST_SOURCES]
    each = [_pose_doubts(seen_objects(problem, poses, name), problem.models.keys()) for name, poses in sources]
    explained = tuple(doubt for found, _ in each for doubt in found)
    # Poses of one source may all be poor; where those of another fit, or ground truth does, the data are not at fault.
    unfit = (
        () if truths or not all(found for _, found in each) else tuple(doubt for _, found in each for doubt in found)
    )
    return explained, unfit


def _pose_doubts(objects: Sequence[Seen], obj_ids: Collection[int]) -> tuple[tuple[Doubt, ...], tuple[Doubt, ...]]:
    explained: dict[Explanation, list[Seen]] = {}
    of_masks: list[Doubt] = []
    off: list[Seen] = []
    n_fit = 0
    for one in objects:
        fit = one.fit()
        n_fit += fit >= FITS_INITIAL
        mask = _mask_fault(one) or _shared_mask(one, objects)
        mistake = None
        if mask is None and fit < (SUSPECT if one.is_truth else OFF):
            mistake = _explanation(one, fit)
            mask = _swapped_mask(one, fit, objects) if mistake is None else None
        if mask is not None:
            of_masks.append(mask)
        elif mistake is not None:
            explained.setdefault(mistake, []).append(one)
        elif fit < OFF:
            off.append(one)
    if not objects or objects[0].is_truth:
        found = (*of_masks, *(mistake.doubt(of, objects, obj_ids) for mistake, of in explained.items()))
        found = found or tuple(_distances_for_depth(objects))
        # A single pose or mask may be wrong for reasons of its own; all of them are not.
        check = "check camera, depth, masks and poses" if len(off) == len(objects) else "check its mask and its pose"
        misfit = (_doubt(DoubtKind.MISFIT, off, f"{UNEXPLAINED}: {check}"),) if off else ()
        return found, _scaled_depths(objects, off) or misfit
    shared = (
        mistake.doubt(of, objects, obj_ids)
        for mistake, of in explained.items()
        if mistake.of not in ("depth", "poses") or (2 * len(of) >= len(objects) and 4 * n_fit <= len(objects))
    )
    found = (*of_masks, *shared) or tuple(_turned(objects, obj_ids))
    if scaled := _scaled_depths(objects, off):
        return found, scaled
    if len(objects) < FEW or len(off) < len(objects) or not all(one.is_elsewhere() for one in off):
        return found, ()
    text = (
        f"depth and the poses of {objects[0].source} do not agree: 0 of {len(objects)} objects lie where depth is; "
        "other units, scales, conventions, cam_K and inverted masks were tried, and none would fit"
    )
    return found, (Doubt(DoubtKind.MISFIT, text, "depth and poses do not agree", _instances(off)),)


def _scaled_depths(objects: Sequence[Seen], off: Sequence[Seen]) -> tuple[Doubt, ...]:
    """A doubt where no object fits, but all would fit as well as true poses if depth were scaled by one factor."""
    if not off or len(off) < len(objects):
        return ()
    ratios = np.array([one.depth_ratio() for one in off])
    ratio = float(np.median(ratios))
    if not abs(np.log(ratio)) > SCALED or np.ptp(np.log(ratios)) > ALIKE:
        return ()
    right = [replace(one, depth_m=(one.depth_m / ratio).astype(np.float32), near=NEAR) for one in off]
    return (scaled_depth(ratio, off[0].source),) if min(one.fit() for one in right) > WELL else ()


def _mask_fault(one: Seen) -> Doubt | None:
    """A doubt about a mask that covers more than its model can while depth lies where the model is; else None."""
    share = float(one.mask.mean())
    if one.size <= LARGE or (share <= WHOLE and (one.agreement() < IN_PLACE or one.beside_scaled() < OTHER)):
        return None
    if replace(one, mask=~one.mask).fit() >= FITS_INITIAL:
        return None
    whole = f"{share:.0%} of the image, " if share > WHOLE else ""
    text = (
        f"the mask of {one.name} covers {whole}{one.covered_m:.2g} m, and the model is {one.diameter_m:.2g} m across: "
        "check whether the mask shows several objects (labels), or everything"
    )
    numbers = {"covered_m": one.covered_m, "diameter_m": one.diameter_m, "share_of_image": share}
    return Doubt(DoubtKind.MASK, text, "mask too large", _instances([one]), numbers)


def _shared_mask(one: Seen, objects: Sequence[Seen]) -> Doubt | None:
    """A doubt where two objects have one mask while depth shows both, side by side; else None."""
    for other in objects:
        n_both, n_either = np.count_nonzero(one.mask & other.mask), np.count_nonzero(one.mask | other.mask)
        if other is one or n_both < SAME_MASK * n_either:
            continue
        own, its = one.drawn_m() > 0, other.drawn_m() > 0
        is_beside = np.count_nonzero(own & its) < BESIDE * min(np.count_nonzero(own), np.count_nonzero(its))
        is_inverted = replace(one, mask=~one.mask).fit() >= FITS_INITIAL
        if is_beside and not is_inverted and min(one.agreement(), other.agreement()) >= IN_PLACE:
            text = f"{one.name} and {other.name} have one mask: check whether it shows several objects (labels)"
            numbers = {"shared": float(n_both / n_either)}
            return Doubt(DoubtKind.MASK, text, "mask of several objects", _instances([one]), numbers)
    return None


def _explanation(one: Seen, fit: float) -> Explanation | None:
    """The mistake that, once undone, lets an object fit best; None where none does."""
    best, k = max(((undone.fit(), -k) for k, undone in _undone(one)), default=(0.0, 0))
    return EXPLANATIONS[-k] if best >= _least(one, fit) else None


def _swapped_mask(one: Seen, fit: float, objects: Sequence[Seen]) -> Doubt | None:
    """A doubt where another object's mask fits the ground-truth pose; estimates are assigned to the masks they fit."""
    for other in objects if one.is_truth else ():
        if other is not one and replace(one, mask=other.mask).fit() >= _least(one, fit):
            words = f"the mask of {other.name} would fit: masks and poses look as if they were in another order"
            return _doubt(DoubtKind.MASK, [one], words, "masks in another order")
    return None


def _least(one: Seen, fit: float) -> float:
    return max(FITS if one.is_truth else FITS_INITIAL, fit + BETTER)


def _undone(one: Seen) -> Iterator[tuple[int, Seen]]:
    for k, mistake in enumerate(EXPLANATIONS):
        if one.is_truth or not mistake.is_subtle:
            undone = mistake.undo(one)
            if undone.T_cam_obj[2, 3] > 0.02 and _is_plausible(mistake, undone):
                yield k, undone


def _is_plausible(mistake: Explanation, undone: Seen) -> bool:
    """Whether size and distance of what the mask covers suit the object, whatever its pose."""
    if mistake.of == "depth" and not NEAREST_M < undone.away_m < FARTHEST_M:
        return False
    if mistake.of == "models" and undone.n_borders() > MOST_BORDERS:
        return False
    return undone.size <= MOST_SIZE and (undone.size >= LEAST_SIZE or mistake.of not in ("depth", "models"))


def _turned(objects: Sequence[Seen], obj_ids: Collection[int]) -> Iterator[Doubt]:
    """A doubt where most initial poses fit as well as true ones once the same turn is undone, and none fits worse."""
    strict = [replace(one, near=NEAR) for one in objects]
    as_they_are = [one.fit() for one in strict]
    n_off, alone = sum(fit < STRICTLY for fit in as_they_are), len(objects) == 1
    # A single poor pose may become right by a quarter turn by chance, as many shapes look alike from several sides.
    for mistake in (TRANSPOSED,) if alone else (e for e in EXPLANATIONS if e.is_subtle):
        fits = [(mistake.undo(one).fit(), fit) for one, fit in zip(strict, as_they_are, strict=True)]
        if any(undone < fit - LOSS for undone, fit in fits):
            continue
        least, better = (STRICTLY_ALONE, 2 * STRICTLY_BETTER) if alone else (STRICTLY, STRICTLY_BETTER)
        shows = [one for one, (undone, fit) in zip(objects, fits, strict=True) if undone >= max(least, fit + better)]
        if len(shows) >= (1 if alone else 2) and 2 * len(shows) >= n_off:
            yield mistake.doubt(shows, objects, obj_ids)
            return


def _distances_for_depth(objects: Sequence[Seen]) -> Iterator[Doubt]:
    """A doubt where the depth images hold distances from the camera, not z."""
    truths = [one for one in objects if one.is_truth and np.median(one.rays[one.mask]) > ASIDE]
    if truths:
        as_z = [one.error_m() for one in truths]
        as_distance = [replace(one, depth_m=(one.depth_m / one.rays).astype(np.float32)).error_m() for one in truths]
        if np.median(as_z) > CURVED_M and np.median(as_distance) < CURVED * np.median(as_z):
            off_mm, as_distance_mm = 1e3 * float(np.median(as_z)), 1e3 * float(np.median(as_distance))
            yield Doubt(
                DoubtKind.DEPTH_DISTANCES,
                f"depth is off by {off_mm:.0f} mm from the ground-truth poses, and by {as_distance_mm:.0f} mm if it is "
                "the distance from the camera: the depth images seem to hold distances, expected z",
                numbers={"off_mm": off_mm, "off_as_distance_mm": as_distance_mm},
                remedy=DataSettings(depth_along="ray"),
            )


def _doubt(
    kind: DoubtKind,
    shown_by: Sequence[Seen],
    words: str,
    short: str = "",
    numbers: Mapping[str, float] = MappingProxyType({}),
    remedy: DataSettings | None = None,
) -> Doubt:
    return Doubt(kind, f"{_what(shown_by)}; {words}", short, _instances(shown_by), numbers, remedy)


def _instances(of: Sequence[Seen]) -> tuple[int, ...]:
    return tuple(one.instance_id for one in of)


def _what(objects: Sequence[Seen]) -> str:
    names, (them, plural) = listed([one.name for one in objects]), ("it", "") if len(objects) == 1 else ("them", "s")
    poses = f"ground-truth pose{plural}" if objects[0].is_truth else f"pose{plural} of {objects[0].source}"
    return f"what is seen of {names} is not where the {poses} put{'' if plural else 's'} {them}"
