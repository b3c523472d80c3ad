"""The Bandit panel: which hypothesis was chosen, and why; and the curves beside the maps."""

from __future__ import annotations

from collections.abc import Sequence

import viser

from verefine_viz.core.palette import STAGE_COLORS
from verefine_viz.methods.registry import method_of
from verefine_viz.pictures.visited_tree import Tree, tree_of
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.bandit_tables import arm_history, arms_table, scene_arms_table
from verefine_viz.viewer.drawing.markup import cut, link, sentence, swatch, text
from verefine_viz.viewer.drawing.tables import other_scale_sign
from verefine_viz.viewer.drawing.tree_layers import tree_html
from verefine_viz.viewer.panels.widgets import Block, Chart, Line, Send
from verefine_viz.viewer.snapshot.scene_state import ObjectState
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.names import arm_color
from verefine_viz.viewer.text.sentences import chosen

# The curves of the whole scene: how well the objects fit together, pass by pass, and each object's own best.

PASS, BEST_KNOWN, INCUMBENT = STAGE_COLORS["current"], STAGE_COLORS["simulated"], STAGE_COLORS["best"]

LEGEND_CHARACTERS = 24
"""The legend has no room for longer names; the list of objects has their colours."""


def has_room(view: Snapshot) -> bool:
    """Whether the names of all objects fit into the legend."""
    return sum(len(o.label) for o in view.scene.objects) <= LEGEND_CHARACTERS


def scene_x(view: Snapshot) -> list[float]:
    """Every iteration of the run, and the moment before the first."""
    return [0.0, *(float(i.index) for i in view.iterations)]


def scene_score_lines(view: Snapshot) -> list[Line]:
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


def _object_line(view: Snapshot, o: ObjectState, width: float) -> Line:
    own = [i for i in view.iterations if i.instance_id == o.instance_id]
    if o.answer is None or not own:
        return Line(o.label, o.color, [])
    now = own[0].best.score.score
    values = [now]
    for i in view.iterations:
        now = i.best.score.score if i.instance_id == o.instance_id else now
        values.append(now)
    return Line(o.label, o.color, values, width, in_legend=has_room(view), dashed=True)


def spent_lines(view: Snapshot) -> list[Line]:
    """Iterations spent on each object."""
    lines = []
    for o in view.scene.objects:
        values = [0.0]
        for i in view.iterations:
            values.append(values[-1] + (i.instance_id == o.instance_id))
        lines.append(Line(o.label, o.color, values, in_legend=has_room(view)))
    return lines


def scene_error_lines(view: Snapshot) -> list[Line]:
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


