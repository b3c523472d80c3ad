"""Tables about several objects at once, as HTML. Names that come from data are escaped by :mod:`markup`."""

from __future__ import annotations

from verefine_viz.viewer import commands as c
from verefine_viz.viewer.answer import visit
from verefine_viz.viewer.long_names import cut
from verefine_viz.viewer.markup import Row, swatch, table
from verefine_viz.viewer.plays import CHOOSING, N_MEANS, plays_text, what_n_counts
from verefine_viz.viewer.scene_words import TERMS
from verefine_viz.viewer.tables import number
from verefine_viz.viewer.view import View


def scene_arms_table(view: View) -> str:
    """A row per object: the hypothesis of its latest iteration, and what each one has got."""
    rows = []
    past = view.iterations[: view.cursor]
    chooses = view.session.method.name in CHOOSING
    for o in view.scene.objects:
        latest = next((i for i in reversed(past) if i.instance_id == o.instance_id), None)
        spent = [0] * len(o.target.instance.hypotheses)
        for i in past:
            if i.instance_id == o.instance_id and i.arm < len(spent):
                spent[i.arm] += 1
        choice = latest.choice if latest else None
        counted = choice.plays.tolist() if choice else [1.0] * len(spent) if chooses else spent
        plays = " · ".join(plays_text(n) for n in counted)
        cells = [
            f"{swatch(o.color)}{cut(o.label)}",
            f"{latest.arm + 1}" if latest else "–",
            cut(plays, 215),
            number(o.answer.score.score if o.answer else None, 3),
        ]
        rows.append(Row(cells, c.Focus(o.instance_id)))
    head = [
        ("object", "click a row for its hypotheses"),
        ("last", "hypothesis of its latest iteration"),
        ("n by hypothesis" if chooses else "iterations by hypothesis", N_MEANS if chooses else "spent on each of them"),
        ("best", "score of the answer so far"),
    ]
    return table(head, rows) + what_n_counts(view)


def passes_table(view: View, newest: int = 8) -> str:
    """The latest passes that were closed at the cursor."""
    closed = [p for p in view.scene.closed if p.iteration <= view.cursor]
    if not closed:
        return ""
    rows = []
    for p in reversed(closed[-newest:]):
        cells = [
            f"{p.cluster}.{p.number}" if view.scene.n_clusters > 1 else f"{p.number}",
            f"{p.record.score.score:.3f}",
            f"{p.record.best_known.score:.3f}",
            f"{p.record.incumbent_score:.3f}{' ★' if p.best_pass == p.number else ''}",
            f"{p.record.reward:.3f}",
        ]
        rows.append(Row(cells, visit(view, view.at(p.iteration)), marked=p.iteration == view.cursor))
    head = [
        ("no.", "click to go to the iteration that closed it; cluster.pass"),
        ("pass", TERMS["pass score"]),
        ("best known", "each object's own best pose so far, rendered together"),
        ("incumbent", f"{TERMS['incumbent']}; ★ = found in this pass"),
        ("reward", "what the hypotheses of this pass got"),
    ]
    return "<p><b>Passes</b></p>" + table(head, rows)
