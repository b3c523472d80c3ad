"""Numbers over the iterations: score, UCB and pulls per hypothesis, fit, error, physics; score and cost of a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from verefine_viz.core.arrays import Float
from verefine_viz.core.palette import ARM_COLORS, RGB, STAGE_COLORS
from verefine_viz.core.records import Iteration
from verefine_viz.recording import entities
from verefine_viz.recording.block import Block
from verefine_viz.recording.layout import Layout, ObjectBranch
from verefine_viz.recording.recording_file import RecordingFile

_GREY: RGB = (150, 150, 150)
_PURPLE: RGB = (190, 90, 220)
_BLUE: RGB = (110, 150, 255)
_GREEN, _ORANGE, _RED = STAGE_COLORS["best"], (255, 179, 90), (220, 50, 47)
_SIMULATED, _REFINED = STAGE_COLORS["simulated"], STAGE_COLORS["refined"]


@dataclass(frozen=True)
class CurveStyle:
    """One curve of a group: the last part of its entity path, its name, its colour."""

    entity: str
    name: str
    color: RGB


def _darker(color: RGB) -> RGB:
    return color[0] * 6 // 10, color[1] * 6 // 10, color[2] * 6 // 10


_STYLES: Mapping[str, tuple[CurveStyle, ...]] = {
    "fit": (
        CurveStyle("f_d_simulated", "f_d simulated", _SIMULATED),
        CurveStyle("f_n_simulated", "f_n simulated", _darker(_SIMULATED)),
        CurveStyle("f_d_refined", "f_d refined", _REFINED),
        CurveStyle("f_n_refined", "f_n refined", _darker(_REFINED)),
    ),
    "physics": (
        CurveStyle("simulation_moved_mm", "simulation moved [mm]", _SIMULATED),
        CurveStyle("simulation_turned_deg", "simulation turned [°]", _darker(_SIMULATED)),
        CurveStyle("refiner_moved_mm", "refiner moved [mm]", _REFINED),
        CurveStyle("refiner_turned_deg", "refiner turned [°]", _darker(_REFINED)),
        CurveStyle("contacts", "contacts", _GREY),
        CurveStyle("penetration_mm", "deepest penetration [mm]", _RED),
    ),
    "error": (
        CurveStyle("rotation_deg", "rotation of the accepted pose [°]", _PURPLE),
        CurveStyle("translation_mm", "translation of the accepted pose [mm]", _GREY),
        CurveStyle("add_s_mm", "ADD(-S) of the best pose [mm]", _GREEN),
    ),
    "scene": (
        CurveStyle("reward", "reward", _GREY),
        CurveStyle("pass", "poses of the pass", _BLUE),
        CurveStyle("best_known", "best pose of each object", _ORANGE),
        CurveStyle("incumbent", "best scene so far", _GREEN),
    ),
    "cost": (
        CurveStyle("this_px", "this scene [px]", _BLUE),
        CurveStyle("incumbent_px", "best scene so far [px]", _GREEN),
    ),
}
"""Groups whose curves are the same for every object; those of :data:`_BY_HYPOTHESIS` have one per hypothesis."""
_BY_HYPOTHESIS = ("score", "ucb", "pulls")
_ALONE = ("best", "add_s")
"""Groups of one curve per object, named after the object."""


def _styles_of(group: str, branch: ObjectBranch) -> tuple[CurveStyle, ...]:
    """The curves of a group, in the order in which their numbers are sent."""
    if group not in _BY_HYPOTHESIS:
        return _STYLES[group]
    arms = range(branch.n_arms)
    styles = [CurveStyle(f"h{j + 1}", f"hypothesis {j + 1}", ARM_COLORS[j % len(ARM_COLORS)]) for j in arms]
    return (*styles, *([CurveStyle("best", "best", _GREEN)] if group == "score" else []))


def log_styles(file: RecordingFile, branch: ObjectBranch) -> None:
    """Names and colours of all curves of an object."""
    for group in (*_BY_HYPOTHESIS, "fit", "physics", *(["error"] if branch.has_truth else [])):
        _log_styles(file, group, branch)


def log_scene_styles(file: RecordingFile, layout: Layout) -> None:
    """Names and colours of the curves of a scene."""
    for branch in layout.branches:
        for group in _ALONE:
            color = layout.colors[branch.instance_id]
            file.log(entities.curves(group, branch.name), _line(branch.name, color, 2.0))
    # Clusters have curves of their own, named after their first object.
    for branch in layout.branches:
        for group, is_there in (("scene", layout.has_passes), ("cost", layout.has_tree)):
            if is_there:
                _log_styles(file, group, branch)


def _log_styles(file: RecordingFile, group: str, branch: ObjectBranch) -> None:
    holds = group in (*_BY_HYPOTHESIS, *_ALONE, "scene", "cost")
    for style in _styles_of(group, branch):
        width = 2.5 if style.entity == "best" else 2.0 if group in ("scene", "cost") else 1.5
        file.log(entities.curve(group, branch.name, style.entity), _line(style.name, style.color, width, holds))


def send_initial(file: RecordingFile, branch: ObjectBranch, before: int) -> None:
    """The initial scores, at the iteration before the object's first."""
    _send(file, "score", branch, [before], [[*branch.initial_scores, max(branch.initial_scores)]])


