"""Right data of many kinds, made from right frames; and close views of single objects, for poor initial poses."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tests.calibration.sizes import moved, with_models, with_truth
from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import axis_angle, random_unit_vector, transform
from verefine_viz.core.problem import Hypothesis, Instance, Problem
from verefine_viz.observation.observed_frame import segment_cloud

Variant = Callable[[Problem, np.random.Generator], Problem]
OfDepth = Callable[[NDArray[np.float64], np.random.Generator], NDArray[np.floating]]
OfMask = Callable[[Mask, np.random.Generator], Mask]


def seen_again(
    p: Problem,
    depth_m: NDArray[np.floating],
    masks: list[Mask],
    camera: Camera | None = None,
    rgb: NDArray[np.uint8] | None = None,
) -> Problem:
    """The frame with other depth and masks; objects of whose mask too little is left are out."""
    camera, rgb = (p.observation.camera, p.observation.rgb) if camera is None else (camera, rgb)
    depth_m = np.ascontiguousarray(depth_m, np.float32)
    instances = [
        replace(i, mask=mask, points_cam=segment_cloud(depth_m, camera, mask, 700, 0))
        for i, mask in zip(p.instances, masks, strict=True)
        if np.count_nonzero(mask & (depth_m > 0)) >= 30
    ]
    union, flat = np.any(masks, axis=0), np.zeros((*depth_m.shape, 3), np.float32)
    seen = replace(p.observation, camera=camera, depth_m=depth_m, normals_cam=flat, rgb=rgb, object_mask=union)
    return replace(p, observation=seen, instances=tuple(instances))


def sampled(p: Problem, K: Float, rows: slice, columns: slice) -> Problem:
    """Images of some rows and columns, and the camera that sees them."""
    seen = p.observation
    rgb = None if seen.rgb is None else np.ascontiguousarray(seen.rgb[rows, columns])
    depth_m = seen.depth_m[rows, columns]
    camera = Camera(K, depth_m.shape[1], depth_m.shape[0])
    masks = [np.ascontiguousarray(i.mask[rows, columns]) for i in p.instances]
    return seen_again(p, depth_m, masks, camera, rgb)


def of_depth(change: OfDepth) -> Variant:
    return lambda p, rng: seen_again(
        p, change(p.observation.depth_m.astype(np.float64), rng), [i.mask for i in p.instances]
    )


def missing(share: float) -> Variant:
    """Pixels without depth, at random."""
    return of_depth(lambda d, rng: np.where(rng.random(d.shape) < share, 0, d))


def every(rows: int, columns: int) -> Variant:
    """Depth of some rows and columns alone."""

    def kept(d: NDArray[np.float64], rng: np.random.Generator) -> Float:
        v, u = np.indices(d.shape)
        return np.where((v % rows == 0) & (u % columns == 0), d, 0)

    return of_depth(kept)


def steps(step_m: float) -> Variant:
    return of_depth(lambda d, rng: np.round(d / step_m) * step_m)


def blobs(d: NDArray[np.float64], rng: np.random.Generator) -> Float:
    """Holes of some 10 px in a third of the image."""
    waves = ndimage.gaussian_filter(rng.standard_normal(d.shape), 6)
    return np.where(waves > np.quantile(waves, 0.67), 0, d)


def edges_off(d: NDArray[np.float64], rng: np.random.Generator) -> Float:
    """Nothing measured within 4 px of edges."""
    edge = ndimage.maximum_filter(d, 9) - ndimage.minimum_filter(d, 9) > 0.03
    return np.where(edge, 0, d)


def of_masks(change: OfMask) -> Variant:
    return lambda p, rng: seen_again(p, p.observation.depth_m, [change(i.mask, rng) for i in p.instances])


def outside_px(mask: Mask) -> Float:
    """How far each pixel is outside of a mask; negative inside."""
    return np.asarray(ndimage.distance_transform_edt(~mask)) - np.asarray(ndimage.distance_transform_edt(mask))


def grown(px: float) -> OfMask:
    """A mask that is too wide, or too narrow."""
    return lambda mask, rng: outside_px(mask) <= px


def boxed(mask: Mask, rng: np.random.Generator) -> Mask:
    """The box around a mask."""
    out = np.zeros_like(mask)
    if mask.any():
        v, u = np.nonzero(mask)
        out[v.min() : v.max() + 1, u.min() : u.max() + 1] = True
    return out


def rough_by(px: float) -> OfMask:
    """A mask whose border wanders by some pixels."""

    def change(mask: Mask, rng: np.random.Generator) -> Mask:
        waves = ndimage.gaussian_filter(rng.normal(size=mask.shape), 8)
        return outside_px(mask) <= px * waves / waves.std()

    return change


def cut_off(share: float) -> OfMask:
    """A part of a mask is missing, on one side."""

    def change(mask: Mask, rng: np.random.Generator) -> Mask:
        v, u = np.nonzero(mask)
        if len(v) == 0:
            return mask
        angle = rng.uniform(0, 2 * np.pi)
        along, left = u * np.cos(angle) + v * np.sin(angle), mask.copy()
        off = along < np.quantile(along, share)
        left[v[off], u[off]] = False
        return left

    return change


def window(p: Problem, rows: slice, columns: slice) -> Problem:
    """A part of the images."""
    return sampled(p, p.observation.camera.K - [[0, 0, columns.start], [0, 0, rows.start], [0, 0, 0]], rows, columns)


def middle(share: float) -> Variant:
    """The middle of the images."""

    def variant(p: Problem, rng: np.random.Generator) -> Problem:
        h, w = p.observation.camera.shape
        dv, du = int(h * (1 - share) / 2), int(w * (1 - share) / 2)
        return window(p, slice(dv, h - dv), slice(du, w - du))

    return variant


def thinned(by: int) -> Variant:
    """Images of a smaller size."""
    scale, every_nth = np.diag([1 / by, 1 / by, 1.0]), slice(None, None, by)
    return lambda p, rng: sampled(p, scale @ p.observation.camera.K, every_nth, every_nth)


def only(n: int) -> Variant:
    """The objects with the largest masks alone."""

    def variant(p: Problem, rng: np.random.Generator) -> Problem:
        largest = sorted(p.instances, key=lambda i: -int(np.count_nonzero(i.mask)))
        return p.only([i.instance_id for i in largest[:n]])

    return variant


def nearer(times: float) -> Variant:
    """The whole world of another size: a small object before a camera for close views, or a large one far away."""

    def variant(p: Problem, rng: np.random.Generator) -> Problem:
        p = with_truth(with_models(p, times), moved(times))
        depth_m = np.round(p.observation.depth_m.astype(np.float64) * times, 3)
        return seen_again(p, depth_m, [i.mask for i in p.instances])

    return variant


def upside_down(p: Problem, rng: np.random.Generator) -> Problem:
    """Images turned by 180°, with all that follows from it."""
    K, (h, w) = p.observation.camera.K.copy(), p.observation.camera.shape
    K[:2, 2] = (w - 1 - K[0, 2], h - 1 - K[1, 2])
    backwards = slice(None, None, -1)
    return sampled(with_truth(p, lambda T: np.diag([-1.0, -1.0, 1.0, 1.0]) @ T), K, backwards, backwards)


def estimated(p: Problem, poses: Callable[[Float], Float], others: Callable[[Float], Float] | None = None) -> Problem:
    """The frame without ground truth; ``poses`` are those of the first object, ``others`` the rest's if they differ."""

    def one(k: int, i: Instance) -> Instance:
        if i.T_cam_obj_gt is None:
            return replace(i, hypotheses=())
        T = (poses if k == 0 or others is None else others)(i.T_cam_obj_gt)
        return replace(i, T_cam_obj_gt=None, hypotheses=(Hypothesis(T, 1.0, "net"),))

    largest = sorted(p.instances, key=lambda i: -int(np.count_nonzero(i.mask)))
    return replace(p, instances=tuple(one(k, i) for k, i in enumerate(largest)))


