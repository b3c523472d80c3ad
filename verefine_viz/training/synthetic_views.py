"""Views of an object among others on a table, by a depth sensor and an imperfect detector. Same seed, same view.

A view covers only the object's surroundings: a small image, with the principal point of a crop from a large one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import axis_angle, random_unit_vector, rotation_of_quat_wxyz, transform
from verefine_viz.rendering.rasterizer import draw_frame
from verefine_viz.scenes.sensor import Sensor, sense
from verefine_viz.training.training_shapes import TrainingShape, draw_shape

FOCAL_PX = (450.0, 1100.0)
OBJECT_PX = (36.0, 150.0)
"""Smallest and largest diameter in the image."""
DISTANCE_M = (0.35, 1.6)
OFF_AXIS_DEG = 24.0
"""Largest angle between the ray to the object and the camera's axis."""
ELEVATION_DEG = (12.0, 88.0)
"""How steeply the camera looks down on the table."""
LEAST_VISIBLE = 0.25
"""Least visible share of the object's silhouette; views with less are drawn again."""
LEAST_PX = 120
"""Fewest visible pixels of the object."""
NO_TABLE, STANDS, IS_HIDDEN, HAS_HOLES = 0.15, 0.6, 0.25, 0.3
"""Probabilities that there is no table, that an object lies on a side of its hull, that something floats in front, that
patches are missing."""


@dataclass(frozen=True, eq=False)
class SyntheticView:
    """One object in one small depth image."""

    shape: TrainingShape
    camera: Camera
    depth_m: NDArray[np.float32]
    """(H, W) z [m], 0 = not measured."""
    mask: Mask
    """(H, W) mask by the detector."""
    T_cam_obj: Float
    """(4, 4) ground truth [m]."""


def draw_view(seed: tuple[int, ...], held_out: bool = False) -> SyntheticView:
    """The view of a seed."""
    rng = np.random.default_rng(seed)
    while True:
        view = _attempt(rng, held_out)
        if view is not None:
            return view


def _attempt(rng: np.random.Generator, held_out: bool) -> SyntheticView | None:
    shape = draw_shape(rng, held_out)
    camera, centre_cam = _camera(rng, shape.radius_m)
    has_table = rng.random() >= NO_TABLE
    up_cam = _up(rng)
    R = _resting(rng, shape, up_cam) if rng.random() < STANDS else _any_rotation(rng)
    table_cam = centre_cam + up_cam * (shape.mesh.vertices @ R.T @ up_cam).min()
    scene = [(shape, transform(R, centre_cam))]
    for _ in range(int(rng.integers(4))):
        scene.append(_neighbour(rng, shape, centre_cam, table_cam, up_cam))
    if rng.random() < IS_HIDDEN:
        other = draw_shape(rng)
        aside = shape.radius_m * rng.uniform(0.4, 1.3) * random_unit_vector(rng)
        scene.append((other, transform(_any_rotation(rng), centre_cam * rng.uniform(0.6, 0.88) + aside)))
    depth_m, normals, labels = _rendered(scene, camera)
    alone = _rendered(scene[:1], camera)[2] == 0
    if has_table:
        depth_m, normals, labels = _with_table(depth_m, normals, labels, camera, table_cam, up_cam)
    visible = labels == 0
    if visible.sum() < max(LEAST_PX, LEAST_VISIBLE * alone.sum()):
        return None
    sensor = Sensor(
        noise_px=rng.uniform(0.02, 0.12),
        noise_grain_px=rng.uniform(0.6, 1.6),
        disparity_step_px=1 / float(rng.choice([8, 16, 32, 64])),
        edge_dropout=rng.uniform(0.1, 0.8),
    )
    seen_m = sense(depth_m, normals, camera, int(rng.integers(2**31)), sensor)
    if rng.random() < HAS_HOLES:
        for _ in range(int(rng.integers(1, 4))):
            seen_m[_blob(rng, visible, 0.05, 0.25)] = 0
    mask = _detected(rng, visible, labels)
    if (mask & visible & (seen_m > 0)).sum() < LEAST_PX / 2:
        return None
    return SyntheticView(shape, camera, seen_m, mask, scene[0][1])


def _camera(rng: np.random.Generator, radius_m: float) -> tuple[Camera, Float]:
    """A camera and where the object's middle is in its frame (3,) [m]."""
    focal = rng.uniform(*FOCAL_PX)
    wanted_px = np.exp(rng.uniform(*np.log(OBJECT_PX)))
    away_m = float(np.clip(2 * radius_m * focal / wanted_px, *DISTANCE_M))
    away_m = max(away_m, 2 * radius_m * focal / (1.3 * OBJECT_PX[1]), 3.0 * radius_m)
    slope = np.tan(np.deg2rad(OFF_AXIS_DEG)) * np.sqrt(rng.random())
    around = rng.uniform(0, 2 * np.pi)
    ray = np.array([slope * np.cos(around), slope * np.sin(around), 1.0])
    side = int(2.4 * 2 * radius_m * focal / away_m) + 24
    middle = (side - 1) / 2
    K = np.array([[focal, 0, middle - focal * ray[0]], [0, focal, middle - focal * ray[1]], [0, 0, 1.0]])
    return Camera(K, side, side), ray * away_m


