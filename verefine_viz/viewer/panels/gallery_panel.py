"""The gallery: the answers of a batch as tiles; a click opens one where it went wrong.

All tiles are sent once. What belongs to one browser (size of the tiles, selection) and what must be quick (search,
filters, order) is done there, by ``batch/templates/gallery.js``; it asks for a picture when its tile comes into sight.
"""

from __future__ import annotations

import json
from concurrent.futures import Future

import viser

from verefine_viz.batch.answer_cards import bar_html, cause_of, entry_html, gallery_asset
from verefine_viz.core.palette import STAGE_COLORS
from verefine_viz.pictures.answer_pictures import color_of
from verefine_viz.viewer.command_json import to_json
from verefine_viz.viewer.drawing.markup import swatch, text, warning
from verefine_viz.viewer.drawing.thumbnails import Painter, Thumbnails
from verefine_viz.viewer.panels.widgets import Block, add_style
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.batch_gallery import Entry, Gallery


class GalleryPanel:
    """A block with all tiles, and a small one with what changes: order, filters, tags, what is open."""

    def __init__(self, gui: viser.GuiApi, gallery: Gallery) -> None:
        add_style(gui, gallery_asset("gallery.css"))
        self._gallery = gallery
        self._thumbnails = Thumbnails(Painter(gallery))
        self._tiles, self._state = Block(gui, "gallery-pane"), Block(gui, "gallery-hidden")
        self._entries: tuple[Entry, ...] = ()
        self._numbers: dict[Entry, int] = {}

    def show(self, snapshot: Snapshot) -> None:
        """What is chosen, and the tiles where others came; pictures wait while a run is on, which gets all cores."""
        if self._gallery.entries is not self._entries:
            self._entries = self._gallery.entries
            self._numbers = {entry: k for k, entry in enumerate(self._entries)}
            self._tiles.show(gallery_html(self._gallery))
        self._state.show(f'<i class="gallery-state" data-state="{text(json.dumps(self._state_of(snapshot)))}"></i>')
        b_runs = snapshot.comparison is not None and snapshot.comparison.running
        self._thumbnails.hold(snapshot.progress.running or b_runs)

    def picture(self, number: int) -> Future[bytes] | None:
        """The picture of an answer; None = there is no such answer."""
        if number >= len(self._gallery.entries):
            return None
        return self._thumbnails.ask(self._gallery.entries[number])

    def stop(self) -> None:
        """No further pictures."""
        self._thumbnails.stop()

    def _state_of(self, snapshot: Snapshot) -> dict[str, object]:
        gallery, options = self._gallery, snapshot.options
        tags = {self._numbers[entry]: tags for entry in gallery.entries if (tags := gallery.tags_of(entry))}
        return {
            **options.arrangement.model_dump(),
            "by": options.arranged_by,
            "tags": tags,
            "filters": {name: saved.model_dump() for name, saved in gallery.saved_filters.items()},
            "open": self._numbers.get(snapshot.entry) if snapshot.entry is not None else None,
        }


def gallery_html(gallery: Gallery) -> str:
    """The bar and all tiles."""
    notes = [*(f"{note}." for note in gallery.notes), gallery.doubt, *gallery.tag_faults.values()]
    if gallery.n_unfinished:
        notes.append(f"Runs without a finished frame are left out: {gallery.n_unfinished}.")
    tiles = "".join(entry_of(gallery, entry, k) for k, entry in enumerate(gallery.entries))
    bar = bar_html(list(gallery.values.values()), has_tags=True)
    doubts = "".join(warning(note, red=True, folded=True) for note in notes if note)
    legend = f"{swatch(color_of('best'))}answer {swatch(STAGE_COLORS['ground truth'])}ground truth"
    return (
        f'<div class="gallery"><div class="gallery-top"><p class="outcome"><span>{text(gallery.outcome)}.</span>'
        f'<span class="dim">{legend}</span></p>{bar}{doubts}</div><div class="gallery-grid">{tiles}</div></div>'
    )


def entry_of(gallery: Gallery, entry: Entry, number: int) -> str:
    """One tile."""
    row = entry.row
    return entry_html(
        row,
        str(number),
        gallery.values[entry],
        gallery.places[entry],
        made_by=entry.run if gallery.has_several_runs else row.method,
        tip=tip(entry),
        command=to_json(gallery.opens(entry)) if entry.can_be_opened else "",
    )


def tip(entry: Entry) -> str:
    """In full, what a tile may have no space for, and where a click leads."""
    row, why = entry.row, cause_of(entry.row)
    share = f", {row.relative_error:.0%} of the diameter" if row.relative_error is not None else ""
    words = f"{row.name or 'all objects'} · {row.frame} · {row.method}{share}{f': {why}' if why else ''}."
    return " ".join(filter(None, (words, row.evidence, _opens_at(entry) if entry.can_be_opened else "")))


def _opens_at(entry: Entry) -> str:
    at = f"Opens at iteration {entry.iteration}" if entry.iteration else "Opens before iteration 1"
    if entry.row.status != "ok":
        return f"{at}."
    if entry.row.worst_iteration is None:
        return f"{at}, where the answer comes from: no iteration made it much worse."
    return f"{at}, which made it worse than any other."