class BanditPanel:
    """The table of arms, the history of one, and the what-if; for a tree search the tree."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._words = Block(gui)
        self._arms = Block(gui)
        self._history = Block(gui)

    def show(self, view: Snapshot) -> None:
        """The numbers as they were when the bandit chose."""
        cluster = None if view.options.focus is None else view.scene.object(view.options.focus).cluster - 1
        tree = tree_of(view.iterations[: view.cursor], cluster)
        if tree is not None:
            labels = {o.instance_id: o.label for o in view.scene.objects}
            colors = {o.instance_id: o.color for o in view.scene.objects}
            self._words.show(sentence(tree_words(tree, view.scene.n_clusters)))
            self._arms.show(tree_html(tree, labels, colors))
            self._history.show("")
        elif view.is_whole_scene:
            self._words.show(sentence("What each object's hypotheses have got so far. Click a row for one object."))
            self._arms.show(scene_arms_table(view))
            self._history.show("")
        else:
            self._words.show(sentence(chosen(view)))
            self._arms.show(arms_table(view) + what_if(view))
            self._history.show(arm_history(view))


def tree_words(tree: Tree, n_clusters: int) -> str:
    """How far the search is."""
    said = f"The tree has {len(tree.nodes) - 1} nodes"
    if n_clusters > 1:
        said += f" (cluster {tree.cluster + 1} of {n_clusters})"
    return (
        f"{said}. The cheapest complete scene leaves {tree.incumbent_px:,.0f} px unexplained; iteration "
        f"{tree.incumbent_iteration} found it. Each node is visited where cost per visit minus bonus is lowest."
    )


def what_if(view: Snapshot) -> str:
    """Links that run the whole frame again with other exploration."""
    if not method_of(view.session.method.name).has_ucb or view.n_arms < 2:
        return ""
    now = view.session.method.exploration
    values = [0.0, max(2 * now, 0.05), max(4 * now, 0.1)]
    links = ", ".join(
        link(f"c = {v:g}", c.Fork((("method.exploration", v),), 0, run=True), "runs a new branch from the start")
        for v in values
        if v != now
    )
    return f"<p>What if {links} instead of {now:g}?</p>"


MISSING = {
    "Score": "There is no score here.",
    "UCB": "There is no bandit here, or it chooses for one object at a time: click one in the list.",
    "Pulls": "Nothing was chosen here.",
    "Error": "There is no ground truth here.",
}


IN_ONE_ROW = 6
"""Names beside the caption; more get a row of their own below it."""
BEST_PX = 5.0
"""Width of the line of the best pose, which others are drawn over."""
ACCEPTED_COLOR = (225, 225, 225)
SCORES = ("Score", "UCB")
"""Curves of which the score is a part."""


class CurvesPanel:
    """Scores, UCB, pulls and errors over the iterations of the object in focus."""

    def __init__(self, gui: viser.GuiApi, panel: viser.PanelHandle) -> None:
        self._charts: dict[str, tuple[Block, Chart]] = {}
        for name in ("Score", "UCB", "Pulls", "Error"):
            tab = panel.add_tab(name)
            with tab:
                self._charts[name] = (Block(gui), Chart(gui, 148, tab))

    def show(self, view: Snapshot) -> None:
        """All curves; drawn again only if they changed."""
        if view.is_whole_scene:
            self._show_scene(view)
            return
        own = view.own_iterations
        n = len(view.state.arms) if view.state is not None else 0
        # Iterations count over all objects; this one's curves begin where its turn did.
        x = [float(own[0].index - 1) if own else 0.0, *(float(i.index) for i in own)]
        scored = "score by arm" if len(view.scene.objects) == 1 else "by arm"
        self._draw("Score", x, score_lines(view, n) if own else [], scored, view)
        self._draw("UCB", x[1:], ucb_lines(view, n), "mean + bonus by arm", view)
        counted = "chosen (n adds the start)" if method_of(view.session.method.name).chooses else "iterations, by arm"
        self._draw("Pulls", x, pull_lines(view, n) if own else [], counted, view)
        self._draw("Error", x, error_lines(view) if own else [], "ADD(-S) in mm", view)

    def _show_scene(self, view: Snapshot) -> None:
        x, tree = scene_x(view), tree_of(view.iterations)
        started = bool(view.iterations)
        if tree is not None:
            self._draw("Score", *cost_lines(tree), "unexplained pixels")
        else:
            self._draw("Score", x, scene_score_lines(view) if started else [], "scene score; dashed: objects")
        self._draw("UCB", x, [], "")
        self._draw("Pulls", x, spent_lines(view) if started else [], "iterations spent")
        self._draw("Error", x, scene_error_lines(view) if started else [], "ADD(-S) in mm")

    def _draw(self, name: str, x: Sequence[float], lines: list[Line], caption: str, of: Snapshot | None = None) -> None:
        """Curves with their legend; ``of``: whose object in focus they are about, None = all objects."""
        words, chart = self._charts[name]
        if not lines:
            caption, of = "Curves begin with the first iteration." if len(x) < 2 else MISSING[name], None
        names = [f"<span>{swatch(line.color)}{text(line.label)}</span>" for line in lines if line.in_legend]
        before = "" if of is None else f"<span>{whose(of)}</span>"
        sign = other_scale_sign(of) if of is not None and name in SCORES else ""
        # Where there is no room for all the words say less: the curves need their names.
        said = f'{before}<span class="what" title="{text(caption)}">{text(caption)}</span>{sign}'
        many = " many" if len(names) > IN_ONE_ROW else ""
        words.show(f'<div class="curves{many}">{said}<span class="who">{" ".join(names)}</span></div>')
        chart.show(x, lines)


def whose(view: Snapshot) -> str:
    """The object in focus before a caption; empty where there is one object only."""
    if len(view.scene.objects) < 2:
        return ""
    o = view.scene.object(view.target.instance.instance_id)
    return f"{swatch(o.color)}{cut(o.label, 76)}: "


def score_lines(view: Snapshot, n_arms: int) -> list[Line]:
    """Score of each hypothesis's accepted pose, and of the best so far."""
    best = max(view.begun.arms[j].entries[0].score.score for j in range(n_arms)) if n_arms else 0.0
    # Where whole scenes are searched the answer is the pose in the best scene, which may score less than another.
    of_scene = any(i.tree is not None or i.scene_pass is not None for i in view.own_iterations)
    name = "answer" if of_scene else "best"
    # Below the others and wider, so that the hypothesis that leads is seen in it.
    values = [best, *(i.best.score.score for i in view.own_iterations)]
    lines = [Line(name, STAGE_COLORS["best"], values, width=BEST_PX)]
    for j in range(n_arms):
        now = view.begun.arms[j].entries[0].score.score
        values = [now]
        for i in view.own_iterations:
            if i.arm == j and i.accepted_stage.score is not None:
                now = i.accepted_stage.score.score
            values.append(now)
        lines.append(Line(f"{j + 1}", arm_color(j), values))
    return lines


def ucb_lines(view: Snapshot, n_arms: int) -> list[Line]:
    """Mean + bonus of each hypothesis, as they were when the bandit chose; none without a bandit."""
    choices = [i.choice for i in view.own_iterations]
    if not choices or any(c is None for c in choices):
        return []
    return [Line(f"{j + 1}", arm_color(j), [float(c.ucb[j]) for c in choices if c is not None]) for j in range(n_arms)]


def pull_lines(view: Snapshot, n_arms: int) -> list[Line]:
    """How often each hypothesis was chosen, summed up."""
    lines = []
    for j in range(n_arms):
        values = [0.0]
        for i in view.own_iterations:
            values.append(values[-1] + (i.arm == j))
        lines.append(Line(f"{j + 1}", arm_color(j), values))
    return lines


def error_lines(view: Snapshot) -> list[Line]:
    """ADD(-S) [mm] of the accepted and of the best pose; none without ground truth."""
    if any(kept is None or best is None for _, kept, best in view.error_series) or not view.error_series:
        return []
    first = [e.add_s_mm for e in view.initial_errors if e is not None]
    start = first[view.own_iterations[0].arm] if first else 0.0
    accepted = [start, *(e.add_s_mm for _, e, _ in view.error_series if e is not None)]
    best = [start, *(e.add_s_mm for _, _, e in view.error_series if e is not None)]
    return [Line("best", STAGE_COLORS["best"], best, width=BEST_PX), Line("accepted", ACCEPTED_COLOR, accepted)]
