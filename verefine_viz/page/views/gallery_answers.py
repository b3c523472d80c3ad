"""The gallery of a batch: its answers as cards: message ``answers``."""

from __future__ import annotations

from typing import Any

from verefine_viz.batch.index import ORDERS, Order, sort_key
from verefine_viz.diagnosis.causes import cause_title
from verefine_viz.page.gallery import Gallery, GalleryEntry

Json = dict[str, Any]


def answers_message(gallery: Gallery) -> Json:
    """Return the answers of all runs, and how they can be sorted and filtered."""
    return {
        "t": "answers",
        "outcome": gallery.outcome,
        "doubt": gallery.doubt,
        "notes": gallery.notes,
        "runs": list(gallery.runs),
        "unfinished": gallery.n_unfinished,
        "faults": list(gallery.tag_faults.values()),
        "first": gallery.first_filter,
        "orders": [{"id": order, "words": ORDERS[order], "keys": _sorted_keys(gallery, order)} for order in ORDERS],
        "rows": [_row(gallery, key, entry) for key, entry in enumerate(gallery.entries)],
    }


def _sorted_keys(gallery: Gallery, order: Order) -> list[int]:
    """Return the keys of all answers in an order."""
    place, entries = sort_key(order), gallery.entries
    return sorted(range(len(entries)), key=lambda key: place(entries[key].row))


def _row(gallery: Gallery, key: int, entry: GalleryEntry) -> Json:
    row = entry.row
    tone = "waiting" if entry.is_waiting else "none" if row.status != "ok" else (
        "unknown" if row.is_correct is None else "right" if row.is_correct else "wrong"
    )  # fmt: skip
    return {
        "key": key,
        "run": entry.run,
        "frame": row.frame,
        "obj": row.instance_id,
        "object": row.obj_id,
        "name": row.name,
        "method": row.method,
        "tone": tone,
        "result": entry.result,
        "score": row.score,
        "err": row.add_s_mm,
        "limit": None if row.diameter_mm is None else 0.1 * row.diameter_mm,
        "k": entry.iteration,
        "cause": cause_title(row.cause),
        "evidence": row.evidence,
        "status": row.status,
        "message": row.message,
        "visible": row.visib_fract,
        "undetermined_mm": row.undetermined_mm,
        "tags": list(gallery.tags_of(entry)),
        "opens": entry.can_be_opened,
        "thumb": row.was_asked_for,
    }
