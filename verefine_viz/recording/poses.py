"""Where every object's meshes are over the iterations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np
import rerun as rr

from verefine_viz.core.arrays import Float
from verefine_viz.core.records import Iteration, PlacedPose
from verefine_viz.recording import chunks, columns, entities
from verefine_viz.recording.layout import Layout
from verefine_viz.recording.piece import Piece

NOWHERE = np.diag([1e-6, 1e-6, 1e-6, 1.0])
"""Too small to be seen: what has no valid transform at all would be reported as an error in the view."""

Moves = list[tuple[int, str, Float]]
"""Iteration, stage, pose."""


class Poses:
    """Follows the stages of all objects from iteration to iteration; knows what is shown, and sends what changes."""

    def __init__(self, layout: Layout) -> None:
        self._branches = {b.instance_id: b for b in layout.branches}
        self._stages = entities.DRAWN_STAGES + (entities.IN_SCENE if layout.is_scene else ())
        self._moves: dict[int, Moves] = {i: [] for i in self._branches}
        self._shown: dict[tuple[int, str], Float] = {}
        self._worked_on: int | None = None
        self._best: dict[int, Float] = {}
        self._placed: dict[int, Float] = {}

    def start(self) -> Iterator[Piece]:
        """Nothing is shown before the first iteration."""
        for branch in self._branches.values():
            yield _nothing(branch.name, self._stages)

    def add(self, iteration: Iteration) -> None:
        """Takes the next one."""
        k, own, before = iteration.index, iteration.instance_id, self._worked_on
        if before is not None and before != own:
            # Another object's turn: of this one only what it came to stays.
            for stage in entities.WORKED_ON:
                self._move(k, before, stage, NOWHERE)
        self._worked_on = own
        self._place(iteration)
        shown = {stage.name: stage.T_cam_obj for stage in iteration.stages}
        for stage in entities.WORKED_ON:
            self._move(k, own, stage, shown.get(stage, NOWHERE))
        self._move(k, own, "best", iteration.best.T_cam_obj)
        self._best[own] = iteration.best.T_cam_obj
        for pose in _incumbent(iteration):
            self._move(k, pose.instance_id, "incumbent", pose.T_cam_obj)

    def chunks(self) -> Iterator[Piece]:
        """What moved since the last call."""
        for instance_id, moves in self._moves.items():
            if moves:
                yield _transforms(self._branches[instance_id].name, moves)
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


@lru_cache(maxsize=64)
def _nothing(branch_name: str, stages: tuple[str, ...]) -> Piece:
    return _transforms(branch_name, [(0, stage, NOWHERE) for stage in stages])


def _transforms(branch_name: str, moves: Moves) -> Piece:
    indices, stages, Ts = zip(*moves, strict=True)
    parts = [
        *columns.transforms(np.concatenate(Ts).reshape(-1, 4, 4)),
        _children(branch_name, stages),
        _parents(len(moves)),
    ]
    return chunks.rows_of(f"{entities.OBJECTS}/{branch_name}/poses", indices, parts)


@lru_cache(maxsize=256)
def _children(branch_name: str, stages: tuple[str, ...]) -> columns.Column:
    """Frames that move, mostly the same ones in the same order."""
    frames = [entities.stage_frame(branch_name, stage) for stage in stages]
    return columns.text(rr.Transform3D.descriptor_child_frame(), frames)


@lru_cache(maxsize=256)
def _parents(n: int) -> columns.Column:
    return columns.text(rr.Transform3D.descriptor_parent_frame(), [f"tf#{entities.SCENE}"] * n)
