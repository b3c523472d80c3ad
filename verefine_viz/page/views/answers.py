"""The gallery of a batch: its answers as cards: message ``answers``."""

from __future__ import annotations

from typing import Any

from verefine_viz.diagnosis.causes import TITLES, Cause
from verefine_viz.page.gallery import Entry, Gallery

Json = dict[str, Any]


def answers_message(gallery: Gallery) -> Json:
    """Return the answers of all runs, and how they can be sorted and filtered."""
    return {
        "t": "answers",
        "outcome": gallery.outcome,
        "doubt": gallery.doubt,
        "notes": gallery.notes,
        "runs": list(gallery.runs),
        "first": dict(gallery.first_arrangement.only),
        "rows": [_row(gallery, key, entry) for key, entry in enumerate(gallery.entries)],
    }


def _row(gallery: Gallery, key: int, entry: Entry) -> Json:
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
        "score": row.score,
        "err": row.add_s_mm,
        "limit": None if row.diameter_mm is None else 0.1 * row.diameter_mm,
        "k": entry.iteration,
        "cause": TITLES[Cause(row.cause)] if row.cause else "",
        "evidence": row.evidence,
        "status": row.status,
        "message": row.message,
        "visible": row.visib_fract,
        "undetermined_mm": row.undetermined_mm,
        "tags": list(gallery.tags_of(entry)),
        "opens": entry.can_be_opened,
        "thumb": row.T_cam_obj is not None,
    }
