"""Checks of a data set's ground truth: readable, consistent, of the right size, and where depth was measured."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from heapq import nlargest
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from verefine_viz.calibration.camera_check import MOST, Verdict, outline_fits, sample, share_near, verdict
from verefine_viz.calibration.outlines import OutlineFit
from verefine_viz.commands.dataset_parts import MOST_FAULTS, Parts
from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.files import id_of
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Placed
from verefine_viz.core.text_format import first_of
from verefine_viz.scenes.bop import BopDataset, GroundTruth, MaskFolder
from verefine_viz.scenes.frames import frame_name
from verefine_viz.scenes.segments import draw_placed


def _unequal_counts(dataset: BopDataset, scene_id: int) -> Iterator[str]:
    """A sentence for each image of which other files list more or fewer instances than scene_gt.json does."""
    with suppress(VerefineError):  # A file that is damaged is a finding of its own.
        folder = dataset.scene_folder(scene_id)
        truths = _lengths(dataset.truths(scene_id))
        kinds = [kind for kind in sorted(get_args(MaskFolder)) if (folder / kind).is_dir()]
        others = {f"{kind}/": _masks(folder / kind) for kind in kinds}
        infos = dataset.infos(scene_id)
        if infos is not None:
            others = {"scene_gt_info.json": _lengths(infos), **others}
        for im_id, n in truths.items():
            wrong = [f"{counts[im_id]} in {name}" for name, counts in others.items() if counts[im_id] != n]
            if wrong:
                yield f"image {scene_id}/{im_id}: {n} instances in scene_gt.json, {', '.join(wrong)}"


def _lengths(entries: Mapping[int, Sequence[object]] | None) -> Counter[int]:
    """How many entries a file has for each image."""
    return Counter({im_id: len(of_image) for im_id, of_image in (entries or {}).items()})


def _masks(folder: Path) -> Counter[int]:
    """How many masks there are of each image; they are called image_instance.png."""
    stems = {path.stem for path in folder.iterdir()}
    return Counter(im_id for stem in stems if (im_id := id_of(stem.partition("_")[0])) is not None)


def check_truths(dataset: BopDataset, sampled: Sequence[tuple[int, int]], parts: Parts) -> None:
    """Adds what is there and what is wrong; frames whose ground truth is damaged do not stop the others."""
    truths: list[Sequence[GroundTruth]] = []
    damage: list[str] = []
    for ids in sampled:
        try:
            truths.append(dataset.ground_truth(*ids) or ())
        except VerefineError as error:
            damage.append(str(error))
    damage = list(dict.fromkeys(damage))
    n_with = sum(map(bool, truths))
    parts.ground_truth = n_with > 0
    parts.damaged_ground_truth = damage[0] if damage and not parts.ground_truth else ""
    faults = [first_of(damage, MOST_FAULTS, "; ")] * bool(damage)
    faults += [t.fault for entries in truths for t in entries if t.fault][:MOST_FAULTS]
    if parts.masks and not parts.names_objects and not damage:
        faults.append(
            "nothing says which object is where: add scene_gt.json to the scenes, or a detections JSON (its name "
            f"holds “detect”) to {dataset.folder}"
        )
    without_model = sorted({t.obj_id for entries in truths for t in entries} - set(dataset.models.ids))
    if without_model and dataset.models.ids:
        faults.append(f"there is no model of object {', '.join(map(str, without_model))}; its instances are left out")
    where = f"in {n_with} of {len(sampled)} frames checked"
    without = "damaged" if damage else "none: nothing can be measured, only shown"
    parts.add("ground truth", where if n_with else without, "; ".join(faults))
    unequal = [fault for scene_id in dataset.scene_ids for fault in _unequal_counts(dataset, scene_id)]
    if unequal:
        needed = (
            "all must list the same instances in the same order; evaluate refuses images where scene_gt_info differs"
        )
        parts.add("instances", "not the same in all files", f"{first_of(unequal, MOST_FAULTS, '; ')}; {needed}")


# Whether the objects of a data set appear as large as their models do in their ground-truth poses.


def object_sizes(dataset: BopDataset, sampled: Sequence[tuple[int, int]], kind: MaskFolder) -> Verdict:
    """What the masks in ``kind`` of these frames show together; what cannot be read is reported already."""
    fits: list[OutlineFit] = []
    for ids in sampled:
        with suppress(VerefineError):
            image = dataset.image(*ids)
            together = np.zeros(image.camera.shape, np.bool_)
            # A frame may hold thousands of instances, so no more masks are held than are compared.
            largest = nlargest(MOST, _sized_objects(dataset, ids, kind, together), lambda one: np.count_nonzero(one[2]))
            fits += outline_fits(largest, image.camera, image.depth_m, together)
    return verdict(fits)


def _sized_objects(
    dataset: BopDataset, ids: tuple[int, int], kind: MaskFolder, together: Mask
) -> Iterator[tuple[ObjectModel, Float, Mask]]:
    """Model, ground-truth pose and mask (H, W) of each instance of a frame of which all are known.

    Masks of all instances, also of others, are added to ``together`` (H, W).
    """
    for truth in dataset.ground_truth(*ids) or ():
        with suppress(VerefineError):
            mask = dataset.mask(*ids, truth.gt_id, kind, together.shape)
            together |= mask
            if mask.any() and truth.T_cam_obj is not None:
                yield dataset.models.get(truth.obj_id), truth.T_cam_obj, mask


# Whether depth in the objects' masks lies on their ground-truth poses, frame by frame and object by object.
#
# What is wrong in one frame alone leaves sums over frames as they are. Measured on eight real frames (YCB-V): with
# masks of what is visible, 98% and more of the points of each of 29 objects lie on the model, at least 43% where all
# but a sliver of 5% is hidden; with masks of all of an object, 78% and more of each frame. With the instances of a
# frame in another order, cam_K transposed or depth_scale 10 times too large it is 0 to 25% of a frame.

NEAR_M, NEAR = 0.015, 0.06
"""Depth this near to a model lies on it [m] (BOP's visibility tolerance); or this share of its size, as points of large
models are further apart."""
FEWEST_ON = 0.3
"""Where less of the points lie on the models, something is wrong with the frame or object."""
FEWEST_POINTS = 100
"""Objects with less measured depth in their mask are checked with their frame only."""
OTHER_ON = 0.7
"""So much of the points of another mask lie on a model that the mask is that model's."""
OFF_DEPTH = 1.15
"""Depth that differs from the true one by a larger factor is reported."""
SAME_DEPTH = 0.1
"""Factors whose logarithms differ by less are the same."""
FEW = 3
"""Objects below which a factor may be chance, if it is no larger than 2."""


@dataclass(frozen=True, eq=False)
class _Object:
    """An annotated instance with a mask."""

    gt_id: int
    model: ObjectModel
    T_cam_obj: Float
    n_points: int
    """Measured in its mask, > 0."""
    points_cam: Float
    """(N, 3) [m]: some of them, as a frame may hold thousands of objects."""
    middle_m: float
    """Their depth (median of all)."""

    def share(self, points_cam: Float) -> float:
        """Share of points (N, 3) [m] that lie on its model in its ground-truth pose."""
        return share_near(points_cam, self.model, self.T_cam_obj, max(NEAR_M, NEAR * self.model.diameter_m))


def each_frame(dataset: BopDataset, opened: Sequence[tuple[int, int]], kind: MaskFolder) -> tuple[str, str] | None:
    """The result with the masks in ``kind``, and what to do about it (empty = nothing), the worst frame first.

    None where no frame shows an object; what cannot be read is reported elsewhere.
    """
    shares: dict[str, float] = {}
    faults: dict[str, str] = {}
    for ids in opened:
        objects = _objects(dataset, ids, kind)
        if objects:
            name, fits = frame_name(ids), {one.gt_id: one.share(one.points_cam) for one in objects}
            sizes = [one.n_points for one in objects]
            shares[name] = float(np.average(list(fits.values()), weights=sizes))
            fault = _fault(objects, fits, shares[name], kind)
            faults |= {name: fault} if fault else {}
    if not shares:
        return None
    worst = min(shares, key=lambda name: shares[name])
    result = (
        f"in the worst of {len(shares)} frames checked, {worst}, {shares[worst]:.0%} of the depth in the objects' "
        "masks lies on their models in their ground-truth poses"
    )
    sentences = [f"{name}: {faults[name]}" for name in sorted(faults, key=lambda name: shares[name])]
    return result, first_of(sentences, MOST_FAULTS, "; ")


def _objects(dataset: BopDataset, ids: tuple[int, int], kind: MaskFolder) -> list[_Object]:
    """The annotated instances of a frame in whose masks depth was measured."""
    objects: list[_Object] = []
    with suppress(VerefineError):
        image = dataset.image(*ids)
        points_cam = image.camera.back_project(image.depth_m)
        for truth in dataset.ground_truth(*ids) or ():
            with suppress(VerefineError):
                mask: Mask = dataset.mask(*ids, truth.gt_id, kind, image.camera.shape) & (image.depth_m > 0)
                if mask.any() and truth.T_cam_obj is not None:
                    model = dataset.models.get(truth.obj_id)
                    seen_cam = points_cam[mask]
                    some, middle_m = sample(seen_cam), float(np.median(seen_cam[:, 2]))
                    objects.append(_Object(truth.gt_id, model, truth.T_cam_obj, len(seen_cam), some, middle_m))
    return objects


def _fault(objects: Sequence[_Object], fits: Mapping[int, float], share: float, kind: MaskFolder) -> str:
    """What is wrong with a frame, or with some of its objects, and what to check; empty where nothing is."""
    off = [one for one in objects if fits[one.gt_id] < FEWEST_ON and one.n_points >= FEWEST_POINTS]
    # The mask of all of an object covers what hides it as well.
    alone = off if kind == "mask_visib" else []
    if share >= FEWEST_ON and not alone:
        return ""
    if share < FEWEST_ON:
        what = f"only {share:.0%} lies there"
        times = _times(objects)
        if times is not None:
            return f"{what}; measured depth is about {times:.3g} times the true one: check depth_scale"
        advice = "check cam_K and depth_scale in scene_camera.json, the masks, and scene_gt.json"
    else:
        named = [f"{fits[one.gt_id]:.0%} of {one.model.name} (entry {one.gt_id})" for one in alone]
        what, advice = f"only {first_of(named, MOST_FAULTS)}", "check its mask, and its pose in scene_gt.json"
    swapped = next(_swapped(off, objects), None)
    if swapped is not None:
        entry, mask = swapped
        order = "put the entries in the order in which the masks are numbered"
        advice = f"mask {mask} shows the object of entry {entry} of scene_gt.json: {order}"
    return f"{what}; {advice}"


def _swapped(off: Sequence[_Object], objects: Sequence[_Object]) -> Iterator[tuple[int, int]]:
    """Pairs of an entry and the number of another entry's mask that is its own."""
    for one in off:
        for other in objects:
            if other is not one and one.share(other.points_cam) > OTHER_ON:
                yield one.gt_id, other.gt_id


def _times(objects: Sequence[_Object]) -> float | None:
    """How many times as far away as ground truth all objects are measured; None where that is no explanation."""
    ahead = [one for one in objects if one.T_cam_obj[2, 3] > 0]
    logs = np.log([one.middle_m / one.T_cam_obj[2, 3] for one in ahead])
    if not len(logs) or np.ptp(logs) > 2 * SAME_DEPTH:
        return None
    times = float(np.exp(np.median(logs)))
    factor = max(times, 1 / times)
    return times if factor > (OFF_DEPTH if len(logs) >= FEW else 2) else None


# Whether measured depth lies where the ground truth has the objects.

Pixels = NDArray[np.intp]

SHIFTS_PX = range(-30, 31, 3)
"""Displacements that are tried to see whether depth is registered to colour [px]."""
GAIN = 0.15
"""So much more of the pixels must agree after a displacement for it to be the explanation."""


@dataclass(frozen=True, eq=False)
class _Frame:
    """A frame with ground truth."""

    seen_m: Float
    """(H, W) measured depth [m], 0 where there is none."""
    camera: Camera
    placed: tuple[Placed, ...]


def registration(
    dataset: BopDataset, sampled: Sequence[tuple[int, int]], is_in_place: bool
) -> Iterator[tuple[str, str]]:
    """The result, and what to do about it (empty = nothing): once, or never where no object is in any image.

    Where depth does not lie where the ground truth has the objects, whether it does when displaced or rescaled. A wrong
    cam_K displaces the drawn models instead: for displaced depth masks must lie over these (``is_in_place``).
    """
    frames = list(_frames(dataset, sampled))
    times = _times_as_far(frames)
    if times is not None:
        guess = ", it looks like metres" if 300 < times < 3000 else ""
        yield (
            "ground-truth poses put the camera inside of the objects",
            f"measured depth is about {times:.0f} times as far away: check that cam_t_m2c in scene_gt.json is in "
            f"millimetres{guess}",
        )
        return
    pairs = [
        (frame.seen_m, drawn)
        for frame in frames
        if (drawn := draw_placed(frame.placed, frame.camera)[0].astype(np.float64)).any()
    ]
    if pairs:
        yield _agreement(pairs, is_in_place)


def _agreement(pairs: Sequence[tuple[Float, Float]], is_in_place: bool) -> tuple[str, str]:
    """Result and advice on frames' measured and rendered depth (H, W) [m]."""
    sampled_pixels = [(seen, *_some_pixels(drawn)) for seen, drawn in pairs]
    shares = {(dx, dy): _share_near(sampled_pixels, dx, dy) for dx in SHIFTS_PX for dy in SHIFTS_PX}
    here, best = shares[0, 0], max(shares, key=lambda shift: (shares[shift], -abs(shift[0]) - abs(shift[1])))
    both = [(seen[(seen > 0) & (drawn > 0)], drawn[(seen > 0) & (drawn > 0)]) for seen, drawn in pairs]
    ratios = np.concatenate([seen / drawn for seen, drawn in both])
    ratio = float(np.median(ratios)) if len(ratios) else 1.0
    result = f"{here:.0%} of the objects' pixels lie within {NEAR_M * 1e3:.0f} mm of their ground-truth pose"
    if not 0.5 < ratio < 2:
        advice = f"measured depth is {ratio:.3g} times the true one: check depth_scale, and that poses are in mm"
    elif is_in_place and shares[best] > here + GAIN:
        advice = (
            f"{shares[best]:.0%} do if depth is displaced by {best[0]} px in x and {best[1]} px in y: "
            f"either depth is not registered to colour (warp it into the colour camera first), or {_centre_off(*best)}"
        )
    elif here < 0.3:
        advice = "poses, models or intrinsics do not belong to these images"
    else:
        advice = ""
    return result, advice


def _centre_off(dx: int, dy: int) -> str:
    """What is wrong with cam_K where that is why depth fits after a displacement [px] only."""
    off = [(name, px) for name, px in (("cx", dx), ("cy", dy)) if 4 * abs(px) > max(abs(dx), abs(dy))]
    return " and ".join(
        f"{name} of cam_K is {'at least' if abs(px) == max(SHIFTS_PX) else 'about'} {abs(px)} px too "
        f"{'large' if px > 0 else 'small'}"
        for name, px in off
    )


def _frames(dataset: BopDataset, sampled: Sequence[tuple[int, int]]) -> Iterator[_Frame]:
    for ids in sampled:
        try:
            image, truths = dataset.image(*ids), dataset.ground_truth(*ids) or ()
            known = [(t, t.T_cam_obj) for t in truths if t.obj_id in dataset.models.ids]
            placed = [Placed(t.gt_id, dataset.models.get(t.obj_id), T) for t, T in known if T is not None]
        except VerefineError:
            continue  # Reported already.
        yield _Frame(image.depth_m.astype(np.float64), image.camera, tuple(placed))


def _times_as_far(frames: Sequence[_Frame]) -> float | None:
    """How often objects' true distance goes into what is measured where their origins are seen (median).

    None where most objects are in front of the camera, not around it: then rendering them says more.
    """
    placed = [(frame, one) for frame in frames for one in frame.placed]
    inside = [0 < one.T_cam_obj[2, 3] < one.model.diameter_m / 2 for _, one in placed]
    if 2 * sum(inside) <= len(inside):
        return None
    times: list[float] = []
    for (frame, one), is_inside in zip(placed, inside, strict=True):
        if is_inside:
            # Where an origin is seen does not depend on the unit of length.
            u, v = np.round(frame.camera.project(one.T_cam_obj[:3, 3])).astype(int)
            around = frame.seen_m[max(v - 5, 0) : max(v + 6, 0), max(u - 5, 0) : max(u + 6, 0)]
            measured = around[around > 0]
            if len(measured):
                times.append(float(np.median(measured)) / one.T_cam_obj[2, 3])
    return float(np.median(times)) if times else None


def _some_pixels(drawn: Float) -> tuple[Pixels, Pixels, Float]:
    """Rows, columns and depths of every seventh rendered pixel."""
    v, u = np.nonzero(drawn)
    return v[::7], u[::7], drawn[v[::7], u[::7]]


def _share_near(pairs: Sequence[tuple[Float, Pixels, Pixels, Float]], dx: int, dy: int) -> float:
    """Share of the rendered pixels whose measured depth, displaced by (dx, dy), is near the rendered one."""
    near = total = 0
    for seen, v, u, drawn in pairs:
        inside = (u - dx >= 0) & (u - dx < seen.shape[1]) & (v - dy >= 0) & (v - dy < seen.shape[0])
        measured = seen[v[inside] - dy, u[inside] - dx]
        known = measured > 0
        near += int((np.abs(measured - drawn[inside]) < NEAR_M)[known].sum())
        total += int(known.sum())
    return near / total if total else 0.0
