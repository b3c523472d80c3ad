"""What does not change during a run, logged once: the frame, its support plane, a mesh for everything drawn later."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache, lru_cache

import numpy as np
import rerun as rr
from numba import njit
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.observation import Observation, Support
from verefine_viz.core.palette import OBJECT_COLORS
from verefine_viz.core.problem import Problem
from verefine_viz.recording import chunks, columns, entities
from verefine_viz.recording.layout import Layout, world_from_camera
from verefine_viz.recording.meshes import object_pieces
from verefine_viz.recording.piece import Piece

CLOUD_POINTS, CLOUD_POINTS_WITH_PICTURES = 3_000, 20_000
"""About how many pixels of the objects are drawn as points; the rest of the frame gets far fewer."""
AROUND = 3
"""Around the objects, every so many-th in a row of those that would be drawn of the objects."""
SPARSE_PX = 12
"""Every so many-th pixel far from the objects."""
PLANE_COLOR, GRAVITY_COLOR = 0x5A8CA02D, 0x78BEDCFF


def background(problem: Problem, layout: Layout, pictures: bool) -> Iterator[Piece]:
    """Everything static of a frame; transforms of the stages follow with the iterations.

    Args:
        problem: the frame.
        layout: its layout.
        pictures: also colour, depth and masks as images, and a denser cloud.
    """
    observation = problem.observation
    T_world_cam = world_from_camera(observation)
    yield _up()
    yield chunks.fixed_row(entities.SCENE, columns.transforms(T_world_cam[None]))
    if observation.support:
        yield from _support(observation.support, layout)
    for k, target in enumerate(problem.targets):
        own = OBJECT_COLORS[k % len(OBJECT_COLORS)] if len(problem.targets) > 1 else None
        yield from object_pieces(target, entities.branch(target.instance, problem), own)
    near_m = _depth_m(T_world_cam, layout.center_world)
    yield _camera(observation.camera, near_m)
    yield _cloud(observation, near_m, CLOUD_POINTS_WITH_PICTURES if pictures else CLOUD_POINTS)
    if pictures:
        yield from _images(problem)


@cache
def _up() -> Piece:
    return chunks.fixed("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP)


def _camera(camera: Camera, near_m: float) -> Piece:
    return _pinhole(tuple(camera.K.ravel().tolist()), camera.width, camera.height, round(0.12 * near_m, 2) or 0.01)


@lru_cache(maxsize=256)
def _pinhole(K: tuple[float, ...], width: int, height: int, image_plane_m: float) -> Piece:
    """Made once for all frames that a camera takes from about as far."""
    pinhole = rr.Pinhole(
        image_from_camera=np.reshape(K, (3, 3)),
        resolution=[width, height],
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=image_plane_m,
        color=(140, 140, 140),
    )
    return chunks.fixed(entities.CAMERA, pinhole)


def _images(problem: Problem) -> Iterator[Piece]:
    observation = problem.observation
    if observation.rgb is not None:
        yield chunks.fixed(entities.IMAGE, rr.Image(observation.rgb).compress(jpeg_quality=85))
    # Tenths of a millimetre as long as they fit 16 bits.
    units_per_m = 10_000 if observation.depth_m.max(initial=0) < 6.5 else 1_000
    # Not as PNG, which is smaller but slow to encode.
    depth = np.rint(observation.depth_m * np.float32(units_per_m)).clip(0, 65535).astype(np.uint16)
    # Pixels without depth are 0 and get the darkest colour, which nothing that was measured should have.
    nearest, farthest = _depth_range(depth)
    ranged = (nearest - 0.15 * (farthest - nearest), farthest)
    image = rr.DepthImage(depth, meter=float(units_per_m), colormap="viridis", depth_range=ranged)
    yield chunks.fixed(entities.DEPTH, image)
    labels = np.zeros(observation.camera.shape, np.uint8)
    classes = [rr.AnnotationInfo(id=0, color=(0, 0, 0, 0))]
    for k, instance in enumerate(problem.instances[:255], start=1):
        labels[instance.mask] = k
        color = OBJECT_COLORS[(k - 1) % len(OBJECT_COLORS)]
        classes.append(rr.AnnotationInfo(k, entities.branch(instance, problem), color))
    yield chunks.fixed(entities.MASKS, rr.AnnotationContext(classes), rr.SegmentationImage(labels, opacity=0.35))


def _depth_range(depth: NDArray[np.uint16]) -> tuple[float, float]:
    """From where to where the depths are, single outliers aside."""
    known = depth[::4, ::4][depth[::4, ::4] > 0]
    if not len(known):
        return 0.0, 1.0
    nearest, farthest = np.percentile(known, [1, 97])
    return float(nearest), max(float(farthest), float(nearest) + 1.0)


def _cloud(observation: Observation, near_m: float, n_points: int) -> Piece:
    mask = observation.object_mask
    if not mask.any():
        mask = np.ones_like(mask)
    window = _around_objects(mask)
    step = math.ceil(math.sqrt(np.count_nonzero(mask) / n_points))
    rgb = _NO_COLORS if observation.rgb is None else observation.rgb
    # Far background would only shrink what matters when the view is fitted.
    camera, far_m = observation.camera, np.float32(2.5 * near_m)
    points, colors = _points(
        observation.depth_m, rgb, mask, camera.fx, camera.fy, camera.cx, camera.cy, far_m, window, step
    )
    cloud = rr.Points3D
    parts = [
        columns.vectors(cloud.descriptor_positions(), columns.Ragged([len(points)], points), 3),
        columns.numbers(cloud.descriptor_colors(), columns.Ragged([len(points)], colors), np.uint32),
        columns.numbers(cloud.descriptor_radii(), [[0.0012]], np.float32),
    ]
    return chunks.fixed_row(entities.CLOUD, parts)


_NO_COLORS = np.zeros((0, 0, 3), np.uint8)


@njit(cache=True)
def _points(
    depth_m: NDArray[np.float32],
    rgb: NDArray[np.uint8],
    mask: Mask,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    far_m: np.float32,
    window: tuple[int, int, int, int],
    step: int,
) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Points (n, 3) nearer than ``far_m``, and their colours (n,) as rerun keeps them.

    Of every ``step``-th pixel of the objects, every ``AROUND``-th of those in the window (rows, then columns), then of
    every ``SPARSE_PX``-th of the whole image.
    """
    h, w = depth_m.shape
    v0, v1, u0, u1 = window
    around = AROUND * step
    sparse = max(SPARSE_PX, around)
    most = ((v1 - v0) // step + 1) * ((u1 - u0) // step + 1) + (h // sparse + 1) * (w // sparse + 1)
    points, colors = np.empty((most, 3), np.float32), np.empty(most, np.uint32)
    n = 0
    for top, bottom, left, right, every in ((v0, v1, u0, u1, step), (0, h, 0, w, sparse)):
        for v in range(top, bottom, every):
            for u in range(left, right, every):
                if every == step and not mask[v, u] and ((v - v0) % around or (u - u0) % around):
                    continue
                z = depth_m[v, u]
                if not 0 < z < far_m:
                    continue
                points[n, 0] = np.float32((u - cx) / fx) * z
                points[n, 1] = np.float32((v - cy) / fy) * z
                points[n, 2] = z
                r, g, b = (rgb[v, u, 0], rgb[v, u, 1], rgb[v, u, 2]) if rgb.size else (150, 150, 150)
                colors[n] = r << 24 | g << 16 | b << 8 | 255
                n += 1
    return points[:n], colors[:n]


def _around_objects(mask: Mask) -> tuple[int, int, int, int]:
    """First and last row and column (exclusive) of the objects and half as much around them."""
    rows, across = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    h, w = mask.shape
    if len(rows) == 0:
        return 0, h, 0, w
    margin = int(max(rows[-1] - rows[0], across[-1] - across[0]) // 2) + 8
    return (
        max(int(rows[0]) - margin, 0),
        min(int(rows[-1]) + margin, h),
        max(int(across[0]) - margin, 0),
        min(int(across[-1]) + margin, w),
    )


def _depth_m(T_world_cam: Float, point_world: tuple[float, float, float]) -> float:
    """How far in front of the camera a point is; 1 m for one that is not."""
    depth_m = float(T_world_cam[:3, 2] @ (point_world - T_world_cam[:3, 3]))
    return depth_m if depth_m > 0 else 1.0


def _support(support: Support, layout: Layout) -> Iterator[Piece]:
    n, reach_m = support.normal_world, max(0.15, 0.7 * layout.width_m)
    corners = layout.center_world + reach_m * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    # The plane goes through the world's origin, across its normal.
    corners[:, 2] = -(corners[:, :2] @ n[:2]) / n[2] if abs(n[2]) > 0.2 else 0.0
    mesh, arrow = rr.Mesh3D, rr.Arrows3D
    triangles, plane_color, gravity_vector, gravity_color, gravity_label = _looks_of_support()
    plane = [
        columns.vectors(mesh.descriptor_vertex_positions(), [corners], 3),
        triangles,
        columns.vectors(mesh.descriptor_vertex_normals(), [[n] * 4], 3),
        plane_color,
    ]
    yield chunks.fixed_row(entities.PLANE, plane)
    foot = np.append(corners[0, :2], corners[0, 2] + 0.12)
    origin = columns.vectors(arrow.descriptor_origins(), [foot], 3)
    yield chunks.fixed_row(entities.GRAVITY, [origin, gravity_vector, gravity_color, gravity_label])


@cache
def _looks_of_support() -> tuple[columns.Column, ...]:
    """What is the same in every frame."""
    mesh, arrow = rr.Mesh3D, rr.Arrows3D
    return (
        columns.vectors(mesh.descriptor_triangle_indices(), [[[0, 1, 2], [0, 2, 3]]], 3, np.uint32),
        columns.numbers(mesh.descriptor_albedo_factor(), [[PLANE_COLOR]], np.uint32),
        columns.vectors(arrow.descriptor_vectors(), [[0, 0, -0.1]], 3),
        columns.numbers(arrow.descriptor_colors(), [[GRAVITY_COLOR]], np.uint32),
        columns.texts(arrow.descriptor_labels(), [["gravity"]]),
    )
