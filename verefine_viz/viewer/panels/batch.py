"""The Batch panel: a gallery of answers, worst first; a click opens one where it went wrong."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from typing import get_args

import viser

from verefine_viz.batch.index import ORDERS, Order
from verefine_viz.diagnosis.words import cause_title
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.choice import choice
from verefine_viz.viewer.command import Command
from verefine_viz.viewer.gallery import ALL, PAGE, Entry, Gallery
from verefine_viz.viewer.gallery_commands import BatchFilter
from verefine_viz.viewer.markup import carries, link, sentence, text, warning
from verefine_viz.viewer.standing import LIGHTS
from verefine_viz.viewer.tables import number
from verefine_viz.viewer.thumbnails import Painter, Thumbnails
from verefine_viz.viewer.view import View
from verefine_viz.viewer.widgets import Block

STYLE = """<style>
.vz .choices{display:grid;grid-template-columns:repeat(3,minmax(0,1fr));gap:4px;margin-bottom:6px}
.vz.batch{padding-bottom:0}
.vz.batch p.bad{max-height:8em;overflow-y:auto}
.vz.batch .card{margin-bottom:-5px}
.vz select{display:block;width:100%;font:inherit;font-size:12px;color:inherit;background:#2e2e2e;
 border:1px solid #424242;border-radius:4px;padding:1px 2px;color-scheme:dark}
.vz button.card{display:flex;gap:8px;width:100%;padding:3px;margin:0;text-align:left;font:inherit;font-size:12px;
 line-height:1.36;color:inherit;background:none;border:1px solid transparent;border-radius:5px;cursor:pointer}
.vz button.card:hover{background:rgba(28,126,214,.12)}
.vz button.card:focus-visible{outline:2px solid #1c7ed6}
.vz button.card.marked{background:rgba(40,200,80,.18);border-color:rgba(40,200,80,.55);animation:opened 1ms}
@keyframes opened{from{opacity:.9}}
.vz button.card[disabled]{cursor:not-allowed}
.vz .card .pic{flex:none;width:88px;height:66px;border-radius:3px;background:#333;overflow:hidden}
.vz .card img{image-rendering:auto;width:88px;height:66px}
.vz .card .txt{flex:1;min-width:0}
.vz .card .txt>span{display:flex;justify-content:space-between;gap:6px;white-space:nowrap}
.vz .card .name{overflow:hidden;text-overflow:ellipsis}
.vz .card .txt>.why{display:-webkit-box;-webkit-box-orient:vertical;-webkit-line-clamp:2;overflow:hidden;
 white-space:normal}
.vz .card .pic i{display:block;font-size:11px;padding:24px 0;text-align:center}
.vz .pages{display:flex;justify-content:space-between}
</style>"""
TITLES: dict[BatchFilter, str] = {
    "result": "Show", "cause": "Cause", "object": "Object", "method": "Method", "run": "Run",
}  # fmt: skip


class BatchPanel:
    """Filters, and a card per answer with its picture."""

    def __init__(self, gui: viser.GuiApi, gallery: Gallery) -> None:
        gui.add_html(STYLE)
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

    def show(self, view: View) -> None:
        """One page of the answers that are asked for; the one that is open is marked."""
        gallery, look = self._gallery, view.look
        entries = gallery.shown(look.batch_order, look.batch_only)
        page = min(look.batch_page, max(len(entries) - 1, 0) // PAGE)
        with self._lock:
            self._shown, self._opened = entries[page * PAGE : (page + 1) * PAGE], view.entry
            doubt = warning(gallery.doubt, red=True) if gallery.doubt else ""
            self._words.show(doubt + sentence(summary(gallery, entries)))
            self._choices.show(choices(gallery, look.batch_order, look.batch_only))
            for k in range(PAGE):
                self._show_card(k)
            self._pages.show(pages(page, len(entries)))
        # While a run is on, every core is its own.
        b_runs = view.sides is not None and view.sides.running
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
    said = gallery.outcome
    if gallery.n_unfinished:
        said += f"; unfinished and left out: {gallery.n_unfinished}"
    if not entries:
        return f"{said}. None passes all filters: choose others."
    n = sum(entry.can_be_opened for entry in entries)
    if not n:
        return f"{said}. None of those below can be opened."
    return f"{said}. {f'Click one of {n}' if n > 1 else 'One can be opened: click it'}, or press J, K."


def choices(gallery: Gallery, order: Order, only: Mapping[str, str]) -> str:
    """The filters and the order, side by side."""
    found = [choice("Sort by", [(f"by {o}", c.SortBatch(o)) for o in ORDERS], c.SortBatch(order))]
    for by in get_args(BatchFilter):
        options = [(_label(by, value), c.FilterBatch(by, value)) for value in gallery.choices.get(by, ())]
        if options:
            now = only.get(by, gallery.first_result if by == "result" else ALL)
            found.append(choice(TITLES[by], options, c.FilterBatch(by, now)))
    return f'<div class="choices">{"".join(found)}</div>'


def _label(by: BatchFilter, value: str) -> str:
    if by == "result":
        return f"show {value.partition(' ')[0]}"
    return f"any {by}" if value == ALL else value


def card(entry: Entry, command: Command, picture: str | None, is_open: bool, with_run: bool) -> str:
    """One answer: its picture, how wrong it is, and why. ``picture``: a data URI, empty = there is none, None = yet."""
    row = entry.row
    made_by = entry.run if with_run else row.method
    lines = (
        f'<span><b class="name">{text(row.name or "all objects")}</b>{_error(entry)}</span>'
        f'<span class="dim"><span class="name">{text(row.frame)} · {text(made_by)}</span>{_iteration(entry)}</span>'
    )
    if row.status == "ok":
        why = cause_title(row.cause) if row.cause else row.events.replace("_", " ")
        doubt = f'<b style="color:rgb{LIGHTS["red"]}">data in doubt</b>' if row.doubt else ""
        off = f"{number(row.add_s_mm, 1, ' mm')} · score {number(row.score, 2)}"
        lines += f'<span><span class="dim">{off}</span>{doubt}</span>'
    else:
        why = row.message
    lines += f'<span class="why">{text(why or "–")}</span>'
    image = f'<img src="{picture}" alt="">' if picture else '<i class="dim">no picture</i>' if picture == "" else ""
    # Whole, what there may be no room for.
    told = (f"{row.name or 'all objects'} · {row.frame} · {made_by}{f': {why}' if why else ''}.", row.evidence)
    tip = " ".join(filter(None, (*told, _opens_at(entry) if entry.can_be_opened else "")))
    attributes = carries(command) if entry.can_be_opened else "disabled"
    look = 'class="card marked"' if is_open else 'class="card"'
    return (
        f'<button {look} title="{text(tip)}" {attributes}>'
        f'<span class="pic">{image}</span><span class="txt">{lines}</span></button>'
    )


def _opens_at(entry: Entry) -> str:
    """Where a click leads, and why there."""
    at = f"Opens at iteration {entry.iteration}" if entry.iteration else "Opens before iteration 1"
    if entry.row.status != "ok":
        return f"{at}."
    if entry.row.worst_iteration is None:
        return f"{at}, where the answer comes from: no iteration made it much worse."
    return f"{at}, which made it worse than any other."


def _error(entry: Entry) -> str:
    """How wrong it is, in red or green where that is known."""
    row = entry.row
    if row.status != "ok":
        said = {"no_answer": "no answer", "left_out": "left out"}.get(row.status, "frame failed")
        return f'<b style="color:rgb{LIGHTS["red"]}">{said}</b>'
    if row.relative_error is None:
        return "<b>–</b>"
    return f'<b style="color:rgb{LIGHTS["red" if entry.is_wrong else "green"]}">{row.relative_error:.0%} of ∅</b>'


def _iteration(entry: Entry) -> str:
    return f"<span>it. {entry.iteration}</span>" if entry.can_be_opened else ""


def pages(page: int, n: int) -> str:
    """Where in the list this is, and the way to the rest."""
    if n <= PAGE:
        return ""
    last = (n - 1) // PAGE
    before = link("◀ before", c.TurnPage(page - 1)) if page > 0 else "<span></span>"
    after = link("more ▶", c.TurnPage(page + 1)) if page < last else "<span></span>"
    here = f"{page * PAGE + 1} to {min((page + 1) * PAGE, n)} of {n}"
    return f'<div class="pages">{before}<span>{here}</span>{after}</div>'
