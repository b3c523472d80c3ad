"""Scenes of upright boxes on a table, by ray casting: who stands on whom is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tests.fakes import box_model
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import transform
from verefine_viz.core.observation import Observation, Support
from verefine_viz.core.problem import Instance, Problem

CAMERA = Camera(np.array([[220.0, 0, 99.5], [0, 220.0, 74.5], [0, 0, 1]]), 200, 150)
_LOOK_AT_M = np.array([0.0, 0.0, 0.06])
_BACK = np.array([0.0, -np.cos(np.radians(42)), np.sin(np.radians(42))])
_X = np.array([1.0, 0.0, 0.0])
T_WORLD_CAM = transform(np.stack([_X, np.cross(-_BACK, _X), -_BACK], axis=1), _LOOK_AT_M + 0.8 * _BACK)


@dataclass(frozen=True)
class Box:
    """An upright box, seen from the side of negative y."""

    x_m: float
    y_m: float
    bottom_m: float
    size_m: tuple[float, float, float]
    obj_id: int = 1

    @property
    def top_m(self) -> float:
        return self.bottom_m + self.size_m[2]


def box_scene(boxes: Sequence[Box], order: Sequence[int] | None = None, with_plane: bool = True) -> Problem:
    """Box k is instance k; ``order`` is the one in which the problem lists those of which something is seen."""
    depth_m, labels = _cast(boxes)
    points = CAMERA.back_project(depth_m)
    normals = np.zeros((*CAMERA.shape, 3))
    instances = [
        Instance(k, boxes[k].obj_id, labels == k, points[labels == k][:500], ())
        for k in (order if order is not None else range(len(boxes)))
    ]
    support = Support(T_WORLD_CAM, np.array([0.0, 0.0, 1.0]), "plane", 1.0) if with_plane else None
    observation = Observation(CAMERA, depth_m.astype(np.float32), normals, None, labels >= 0, support)
    models = {b.obj_id: box_model(b.obj_id, f"box{b.obj_id}") for b in boxes}
    return Problem(0, 1, observation, models, tuple(instances), "boxes")


def _cast(boxes: Sequence[Box]) -> tuple[np.ndarray, np.ndarray]:
    """Depth (H, W) [m] and the index of the box (H, W), −1 for the table."""
    rays = CAMERA.back_project(np.ones(CAMERA.shape)) @ T_WORLD_CAM[:3, :3].T
    origin = T_WORLD_CAM[:3, 3]
    depth = -origin[2] / np.minimum(rays[..., 2], -1e-9)
    labels = np.full(CAMERA.shape, -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        for k, box in enumerate(boxes):
            half = np.array(box.size_m) / 2
            centre = np.array([box.x_m, box.y_m, box.bottom_m + half[2]])
            near, far = (centre - half - origin) / rays, (centre + half - origin) / rays
            enters, leaves = np.minimum(near, far).max(axis=-1), np.maximum(near, far).min(axis=-1)
            hit = (enters <= leaves) & (enters > 0) & (enters < depth)
            depth[hit], labels[hit] = enters[hit], k
    return np.where(depth < 3.0, depth, 0.0), labels
