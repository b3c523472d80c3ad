"""Numbers of the whole scene over the iterations: its score after each pass, its cost, each object's best score."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np
import rerun as rr

from verefine_viz.core.arrays import Float
from verefine_viz.core.palette import OBJECT_COLORS, RGB
from verefine_viz.core.records import Iteration
from verefine_viz.recording import chunks, columns
from verefine_viz.recording.block import Block
from verefine_viz.recording.curves import curve
from verefine_viz.recording.layout import Branch, Layout
from verefine_viz.recording.piece import Piece

_SCALARS = rr.Scalars.descriptor_scalars()
_LOOKS: dict[str, tuple[tuple[str, RGB], ...]] = {
    "scene": (
        ("reward", (150, 150, 150)),
        ("poses of the pass", (110, 150, 255)),
        ("best pose of each object", (255, 179, 90)),
        ("best scene so far", (0, 170, 120)),
    ),
    "cost": (("this scene [px]", (110, 150, 255)), ("best scene so far [px]", (0, 170, 120))),
}


@lru_cache(maxsize=64)
def scene_styles(branch_names: tuple[str, ...]) -> tuple[Piece, ...]:
    """Names and colours of all curves of a scene."""
    made: list[Piece] = []
    for k, name in enumerate(branch_names):
        own = _lines([(name, OBJECT_COLORS[k % len(OBJECT_COLORS)])])
        made += [chunks.fixed(curve(group, name), own) for group in ("best", "add_s")]
        # Clusters have curves of their own, called after their first object.
        for group, lines in _LOOKS.items():
            made.append(chunks.fixed(curve(group, name), _lines(lines)))
    return tuple(made)


def start_best(layout: Layout) -> Iterator[Piece]:
    """Every object's best first pose, before the first iteration."""
    for branch in layout.branches:
        if branch.n_arms:
            yield _one("best", branch, [0], np.array([[max(branch.initial_scores)]]))


def scene_curves(layout: Layout, block: Block) -> Iterator[Piece]:
    """The curves that go over all objects."""
    for branch in layout.branches:
        own = block.own(branch.instance_id)
        if own:
            indices = [block.indices[k] for k in own]
            yield _one("best", branch, indices, block.best_scores[own, None])
            if branch.has_truth:
                yield _one("add_s", branch, indices, block.errors[own, 2:])
    yield from _per_cluster("scene", layout, block.iterations)
    yield from _per_cluster("cost", layout, block.iterations)


def _per_cluster(group: str, layout: Layout, iterations: Sequence[Iteration]) -> Iterator[Piece]:
    found: dict[str, tuple[list[int], list[list[float]]]] = {}
    names = {b.instance_id: b.name for b in layout.branches}
    for iteration in iterations:
        scene, tree = iteration.scene, iteration.tree
        if group == "scene" and scene is not None:
            values = [scene.reward, scene.score.score, scene.best_known.score, scene.incumbent_score]
            poses = scene.poses
        elif group == "cost" and tree is not None:
            values, poses = [tree.cost_px, tree.incumbent_cost_px], tree.incumbent
        else:
            continue
        first = min((p.instance_id for p in poses), default=iteration.instance_id)
        indices, numbers = found.setdefault(names[first], ([], []))
        indices.append(iteration.index)
        numbers.append(values)
    for name, (indices, numbers) in found.items():
        yield chunks.rows_of(curve(group, name), indices, [columns.numbers(_SCALARS, numbers)])


def _lines(lines: Sequence[tuple[str, RGB]]) -> rr.SeriesLines:
    names, colors = [n for n, _ in lines], [c for _, c in lines]
    # What was reached holds until something else is.
    return rr.SeriesLines(names=names, colors=colors, widths=[2.0] * len(lines), interpolation_mode="StepAfter")


def _one(group: str, branch: Branch, indices: Sequence[int], values: Float) -> Piece:
    return chunks.rows_of(curve(group, branch.name), indices, [columns.numbers(_SCALARS, values)])
