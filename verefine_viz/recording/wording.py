"""An iteration in words, as markdown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache

from verefine_viz.core.records import PlacedPose, SceneRecord, TreeStep
from verefine_viz.recording.layout import Layout
from verefine_viz.recording.row import Row


def describe(row: Row, layout: Layout, moved_mm: Sequence[float], turned_deg: Sequence[float]) -> str:
    """What happened in this iteration and why, for the text panel.

    Args:
        row: the iteration.
        layout: what its numbers mean.
        moved_mm: how far each stage is from the first.
        turned_deg: the same as an angle.
    """
    branch = layout.branch(row.instance_id)
    source = plain(branch.sources[row.arm]) if row.arm < branch.n_arms else ""
    in_pass = "" if row.parts.scene_pass is None else f", pass {row.parts.scene_pass}"
    lines = [
        f"## Iteration {row.index}: {branch.name}{in_pass}",
        f"**Hypothesis {row.arm + 1} of {branch.n_arms}** ({source}), its iteration {row.arm_iteration}.",
    ]
    if row.reason:
        lines.append(f"Why this one: {plain(row.reason)}")
    lines.append(_stages(row, moved_mm, turned_deg))
    score, *_ = row.best_score.tolist()
    where = f"iteration {row.best_iteration}" if row.best_iteration else "the start"
    lines.append(f"Best so far: {score:.3f}, hypothesis {row.best_arm + 1}, {row.best_stage}, {where}.")
    if branch.has_truth:
        rotation_deg, translation_mm, add_mm = row.errors.tolist()
        lines.append(
            f"Against ground truth: kept pose {rotation_deg:.1f}° and {translation_mm:.1f} mm off;"
            f" best pose ADD(-S) {add_mm:.1f} mm."
        )
    lines += _scene(row, layout)
    if row.event_texts:
        lines.append("\n".join(f"- {plain(text)}" for text in row.event_texts))
    return "\n\n".join(lines)


def _stages(row: Row, moved_mm: Sequence[float], turned_deg: Sequence[float]) -> str:
    """The table of the stages."""
    # Plain floats: for a handful of numbers arrays cost more than they save.
    scores, pixels = row.scores.tolist(), row.pixels.tolist()
    lines = ["| stage | score | f_d | f_n | N | moved | turned |\n|-|-:|-:|-:|-:|-:|-:|"]
    for k, stage in enumerate(row.stages):
        f, depth_fit, normal_fit = scores[k]
        judged = "– | – | – | –" if f != f else f"{f:.3f} | {depth_fit:.3f} | {normal_fit:.3f} | {pixels[k][0]}"
        name = f"**{stage} ✔**" if stage == row.accepted else stage
        lines.append(f"| {name} | {judged} | {moved_mm[k]:.1f} mm | {turned_deg[k]:.1f}° |")
    return "\n".join(lines)


def _scene(row: Row, layout: Layout) -> Iterator[str]:
    parts = row.parts
    if parts.placed:
        yield f"Already placed: {_names(parts.placed, layout)}."
    if parts.scene is not None:
        yield _scene_record(parts.scene)
    if parts.tree is not None:
        yield from _tree_step(parts.tree, layout)


def _scene_record(scene: SceneRecord) -> str:
    return (
        f"**The pass as a scene: {scene.score.score:.3f}** (f_d {scene.score.depth_fit:.3f},"
        f" f_n {scene.score.normal_fit:.3f}); each object at its best {scene.best_known.score:.3f};"
        f" best scene so far {scene.incumbent_score:.3f}. The arms of this pass got {scene.reward:.3f}."
    )


def _tree_step(step: TreeStep, layout: Layout) -> Iterator[str]:
    branch = " → ".join(str(n) for n in step.branch)
    added = "a new node" if step.node is not None else "known to its end"
    yield f"**Search tree {step.cluster + 1}:** branch {branch} ({added})."
    if step.choices:
        yield "\n".join(f"- {plain(choice)}" for choice in step.choices)
    if step.rollout:
        rest = ", ".join(
            f"{_name(pose, layout)} h{arm + 1}" for pose, arm in zip(step.rollout, step.rollout_arms, strict=True)
        )
        yield f"Completed with {rest}."
    yield f"Not explained: {step.cost_px:.0f} px; best scene so far {step.incumbent_cost_px:.0f} px."


def _names(poses: Sequence[PlacedPose], layout: Layout) -> str:
    return ", ".join(_name(pose, layout) for pose in poses)


def _name(pose: PlacedPose, layout: Layout) -> str:
    known = (b.name for b in layout.branches if b.instance_id == pose.instance_id)
    return plain(next(known, f"#{pose.instance_id}"))


@lru_cache(maxsize=4096)
def plain(text: str) -> str:
    """Text from data, so that markdown shows it as it is."""
    return " ".join(text.split()).translate(_ESCAPED)


_ESCAPED = str.maketrans({c: f"\\{c}" for c in "\\`*_{}[]<>|#!&~"})
