"""Where every object's meshes are over the iterations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr

from verefine_viz.core.arrays import Float
from verefine_viz.core.records import Iteration, PlacedPose
from verefine_viz.recording import entities
from verefine_viz.recording.layout import Layout
from verefine_viz.recording.recording_file import RecordingFile

NOWHERE = np.diag([1e-6, 1e-6, 1e-6, 1.0])
"""Too small to be seen: what has no valid transform at all would be reported as an error in the view."""

Moves = list[tuple[int, str, Float]]
"""Iteration, stage, pose."""


class Poses:
    """Follows the stages of all objects from iteration to iteration; knows what is shown, and sends what changes."""

    def __init__(self, layout: Layout) -> None:
        self._branches = {b.instance_id: b for b in layout.branches}
        self._worked_on_stages = layout.worked_on
        self._stages = (*layout.worked_on, "best", *(entities.IN_SCENE if layout.is_scene else ()))
        self._moves: dict[int, Moves] = {i: [] for i in self._branches}
        self._shown: dict[tuple[int, str], Float] = {}
        self._worked_on: int | None = None
        self._best: dict[int, Float] = {}
        self._placed: dict[int, Float] = {}

    def start(self, file: RecordingFile) -> None:
        """Nothing is shown before the first iteration."""
        for branch in self._branches.values():
            _send(file, branch.name, [(0, stage, NOWHERE) for stage in self._stages])

    def add(self, iteration: Iteration) -> None:
        """Takes the next one."""
        k, own, before = iteration.index, iteration.instance_id, self._worked_on
        if before is not None and before != own:
            # Another object's turn: only the best pose of this one stays.
            for stage in self._worked_on_stages:
                self._move(k, before, stage, NOWHERE)
        self._worked_on = own
        self._place(iteration)
        shown = {stage.name: stage.T_cam_obj for stage in iteration.stages}
        for stage in self._worked_on_stages:
            self._move(k, own, stage, shown.get(stage, NOWHERE))
        self._move(k, own, "best", iteration.best.T_cam_obj)
        self._best[own] = iteration.best.T_cam_obj
        for pose in _incumbent(iteration):
            self._move(k, pose.instance_id, "incumbent", pose.T_cam_obj)

    def send(self, file: RecordingFile) -> None:
        """What moved since the last call."""
        for instance_id, moves in self._moves.items():
            if moves:
                _send(file, self._branches[instance_id].name, moves)
                moves.clear()

    def _place(self, iteration: Iteration) -> None:
        """Objects that stand while this one is worked on; where one stands at its best, only that is drawn."""
        k, own, tree = iteration.index, iteration.instance_id, iteration.tree
        if not (self._placed or iteration.placed or tree):
            return
        standing = {p.instance_id: p.T_cam_obj for p in (*iteration.placed, *(tree.rollout if tree else ()))}
        standing.pop(own, None)
        for instance_id in self._placed.keys() | standing.keys():
            now = standing.get(instance_id, NOWHERE)
            self._move(k, instance_id, "placed", now)
            best = self._best.get(instance_id)
            if best is not None and instance_id != own:
                self._move(k, instance_id, "best", NOWHERE if np.array_equal(best, now) else best)
        self._placed = standing

    def _move(self, k: int, instance_id: int, stage: str, T: Float) -> None:
        """Shows it there from iteration ``k`` on, unless it is there already."""
        what = (instance_id, stage)
        was = self._shown.get(what, NOWHERE)
        if was is not T and was.tobytes() != T.tobytes():
            self._shown[what] = T
            self._moves[instance_id].append((k, stage, T))


def _incumbent(iteration: Iteration) -> Sequence[PlacedPose]:
    if iteration.scene is not None:
        return iteration.scene.incumbent
    return iteration.tree.incumbent if iteration.tree is not None else ()


def _send(file: RecordingFile, branch_name: str, moves: Moves) -> None:
    indices, stages, Ts = zip(*moves, strict=True)
    poses = np.concatenate(Ts).reshape(-1, 4, 4)
    columns = rr.Transform3D.columns(
        translation=poses[:, :3, 3],
        mat3x3=poses[:, :3, :3],
        child_frame=[entities.stage_frame(branch_name, stage) for stage in stages],
        parent_frame=[f"tf#{entities.SCENE}"] * len(moves),
    )
    file.send(entities.poses(branch_name), indices, columns)
