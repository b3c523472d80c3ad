"""The Bandit panel: which hypothesis was chosen, and why; and the curves beside the maps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import viser

from verefine_viz.core.palette import SIDE_COLORS, STAGE_COLORS
from verefine_viz.core.records import Iteration
from verefine_viz.methods.bandit import Ucb, next_choice
from verefine_viz.methods.registry import method_of
from verefine_viz.pictures.visited_tree import Tree, tree_of
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.bandit_tables import arm_history, arms_table, scene_arms_table
from verefine_viz.viewer.drawing.markup import focus_label, link, sentence, swatch, text
from verefine_viz.viewer.drawing.pose_tables import other_scale_sign
from verefine_viz.viewer.drawing.tree_layers import tree_html
from verefine_viz.viewer.panels.widgets import Block, Chart, Line
from verefine_viz.viewer.snapshot.comparison_snapshot import ComparisonSnapshot
from verefine_viz.viewer.snapshot.scene_state import ObjectState
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.view_options import stage_label
from verefine_viz.viewer.text.display_names import arm_color
from verefine_viz.viewer.text.headline import cheapest_scene
from verefine_viz.viewer.text.pose_words import beside_answer


class BanditPanel:
    """The table of arms, the history of one, and the what-if; for a tree search the tree."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._words = Block(gui)
        self._arms = Block(gui)
        self._history = Block(gui)

    def show(self, snapshot: Snapshot) -> None:
        """The numbers as they were when the bandit chose."""
        focus, objects = snapshot.options.focus, snapshot.scene.objects
        tree = tree_of(
            snapshot.iterations[: snapshot.cursor],
            None if focus is None else snapshot.scene.object(focus).cluster - 1,
        )
        history = ""
        if tree is not None:
            words = tree_words(tree, snapshot.scene.n_clusters)
            arms = tree_html(tree, {o.instance_id: o.label for o in objects}, {o.instance_id: o.color for o in objects})
        elif snapshot.is_whole_scene:
            words, arms = "", scene_arms_table(snapshot)
        else:
            words, arms = chosen(snapshot), arms_table(snapshot) + what_if(snapshot)
            history = arm_history(snapshot)
        self._words.show(sentence(words))
        self._arms.show(arms)
        self._history.show(history)


def chosen(snapshot: Snapshot) -> str:
    """Why the bandit took this hypothesis, or what will be chosen first."""
    method, shown = method_of(snapshot.session.method.name), snapshot.shown
    if snapshot.state is None:
        return "There is no hypothesis to choose from."
    if shown is not None and shown.choice is not None:
        return f"{beside_answer(snapshot)}Iteration {shown.index} took {shown.choice.reason}."
    if shown is not None:
        works = f"it works on hypothesis {shown.arm + 1}"
        return f"{beside_answer(snapshot)}{works[:1].upper()}{works[1:]} alone."
    if snapshot.state.edited_arms:
        return f"First comes hypothesis {snapshot.state.edited_arms[0] + 1}, which was edited."
    if method.has_tree:
        return "The search tree is empty."
    if not method.chooses:
        return f"{method.label} works on hypothesis {snapshot.state.best.arm + 1} alone."
    if not method.has_ucb:
        return "Nothing was chosen yet."
    return f"First comes {next_choice(Ucb(snapshot.exploration), snapshot.state).reason}."


def tree_words(tree: Tree, n_clusters: int) -> str:
    """How far the search is."""
    of = f" (cluster {tree.cluster + 1} of {n_clusters})" if n_clusters > 1 else ""
    return f"{len(tree.nodes) - 1} nodes{of}. {cheapest_scene(tree)}"


def what_if(snapshot: Snapshot) -> str:
    """Links that run the whole frame again with other exploration."""
    if not method_of(snapshot.session.method.name).has_ucb or snapshot.n_arms < 2:
        return ""
    now = snapshot.session.method.exploration
    values = [0.0, max(2 * now, 0.05), max(4 * now, 0.1)]
    links = ", ".join(
        link(f"c = {v:g}", c.Fork((("method.exploration", v),), 0, run=True), "runs a new branch from the start")
        for v in values
        if v != now
    )
    return f"<p>What if {links} instead of {now:g}?</p>"


# The curves over the iterations, of the object in focus or of the whole scene.

MISSING = {"Score": "no score", "UCB": "no bandit", "Pulls": "no choice", "Error": "no ground truth"}
IN_ONE_ROW = 6
"""Names beside the caption; more get a row of their own below it."""
SCORES = ("Score", "UCB")
"""Curves of which the score is a part."""


