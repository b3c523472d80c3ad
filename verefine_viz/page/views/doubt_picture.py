"""What shows a doubt about the data in the image: answer to the want ``doubt``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.data_remedies import AS_READ, MADE_FROM_TRUTH, corrected_camera, corrected_depth, corrected_pose
from verefine_viz.core.doubt import Doubt, DoubtKind
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import transform
from verefine_viz.core.problem import Problem, Target
from verefine_viz.core.settings import DataSettings
from verefine_viz.page.answers_to_wants import DoubtAnswer, DoubtRole, DoubtShape
from verefine_viz.page.views.pose_outlines import OutlineOf
from verefine_viz.pictures.contours import contour_lines

if TYPE_CHECKING:
    from verefine_viz.page.blobs import Blobs
    from verefine_viz.page.protocol import DoubtWanted
    from verefine_viz.page.workspace import Workspace

EdgesOf = Callable[[NDArray[np.float32]], Float]
"""How much depth (h, w) [m] jumps at each pixel, 0 to 1: ``calibration/edges.py``."""
EDGE_ROWS = 480
"""Rows of the image in which edges of depth are drawn."""
SHORTEST = 12
"""Fewer points of an edge's outline are noise."""


def doubt(space: Workspace, want: DoubtWanted, _blobs: Blobs, outline_of: OutlineOf, edges_of: EdgesOf) -> DoubtAnswer:
    """The answer to a want of what shows a doubt.

    Raises:
        InputError: there is no such doubt (any more).
    """
    branch = space.branch(want.branch)
    doubts = branch.doubts()
    if want.index >= len(doubts):
        raise InputError("this doubt about the data is there no more")
    one, problem = doubts[want.index], branch.run.problem
    targets = [target for target in problem.targets if one.concerns(target.instance.instance_id)]
    shapes = [*_masks(targets)]
    if one.picture == "edges":
        shapes += _edges(one, problem, edges_of)
    if one.picture == "poses" or one.kind == DoubtKind.MASK:
        shapes += [shape for target in targets for shape in _models(one, target, outline_of)]
    return DoubtAnswer(shapes)


def _masks(targets: list[Target]) -> Iterator[DoubtShape]:
    for target in targets:
        lines = contour_lines(target.instance.mask)
        yield DoubtShape("mask", "masks", target.instance.instance_id, [_polygon(line) for line in lines])


def _edges(one: Doubt, problem: Problem, edges_of: EdgesOf) -> Iterator[DoubtShape]:
    """Edges of depth as they are, and where they would be."""
    seen = problem.observation
    ways: list[tuple[DoubtRole, str, NDArray[np.float32]]] = [("edges", "edges of depth", seen.depth_m)]
    if one.kind == DoubtKind.DEPTH_SHIFT and one.remedy is not None:
        ways.append(("fits", "put right", corrected_depth(seen.depth_m, seen.camera, one.remedy)))
    step = max(1, seen.camera.height // EDGE_ROWS)
    for role, label, depth_m in ways:
        lines = contour_lines(edges_of(depth_m[::step, ::step]) > 0.5)
        polygons = [_polygon(step * line) for line in lines if len(line) >= SHORTEST]
        yield DoubtShape(role, label, None, polygons)


def _models(one: Doubt, target: Target, outline_of: OutlineOf) -> Iterator[DoubtShape]:
    """A model in its pose as the data have it, and as they would fit."""
    T, camera, own = _pose_of(one, target), target.observation.camera, target.instance.instance_id
    if T is None:
        return
    remedy = one.remedy or AS_READ
    if one.kind == DoubtKind.DEPTH_SCALE:
        # Poses stay where they are: the model is drawn as far away as depth has it, in both units.
        measured = target.observation.depth_m[target.instance.mask & (target.observation.depth_m > 0)]
        away = float(np.median(measured)) / T[2, 3] if len(measured) and T[2, 3] > 0 else 1.0
        given, fits = _farther(T, away), _farther(T, away * remedy.depth_times)
    else:
        given, fits = T, _with_model(corrected_pose(T, remedy), target, remedy)
    is_moved = remedy not in (AS_READ, DataSettings(inverted_masks=remedy.inverted_masks))
    label = "models as the data are" if is_moved else "models in their poses"
    yield DoubtShape("given", label, own, outline_of(target.model, given, camera))
    if is_moved:
        polygons = outline_of(target.model, fits, corrected_camera(camera, remedy))
        yield DoubtShape("fits", "put right", own, polygons)


def _pose_of(one: Doubt, target: Target) -> Float | None:
    """The pose that a doubt is about: the true one, unless it is about initial poses alone."""
    instance, remedy = target.instance, one.remedy or AS_READ
    is_of_poses = remedy.pose_times != 1 or remedy.poses != "given"
    if instance.T_cam_obj_gt is not None and not is_of_poses:
        return instance.T_cam_obj_gt
    given = (h.T_cam_obj for h in instance.hypotheses if not is_of_poses or not h.source.startswith(MADE_FROM_TRUTH))
    return next(given, None)


def _farther(T_cam_obj: Float, times: float) -> Float:
    return transform(T_cam_obj[:3, :3], times * T_cam_obj[:3, 3])


def _with_model(T_cam_obj: Float, target: Target, data: DataSettings) -> Float:
    """The pose from which a model looks as large as one so many times its size at the pose given."""
    times = dict(data.model_times).get(target.model.obj_id, 1.0)
    return _farther(T_cam_obj, 1 / times)


def _polygon(line: Float) -> list[float]:
    return np.round(line, 1).ravel().tolist()
