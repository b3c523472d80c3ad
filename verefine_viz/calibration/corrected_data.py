"""Corrects the data of a frame as settings say: depth, camera, models, initial poses and masks."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.camera import Camera
from verefine_viz.core.data_remedies import (
    AS_READ,
    MADE_FROM_TRUTH,
    corrected_camera,
    corrected_depth,
    corrected_pose,
)
from verefine_viz.core.geometry import transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Instance, Problem
from verefine_viz.core.settings import DataSettings, SceneSettings
from verefine_viz.observation.observed_frame import observe, segment_cloud


def corrected(problem: Problem, data: DataSettings, scene: SceneSettings) -> Problem:
    """The frame corrected as ``data`` says, with normals, support plane and clouds of the new images.

    Args:
        problem: the frame as its source reads it.
        data: what is to be put right; the ground truth stays as it is.
        scene: where gravity comes from, and how clouds are drawn.

    Raises:
        ShapeError: no camera has such a matrix.
    """
    if data == AS_READ:
        return problem
    seen = problem.observation
    camera = corrected_camera(seen.camera, data)
    depth_m = corrected_depth(seen.depth_m, camera, data)
    times = dict(data.model_times)
    models = {obj_id: scaled(model, times.get(obj_id, 1.0)) for obj_id, model in problem.models.items()}
    instances = tuple(_corrected(i, depth_m, camera, data, scene) for i in problem.instances)
    # Of objects that are not to be solved, only the union of all masks is known.
    others = seen.object_mask & ~np.any([i.mask for i in problem.instances], axis=0)
    masks = [others, *(i.mask for i in instances)]
    scene, R_world_cam = _gravity(seen, scene)
    observation = observe(camera, depth_m, seen.rgb, masks, scene, R_world_cam, seen.T_map_cam)
    return replace(problem, observation=observation, models=models, instances=instances)


@lru_cache(maxsize=64)
def scaled(model: ObjectModel, times: float) -> ObjectModel:
    """A model enlarged by a factor; the same Python object for all frames."""
    if times == 1:
        return model
    symmetries = [transform(T[:3, :3], times * T[:3, 3]) for T in model.symmetries]
    return replace(
        model,
        vertices=times * model.vertices,
        points=times * model.points,
        diameter_m=times * model.diameter_m,
        symmetries=np.array(symmetries),
    )


def _corrected(
    i: Instance, depth_m: NDArray[np.float32], camera: Camera, data: DataSettings, scene: SceneSettings
) -> Instance:
    mask = ~i.mask if i.obj_id in data.inverted_masks else i.mask
    hypotheses = tuple(
        h if h.source.startswith(MADE_FROM_TRUTH) else replace(h, T_cam_obj=corrected_pose(h.T_cam_obj, data))
        for h in i.hypotheses
    )
    steps = tuple(replace(step, T_cam_obj=corrected_pose(step.T_cam_obj, data)) for step in i.recorded)
    cloud = segment_cloud(depth_m, camera, mask, scene.cloud_points, scene.seed)
    return replace(i, mask=mask, points_cam=cloud, hypotheses=hypotheses, recorded=steps)


def _gravity(seen: Observation, scene: SceneSettings) -> tuple[SceneSettings, Float | None]:
    """Settings and R_world_cam (3, 3), or None, that give the new frame its gravity.

    It is the old frame's where a data set or a sensor states it, else that of the new support plane.
    """
    support = seen.support
    if support is None or support.gravity_source == "plane":
        return scene, None if seen.T_map_cam is None else seen.T_map_cam[:3, :3]
    if support.gravity_source == "world":
        return scene, support.T_world_cam[:3, :3]
    x, y, z = (-support.T_world_cam[2, :3]).tolist()
    return structs.replace(scene, gravity=(x, y, z)), None
