"""The Batch panel: the frames of a batch run, worst first; a click opens one at its worst iteration."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import viser

from verefine_viz.batch.index import ORDERS
from verefine_viz.batch.rows import ObjectRow
from verefine_viz.diagnosis.words import cause_title
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.markup import Row, sentence, table, text
from verefine_viz.viewer.tables import cut, number
from verefine_viz.viewer.view import View
from verefine_viz.viewer.widgets import Block, Send, by_person

MOST_ROWS = 300
ALL = "all"
WRONG = "wrong or no answer"
RESULTS = (ALL, WRONG, "right")
_CORRECT = 0.1


class BatchPanel:
    """A table of objects over all frames."""

    def __init__(self, gui: viser.GuiApi, send: Send) -> None:
        self._words = Block(gui)
        self.order = gui.add_dropdown("Sort by", ORDERS, hint="worst first, or as they ran")
        self.order.on_update(by_person(lambda v: send(c.SortBatch(v))))
        self.filters: dict[c.BatchFilter, viser.GuiDropdownHandle[Any]] = {
            "result": gui.add_dropdown("Show", RESULTS, hint="wrong: an error of 10 % of the diameter or more"),
            "cause": gui.add_dropdown("Cause", (ALL,), hint="why the answer is wrong"),
            "object": gui.add_dropdown("Object", (ALL,)),
            "method": gui.add_dropdown("Method", (ALL,)),
        }
        for by, handle in self.filters.items():
            handle.on_update(by_person(lambda v, by=by: send(c.FilterBatch(by, v))))
        self._rows = Block(gui)

    def show(self, view: View) -> None:
        """The rows in the chosen order; the frame that is open is marked."""
        if view.batch is None:
            return
        every = view.batch.sorted_by(view.look.batch_order)
        rows = filtered(every, view.look.batch_only)
        self._offer("cause", {cause_title(r.cause) for r in every if r.cause}, view)
        self._offer("method", {r.method for r in every if r.method}, view)
        self._offer("object", {r.name for r in every if r.name}, view)
        self.order.value = view.look.batch_order
        self._words.show(sentence(summary(rows) if rows else "No object of this batch is both; choose other filters."))
        more = f'<p class="dim">{len(rows) - MOST_ROWS} more rows in frames.csv.</p>' if len(rows) > MOST_ROWS else ""
        self._rows.show(batch_table(rows[:MOST_ROWS], view.frame) + more)

    def _offer(self, by: c.BatchFilter, values: Iterable[str], view: View) -> None:
        """What can be chosen; a filter with nothing to choose from is hidden."""
        handle, offered = self.filters[by], (ALL, *sorted(values))
        if tuple(handle.options) != offered:
            handle.options = offered
        handle.value = view.look.batch_only.get(by, ALL)
        handle.visible = len(offered) > 2


def filtered(rows: tuple[ObjectRow, ...], only: Mapping[str, str]) -> tuple[ObjectRow, ...]:
    """The rows that pass every filter, in their order."""
    result, cause, name, method = (only.get(by, ALL) for by in ("result", "cause", "object", "method"))
    return tuple(
        row
        for row in rows
        if (result == ALL or (row.status != "ok" or row.is_correct is False) == (result == WRONG))
        and cause in (ALL, cause_title(row.cause))
        and name in (ALL, row.name)
        and method in (ALL, row.method)
    )


def summary(rows: tuple[ObjectRow, ...]) -> str:
    """How the batch went."""
    known = [r for r in rows if r.status == "ok" and r.add_s_mm is not None and r.diameter_mm]
    correct = sum((r.add_s_mm or 0.0) < _CORRECT * (r.diameter_mm or 1.0) for r in known)
    bad = sum(r.status != "ok" for r in rows)
    said = f"{len(rows)} objects in {len({(r.scene_id, r.im_id) for r in rows})} frames"
    if known:
        said += f"; {correct} of {len(known)} are within 10 % of their diameter"
    if bad:
        said += f"; {bad} have no answer"
    return said + ". Click a row to open it where it went worst."


def batch_table(rows: tuple[ObjectRow, ...], open_frame: str) -> str:
    """A row per object; each is a link."""
    shown = []
    has_causes = any(r.cause for r in rows)
    for r in rows:
        frame = f"{r.scene_id}/{r.im_id}"
        share = None if r.add_s_mm is None or not r.diameter_mm else r.add_s_mm / r.diameter_mm * 100
        cells = [
            text(frame),
            cut(r.name or "–"),
            number(r.score, 2),
            number(r.add_s_mm, 1),
            number(share, 0, "%"),
            cut(r.events.replace("_", " ") if r.status == "ok" else f"{r.status}: {r.message}"),
        ]
        if has_causes:
            cells[-1] = f'<span class="cut" title="{text(r.evidence)}">{text(cause_title(r.cause) or "–")}</span>'
        worst = r.worst_iteration if r.worst_iteration is not None else r.best_iteration
        shown.append(Row(cells, c.OpenAt(frame, worst or 0), marked=frame == open_frame))
    head = [
        ("frame", "scene/image"), ("object", ""), ("score", "of the answer"),
        ("ADD(-S)", "error of the answer [mm]"), ("of ∅", "as a share of the diameter; below 10 % counts as correct"),
        ("cause", "why it is wrong; the whole sentence stays under the pointer")
        if has_causes
        else ("events", "what happened on the way"),
    ]  # fmt: skip
    return table(head, shown)