class CurvesPanel:
    """Scores, UCB, pulls and errors."""

    def __init__(self, gui: viser.GuiApi, panel: viser.PanelHandle) -> None:
        self._charts: dict[str, tuple[Block, Chart]] = {}
        for name in ("Score", "UCB", "Pulls", "Error"):
            tab = panel.add_tab(name)
            with tab:
                self._charts[name] = (Block(gui), Chart(gui, 148, tab))

    def show(self, snapshot: Snapshot) -> None:
        """All curves; drawn again only if they changed."""
        curves = scene_curves(snapshot) if snapshot.is_whole_scene else object_curves(snapshot)
        if snapshot.comparison is not None:
            curves |= compared_curves(snapshot.comparison)
        for name, (x, lines, caption) in curves.items():
            is_of_one = not snapshot.is_whole_scene and snapshot.comparison is None
            self._draw(name, x, lines, caption, snapshot if is_of_one else None)

    def _draw(self, name: str, x: Sequence[float], lines: list[Line], caption: str, of: Snapshot | None = None) -> None:
        """Curves with their legend; ``of``: whose object in focus they are about, None = all objects."""
        words, chart = self._charts[name]
        if not lines:
            caption, of = "" if len(x) < 2 else MISSING[name], None
        names = [f"<span>{swatch(line.color)}{text(line.label)}</span>" for line in lines if line.in_legend]
        label = focus_label(of) if of is not None else ""
        whose = f"<span>{label}</span>" if label else ""
        sign = other_scale_sign(of) if of is not None and name in SCORES else ""
        # The caption gives way to the curves' names where there is no room for all.
        shown = f'{whose}<span class="what" title="{text(caption)}">{text(caption)}</span>{sign}'
        many = " many" if len(names) > IN_ONE_ROW else ""
        words.show(f'<div class="curves{many}">{shown}<span class="who">{" ".join(names)}</span></div>')
        chart.show(x, lines)


Curves = dict[str, tuple[Sequence[float], list[Line], str]]
"""By tab: places on the axis of iterations, lines, caption."""


def object_curves(snapshot: Snapshot) -> Curves:
    """Of the object in focus."""
    own = snapshot.own_iterations
    n = len(snapshot.state.arms) if snapshot.state is not None else 0
    # Iterations count over all objects; this one's curves begin where its turn did.
    x = [float(own[0].index - 1) if own else 0.0, *(float(i.index) for i in own)]
    chooses = method_of(snapshot.session.method.name).chooses
    return {
        "Score": (x, score_lines(snapshot, n), ""),
        "UCB": (x[1:], ucb_lines(snapshot, n), "mean + bonus"),
        "Pulls": (x, pull_lines(snapshot, n), "chosen" if chooses else "iterations"),
        "Error": (x, error_lines(snapshot), "ADD(-S) in mm"),
    }


def scene_curves(snapshot: Snapshot) -> Curves:
    """Of all objects."""
    x = [0.0, *(float(i.index) for i in snapshot.iterations)]
    tree = tree_of(snapshot.iterations)
    scores = (x, scene_score_lines(snapshot), "scene score; dashed: objects")
    return {
        "Score": scores if tree is None else (*cost_lines(tree), "unexplained pixels"),
        "UCB": (x, [], ""),
        "Pulls": (x, spent_lines(snapshot), "iterations spent"),
        "Error": (x, scene_error_lines(snapshot), "ADD(-S) in mm"),
    }


def compared_curves(sides: ComparisonSnapshot) -> Curves:
    """Curves of two runs, over the iterations that stand beside each other."""
    curves, alike = sides.curves, "" if sides.scores_alike else ", each by its own settings"
    x = [float(k) for k in range(len(curves.score_a))]

    def pair(a: Sequence[float], b: Sequence[float]) -> list[Line]:
        named = ("A", sides.name_a, a, 2.5), ("B", sides.name_b, b, 2.0)
        return [
            Line(f"{letter} {name}", SIDE_COLORS[letter], values, width, dashed=letter == "B")
            for letter, name, values, width in named
        ]

    errors = pair(curves.error_a, curves.error_b) if curves.error_a is not None and curves.error_b is not None else []
    return {
        "Score": (x, pair(curves.score_a, curves.score_b), f"{sides.curves_of}: best so far{alike}"),
        "Error": (x, errors, f"{sides.curves_of}: ADD(-S) in mm"),
    }


def _carried(start: float, iterations: Sequence[Iteration], known: Mapping[int, float]) -> list[float]:
    """A value before and after each iteration; one of which none is ``known`` leaves the curve where it was."""
    values = [start]
    for iteration in iterations:
        values.append(known.get(iteration.index, values[-1]))
    return values


def _summed(iterations: Sequence[Iteration], counts: Callable[[Iteration], bool]) -> list[float]:
    """How many iterations count, before and after each."""
    values = [0.0]
    for iteration in iterations:
        values.append(values[-1] + counts(iteration))
    return values


# Of one object.

BEST_PX = 5.0
"""Width of the line of the answer so far, which others are drawn over: the hypothesis that leads is seen in it."""
ACCEPTED_COLOR = (225, 225, 225)


def score_lines(snapshot: Snapshot, n_arms: int) -> list[Line]:
    """Score of each hypothesis's accepted pose, and of the answer so far."""
    own = snapshot.own_iterations
    if not own:
        return []
    first = [snapshot.begun.arms[j].entries[0].score.score for j in range(n_arms)]
    best = [max(first, default=0.0), *(i.best.score.score for i in own)]

    def accepted(j: int) -> list[float]:
        stages = {i.index: i.accepted_stage for i in own if i.arm == j}
        return _carried(first[j], own, {k: s.score.score for k, s in stages.items() if s.score is not None})

    lines = [Line(stage_label("best"), STAGE_COLORS["best"], best, width=BEST_PX)]
    return lines + [Line(f"{j + 1}", arm_color(j), accepted(j)) for j in range(n_arms)]


