"""Frames, built-in and real, with other models, poses or cameras, and what is said of their sizes."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.scenes.write_bop import write_bop
from verefine_viz.calibration import camera_check
from verefine_viz.calibration.camera_check import CameraVerdict, outline_fits
from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.geometry import transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Instance, Problem
from verefine_viz.core.settings import HypothesesSettings, SceneSettings
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.demo import demo_problem
from verefine_viz.scenes.source import open_scene

Objects = list[tuple[ObjectModel, Float, Mask]]
Depth = NDArray[np.floating]


class WithoutTruth(Toolbox):
    """A data set without ground truth, but for its initial poses."""

    def problem(self, frame: str, preparing: Callable[[], AbstractContextManager[object]] = nullcontext) -> Problem:
        problem = super().problem(frame, preparing)
        return replace(problem, instances=tuple(replace(i, T_cam_obj_gt=None) for i in problem.instances))


@cache
def scene(name: str = "clutter", frame: str = "0/0") -> Problem:
    """A built-in scene; "clutter" are six objects on a table, of which some hide others, seen by a noisy sensor."""
    return demo_problem(name, SceneSettings(), HypothesesSettings(), frame)


@cache
def real(ycbv: Path, frame: str, masks: str = "mask_visib") -> Problem:
    """A real frame."""
    settings = SceneSettings(source="bop", dataset=str(ycbv), frames=(frame,), masks=masks)
    return open_scene(settings, HypothesesSettings()).problem(frame)


def with_instances(problem: Problem, change: Callable[[Instance], Instance]) -> Problem:
    return replace(problem, instances=tuple(map(change, problem.instances)))


def with_truth(problem: Problem, change: Callable[[Float], Float]) -> Problem:
    """Other ground-truth poses."""
    return with_instances(
        problem, lambda i: i if i.T_cam_obj_gt is None else replace(i, T_cam_obj_gt=change(i.T_cam_obj_gt))
    )


def with_models(problem: Problem, factor: float) -> Problem:
    """Models of another size."""
    models = {
        obj_id: replace(m, vertices=m.vertices * factor, points=m.points * factor, diameter_m=m.diameter_m * factor)
        for obj_id, m in problem.models.items()
    }
    return replace(problem, models=models)


def with_camera(problem: Problem, camera: Camera) -> Problem:
    return replace(problem, observation=replace(problem.observation, camera=camera))


def moved(factor: float) -> Callable[[Float], Float]:
    """A pose whose translation is multiplied."""
    return lambda T: transform(T[:3, :3], factor * T[:3, 3])


def transposed(T: Float) -> Float:
    """The pose with its rotation written column by column."""
    return transform(T[:3, :3].T, T[:3, 3])


def objects(problem: Problem) -> Objects:
    return [(problem.models[i.obj_id], i.T_cam_obj_gt, i.mask) for i in problem.instances if i.T_cam_obj_gt is not None]


def verdict(of: Objects, camera: Camera, depth_m: Depth) -> CameraVerdict:
    together = np.any([mask for _, _, mask in of], axis=0)
    return camera_check.verdict(outline_fits(of, camera, depth_m.astype(np.float32), together))


def with_focal(camera: Camera, factor: float) -> Camera:
    return Camera(camera.K * np.array([[factor, 1, 1], [1, factor, 1], [1, 1, 1]]), camera.width, camera.height)


def of_problem(problem: Problem, focal: float = 1.0) -> CameraVerdict:
    observation = problem.observation
    return verdict(objects(problem), with_focal(observation.camera, focal), observation.depth_m)


def written(folder: Path, problems: Sequence[Problem], focal: float = 1.0, depth: float = 1.0) -> Path:
    """A BOP folder whose cam_K has another focal length, or whose depth another scale."""
    write_bop(folder, problems)
    path = folder / "test" / "000000" / "scene_camera.json"
    content = json.loads(path.read_text())
    for entry in content.values():
        entry["cam_K"][0] *= focal
        entry["cam_K"][4] *= focal
        entry["depth_scale"] *= depth
    path.write_text(json.dumps(content))
    return folder
