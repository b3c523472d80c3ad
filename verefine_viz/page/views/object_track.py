"""An object over the frames of a sequence: how its pose changes, scores, what is undetermined: the want ``track``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from msgspec.structs import replace

from verefine_viz.batch.motion_table import MOTION, read_tracks
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.problem import Target
from verefine_viz.evaluation.pose_motion import (
    FLIP_DEG,
    JUMP_DEG,
    JUMP_MM,
    NEAR_DEG,
    Motion,
    PosedFrame,
    counted,
    motions,
)
from verefine_viz.page import protocol as p
from verefine_viz.page.answers_to_wants import TrackAnswer, TrackFrame
from verefine_viz.page.blobs import Blobs

if TYPE_CHECKING:
    from verefine_viz.page.workspace import Workspace


def track(space: Workspace, want: p.TrackWanted, blobs: Blobs) -> TrackAnswer:
    """Return the frames of the open frame's scene; none where they are no sequence.

    From motion.csv of the batch that is open, else from what another program recorded, else from the frames that were
    solved here.
    """
    targets = {t.instance.instance_id: t for t in space.problem.targets}
    if want.obj not in targets:
        raise InputError(unknown("object", want.obj, [*targets]))
    target = targets[want.obj]
    rows = _batch_rows(space.batch, target, space.frame) or _recorded(space, target) or _solved(space, target)
    if len(rows) < 2:
        return TrackAnswer([], "", JUMP_MM, JUMP_DEG, "camera", {})
    return TrackAnswer(
        frames=[row for _, row in rows],
        words=counted([motion for motion, _ in rows]).text,
        jump_mm=JUMP_MM,
        jump_deg=JUMP_DEG,
        reference="world" if all(motion.reference == "world" for motion, _ in rows) else "camera",
        legend={
            "flip": f"turned by more than {FLIP_DEG:.0f}° to where its shape nearly looks the same "
            f"(within {NEAR_DEG:.0f}°): depth hardly tells the two apart",
            "jump": f"turned by more than {JUMP_DEG:.0f}° or moved by more than {JUMP_MM:.0f} mm, and no symmetry "
            "of its shape explains it",
            "moved": "less than that",
            "no pose": "not solved in this frame",
        },
    )


Rows = list[tuple[Motion, TrackFrame]]


def _frame(motion: Motion) -> TrackFrame:
    return TrackFrame(
        motion.frame, motion.kind, motion.moved_mm, motion.turned_deg, motion.lifted_mm, motion.tilted_deg
    )


def _batch_rows(batch: Path | None, target: Target, frame: str) -> Rows:
    """Return the track that holds the object in the open frame, from a batch's table."""
    if batch is None:
        return []
    try:
        tracks = read_tracks(batch) if (batch / MOTION).is_file() else ()
    except (OSError, InputError):  # It is being written.
        return []
    own = (target.instance.obj_id, target.instance.instance_id)
    for one in tracks:
        if any(row.frame == frame and (row.obj_id, row.instance_id) == own for row in one.rows):
            names = ("score", "recorded_score", "undetermined_mm", "undetermined_deg", "missing_depth")
            return [
                (row.motion, replace(_frame(row.motion), **{name: getattr(row, name) for name in names}))
                for row in one.rows
            ]
    return []


def _recorded(space: Workspace, target: Target) -> Rows:
    """Return the poses that another program recorded, with our scores of the frames that were solved here."""
    recorded = space.recorded_track(target.instance.obj_id)
    if len(recorded) < 2:
        return []
    scores = space.final_scores(target.instance.obj_id)
    changes = _motions(space, target, [PosedFrame(one.frame, one.T_cam_obj) for one in recorded])
    return [
        (motion, replace(_frame(motion), score=scores.get(motion.frame), recorded_score=one.score))
        for motion, one in zip(changes, recorded, strict=True)
    ]


def _solved(space: Workspace, target: Target) -> Rows:
    """Return the answers of the frames that were solved here, in the order of the session's frames."""
    if len(space.frames) < 2:
        return []
    solved = space.solved(target.instance.obj_id)
    if len(solved) < 2:
        return []
    scene = space.frame.partition("/")[0]
    poses = []
    for frame in space.frames:
        if frame in solved and frame.partition("/")[0] == scene:
            of_frame, best = solved[frame]
            observation = of_frame.observation
            T_table_cam = None if observation.support is None else observation.support.T_world_cam
            poses.append(PosedFrame(frame, best.T_cam_obj, observation.T_map_cam, T_table_cam))
    changes = _motions(space, target, poses)
    rows: Rows = []
    evaluator = space.work.first.final_evaluator
    for motion in changes:
        of_frame, best = solved[motion.frame]
        T_gt = of_frame.instance.T_cam_obj_gt
        err = None if T_gt is None else evaluator.add_s_mm(of_frame.model, best.T_cam_obj, T_gt)
        rows.append((motion, replace(_frame(motion), score=best.score.score, err=err)))
    return rows


def _motions(space: Workspace, target: Target, poses: list[PosedFrame]) -> tuple[Motion, ...]:
    turns = space.work.first.final_evaluator.flips(target.model)
    return motions(poses, target.model.middle_m, turns, target.model.symmetries)
