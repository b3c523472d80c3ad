"""The surroundings as the depth image shows them: what lies outside the objects' masks is fixed, and supports and stops
the objects.

A body that stands alone on the support and has no model becomes an unknown object; the rest becomes surfaces
(``support_surfaces.py``) and, where it rises from them, small convex solids. docs/methods.md 7.4.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import KDTree, QhullError

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.geometry import apply
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation, Support
from verefine_viz.core.surroundings import SupportSurface, Surroundings, UnknownObject
from verefine_viz.observation.support_surfaces import (
    CELL_M,
    STEEPEST,
    cells_of,
    support_surfaces,
)

AROUND_M = 0.15
"""Points farther than this from all objects, seen from above, do not count [m]."""
ABOVE_M = 0.10
"""Nor do points this much higher than the highest object [m]."""
EDGE_PX = 6
"""Pixels this near to a mask may show its object: masks end early, and depth is wrong at edges (640 pixels wide)."""
FEWEST_PIXELS = 200
"""With fewer points outside of the objects, the surroundings are unknown."""
RISES_M = 0.010
"""Points farther than this from all surfaces do not belong to one [m]."""
VOXEL_M = 0.010
"""Points of neighbouring voxels belong together [m]."""
FEWEST_POINTS = 60
"""Fewest points of a cluster; a smaller one is noise."""
LEAK_M = 0.020
"""A cluster this close to an object [m] …"""
LEAK_SHARE = 0.6
"""… with this share of its points belongs to the object, whose mask is too small."""
LARGEST_M, LOWEST_M = 0.40, 0.015
"""Largest size of an unknown object, and its least height [m]."""
STANDS_M = 0.05
"""Largest height of its lowest point above a surface [m]; the part below may be hidden."""
INSIDE_M, INSIDE_SHARE = 0.005, 0.001
"""Largest share of the objects' points that may lie deeper inside of it than this [m]."""
SEEN_THROUGH = 0.15
"""Largest share of the rays through its hull that may reach something behind it."""
BLOCK_M = 0.05
"""Side of the blocks that become one convex solid each [m]."""
THICK_M = 0.03
"""Thickness, away from the camera, of the other solids that rise from a surface [m]."""
THICKEST_M, THINNEST_M = 0.10, 0.005
"""Thickness of the solid below a surface [m]."""
MOST_CORNERS = 48
"""Corners of a convex solid that stands for many points."""


def observed_surroundings(
    observation: Observation, support: Support, dropped: Collection[int] = ()
) -> Surroundings | None:
    """The surroundings of the objects in a frame, from its depth image; None where too little of them is seen.

    Args:
        observation: the frame; all masks of it count as objects.
        support: its support plane, where surfaces are looked for first, and which way is up.
        dropped: numbers of unknown objects that must not stop anything.
    """
    objects = apply(support.T_world_cam, _points_of(observation, observation.object_mask))
    if not len(objects):
        return None
    spacing_m = _spacing_m(observation)
    stride = max(1, int(CELL_M / 3 / spacing_m))
    seen = _outside_of_objects(observation, support, stride)
    # Masks leak: a few pixels far behind must not decide which points are near.
    first, last = np.quantile(objects, [0.01, 0.99], axis=0)
    low, high = first[:2] - AROUND_M, last[:2] + AROUND_M
    is_near = ((seen.points[:, :2] >= low) & (seen.points[:, :2] <= high)).all(axis=1)
    near = seen.only(is_near & (seen.points[:, 2] <= last[2] + ABOVE_M))
    if len(near.points) < FEWEST_PIXELS:
        return None

    plane = SupportSurface(support.normal_world, 0.0, np.zeros((0, 2)))
    view = _View(observation, support, plane, KDTree(objects), low, high)
    unknown, is_explained = _unknown_objects(near, view, stride, dropped)
    rest = near.only(~is_explained)
    is_up = (rest.normals[:, 2] >= STEEPEST) & (rest.points[:, 2] > first[2] - THICKEST_M)
    cells = cells_of(rest.points[is_up], low, high, max(CELL_M, 4 * spacing_m))
    everything = np.concatenate([seen.points, objects])
    surfaces = support_surfaces(cells, everything, support.T_world_cam[:3, 3], plane)
    endless = next((s for s in surfaces if s.is_endless), None)
    base = endless or _below(plane, near.points)
    tops: list[SupportSurface] = []
    solids: list[ObjectModel] = []
    rises = _rises(rest.points, base, np.inf)
    for surface in (s for s in surfaces if not s.is_endless):
        thick_m = _thickness(surface, everything)
        corners = surface.lifted(surface.outline_xy)
        solid = convex_model(np.concatenate([corners, corners - thick_m * surface.normal_world]), "support")
        if solid is not None:
            tops.append(surface)
            solids.append(solid)
            rises &= _rises(rest.points, surface, thick_m)
    solids += _solids(rest.points[rises], view)
    return Surroundings("observed", base, endless is None, tuple(tops), tuple(solids), unknown)


