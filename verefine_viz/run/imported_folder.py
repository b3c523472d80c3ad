"""Writes what another program recorded as a folder of ``keep_frame``: a data set in BOP layout with a session."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from verefine_viz.core.errors import InputError
from verefine_viz.core.files import first_line
from verefine_viz.core.problem import Problem, Target
from verefine_viz.run.capture import FARTHEST_M
from verefine_viz.run.capture_folder import CapturedFrame, CapturedObject, CaptureFolder
from verefine_viz.run.data_folder import data_at, looked_for
from verefine_viz.scenes.meshes import Mesh
from verefine_viz.scenes.source import open_scene


def imported(folder: Path, out: Path) -> Iterator[str]:
    """Writes the frames of traces, or of a sequence, one after the other; gives a line about each.

    Args:
        folder: what is read.
        out: a new folder, or one that was written so before, to which frames are added.

    Raises:
        InputError: ``folder`` holds nothing that was recorded, or ``out`` something else.
    """
    known = data_at(folder, {})
    if known is None:
        raise InputError(f"{folder} holds nothing that can be imported; looked for {looked_for()}")
    if known.session.scene.source != "folder":
        raise InputError(f"{folder} holds {known.what}, which need no import: verefine-viz view {folder}")
    source = open_scene(known.session.scene, known.session.hypotheses)
    capture = CaptureFolder(out, source.is_sequence)
    yield f"{folder}: {known.what}"
    for frame in source.frames:
        try:
            problem = source.problem(frame)
            yield f"{frame} → {capture.add(_captured(problem))}"
        except Exception as error:  # The others are imported all the same.
            yield f"{frame} failed: {first_line(error)}"


def _captured(problem: Problem) -> CapturedFrame:
    has_gt = all(target.instance.T_cam_obj_gt is not None for target in problem.targets)
    observation = problem.observation
    support = observation.support
    is_given = support is not None and support.gravity_source == "given"
    down = -support.T_world_cam[2, :3] if support is not None and is_given else None
    objects = [_captured_object(target, has_gt) for target in problem.targets]
    place = {target.instance.instance_id: k for k, target in enumerate(problem.targets)}
    order = [[place[i] for i in cluster] for cluster in problem.order]
    depth_m = np.where(observation.depth_m > FARTHEST_M, 0.0, observation.depth_m.astype(np.float64))
    return CapturedFrame(observation.camera.K, depth_m, observation.rgb, objects, down, order)


def _captured_object(target: Target, has_gt: bool) -> CapturedObject:
    """With its initial poses, and the last one recorded, which the other program answered with."""
    model, instance = target.model, target.instance
    mesh = Mesh(model.vertices, model.faces, model.vertex_colors, (), model.texture)
    poses = {"recorded": [h.T_cam_obj for h in instance.hypotheses]}
    if instance.recorded and not np.array_equal(instance.recorded[-1].T_cam_obj, poses["recorded"][0]):
        poses["recorded_answer"] = [instance.recorded[-1].T_cam_obj]
    T_gt = instance.T_cam_obj_gt if has_gt else None
    return CapturedObject(model.name, mesh, instance.mask, {k: p for k, p in poses.items() if p}, T_gt, None)
