"""Numbers of the whole scene over the iterations: its score after each pass, its cost, each object's best score."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache

import rerun as rr
from rerun.chunk import Chunk

from verefine_viz.core.palette import OBJECT_COLORS, RGB
from verefine_viz.recording import columns
from verefine_viz.recording.curves import curve
from verefine_viz.recording.layout import Branch, Layout
from verefine_viz.recording.row import Row

_SCALARS = rr.Scalars.descriptor_scalars()
_LOOKS: dict[str, tuple[tuple[str, RGB], ...]] = {
    "scene": (
        ("poses of the pass", (110, 150, 255)),
        ("best pose of each object", (255, 179, 90)),
        ("best scene so far", (0, 170, 120)),
        ("reward", (150, 150, 150)),
    ),
    "cost": (("this scene [px]", (110, 150, 255)), ("best scene so far [px]", (0, 170, 120))),
}


@lru_cache(maxsize=64)
def scene_styles(branch_names: tuple[str, ...]) -> tuple[Chunk, ...]:
    """Names and colours of all curves of a scene."""
    made = [
        columns.fixed(
            curve(name, "all"), rr.SeriesLines(names=[n for n, _ in lines], colors=[c for _, c in lines], widths=2.0)
        )
        for name, lines in _LOOKS.items()
    ]
    for k, name in enumerate(branch_names):
        look = rr.SeriesLines(names=[name], colors=[OBJECT_COLORS[k % len(OBJECT_COLORS)]], widths=2.0)
        made.append(columns.fixed(curve("best", name), look))
    return tuple(made)


def start_best(layout: Layout) -> Iterator[Chunk]:
    """Every object's best first pose, before the first iteration."""
    for branch in layout.branches:
        if branch.n_arms:
            yield _best(branch, [0], [max(branch.initial_scores)])


def scene_curves(layout: Layout, rows: Sequence[Row]) -> Iterator[Chunk]:
    """The curves that go over all objects."""
    for branch in layout.branches:
        own = [r for r in rows if r.instance_id == branch.instance_id]
        if own:
            yield _best(branch, [r.index for r in own], [r.best_score[0] for r in own])
    passes = [(r.index, r.parts.scene) for r in rows if r.parts.scene is not None]
    if passes:
        values = [[s.score.score, s.best_known.score, s.incumbent_score, s.reward] for _, s in passes]
        yield columns.rows_of(curve("scene", "all"), [k for k, _ in passes], [columns.numbers(_SCALARS, values)])
    steps = [(r.index, r.parts.tree) for r in rows if r.parts.tree is not None]
    if steps:
        values = [[t.cost_px, t.incumbent_cost_px] for _, t in steps]
        yield columns.rows_of(curve("cost", "all"), [k for k, _ in steps], [columns.numbers(_SCALARS, values)])


def _best(branch: Branch, iterations: Sequence[int], scores: Sequence[float]) -> Chunk:
    return columns.rows_of(curve("best", branch.name), iterations, [columns.numbers(_SCALARS, [[s] for s in scores])])