@dataclass(frozen=True, eq=False)
class _Seen:
    """What the image shows outside of the objects' masks, in the world."""

    points: Float
    """(n, 3) [m]."""
    normals: Float
    """(n, 3)."""
    pixels: NDArray[np.int64]
    """(n, 2) row and column."""

    def only(self, which: NDArray[np.bool_]) -> _Seen:
        return _Seen(self.points[which], self.normals[which], self.pixels[which])


@dataclass(frozen=True, eq=False)
class _View:
    """The data that decide whether a cluster is an object of its own."""

    observation: Observation
    support: Support
    plane: SupportSurface
    objects: KDTree
    """Search tree of the objects' points, world [m]."""
    low: Float
    """(2,) lowest x and y of the region that counts …"""
    high: Float
    """… and highest [m]."""


def convex_model(points: Float, name: str) -> ObjectModel | None:
    """The convex hull of points (n, 3), with about ``MOST_CORNERS`` corners where there are many; None where it has no
    volume.
    """
    if len(points) > MOST_CORNERS:
        points = points[np.unique((points @ _directions(MOST_CORNERS).T).argmax(axis=0))]
    try:
        hull = trimesh.convex.convex_hull(points)
    except (QhullError, ValueError):
        return None
    vertices = np.asarray(hull.vertices, dtype=np.float64)
    size_m = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    if not size_m > 0:
        return None
    faces = np.asarray(hull.faces, dtype=np.int32)
    return ObjectModel(0, name, vertices, faces, vertices, np.zeros_like(vertices), size_m, np.eye(4)[None])


def _directions(n: int) -> Float:
    """(n, 3) unit vectors spread evenly over the sphere (a Fibonacci lattice)."""
    z = 1 - (2 * np.arange(n) + 1) / n
    turn = np.arange(n) * np.pi * (3 - np.sqrt(5))
    r = np.sqrt(1 - z**2)
    return np.column_stack([r * np.cos(turn), r * np.sin(turn), z])


def _points_of(observation: Observation, mask: Mask) -> Float:
    """Points (n, 3) of the pixels of a mask that have depth, in the camera frame [m]."""
    chosen = mask & (observation.depth_m > 0)
    return observation.camera.back_project(observation.depth_m.astype(np.float64))[chosen]


def _spacing_m(observation: Observation) -> float:
    """Distance between neighbouring pixels on the objects [m]."""
    depth = observation.depth_m[observation.object_mask & (observation.depth_m > 0)]
    return float(np.median(depth)) / observation.camera.fx


def _outside_of_objects(observation: Observation, support: Support, stride: int) -> _Seen:
    """Every ``stride``-th pixel of each row and column that has depth and is clear of the masks."""
    edge_px = max(2, round(EDGE_PX * observation.camera.width / 640))
    objects = np.asarray(ndimage.binary_dilation(observation.object_mask, iterations=edge_px), dtype=bool)
    # Where depth jumps, pixels mix both sides, and have no normal.
    is_clear = (observation.depth_m > 0) & ~objects & observation.normals_cam.any(axis=2)
    is_clear &= _every(stride, observation.camera.shape)
    points = apply(support.T_world_cam, _points_of(observation, is_clear))
    normals = observation.normals_cam[is_clear].astype(np.float64) @ support.T_world_cam[:3, :3].T
    return _Seen(points, normals, np.argwhere(is_clear))


