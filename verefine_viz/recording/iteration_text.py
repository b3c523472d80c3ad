"""The panel of an iteration, as markdown: what it did, in the words of the page, and the numbers of its stages."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from verefine_viz.core.records import Iteration, PlacedPose, SceneRecord, TreeStep
from verefine_viz.recording.layout import Layout


def describe(
    iteration: Iteration,
    layout: Layout,
    words: str,
    errors: Sequence[float],
    moved_mm: Sequence[float],
    turned_deg: Sequence[float],
) -> str:
    """An iteration for the text panel.

    Args:
        iteration: the iteration.
        layout: what its numbers mean.
        words: what happened in it and why, from :mod:`verefine_viz.run.iteration_words`.
        errors: against ground truth, as ``Block`` has them.
        moved_mm: how far each stage is from the first.
        turned_deg: the same as an angle.
    """
    i = iteration
    branch = layout.branch(i.instance_id)
    in_pass = "" if i.scene_pass is None else f", pass {i.scene_pass}"
    source = plain(branch.sources[i.arm])
    lines = [
        f"## Iteration {i.index}: {branch.name}{in_pass}",
        f"**Hypothesis {i.arm + 1} of {branch.n_arms}** ({source}), its iteration {i.arm_iteration}.",
    ]
    lines.append(plain(words))
    lines.append(_stages(i, moved_mm, turned_deg))
    best = i.best
    where = f"iteration {best.iteration}" if best.iteration else "the start"
    lines.append(f"Best so far: {best.score.score:.3f}, hypothesis {best.arm + 1}, {best.stage}, {where}.")
    if branch.has_truth:
        rotation_deg, translation_mm, add_mm = errors
        lines.append(
            f"Against ground truth: accepted pose {rotation_deg:.1f}° and {translation_mm:.1f} mm off;"
            f" best pose ADD(-S) {add_mm:.1f} mm."
        )
    lines += _scene(i, layout)
    return "\n\n".join(lines)


def _stages(iteration: Iteration, moved_mm: Sequence[float], turned_deg: Sequence[float]) -> str:
    """The table of the stages."""
    scored = [s.score for s in iteration.stages if s.score is not None]
    terms = {"f_c": "colour_fit", "p": "plausibility"}
    shown = {f: name for f, name in terms.items() if any(getattr(score, name) is not None for score in scored)}
    columns = ["stage", "score", "f_d", "f_n", *shown, "N", "moved", "turned"]
    lines = [f"| {' | '.join(columns)} |\n|-|{'-:|' * (len(columns) - 1)}"]
    for stage, mm, deg in zip(iteration.stages, moved_mm, turned_deg, strict=True):
        s = stage.score
        numbers = ["–"] * (len(columns) - 3)
        if s is not None:
            own = [getattr(s, name) for name in shown.values()]
            fits = [s.depth_fit, s.normal_fit] if s.has_parts else [None, None]
            numbers = ["–" if x is None else f"{x:.3f}" for x in (s.score, *fits, *own)]
            numbers.append(str(s.n_pixels) if s.has_parts else "–")
        scores = " | ".join(numbers)
        name = f"**{stage.name} ✔**" if stage.name == iteration.accepted else stage.name
        lines.append(f"| {name} | {scores} | {mm:.1f} mm | {deg:.1f}° |")
    return "\n".join(lines)


def _scene(iteration: Iteration, layout: Layout) -> Iterator[str]:
    if iteration.placed:
        yield f"Already placed: {', '.join(_name(pose, layout) for pose in iteration.placed)}."
    if iteration.scene is not None:
        yield _scene_record(iteration.scene)
    if iteration.tree is not None:
        yield from _tree_step(iteration.tree, layout)


def _scene_record(scene: SceneRecord) -> str:
    score = scene.score
    parts = f" (f_d {score.depth_fit:.3f}, f_n {score.normal_fit:.3f})" if score.has_parts else ""
    return (
        f"**The pass as a scene: {score.score:.3f}**{parts}; each object at its best {scene.best_known.score:.3f};"
        f" best scene so far {scene.incumbent_score:.3f}. The hypotheses of this pass got {scene.reward:.3f}."
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


def _name(pose: PlacedPose, layout: Layout) -> str:
    return plain(layout.branch(pose.instance_id).name)


def plain(text: str) -> str:
    """Text from data, so that markdown shows it as it is."""
    # The backslash, which the others bring along, comes first.
    text = " ".join(text.split()).replace("\\", "\\\\")
    return re.sub(r"([`*_{}\[\]<>|#!&~])", r"\\\1", text)