def off(rng: np.random.Generator, deg: float, mm: float, z_times: float = 1.0) -> Callable[[Float], Float]:
    """A pose that is off, another way at each call."""

    def change(T: Float) -> Float:
        R = axis_angle(random_unit_vector(rng), np.radians(deg)) @ T[:3, :3]
        return transform(R, z_times * T[:3, 3] + 1e-3 * mm * random_unit_vector(rng))

    return change


def posed(deg: float, mm: float, z_times: float = 1.0, all_of_them: bool = False) -> Variant:
    """A poor initial pose of one object, or of all."""
    return lambda p, rng: estimated(p, off(rng, deg, mm, z_times), None if all_of_them else off(rng, 5, 5))


RIGHT: dict[str, Variant] = {
    "as it is": lambda p, rng: p,
    **{f"depth missing, {share:.0%}": missing(share) for share in (0.3, 0.7, 0.85, 0.95)},
    "every 8th row": every(8, 1),
    "every 4th row and column": every(4, 4),
    "every 8th row and column": every(8, 8),
    "every 5th column": every(1, 5),
    "1 mm steps": steps(1e-3),
    "2 mm steps": steps(2e-3),
    "noise of 4 mm": of_depth(lambda d, rng: np.where(d > 0, d + 0.004 * rng.standard_normal(d.shape), 0)),
    "holes": of_depth(blobs),
    "no depth at edges": of_depth(edges_off),
    "mixed pixels": of_depth(lambda d, rng: np.where(d > 0, ndimage.uniform_filter(d, 5), 0)),
    "nothing beyond 1 m": of_depth(lambda d, rng: np.where(d > 1.0, 0, d)),
    "1 % longer": of_depth(lambda d, rng: 1.01 * d),
    **{f"masks grown by {px:g} px": of_masks(grown(px)) for px in (-3, -1, 2, 4)},
    "masks are boxes": of_masks(boxed),
    "masks rough": of_masks(rough_by(4)),
    "masks with stray pixels": of_masks(lambda mask, rng: mask | (rng.random(mask.shape) < 2e-4)),
    "a fifth of each mask missing": of_masks(cut_off(0.2)),
    "half of each mask missing": of_masks(cut_off(0.5)),
    "middle of the image, 70 %": middle(0.7),
    "middle of the image, 40 %": middle(0.4),
    "middle, 1 mm steps": lambda p, rng: steps(1e-3)(middle(0.3)(p, rng), rng),
    "half the size": thinned(2),
    "a third of the size": thinned(3),
    "one object": only(1),
    "two objects": only(2),
    "all a quarter as large": nearer(0.25),
    "all twice as large": nearer(2.0),
    "upside down": upside_down,
    "initial poses 15° 15 mm off": posed(15, 15, 1, True),
    "initial poses 30° 30 mm off": posed(30, 30, 1, True),
    "one 60° and 50 mm off": posed(60, 50),
    "one 180° off": posed(180, 0),
    "one 300 mm off": posed(0, 300),
    "one 30 % too far": posed(0, 0, 1.3),
}
"""Variants of frames with which nothing is wrong."""

