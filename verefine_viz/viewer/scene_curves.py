"""The curves of the whole scene: how well the objects fit together, pass by pass, and each object's own best."""

from __future__ import annotations

from collections.abc import Sequence

from verefine_viz.core.palette import STAGE_COLORS
from verefine_viz.viewer.scene_now import ObjectNow
from verefine_viz.viewer.tree import Tree
from verefine_viz.viewer.view import View
from verefine_viz.viewer.widgets import Line

PASS, BEST_KNOWN, INCUMBENT = STAGE_COLORS["current"], STAGE_COLORS["simulated"], STAGE_COLORS["best"]

LEGEND_CHARACTERS = 24
"""The legend has no room for longer names; the list of objects has their colours."""


def has_room(view: View) -> bool:
    """Whether the names of all objects fit into the legend."""
    return sum(len(o.label) for o in view.scene.objects) <= LEGEND_CHARACTERS


def scene_x(view: View) -> list[float]:
    """Every iteration of the run, and the moment before the first."""
    return [0.0, *(float(i.index) for i in view.iterations)]


def scene_score_lines(view: View) -> list[Line]:
    """Score of each pass, of the best known poses together and of the incumbent; each object's best score dashed."""
    lines = [_object_line(view, o, 1.2) for o in view.scene.objects]
    closed = {p.iteration: p.record for p in view.scene.closed}
    if closed:
        first = next(iter(closed.values()))
        for label, color, start, pick in (
            ("pass", PASS, first.score.score, lambda r: r.score.score),
            ("best known", BEST_KNOWN, first.best_known.score, lambda r: r.best_known.score),
            ("incumbent", INCUMBENT, first.incumbent_score, lambda r: r.incumbent_score),
        ):
            values = [start]
            for i in view.iterations:
                values.append(pick(closed[i.index]) if i.index in closed else values[-1])
            lines.append(Line(label, color, values, width=3.0 if label == "incumbent" else 2.0))
    return [line for line in lines if line.values]


def _object_line(view: View, o: ObjectNow, width: float) -> Line:
    own = [i for i in view.iterations if i.instance_id == o.instance_id]
    if o.answer is None or not own:
        return Line(o.label, o.color, [])
    now = own[0].best.score.score
    values = [now]
    for i in view.iterations:
        now = i.best.score.score if i.instance_id == o.instance_id else now
        values.append(now)
    return Line(o.label, o.color, values, width, in_legend=has_room(view), dashed=True)


def spent_lines(view: View) -> list[Line]:
    """Iterations spent on each object."""
    lines = []
    for o in view.scene.objects:
        values = [0.0]
        for i in view.iterations:
            values.append(values[-1] + (i.instance_id == o.instance_id))
        lines.append(Line(o.label, o.color, values, in_legend=has_room(view)))
    return lines


def scene_error_lines(view: View) -> list[Line]:
    """ADD(-S) [mm] of each object's answer; none without ground truth."""
    lines = []
    for o in view.scene.objects:
        own = [i for i in view.iterations if i.instance_id == o.instance_id]
        first = view.best_errors.get(own[0].index) if own else None
        if first is None:
            continue
        now = first.add_s_mm
        values = [now]
        for i in view.iterations:
            found = view.best_errors.get(i.index) if i.instance_id == o.instance_id else None
            now = found.add_s_mm if found is not None else now
            values.append(now)
        lines.append(Line(o.label, o.color, values, in_legend=has_room(view)))
    return lines


def cost_lines(tree: Tree) -> tuple[Sequence[float], list[Line]]:
    """(x, lines): cost of each complete scene and of the incumbent [px]."""
    x = [float(index) for index, _, _ in tree.costs]
    return x, [
        Line("this scene", PASS, [cost for _, cost, _ in tree.costs], width=1.2),
        Line("incumbent", INCUMBENT, [cost for _, _, cost in tree.costs], width=3.0),
    ]
