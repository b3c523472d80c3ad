"""Numbers over the iterations: score, UCB and pulls per hypothesis, fit, error, physics; score and cost of a scene."""

from __future__ import annotations

from collections.abc import Sequence

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
_PHYSICS = ["simulation moved [mm]", "simulation turned [°]", "refiner moved [mm]", "refiner turned [°]"]
_PHYSICS += ["contacts", "deepest penetration [mm]"]
_SCENE = ["reward", "poses of the pass", "best pose of each object", "best scene so far"]


def log_styles(file: RecordingFile, branch: ObjectBranch) -> None:
    """Names and colours of all curves of an object."""
    arms = [f"hypothesis {j + 1}" for j in range(branch.n_arms)]
    colors = [ARM_COLORS[j % len(ARM_COLORS)] for j in range(branch.n_arms)]
    simulated, refined = STAGE_COLORS["simulated"], STAGE_COLORS["refined"]
    pairs = [simulated, _darker(simulated), refined, _darker(refined)]
    styles: dict[str, tuple[list[str], list[RGB]]] = {
        "score": ([*arms, "best"], [*colors, STAGE_COLORS["best"]]),
        "ucb": (arms, colors),
        "pulls": (arms, colors),
        "fit": (["f_d simulated", "f_n simulated", "f_d refined", "f_n refined"], pairs),
        "physics": (_PHYSICS, [*pairs, _GREY, (220, 50, 47)]),
    }
    if branch.has_truth:
        names = ["rotation of the accepted pose [°]", "translation of the accepted pose [mm]"]
        names.append("ADD(-S) of the best pose [mm]")
        styles["error"] = (names, [_PURPLE, _GREY, STAGE_COLORS["best"]])
    for group, (names, colours) in styles.items():
        widths = [2.5 if name == "best" else 1.5 for name in names]
        holds = group in ("score", "ucb", "pulls")
        file.log(entities.curve(group, branch.name), _lines(names, colours, widths, holds))


def log_scene_styles(file: RecordingFile, layout: Layout) -> None:
    """Names and colours of the curves of a scene."""
    for branch in layout.branches:
        own = _lines([branch.name], [layout.colors[branch.instance_id]], [2.0])
        for group in ("best", "add_s"):
            file.log(entities.curve(group, branch.name), own)
        # Clusters have curves of their own, called after their first object.
        colors: list[RGB] = [_GREY, (110, 150, 255), (255, 179, 90), (0, 170, 120)]
        file.log(entities.curve("scene", branch.name), _lines(_SCENE, colors, [2.0] * 4))
        cost = _lines(["this scene [px]", "best scene so far [px]"], [colors[1], colors[3]], [2.0] * 2)
        file.log(entities.curve("cost", branch.name), cost)


def send_initial(file: RecordingFile, branch: ObjectBranch, before: int) -> None:
    """The initial scores, at the iteration before the object's first."""
    _send(file, "score", branch.name, [before], [[*branch.initial_scores, max(branch.initial_scores)]])


def send_initial_best(file: RecordingFile, layout: Layout) -> None:
    """Every object's best initial pose, before the first iteration."""
    for branch in layout.branches:
        if branch.n_arms:
            _send(file, "best", branch.name, [0], [[max(branch.initial_scores)]])


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
        _send(file, group, branch.name, [i.index for i in iterations], values)


def send_scene_curves(file: RecordingFile, layout: Layout, block: Block) -> None:
    """The curves that go over all objects."""
    for branch in layout.branches:
        own = block.own(branch.instance_id)
        if own:
            indices = [block.indices[k] for k in own]
            _send(file, "best", branch.name, indices, block.best_scores[own, None])
            if branch.has_truth:
                _send(file, "add_s", branch.name, indices, block.errors[own, 2:])
    _send_per_cluster(file, "scene", layout, block.iterations)
    _send_per_cluster(file, "cost", layout, block.iterations)


def _send_per_cluster(file: RecordingFile, group: str, layout: Layout, iterations: Sequence[Iteration]) -> None:
    rows: dict[str, tuple[list[int], list[list[float]]]] = {}
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
        indices, numbers = rows.setdefault(layout.branch(first).name, ([], []))
        indices.append(iteration.index)
        numbers.append(values)
    for name, (indices, numbers) in rows.items():
        _send(file, group, name, indices, numbers)


def _send(
    file: RecordingFile, group: str, branch_name: str, indices: Sequence[int], rows: Sequence[Sequence[float]] | Float
) -> None:
    values = np.array(rows, np.float64)
    columns = rr.Scalars.columns(scalars=values.ravel()).partition([values.shape[1]] * len(values))
    file.send(entities.curve(group, branch_name), indices, columns)


def _lines(names: Sequence[str], colors: Sequence[RGB], widths: Sequence[float], holds: bool = True) -> rr.SeriesLines:
    """``holds``: what was reached holds until something else is."""
    mode = "StepAfter" if holds else "Linear"
    return rr.SeriesLines(names=names, colors=colors, widths=widths, interpolation_mode=mode)


def _darker(color: RGB) -> RGB:
    return color[0] * 6 // 10, color[1] * 6 // 10, color[2] * 6 // 10
