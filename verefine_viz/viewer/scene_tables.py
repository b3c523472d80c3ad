"""Tables about several objects at once, as HTML. Names that come from data are escaped by :mod:`markup`."""

from __future__ import annotations

from verefine_viz.viewer import commands as c
from verefine_viz.viewer.answer import visit
from verefine_viz.viewer.markup import Row, swatch, table, text
from verefine_viz.viewer.scene_words import TERMS
from verefine_viz.viewer.tables import cut, number
from verefine_viz.viewer.view import View


def scene_arms_table(view: View) -> str:
    """A row per object: the hypothesis of its latest iteration, and what each one has got."""
    rows = []
    for o in view.scene.objects:
        past = view.iterations[: view.cursor]
        latest = next((i for i in reversed(past) if i.instance_id == o.instance_id), None)
        spent = [0] * len(o.target.instance.hypotheses)
        for i in past:
            if i.instance_id == o.instance_id and i.arm < len(spent):
                spent[i.arm] += 1
        choice = latest.choice if latest else None
        plays = " · ".join(f"{n:.1f}" for n in choice.plays) if choice else " · ".join(map(str, spent))
        cells = [
            f"{swatch(o.color)}{cut(o.label)}",
            f"{latest.arm + 1}" if latest else "–",
            f'<span class="cut" style="max-width:215px" title="{text(plays)}">{text(plays)}</span>',
            number(o.answer.score.score if o.answer else None, 3),
        ]
        rows.append(Row(cells, c.Focus(o.instance_id)))
    head = [
        ("object", "click a row for its hypotheses"),
        ("last", "hypothesis of its latest iteration"),
        ("plays by hypothesis", "n_j as they were when it chose, or iterations spent where nothing is chosen"),
        ("best", "score of the answer so far"),
    ]
    return table(head, rows)


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