def send_initial_best(file: RecordingFile, layout: Layout) -> None:
    """Every object's best initial pose, before the first iteration."""
    for branch in layout.branches:
        if branch.n_arms:
            _send(file, "best", branch, [0], [[max(branch.initial_scores)]])


def send_curves(
    file: RecordingFile, branch: ObjectBranch, block: Block, own: Sequence[int], last_scores: Float
) -> None:
    """The curves of an object.

    Args:
        file: where to.
        branch: the object.
        block: iterations of all objects.
        own: which of them are the object's; at least one.
        last_scores: (H,) latest accepted score of each hypothesis before them; updated in place.
    """
    iterations = [block.iterations[k] for k in own]
    scores = np.empty((len(own), len(last_scores) + 1))
    for k, i in enumerate(iterations):
        score = i.accepted_stage.score
        if score is not None:
            last_scores[i.arm] = score.score
        scores[k, :-1] = last_scores
    scores[:, -1] = block.best_scores[own]
    groups = {"score": scores, "fit": block.fit[own], "physics": block.physics[own]}
    choices = [i.choice for i in iterations if i.choice is not None]
    if len(choices) == len(own):
        groups |= {"ucb": np.array([c.ucb for c in choices]), "pulls": np.array([c.plays for c in choices])}
    if branch.has_truth:
        groups["error"] = block.errors[own]
    for group, values in groups.items():
        _send(file, group, branch, [i.index for i in iterations], values)


def send_scene_curves(file: RecordingFile, layout: Layout, block: Block) -> None:
    """The curves about all objects together."""
    for branch in layout.branches:
        own = block.own(branch.instance_id)
        if own:
            indices = [block.indices[k] for k in own]
            _send(file, "best", branch, indices, block.best_scores[own, None])
            if branch.has_truth:
                _send(file, "add_s", branch, indices, block.errors[own, 2:])
    _send_per_cluster(file, "scene", layout, block.iterations)
    _send_per_cluster(file, "cost", layout, block.iterations)


def _send_per_cluster(file: RecordingFile, group: str, layout: Layout, iterations: Sequence[Iteration]) -> None:
    rows: dict[int, tuple[list[int], list[list[float]]]] = {}
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
        indices, numbers = rows.setdefault(first, ([], []))
        indices.append(iteration.index)
        numbers.append(values)
    for first, (indices, numbers) in rows.items():
        _send(file, group, layout.branch(first), indices, numbers)


def _send(
    file: RecordingFile,
    group: str,
    branch: ObjectBranch,
    indices: Sequence[int],
    rows: Sequence[Sequence[float]] | Float,
) -> None:
    """A row of numbers for each index: a curve for each column."""
    columns = np.array(rows, np.float64).T
    if group in _ALONE:
        file.send(entities.curves(group, branch.name), indices, rr.Scalars.columns(scalars=columns[0]))
        return
    for style, values in zip(_styles_of(group, branch), columns, strict=True):
        file.send(entities.curve(group, branch.name, style.entity), indices, rr.Scalars.columns(scalars=values))


def _line(name: str, color: RGB, width: float, holds: bool = True) -> rr.SeriesLines:
    """``holds``: each value holds until the next one."""
    mode = "StepAfter" if holds else "Linear"
    return rr.SeriesLines(names=[name], colors=[color], widths=[width], interpolation_mode=mode)
