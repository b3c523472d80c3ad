"""The gallery of a batch: its answers as cards: message ``answers``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from msgspec import UNSET, UnsetType

from verefine_viz.batch.answer_orders import ORDERS, WITHOUT_TRUTH, Order, sort_key
from verefine_viz.page.gallery_messages import AnswersMessage, CardTone, GalleryOrder, GalleryRow

if TYPE_CHECKING:
    from verefine_viz.page.gallery import Gallery, GalleryEntry


def answers_message(gallery: Gallery, frames: Sequence[str] | UnsetType | None = UNSET) -> AnswersMessage:
    """Return the answers of all runs, and how they can be sorted and filtered.

    Args:
        gallery: of the runs.
        frames: those of the open session now, of a folder that is watched.
    """
    orders = ORDERS if any(entry.row.can_be_right for entry in gallery.entries) else WITHOUT_TRUTH
    return AnswersMessage(
        outcome=gallery.outcome,
        doubt=gallery.doubt,
        notes=gallery.notes,
        runs=list(gallery.runs),
        unfinished=gallery.n_unfinished,
        faults=list(gallery.tag_faults.values()),
        first=gallery.first_filter,
        orders=[GalleryOrder(order, words, _sorted_keys(gallery, order)) for order, words in orders.items()],
        rows=[_row(gallery, key, entry) for key, entry in enumerate(gallery.entries)],
        frames=frames,
    )


def _sorted_keys(gallery: Gallery, order: Order) -> list[int]:
    """Return the keys of all answers in an order."""
    place, entries = sort_key(order), gallery.entries
    return sorted(range(len(entries)), key=lambda key: place(entries[key].row))


def _row(gallery: Gallery, key: int, entry: GalleryEntry) -> GalleryRow:
    row = entry.row
    return GalleryRow(
        key=key,
        run=entry.run,
        frame=row.frame,
        obj=row.instance_id,
        object=row.obj_id,
        name=row.name,
        method=row.method,
        tone=_tone(entry),
        result=entry.result,
        score=row.score,
        err=row.add_s_mm,
        err_seen=row.error_seen_mm,
        limit=None if row.diameter_mm is None else 0.1 * row.diameter_mm,
        k=entry.iteration,
        cause=entry.cause_title,
        evidence=row.evidence,
        status=row.status,
        message=row.message,
        visible=row.visib_fract,
        undetermined_mm=row.undetermined_mm,
        undetermined_deg=row.undetermined_deg,
        ms=row.ms_total,
        tags=gallery.tags_of(entry),
        opens=entry.can_be_opened,
        thumb=row.was_asked_for,
        film=row.status == "ok" and row.n_iterations > 0,
    )


def _tone(entry: GalleryEntry) -> CardTone:
    row = entry.row
    if entry.is_waiting:
        return "waiting"
    if row.status != "ok":
        return "none"
    if row.is_correct is None:
        return "doubt" if row.cause else "unknown"
    return "right" if row.is_correct else "seen" if row.right_seen else "wrong"
