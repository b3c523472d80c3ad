"""The open frame, its picture, objects and settings, and what else can be opened: message ``frame``."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from verefine_viz.core.observation import Observation
from verefine_viz.core.presets import PRESETS
from verefine_viz.core.problem import LeftOut, Problem, Target
from verefine_viz.estimators.registry import ESTIMATORS
from verefine_viz.methods.known_methods import ALL_METHOD_NAMES, method_of
from verefine_viz.page.frame_messages import (
    Camera,
    Choices,
    FrameMessage,
    FrameObject,
    MethodChoice,
    OrderEdge,
    SolvingOrder,
    SupportPlane,
    TitledSession,
)
from verefine_viz.page.frame_objects import clusters_of, color_of, labels_of
from verefine_viz.page.sent_palette import hex_color
from verefine_viz.page.views.doubts import as_read, shown_doubts
from verefine_viz.page.views.editable_settings import editable_settings
from verefine_viz.page.views.rows import initial_poses
from verefine_viz.page.wire import pose_numbers
from verefine_viz.pictures.contours import contour_lines
from verefine_viz.pictures.support_patch import support_patch
from verefine_viz.refiners.registry import REFINERS

if TYPE_CHECKING:
    from verefine_viz.page.blobs import Blobs
    from verefine_viz.page.branch import Branch
    from verefine_viz.page.workspace import Workspace


def frame_message(
    space: Workspace, blobs: Blobs, batch_run: str, demos: Sequence[str], sessions: Sequence[TitledSession]
) -> FrameMessage:
    """Return the part of the open frame that does not depend on a run."""
    branch, problem = space.work.first, space.problem
    observation, session = problem.observation, branch.tools.session
    h, w = observation.camera.shape
    camera = observation.camera
    return FrameMessage(
        id=space.frame_id,
        title=session.title or problem.title,
        frame=space.frame,
        frames=space.frames,
        source=session.scene.source,
        dataset=session.scene.dataset or session.scene.demo,
        run=batch_run,
        preset=session.preset,
        method=session.method.name,
        method_label=method_of(session.method.name).label,
        refiner=session.method.refiner,
        tau_m=session.score.tau_m,
        colour_weight=session.score.colour_weight,
        camera=Camera(w, h, (camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0)),
        rgb=None if observation.rgb is None else blobs.put(png(observation.rgb), "image/png"),
        depth=blobs.put(np.ascontiguousarray(observation.depth_m, np.float32).tobytes()),
        smoothed=_smoothed(branch, blobs),
        objects=[*_objects(branch), *(_left_out(one) for one in problem.left_out)],
        support=_support(observation, blobs),
        order=order_of(problem),
        notes=problem.notes,
        doubts=shown_doubts(branch) if branch.data.is_done else [],
        as_read=as_read(branch),
        session_file=str(next(reversed(space.files))) if space.files else None,
        recording=str(branch.recording) if branch.recording else None,
        demos=demos,
        sessions=sessions,
        breakpoints=space.breakpoints,
        choices=Choices(
            methods=[MethodChoice(name, method_of(name).label, method_of(name).verifies) for name in ALL_METHOD_NAMES],
            refiners=list(REFINERS),
            presets=list(PRESETS),
            estimators=[*ESTIMATORS, "session"],
            settings=editable_settings(branch.settings),
        ),
    )


def _smoothed(branch: Branch, blobs: Blobs) -> str | None:
    """Return the key of the colour image as the score sees it; None where no model has colours."""
    problem = branch.run.problem
    rgb = problem.observation.rgb
    if rgb is None or not any(target.model.has_colors for target in problem.targets):
        return None
    return blobs.put(branch.evaluator_of(0).scored_colours(rgb).tobytes())


def _objects(branch: Branch) -> list[FrameObject]:
    """Return the objects in the order to solve them."""
    problem, labels = branch.run.problem, labels_of(branch.run.problem)
    ids = [i.instance_id for i in problem.instances]
    out = []
    for number, cluster in enumerate(clusters_of(branch), 1):
        for instance_id in cluster:
            color = hex_color(color_of(ids.index(instance_id)))
            out.append(_object(branch, problem.target(instance_id), labels[instance_id], color, number))
    return out


def _object(branch: Branch, target: Target, label: str, color: str, cluster: int) -> FrameObject:
    instance, model = target.instance, target.model
    rows, columns = np.nonzero(instance.mask)
    box = (int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1) if len(rows) else None
    T_gt = instance.T_cam_obj_gt
    return FrameObject(
        id=instance.instance_id,
        obj_id=instance.obj_id,
        label=label,
        color=color,
        cluster=cluster,
        diameter_mm=1e3 * model.diameter_m,
        symmetric=model.is_symmetric,
        has_gt=T_gt is not None,
        gt=None if T_gt is None else pose_numbers(T_gt),
        gt_score=None if T_gt is None else branch.evaluator_of(0).score(target, T_gt).score,
        visible=instance.visib_fract,
        box=box,
        mask=[[round(float(x), 1) for x in line.ravel()] for line in contour_lines(instance.mask)],
        arms=initial_poses(branch, target),
        recorded=len(instance.recorded),
        left_out="",
    )


def _left_out(one: LeftOut) -> FrameObject:
    return FrameObject(
        id=one.instance_id,
        obj_id=one.obj_id,
        label=one.name,
        color="#888888",
        cluster=0,
        diameter_mm=None,
        symmetric=False,
        has_gt=one.has_truth,
        gt=None,
        gt_score=None,
        visible=None,
        box=None,
        mask=[],
        arms=[],
        recorded=0,
        left_out=one.why,
    )


def _support(observation: Observation, blobs: Blobs) -> SupportPlane | None:
    support, patch = observation.support, support_patch(observation)
    if support is None or patch is None:
        return None
    corners = patch.outline_cam[patch.outline_cam[:, 2] > 0]
    return SupportPlane(
        source=support.gravity_source,
        inlier_share=support.inlier_share,
        rms_mm=1e3 * support.rms_m,
        tilt_deg=support.tilt_deg,
        unknown=[one.number for one in support.surroundings.unknown] if support.surroundings is not None else [],
        outline=[round(float(x), 1) for x in observation.camera.project(corners).ravel()],
        inliers=blobs.put(patch.inliers.astype(np.uint8).tobytes()),
    )


def order_of(problem: Problem) -> SolvingOrder | None:
    """Return the dependency graph: which object stands on which, and the order in which they are solved."""
    graph = problem.dependencies
    if graph is None:
        return None
    return SolvingOrder(
        clusters=graph.clusters,
        source=graph.source,
        notes=graph.notes,
        edges=[OrderEdge(e.kind, e.first, e.second, e.strength, e.evidence, e.state) for e in graph.edges],
    )


def png(rgb: np.ndarray) -> bytes:
    """Return a picture (H, W, 3) as a PNG file, compressed fast."""
    out = io.BytesIO()
    Image.fromarray(rgb).save(out, "png", compress_level=1)
    return out.getvalue()
