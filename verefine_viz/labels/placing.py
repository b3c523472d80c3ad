"""Places objects in a frame that has none: the pose for a click, and the target for a pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import apply, axis_angle, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Instance, Placed, Target
from verefine_viz.core.settings import SceneSettings
from verefine_viz.observation.observed_frame import segment_cloud
from verefine_viz.scenes.own_pixels import fit_reach_m, own_pixels


def target_at(
    observation: Observation,
    model: ObjectModel,
    instance_id: int,
    T_cam_obj: Float,
    others: Sequence[Placed],
    scene: SceneSettings,
    within_m: float | None = None,
) -> Target:
    """An object whose mask is what depth shows of it at a pose.

    Args:
        observation: the frame.
        model: of the object.
        instance_id: number of the object in its frame.
        T_cam_obj: (4, 4) its assumed pose [m].
        others: objects around it.
        scene: how many points of it the refiner sees, and the seed.
        within_m: how far off the pose may be [m]; None = it fits.
    """
    mask = own_pixels(observation, model, T_cam_obj, others, fit_reach_m(model) if within_m is None else within_m)
    return target_of(observation, model, instance_id, mask, scene)


def target_of(
    observation: Observation, model: ObjectModel, instance_id: int, mask: Mask, scene: SceneSettings
) -> Target:
    """An object whose mask (H, W) is known."""
    cloud = segment_cloud(observation.depth_m, observation.camera, mask, scene.cloud_points, scene.seed)
    return Target(observation, Instance(instance_id, model.obj_id, mask, cloud, ()), model)


def up_of(observation: Observation) -> Float:
    """(3,) the up direction in the camera frame; towards the image's upper edge where no support is known."""
    support = observation.support
    return np.array([0.0, -1.0, 0.0]) if support is None else np.array(support.T_world_cam[2, :3])


def placed_by_click(observation: Observation, model: ObjectModel, u: float, v: float, turn_deg: float = 0.0) -> Float:
    """The pose (4, 4) that a click gives an object: z of the model upright, its surface at the depth that was clicked.

    Args:
        observation: the frame.
        model: of the object.
        u: column [px].
        v: row [px].
        turn_deg: about the vertical.

    Raises:
        InputError: nothing was measured within 10 px of the pixel.
    """
    camera = observation.camera
    z_m = _depth_near(observation, u, v)
    seen = np.array([(u - camera.cx) / camera.fx * z_m, (v - camera.cy) / camera.fy * z_m, z_m])
    up = up_of(observation)
    towards = seen - (seen @ up) * up
    y = towards / max(float(np.linalg.norm(towards)), 1e-9)
    R = np.column_stack([np.cross(y, up), y, up]) @ axis_angle(np.array([0.0, 0.0, 1.0]), np.radians(turn_deg))
    low, high = model.vertices.min(axis=0), model.vertices.max(axis=0)
    ray = seen / np.linalg.norm(seen)
    # What is clicked is the front: the middle lies behind it by half of the model's narrowest side.
    middle = seen + ray * float((high - low).min()) / 2
    if observation.support is not None:
        heights = apply(observation.support.T_world_cam, middle[None])[0]
        lowest = (high - low)[2] / 2
        if abs(heights[2] - lowest) < lowest:  # Near enough to stand on the support.
            middle = middle + (lowest - heights[2]) * up
    return transform(R, middle - R @ model.middle_m)


NEAR_PX = 10


def _depth_near(observation: Observation, u: float, v: float) -> float:
    """Median depth next to a pixel [m]."""
    height, width = observation.camera.shape
    if not (0 <= u < width and 0 <= v < height):
        raise InputError(f"({u:.0f}, {v:.0f}) is outside of the image of {width}×{height} pixels")
    for reach in (2, NEAR_PX):
        rows, columns = (slice(max(int(x) - reach, 0), int(x) + reach + 1) for x in (v, u))
        there = observation.depth_m[rows, columns]
        if (there > 0).any():
            return float(np.median(there[there > 0]))
    raise InputError(f"no depth was measured within {NEAR_PX} px of ({u:.0f}, {v:.0f}); click where there is some")
