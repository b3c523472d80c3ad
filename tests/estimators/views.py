"""Single objects seen by a made-up depth sensor: rays cast by open3d, noise from a seed."""

from __future__ import annotations

import numpy as np

from tests.rendering.witness import cast
from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Hypothesis, Instance, Target
from verefine_viz.observation.normals import estimate_normals

CAMERA = Camera(np.array([[420.0, 0, 120.0], [0, 420.0, 120.0], [0, 0, 1]]), 241, 241)
"""Square with its principal point in the middle: turned by a quarter, the image is one of the same camera."""
BACKGROUND_M = 1.2


def view(model: ObjectModel, T_cam_obj: Float, noise_m: float = 0.001, seed: int = 0) -> Target:
    """The object before a wall."""
    depth = cast([(model, T_cam_obj)], CAMERA)[0]
    mask = depth > 0
    depth = np.where(mask, depth, BACKGROUND_M) + np.random.default_rng(seed).normal(0, noise_m, depth.shape)
    return target_of(model, depth, mask, T_cam_obj)


def target_of(model: ObjectModel, depth_m: Float, mask: Mask, T_cam_obj: Float | None = None) -> Target:
    observation = Observation(CAMERA, depth_m.astype(np.float32), estimate_normals(depth_m, CAMERA), None, mask, None)
    return Target(observation, Instance(0, model.obj_id, mask, np.zeros((0, 3)), (), T_cam_obj), model)


def random_pose(seed: int, model: ObjectModel) -> Float:
    """Any rotation, the object about as large as half of the image."""
    rng = np.random.default_rng(seed)
    z = 3.5 * model.diameter_m
    t = [*rng.uniform(-0.15 * model.diameter_m, 0.15 * model.diameter_m, 2), z]
    return transform(axis_angle(rng.normal(size=3), rng.uniform(0, np.pi)), t)


def bits(pool: tuple[Hypothesis, ...]) -> list[tuple[bytes, float, str]]:
    return [(h.T_cam_obj.tobytes(), h.confidence, h.source) for h in pool]