def _up(rng: np.random.Generator) -> Float:
    """Direction against gravity, in the camera's frame (3,)."""
    elevation, roll = np.deg2rad(rng.uniform(*ELEVATION_DEG)), np.deg2rad(rng.normal(0, 8))
    up = np.array([0.0, -np.cos(elevation), -np.sin(elevation)])
    return axis_angle([0, 0, 1], roll) @ up


def _any_rotation(rng: np.random.Generator) -> Float:
    return rotation_of_quat_wxyz(rng.normal(size=4))


def _resting(rng: np.random.Generator, shape: TrainingShape, up_cam: Float) -> Float:
    """A rotation that lays the shape on a side of its hull."""
    down = shape.resting_normals[rng.choice(len(shape.resting_weights), p=shape.resting_weights)]
    first, second = _frame(down), _frame(-up_cam)
    return cast(Float, second @ axis_angle([0, 0, 1], rng.uniform(0, 2 * np.pi)) @ first.T)


def _frame(z: Float) -> Float:
    """A rotation (3, 3) whose third column is z."""
    x = np.cross(z, np.eye(3)[int(np.abs(z).argmin())])
    x /= np.linalg.norm(x)
    return cast(Float, np.stack([x, np.cross(z, x), z], axis=1))


def _neighbour(
    rng: np.random.Generator, shape: TrainingShape, centre_cam: Float, table_cam: Float, up_cam: Float
) -> tuple[TrainingShape, Float]:
    """Another shape that stands on the table beside the object, close enough to touch or hide it."""
    other = draw_shape(rng)
    R = _resting(rng, other, up_cam) if rng.random() < STANDS else _any_rotation(rng)
    beside = _frame(up_cam) @ axis_angle([0, 0, 1], rng.uniform(0, 2 * np.pi))[:, 0]
    on_table = centre_cam + up_cam * float((table_cam - centre_cam) @ up_cam)
    lowest = (other.mesh.vertices @ R.T @ up_cam).min()
    away = (shape.radius_m + other.radius_m) * rng.uniform(0.6, 1.3)
    return other, transform(R, on_table + beside * away - up_cam * lowest)


def _rendered(
    scene: list[tuple[TrainingShape, Float]], camera: Camera
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int32]]:
    """Depth (H, W) [m], normals (H, W, 3) and labels (H, W), -1 = nothing, as an ideal sensor sees them."""
    inv_z = np.zeros(camera.shape, np.float32)
    normals = np.zeros((*camera.shape, 3), np.float32)
    labels = np.full(camera.shape, -1, np.int32)
    for k, (shape, T) in enumerate(scene):
        face_of = np.full(camera.shape, -1, np.int32)
        draw_frame(T, *shape.mesh.arrays, camera.fx, camera.fy, camera.cx, camera.cy, inv_z, face_of)
        drawn = face_of >= 0
        labels[drawn] = k
        normals[drawn] = shape.mesh.face_normals[face_of[drawn]] @ T[:3, :3].T
    return np.divide(1.0, inv_z, out=np.zeros_like(inv_z), where=inv_z > 0), normals, labels


def _with_table(
    depth_m: NDArray, normals: NDArray, labels: NDArray, camera: Camera, table_cam: Float, up_cam: Float
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int32]]:
    down = camera.back_project(np.ones(camera.shape)) @ up_cam
    table_m = np.divide(table_cam @ up_cam, down, out=np.zeros(camera.shape), where=down < -1e-6)
    is_table = (table_m > 0) & (table_m < 4.0) & ((depth_m == 0) | (table_m < depth_m))
    depth_m = np.where(is_table, table_m, depth_m).astype(np.float32)
    normals = np.where(is_table[..., None], up_cam, normals).astype(np.float32)
    return depth_m, normals, np.where(is_table, np.int32(-1), labels)


def _detected(rng: np.random.Generator, visible: Mask, labels: NDArray[np.int32]) -> Mask:
    """The mask of a detector: right, too wide, too narrow, with pixels of a neighbour, or without a part."""
    mask = visible
    kind = rng.random()
    if kind < 0.3:
        return mask
    if kind < 0.55:
        mask = np.asarray(binary_dilation(mask, iterations=int(rng.integers(1, 5))), bool)
    elif kind < 0.7:
        mask = np.asarray(binary_erosion(mask, iterations=int(rng.integers(1, 4))), bool)
    if rng.random() < 0.3 and (labels > 0).any():
        other = labels == rng.choice(np.unique(labels[labels > 0]))
        mask = mask | (other & _blob(rng, other, 0.2, 0.6))
    if rng.random() < 0.25:
        mask = mask & ~_blob(rng, visible, 0.15, 0.45)
    return cast(Mask, mask)


def _blob(rng: np.random.Generator, about: Mask, least: float, most: float) -> Mask:
    """An ellipse around a pixel of a mask, its half axes as shares of the mask's size."""
    rows, columns = np.nonzero(about)
    k = int(rng.integers(len(rows)))
    size = np.sqrt(len(rows))
    a, b = size * rng.uniform(least, most, 2)
    turn = rng.uniform(0, np.pi)
    v, u = np.mgrid[: about.shape[0], : about.shape[1]]
    du, dv = u - columns[k], v - rows[k]
    along, across = np.cos(turn) * du + np.sin(turn) * dv, -np.sin(turn) * du + np.cos(turn) * dv
    return (along / a) ** 2 + (across / b) ** 2 <= 1
