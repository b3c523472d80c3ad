"""Grasps of a finished run's answers on a timeline of their own: one object after another, by the answer on one side
and by the ground truth on the other, with gripper, objects and contacts, and how each ends in words.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply, transform
from verefine_viz.core.palette import GRASP_COLORS, OBJECT_COLORS
from verefine_viz.core.problem import Problem
from verefine_viz.grasping.gripper import Box, finger, fork, palm
from verefine_viz.recording import entities
from verefine_viz.recording.background import DRAWN_FACES_IN_SCENE, drawn_mesh
from verefine_viz.recording.layout import Layout, world_from_camera
from verefine_viz.recording.recording_file import RecordingFile

if TYPE_CHECKING:  # Bullet and open3d are for what carries grasps out.
    from verefine_viz.grasping.grasp_answer import AnswerGrasps, GraspAttempt, GraspPair
    from verefine_viz.grasping.grasp_trial import GraspPath

SIDES = {"answer": "By the answer", "ground_truth": "By the ground truth"}
"""Name of the entity, title of the view."""
PAUSE = 20
"""Moments between two grasps."""
GRIPPER_COLOR = (205, 210, 218, 255)
CONTACT_COLOR = (255, 40, 40)
LINE_M = {"blocked": 0.0004, "free": 0.0008, "chosen": 0.0018}
DARK = (24, 26, 30)


def log_grasps(file: RecordingFile, problem: Problem, layout: Layout, grasps: AnswerGrasps, opening_m: float) -> None:
    """All grasps of a frame, in the order of its objects.

    Args:
        file: where to.
        problem: the frame.
        layout: its layout.
        grasps: of its answers.
        opening_m: distance of the open fingers [m].
    """
    T_world_cam = world_from_camera(problem.observation)
    for side in SIDES:
        _log_meshes(file, problem, layout, entities.grasp_side(side))
    start, table = 0, ["| object | grasps free | by the answer | by the ground truth |", "|---|---|---|---|"]
    for target in problem.targets:
        instance_id, T_gt = target.instance.instance_id, target.instance.T_cam_obj_gt
        pair = grasps.pairs.get(instance_id)
        if pair is None or T_gt is None:
            continue
        name = layout.branch(instance_id).name
        for side, attempt in _sides(pair):
            origin = entities.grasp_side(side)
            n_free, n = int(attempt.is_free.sum()), len(attempt.is_free)
            words = f"**{name}: {attempt.verdict}** ({n_free} of {n} {attempt.grasps.source} grasps free)"
            file.log_at(
                entities.GRASP_TIMELINE,
                start,
                f"{origin}/end",
                rr.TextDocument(words, media_type=rr.MediaType.MARKDOWN),
            )
            _log_choice(file, origin, attempt, T_world_cam @ attempt.T_cam_obj, opening_m, start)
            if attempt.path is not None:
                _log_path(file, layout, origin, attempt.path, start)
        if pair.answer.path is not None:
            _log_stages(file, name, pair.answer.path, start)
        ends = pair.answer.verdict, pair.ground_truth.verdict
        table.append(f"| {name} | {int(pair.answer.is_free.sum())} | {ends[0]} | {ends[1]} |")
        n_moments = max([1, *(a.path.n_moments for _, a in _sides(pair) if a.path is not None)])
        start += n_moments + PAUSE
    file.log(entities.GRASP_ENDS, rr.TextDocument("\n".join(table), media_type=rr.MediaType.MARKDOWN))


def _sides(pair: GraspPair) -> tuple[tuple[str, GraspAttempt], ...]:
    return ("answer", pair.answer), ("ground_truth", pair.ground_truth)


def _log_meshes(file: RecordingFile, problem: Problem, layout: Layout, origin: str) -> None:
    """From the first moment on, not before: without a place they would all stand in the middle of other timelines."""
    for k, target in enumerate(problem.targets):
        name = layout.branch(target.instance.instance_id).name
        mesh = drawn_mesh(target.model, DRAWN_FACES_IN_SCENE, OBJECT_COLORS[k % len(OBJECT_COLORS)], 255)
        file.log_at(entities.GRASP_TIMELINE, 0, f"{origin}/objects/{name}", mesh)
    for part, box in (("palm", palm()), ("left", finger(0.0, -1)), ("right", finger(0.0, 1))):
        file.log_at(entities.GRASP_TIMELINE, 0, f"{origin}/gripper/{part}", _box_mesh(box))


def _box_mesh(box: Box) -> rr.Mesh3D:
    corners = box.corners[box.faces].reshape(-1, 3)
    sides = corners.reshape(-1, 3, 3)
    normals = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return rr.Mesh3D(
        vertex_positions=corners.astype(np.float32),
        vertex_normals=np.repeat(normals, 3, axis=0).astype(np.float32),
        albedo_factor=GRIPPER_COLOR,
    )


def _log_choice(
    file: RecordingFile, origin: str, attempt: GraspAttempt, T_world_obj: Float, opening_m: float, start: int
) -> None:
    """The grasps to choose from, until the gripper closes."""
    lines, colors, radii = [], [], []
    for kind, indices in attempt.kinds.items():
        for T in T_world_obj @ attempt.grasps.T_obj_gripper[indices]:
            lines += list(apply(T, fork(opening_m).reshape(-1, 3)).reshape(-1, 2, 3))
            colors += [GRASP_COLORS[kind]] * len(fork(opening_m))
            radii += [LINE_M[kind]] * len(fork(opening_m))
    file.log_at(entities.GRASP_TIMELINE, start, f"{origin}/grasps", rr.LineStrips3D(lines, colors=colors, radii=radii))
    stages = () if attempt.path is None else attempt.path.stages
    if "close" in stages:
        closes = start + stages.index("close")
        file.log_at(entities.GRASP_TIMELINE, closes, f"{origin}/grasps", rr.LineStrips3D([]))


def _log_path(file: RecordingFile, layout: Layout, origin: str, path: GraspPath, start: int) -> None:
    moments = range(start, start + path.n_moments)
    for instance_id, Ts in path.Ts_world_obj.items():
        _send_poses(file, f"{origin}/objects/{layout.branch(instance_id).name}", moments, Ts)
    _send_poses(file, f"{origin}/gripper/palm", moments, path.Ts_world_gripper)
    for side, name in ((-1, "left"), (1, "right")):
        apart = np.array([transform(np.eye(3), [0.0, side * gap_m / 2, 0.0]) for gap_m in path.gaps_m])
        _send_poses(file, f"{origin}/gripper/{name}", moments, path.Ts_world_gripper @ apart)
    for moment, contacts in zip(moments, path.contacts, strict=True):
        points = rr.Points3D([contact.point_world for contact in contacts], colors=CONTACT_COLOR, radii=0.003)
        file.log_at(entities.GRASP_TIMELINE, moment, f"{origin}/contacts", points)


def _log_stages(file: RecordingFile, name: str, path: GraspPath, start: int) -> None:
    """When each stage begins, for all that move in step: a collision ends a grasp early."""
    firsts = [0, *(k for k, (before, now) in enumerate(pairwise(path.stages), start=1) if now != before)]
    for k in firsts:
        words = rr.TextLog(f"{name}: {path.stages[k]}")
        file.log_at(entities.GRASP_TIMELINE, start + k, f"{entities.GRASP}/stage", words)


def _send_poses(file: RecordingFile, entity: str, moments: Sequence[int], Ts: Float) -> None:
    columns = rr.Transform3D.columns(translation=Ts[:, :3, 3], mat3x3=Ts[:, :3, :3])
    file.send(entity, moments, columns, timeline=entities.GRASP_TIMELINE)


def grasp_tab(layout: Layout) -> rrb.Container:
    """A tab of the whole window: both sides, above them how each ends; below, all in a table."""
    eye = rrb.EyeControls3D(position=layout.eye_world, look_target=layout.center_world, eye_up=(0.0, 0.0, 1.0))
    sides = [
        rrb.Vertical(
            rrb.TextDocumentView(origin=f"{entities.grasp_side(side)}/end", name=title),
            rrb.Spatial3DView(
                origin="/",
                contents=[f"+ {entities.grasp_side(side)}/**", f"+ {entities.SUPPORT}/**"],
                name=title,
                background=DARK,
                eye_controls=eye,
            ),
            row_shares=[1, 7],
        )
        for side, title in SIDES.items()
    ]
    columns = rrb.archetypes.TextLogColumns(text_log_columns=["Body"])
    stages = rrb.TextLogView(origin=f"{entities.GRASP}/stage", name="Stages by the answer", columns=columns)
    ends = rrb.TextDocumentView(origin=entities.GRASP_ENDS, name="How grasps end")
    below = rrb.Horizontal(ends, stages, column_shares=[3, 2])
    return rrb.Vertical(rrb.Horizontal(*sides), below, row_shares=[3, 1], name="Grasps (timeline: grasp)")
