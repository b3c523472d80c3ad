"""The Batch panel: a gallery of answers, worst first; a click opens one where it went wrong."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from typing import get_args

import viser

from verefine_viz.batch.index import ORDERS, Order
from verefine_viz.core.palette import RGB
from verefine_viz.diagnosis.causes import cause_title
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.commands import BatchFilter, Command
from verefine_viz.viewer.drawing.markup import carries, choice, filled, link, number, ready, sentence, warning
from verefine_viz.viewer.drawing.plausibility_picture import LIGHTS
from verefine_viz.viewer.drawing.thumbnails import Painter, Thumbnails
from verefine_viz.viewer.panels.widgets import Block
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.batch_gallery import ALL, PAGE, Entry, Gallery

TITLES: dict[BatchFilter, str] = {
    "result": "Show", "cause": "Cause", "object": "Object", "method": "Method", "run": "Run",
}  # fmt: skip


class BatchPanel:
    """Filters, and a card per answer with its picture."""

    def __init__(self, gui: viser.GuiApi, gallery: Gallery) -> None:
        self._words = Block(gui, "batch")
        self._choices = Block(gui, "batch")
        self._cards = [Block(gui, "batch") for _ in range(PAGE)]
        self._pages = Block(gui)
        self._lock = threading.Lock()  # Pictures arrive on another thread.
        self._shown: tuple[Entry, ...] = ()
        self._opened: Entry | None = None
        self._gallery = gallery
        self.thumbnails = Thumbnails(Painter(gallery), self._arrived)

    def stop(self) -> None:
        """No further pictures."""
        self.thumbnails.stop()

    def show(self, view: Snapshot) -> None:
        """One page of the answers that are asked for; the one that is open is marked."""
        gallery, options = self._gallery, view.options
        entries = gallery.shown(options.batch_order, options.batch_only)
        page = min(options.batch_page, max(len(entries) - 1, 0) // PAGE)
        with self._lock:
            self._shown, self._opened = entries[page * PAGE : (page + 1) * PAGE], view.entry
            doubt = warning(gallery.doubt, red=True) if gallery.doubt else ""
            self._words.show(doubt + sentence(summary(gallery, entries)))
            self._choices.show(choices(gallery, options.batch_order, options.batch_only))
            for k in range(PAGE):
                self._show_card(k)
            self._pages.show(pages(page, len(entries)))
        # A run gets all cores.
        b_runs = view.comparison is not None and view.comparison.running
        self.thumbnails.want(() if view.progress.running or b_runs else self._shown)

    def _show_card(self, k: int) -> None:
        if k >= len(self._shown):
            self._cards[k].show("")
            return
        entry, gallery = self._shown[k], self._gallery
        picture = self.thumbnails.of(entry)
        self._cards[k].show(card(entry, gallery.opens(entry), picture, entry == self._opened, gallery.has_several_runs))

    def _arrived(self, entry: Entry) -> None:
        with self._lock:
            if entry in self._shown:
                self._show_card(self._shown.index(entry))


def summary(gallery: Gallery, entries: Sequence[Entry]) -> str:
    """How the batch went, and what is shown of it."""
    if gallery.n_unfinished:
        return f"{gallery.outcome}; unfinished: {gallery.n_unfinished}. {_matches(entries)}"
    return f"{gallery.outcome}. {_matches(entries)}"


def _matches(entries: Sequence[Entry]) -> str:
    """As in: 12 matches. Click to open; J/K = next/previous."""
    if not entries:
        return "No match: choose other filters."
    n = sum(entry.can_be_opened for entry in entries)
    if not n:
        return f"{counted_matches(len(entries))}, none can be opened."
    return f"{counted_matches(n)}. Click to open; J/K = next/previous."


def counted_matches(n: int) -> str:
    """As in: 1 match, 2 matches."""
    return f"{n} match{'es' * (n != 1)}"


def choices(gallery: Gallery, order: Order, only: Mapping[str, str]) -> str:
    """The filters and the order, side by side."""
    dropdowns = [choice("Sort by", [(f"by {o}", c.SortBatch(o)) for o in ORDERS], c.SortBatch(order))]
    for by in get_args(BatchFilter):
        options = [(_label(by, value), c.FilterBatch(by, value)) for value in gallery.choices.get(by, ())]
        if options:
            now = only.get(by, gallery.first_result if by == "result" else ALL)
            dropdowns.append(choice(TITLES[by], options, c.FilterBatch(by, now)))
    return f'<div class="choices">{"".join(dropdowns)}</div>'


def _label(by: BatchFilter, value: str) -> str:
    if by == "result":
        return f"show {value.partition(' ')[0]}"
    return f"any {by}" if value == ALL else value


def card(entry: Entry, command: Command, picture: str | None, is_open: bool, with_run: bool) -> str:
    """One answer: its picture, how wrong it is, and why. ``picture``: a data URI, empty = there is none, None = yet."""
    row = entry.row
    made_by = entry.run if with_run else row.method
    why, off = row.message, ""
    if row.status == "ok":
        why = cause_title(row.cause) if row.cause else row.events.replace("_", " ")
        off = f"{number(row.add_s_mm, 1, ' mm')} · score {number(row.score, 2)}"
    # In full, what the card may have no space for.
    in_full = (f"{row.name or 'all objects'} · {row.frame} · {made_by}{f': {why}' if why else ''}.", row.evidence)
    error, color = _error(entry)
    return filled(
        "card.html",
        row=row,
        iteration=entry.iteration,
        made_by=made_by,
        why=why,
        off=off,
        error=error,
        error_color=color,
        red=LIGHTS["red"],
        picture=picture,
        is_open=is_open,
        tip=" ".join(filter(None, (*in_full, _opens_at(entry) if entry.can_be_opened else ""))),
        attributes=ready(carries(command)) if entry.can_be_opened else "",
    )


def _opens_at(entry: Entry) -> str:
    """Where a click leads, and why there."""
    at = f"Opens at iteration {entry.iteration}" if entry.iteration else "Opens before iteration 1"
    if entry.row.status != "ok":
        return f"{at}."
    if entry.row.worst_iteration is None:
        return f"{at}, where the answer comes from: no iteration made it much worse."
    return f"{at}, which made it worse than any other."


def _error(entry: Entry) -> tuple[str, RGB | None]:
    """How wrong it is, with its colour: red or green where that is known."""
    row = entry.row
    if entry.is_waiting:
        return "waiting", None
    if row.status != "ok":
        return {"no_answer": "no answer", "left_out": "left out"}.get(row.status, "frame failed"), LIGHTS["red"]
    if row.relative_error is None:
        return "–", None
    return f"{row.relative_error:.0%} of ∅", LIGHTS["red" if entry.is_wrong else "green"]


def pages(page: int, n: int) -> str:
    """Where in the list this is, and the way to the rest."""
    if n <= PAGE:
        return ""
    last = (n - 1) // PAGE
    before = link("◀ before", c.TurnPage(page - 1)) if page > 0 else "<span></span>"
    after = link("more ▶", c.TurnPage(page + 1)) if page < last else "<span></span>"
    here = f"{page * PAGE + 1} to {min((page + 1) * PAGE, n)} of {n}"
    return f'<div class="pages">{before}<span>{here}</span>{after}</div>'