POOR: dict[str, Callable[[np.random.Generator], Callable[[Float], Float]]] = {
    "60° and 50 mm": lambda rng: off(rng, 60, 50),
    "180°": lambda rng: off(rng, 180, 0),
    "30 % too far": lambda rng: off(rng, 0, 0, 1.3),
    "30 % too near": lambda rng: off(rng, 0, 0, 0.7),
    "300 mm": lambda rng: off(rng, 0, 300),
}
"""Initial poses that are off."""


def has_truth(p: Problem) -> bool:
    """Whether any pose is known."""
    return any(i.T_cam_obj_gt is not None for i in p.instances)


def close_views(of: list[Problem]) -> Iterator[tuple[float, Problem]]:
    """One object alone with a margin around its mask, as a share of it."""
    for p in of:
        for i in p.instances:
            v, u = np.nonzero(i.mask)
            if len(v) < 1500 or i.T_cam_obj_gt is None:
                continue
            for margin in (0.05, 0.15, 0.3):
                dv, du = (int(margin * np.ptp(x)) + 1 for x in (v, u))
                h, w = p.observation.camera.shape
                rows = slice(max(0, int(v.min()) - dv), min(h, int(v.max()) + dv + 1))
                columns = slice(max(0, int(u.min()) - du), min(w, int(u.max()) + du + 1))
                yield margin, window(p.only([i.instance_id]), rows, columns)