def _every(stride: int, shape: tuple[int, int]) -> Mask:
    chosen = np.zeros(shape, dtype=bool)
    chosen[::stride, ::stride] = True
    return chosen


def _mask(pixels: NDArray[np.int64], shape: tuple[int, int], stride: int) -> Mask:
    """The pixels (n, 2), every ``stride``-th, together with those between them."""
    mask = np.zeros(shape, dtype=bool)
    mask[tuple(pixels.T)] = True
    grown = ndimage.binary_dilation(mask, np.ones((stride, stride)))
    return np.asarray(ndimage.binary_closing(grown, np.ones((3, 3))), dtype=bool)


def _clusters(points: Float, rising: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Indices of the points of each separate group, the largest first."""
    if len(rising) < FEWEST_POINTS:
        return []
    voxels = np.floor((points[rising] - points[rising].min(axis=0)) / VOXEL_M).astype(np.int64)
    grid = np.zeros(tuple(voxels.max(axis=0) + 1), dtype=bool)
    grid[tuple(voxels.T)] = True
    labels = np.zeros(grid.shape, dtype=np.int32)
    ndimage.label(grid, np.ones((3, 3, 3)), output=labels)
    own = labels[tuple(voxels.T)]
    sizes = np.bincount(own)
    large = [k for k in np.argsort(-sizes, kind="stable") if sizes[k] >= FEWEST_POINTS]
    return [rising[own == k] for k in large]


def _unknown_objects(
    near: _Seen, view: _View, stride: int, dropped: Collection[int]
) -> tuple[tuple[UnknownObject, ...], NDArray[np.bool_]]:
    """Clusters that are objects of their own, the largest first, and which points belong to them or to a known
    object.
    """
    is_explained = np.zeros(len(near.points), dtype=bool)
    unknown: list[UnknownObject] = []
    for cluster in _clusters(near.points, np.flatnonzero(view.plane.heights(near.points) > RISES_M)):
        points, pixels = near.points[cluster], near.pixels[cluster]
        is_leak = _is_leak(points, view)
        model = None if is_leak else _standing_alone(points, pixels, view)
        is_explained[cluster] = is_leak or model is not None
        if model is not None:
            number, mask = len(unknown) + 1, _mask(pixels, view.observation.camera.shape, stride)
            unknown.append(UnknownObject(number, model, mask, number in dropped))
    return tuple(unknown), is_explained


def _is_leak(points: Float, view: _View) -> bool:
    """Whether a cluster (n, 3) is a rim of an object that its mask does not cover."""
    return bool(np.mean(view.objects.query(points, distance_upper_bound=LEAK_M)[0] <= LEAK_M) >= LEAK_SHARE)


def _standing_alone(points: Float, pixels: NDArray[np.int64], view: _View) -> ObjectModel | None:
    """A cluster as one convex solid down to the plane; None where it is not an object seen as a whole."""
    heights, extent = view.plane.heights(points), np.ptp(points, axis=0)
    first, last = points[:, :2].min(axis=0) - VOXEL_M, points[:, :2].max(axis=0) + VOXEL_M
    camera = view.observation.camera
    at_border = (pixels <= 2).any() or (pixels >= np.array(camera.shape) - 3).any()
    is_sized = extent.max() <= LARGEST_M and heights.max() >= LOWEST_M and heights.min() <= STANDS_M
    if (first < view.low).any() or (last > view.high).any() or at_border or not is_sized:
        return None
    model = convex_model(np.concatenate([points, view.plane.lifted(points[:, :2])]), "unknown object")
    if model is None:
        return None
    inward, offsets = _planes(model)
    if np.mean((view.objects.data @ inward.T + offsets > INSIDE_M).all(axis=1)) > INSIDE_SHARE:
        return None
    # Where the camera sees through the hull, there is no object.
    T_world_cam = view.support.T_world_cam
    behind = apply(T_world_cam, _points_of(view.observation, _every(max(1, camera.width // 160), camera.shape)))
    eye = T_world_cam[:3, 3]
    entry, leave = _through(eye, behind, inward, offsets)
    crosses = leave - entry > 0.02 / np.linalg.norm(behind - eye, axis=1)
    through = np.count_nonzero(crosses & (entry > 0) & (leave < 1.0))
    return model if through <= SEEN_THROUGH * max(np.count_nonzero(crosses), 1) else None


def _planes(model: ObjectModel) -> tuple[Float, Float]:
    """Inward unit normals (f, 3) of a convex model's faces and offsets (f,): inside all ``n · p + offset`` are > 0."""
    a, b, c = (model.vertices[model.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    inward = -(normals / np.maximum(lengths, 1e-15)[:, None])[lengths > 1e-12]
    return inward, -(inward * a[lengths > 1e-12]).sum(axis=1)


def _through(eye: Float, to: Float, inward: Float, offsets: Float) -> tuple[Float, Float]:
    """Where the rays from ``eye`` to points (n, 3) enter and leave a convex solid, as shares (n,) of the way."""
    at_eye = inward @ eye + offsets
    slope = (to - eye) @ inward.T
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = -at_eye / slope
    entry = np.where(slope > 0, crossing, -np.inf).max(axis=1)
    leave = np.where(slope < 0, crossing, np.inf).min(axis=1)
    never = ((slope == 0) & (at_eye < 0)).any(axis=1)
    return np.where(never, np.inf, entry), np.where(never, -np.inf, leave)


def _below(plane: SupportSurface, points: Float) -> SupportSurface:
    """A plane below everything that was seen."""
    lowest = float(np.quantile(plane.heights(points), 0.001))
    return SupportSurface(plane.normal_world, plane.offset_m - lowest + THICKEST_M, plane.outline_xy)


def _thickness(surface: SupportSurface, seen: Float) -> float:
    """Largest thickness [m] of the solid below a surface that the points seen below it allow."""
    heights = surface.heights(seen)
    inside = surface.reaches(seen[:, :2], -0.02) & (heights < -RISES_M)
    gaps = -heights[inside] - THINNEST_M
    return float(np.clip(np.quantile(gaps, 0.02) if len(gaps) else THICKEST_M, THINNEST_M, THICKEST_M))


def _rises(points: Float, surface: SupportSurface, thick_m: float) -> NDArray[np.bool_]:
    """Which points (n, 3) are neither on a surface nor in the solid below it."""
    heights = surface.heights(points)
    return (heights > RISES_M) | (heights < -thick_m) | ~surface.reaches(points[:, :2], RISES_M)


def _solids(points: Float, view: _View) -> list[ObjectModel]:
    """The points near the objects in blocks, each a convex solid with some thickness away from the camera."""
    near = view.objects.query(points, distance_upper_bound=AROUND_M)[0] <= AROUND_M
    solids = []
    for cluster in (points[of] for of in _clusters(points, np.flatnonzero(near))):
        if _is_leak(cluster, view):
            continue
        rays = cluster - view.support.T_world_cam[:3, 3]
        deeper = cluster + THICK_M * rays / np.linalg.norm(rays, axis=1, keepdims=True)
        own = np.unique(np.floor(cluster / BLOCK_M), axis=0, return_inverse=True)[1].ravel()
        blocks = [own == k for k in range(own.max() + 1)]
        solids += [
            convex_model(np.concatenate([cluster[block], deeper[block]]), "surroundings")
            for block in blocks
            if np.count_nonzero(block) >= FEWEST_POINTS // 3
        ]
    return [solid for solid in solids if solid is not None]