def ucb_lines(snapshot: Snapshot, n_arms: int) -> list[Line]:
    """Mean + bonus of each hypothesis, as they were when the bandit chose; none without a bandit."""
    choices = [i.choice for i in snapshot.own_iterations]
    if not choices or any(c is None for c in choices):
        return []
    return [Line(f"{j + 1}", arm_color(j), [float(c.ucb[j]) for c in choices if c is not None]) for j in range(n_arms)]


def pull_lines(snapshot: Snapshot, n_arms: int) -> list[Line]:
    """How often each hypothesis was chosen, summed up."""
    own = snapshot.own_iterations
    arms = range(n_arms) if own else ()
    return [Line(f"{j + 1}", arm_color(j), _summed(own, lambda i, j=j: i.arm == j)) for j in arms]


def error_lines(snapshot: Snapshot) -> list[Line]:
    """ADD(-S) [mm] of the accepted pose and of the answer so far; none without ground truth."""
    known = [(a, b) for _, a, b in snapshot.error_series if a is not None and b is not None]
    if not known or len(known) < len(snapshot.error_series):
        return []
    initial = [e.add_s_mm for e in snapshot.initial_errors if e is not None]
    start = initial[snapshot.own_iterations[0].arm] if initial else 0.0
    accepted, best = ([start, *(e.add_s_mm for e in errors)] for errors in zip(*known, strict=True))
    return [
        Line(stage_label("best"), STAGE_COLORS["best"], best, width=BEST_PX),
        Line("accepted", ACCEPTED_COLOR, accepted),
    ]


# Of the whole scene: how well the objects fit together, pass by pass, and each object's own best.

PASS, BEST_KNOWN, INCUMBENT = STAGE_COLORS["current"], STAGE_COLORS["simulated"], STAGE_COLORS["best"]
LEGEND_CHARACTERS = 24
"""The legend has no room for longer names; the list of objects has their colours."""


def _object_line(snapshot: Snapshot, o: ObjectState, values: list[float], dashed: bool = False) -> Line:
    fits = sum(len(p.label) for p in snapshot.scene.objects) <= LEGEND_CHARACTERS
    return Line(o.label, o.color, values, 1.2 if dashed else 2.0, in_legend=fits, dashed=dashed)


def _best_line(snapshot: Snapshot, o: ObjectState, known: Mapping[int, float], dashed: bool = False) -> Line:
    """What is ``known`` by iteration of one object's best pose, over the iterations of all."""
    values = _carried(next(iter(known.values())), snapshot.iterations, known)
    return _object_line(snapshot, o, values, dashed)


def scene_score_lines(snapshot: Snapshot) -> list[Line]:
    """Score of each pass, of the best known poses together and of the incumbent; each object's best score dashed."""
    lines = []
    for o in snapshot.scene.objects:
        scores = {i.index: i.best.score.score for i in snapshot.iterations if i.instance_id == o.instance_id}
        if o.answer is not None and scores:
            lines.append(_best_line(snapshot, o, scores, dashed=True))
    closed = {p.iteration: p.record for p in snapshot.scene.closed}
    for label, color, width, pick in (
        ("pass", PASS, 2.0, lambda record: record.score.score),
        ("best known", BEST_KNOWN, 2.0, lambda record: record.best_known.score),
        ("incumbent", INCUMBENT, 3.0, lambda record: record.incumbent_score),
    ):
        scores = {index: pick(record) for index, record in closed.items()}
        if scores:
            values = _carried(next(iter(scores.values())), snapshot.iterations, scores)
            lines.append(Line(label, color, values, width))
    return lines


def spent_lines(snapshot: Snapshot) -> list[Line]:
    """Iterations spent on each object."""
    return [
        _object_line(snapshot, o, _summed(snapshot.iterations, lambda i, o=o: i.instance_id == o.instance_id))
        for o in (snapshot.scene.objects if snapshot.iterations else ())
    ]


def scene_error_lines(snapshot: Snapshot) -> list[Line]:
    """ADD(-S) [mm] of each object's answer; none without ground truth."""
    lines = []
    for o in snapshot.scene.objects:
        own = (i.index for i in snapshot.iterations if i.instance_id == o.instance_id)
        known = {k: e.add_s_mm for k in own if (e := snapshot.best_errors.get(k)) is not None}
        if known:
            lines.append(_best_line(snapshot, o, known))
    return lines


def cost_lines(tree: Tree) -> tuple[Sequence[float], list[Line]]:
    """(x, lines): cost of each complete scene and of the incumbent [px]."""
    x = [float(index) for index, _, _ in tree.costs]
    return x, [
        Line("this scene", PASS, [cost for _, cost, _ in tree.costs], width=1.2),
        Line("incumbent", INCUMBENT, [cost for _, _, cost in tree.costs], width=3.0),
    ]
